//! The scalar values of a scene by their keys, as parameters that a host may change before the start.

use std::ops::RangeInclusive;

use super::material::DampingTime;
use super::value::{Finite, Gradient, NotNegative, NumberOrProfile, Positive, ScalarSignal, Share, Tolerance};
use super::{HeadKind, Scene};
use crate::head::Signal;

/// A scalar value of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct ScalarParameter {
    /// Dotted key, for example `rod.length_m`.
    pub key: String,
    /// The index of the component, if the key has several.
    pub component: Option<usize>,
    /// SI unit, or `1` if dimensionless.
    pub unit: &'static str,
    /// Description.
    pub description: String,
    /// Its value in this scene.
    pub value: f64,
    /// Smallest and largest value.
    pub range: RangeInclusive<f64>,
}

impl ScalarParameter {
    /// The key as written in overrides and sweeps, with the index of its component if it has several: `tendons.0.offset_m`,
    /// `medium.flow_m_s.1`.
    pub fn path(&self) -> String {
        self.component.map_or_else(|| self.key.clone(), |i| format!("{}.{i}", self.key))
    }

    /// The same as a structured name of the FMI standard, with `[0]`, `[1]`, … instead of `.0`, `.1`, ….
    pub fn name(&self) -> String {
        let mut name = String::with_capacity(self.key.len() + 3);
        for part in self.key.split('.') {
            match part.parse::<usize>() {
                Ok(place) => name += &format!("[{place}]"),
                Err(_) if name.is_empty() => name += part,
                Err(_) => name += &format!(".{part}"),
            }
        }
        self.component.map_or(name.clone(), |i| format!("{name}[{i}]"))
    }

    /// True if it may change between steps at an unchanged state, see
    /// [`Stepper::change_parameters`](crate::stepper::Stepper::change_parameters). Drive and medium may change too, as inputs.
    pub fn is_tunable(&self) -> bool {
        self.is_of_material() || self.key == "reactive.shedding" || self.key.starts_with("drag.")
    }

    /// True if it is a stiffness or the damping of the rod.
    pub fn is_of_material(&self) -> bool {
        MATERIAL.contains(&self.key.as_str())
    }
}

/// A quantity of a scene that is given by points along the rod.
#[derive(Debug, Clone, PartialEq)]
pub struct ProfileParameter {
    /// Dotted key, for example `rod.depth_m`.
    pub key: &'static str,
    /// SI unit, or `1` if dimensionless.
    pub unit: &'static str,
    /// Points [ξ, value].
    pub points: Vec<[f64; 2]>,
}

/// The key of the material's damping.
const DAMPING_TIME: &str = "rod.damping_time_s";

/// The keys of the material's stiffness and damping.
pub(crate) const MATERIAL: [&str; 4] =
    ["rod.youngs_modulus_pa", "rod.axial_stiffness_n", "rod.bending_stiffness_n_m2", DAMPING_TIME];

/// A number type with a range.
pub(super) trait Ranged {
    fn number(&self) -> f64;
    fn range() -> RangeInclusive<f64>;
}

macro_rules! ranged {
    ($($name:ident: $range:expr),*) => {
        $(impl Ranged for $name {
            fn number(&self) -> f64 {
                self.get()
            }
            fn range() -> RangeInclusive<f64> {
                $range
            }
        })*
    };
}

ranged!(Positive: f64::MIN_POSITIVE..=f64::INFINITY, NotNegative: 0.0..=f64::INFINITY,
    Tolerance: f64::MIN_POSITIVE..=1.0_f64.next_down(), Share: 0.0..=1.0, Gradient: (-1.0_f64).next_up()..=f64::INFINITY,
    Finite: f64::NEG_INFINITY..=f64::INFINITY);

/// Collects parameters.
#[derive(Default)]
pub(super) struct ParameterList(Vec<ScalarParameter>);

impl ParameterList {
    pub(super) fn add<T: Ranged>(&mut self, key: &str, unit: &'static str, description: &str, value: T) {
        self.push(key, None, unit, description, &value);
    }

    /// Adds a number, if there is one.
    fn given<T: Ranged>(&mut self, key: &str, unit: &'static str, description: &str, value: Option<T>) {
        if let Some(value) = value {
            self.add(key, unit, description, value);
        }
    }

    /// Adds a number, unless it is a profile.
    fn along<T: Ranged + Copy>(
        &mut self,
        key: &str,
        unit: &'static str,
        description: &str,
        value: &NumberOrProfile<T>,
    ) {
        if let Some(value) = value.number() {
            self.add(key, unit, description, value);
        }
    }

    /// The same for an optional value.
    fn optional<T: Ranged + Copy>(
        &mut self,
        key: &str,
        unit: &'static str,
        description: &str,
        value: &Option<NumberOrProfile<T>>,
    ) {
        if let Some(value) = value {
            self.along(key, unit, description, value);
        }
    }

    /// Adds the numbers of a signal except its frequency: that of a constant, within the range of T, or those of a sinusoid.
    fn signal<T: Ranged>(
        &mut self,
        key: &str,
        unit: &'static str,
        description: &str,
        signal: Option<&ScalarSignal>,
        constant: fn(f64) -> T,
    ) {
        match signal.and_then(|ScalarSignal(signal)| signal.formula()) {
            Some(Signal::Constant(value)) => self.add(key, unit, description, constant(*value)),
            Some(Signal::Sinusoid { amplitude, phase, offset, .. }) => {
                for (part, unit, what, value) in [
                    ("amplitude", unit, "amplitude", amplitude),
                    ("phase_rad", "rad", "phase", phase),
                    ("offset", unit, "offset", offset),
                ] {
                    let description = format!("{what} of the {description}");
                    self.add(&format!("{key}.{part}"), unit, &description, Finite::constant(*value));
                }
            }
            _ => {}
        }
    }

    fn pair<T: Ranged>(&mut self, key: &str, unit: &'static str, descriptions: [&str; 2], values: [T; 2]) {
        for (i, (value, description)) in values.iter().zip(descriptions).enumerate() {
            self.push(key, Some(i), unit, description, value);
        }
    }

    fn push<T: Ranged>(
        &mut self,
        key: &str,
        component: Option<usize>,
        unit: &'static str,
        description: &str,
        value: &T,
    ) {
        let (description, value) = (description.to_string(), value.number());
        self.0.push(ScalarParameter { key: key.to_string(), component, unit, description, value, range: T::range() });
    }
}

impl Scene {
    /// The scalar values of this scene. Their set depends only on the tables and kinds of the scene. The number of nodes is
    /// excluded, because it changes the sizes of variables.
    pub fn parameters(&self) -> Vec<ScalarParameter> {
        let mut list = ParameterList::default();
        let rod = &self.rod;
        list.add("rod.length_m", "m", "length of the rod", rod.length_m);
        list.optional("rod.outer_radius_m", "m", "outer radius", &rod.outer_radius_m);
        list.along("rod.inner_radius_m", "m", "inner radius; 0 is a solid rod", &rod.inner_radius_m);
        list.optional("rod.depth_m", "m", "depth across the plane of motion", &rod.depth_m);
        list.given("rod.youngs_modulus_pa", "Pa", "Young's modulus", rod.youngs_modulus_pa);
        list.optional("rod.density_kg_m3", "kg/m^3", "density of the rod", &rod.density_kg_m3);
        list.optional("rod.axial_stiffness_n", "N", "axial stiffness EA", &rod.axial_stiffness_n);
        list.optional("rod.bending_stiffness_n_m2", "N m^2", "bending stiffness EI", &rod.bending_stiffness_n_m2);
        list.optional("rod.mass_per_length_kg_m", "kg/m", "mass per length", &rod.mass_per_length_kg_m);
        if let Some(time) = rod.damping_time_s.as_ref().and_then(DampingTime::number) {
            list.add(DAMPING_TIME, "s", "damping time of the material, eta/E", time);
        } else if let Some([stretch, bending]) = rod.damping_time_s.as_ref().and_then(DampingTime::numbers) {
            list.add("rod.damping_time_s.stretch", "s", "damping time of stretching", stretch);
            list.add("rod.damping_time_s.bending", "s", "damping time of bending", bending);
        }
        list.optional("rod.loss_factor", "1", "loss factor of the material at its frequency", &rod.loss_factor);
        list.given("rod.loss_frequency_hz", "Hz", "frequency of the loss factor", rod.loss_frequency_hz);
        if rod.stiffness_profile.is_none() {
            let gradient = rod.stiffness_gradient.unwrap_or(Gradient::constant(0.0));
            list.add("rod.stiffness_gradient", "1", "a in the bending stiffness EI(1 + a(1 - xi))", gradient);
        }
        if let Some(actuation) = &self.actuation {
            if let Some(amplitude) = actuation.kappa_amp {
                list.add("actuation.kappa_amp", "1", "amplitude, a turning per reference length", amplitude);
                let reference = actuation.kappa_reference_length_m.unwrap_or(Positive::constant(1.0));
                list.add("actuation.kappa_reference_length_m", "m", "reference length of the amplitude", reference);
            }
            list.given(
                "actuation.moment_amp_n_m",
                "N m",
                "amplitude of the active moment of a joint",
                actuation.moment_amp_n_m,
            );
            list.given("actuation.lag_s", "s", "time of the first-order lag of the drive", actuation.lag_s);
            list.given("actuation.largest_1_m", "1/m", "largest natural curvature of the drive", actuation.largest_1_m);
            list.given(
                "actuation.largest_moment_n_m",
                "N m",
                "largest active moment of the drive",
                actuation.largest_moment_n_m,
            );
            list.given("actuation.slope", "1", "largest slope of the sine", actuation.slope);
            list.add("actuation.frequency_hz", "Hz", "frequency of the actuation", actuation.frequency_hz);
            list.given("actuation.wavelength_m", "m", "wavelength of the actuation", actuation.wavelength_m);
            let descriptions = ["e0 of the amplitude e0 + e1 xi along the rod", "e1 of it"];
            list.pair("actuation.envelope", "1", descriptions, actuation.envelope);
            for (i, size) in actuation.harmonics.iter().flatten().enumerate() {
                let description = format!("harmonic {} over the first", i + 2);
                list.push("actuation.harmonics", Some(i), "1", &description, size);
            }
        }
        for (i, tendon) in self.tendons.iter().enumerate() {
            let key = |name: &str| format!("tendons.{i}.{name}");
            let offset = format!("distance of tendon {} from the centreline, to the left", i + 1);
            list.add(&key("offset_m"), "m", &offset, tendon.offset_m);
            let of = |what: &str| format!("{what} of tendon {}", i + 1);
            let (tension, length) = (tendon.tension_n.as_ref(), tendon.length_m.as_ref());
            list.signal(&key("tension_n"), "N", &of("tension"), tension, NotNegative::constant);
            list.given(&key("stiffness_n_m"), "N/m", &of("stiffness"), tendon.stiffness_n_m);
            list.signal(&key("length_m"), "m", &of("length that the winch gives"), length, Finite::constant);
            list.given(&key("take_up_m"), "m", &of("stretch that takes up the slack"), tendon.take_up_m);
        }
        let head = &self.head;
        let stiffness = "stiffness of the servo of the hinged head";
        list.given("head.stiffness_n_m", "N m/rad", stiffness, head.stiffness_n_m);
        let damping = "damping of the bearing of the hinged head";
        list.given("head.damping_n_m_s", "N m s/rad", damping, head.damping_n_m_s);
        let inertia = "inertia of what turns with the hinged head";
        list.given("head.inertia_kg_m2", "kg m^2", inertia, head.inertia_kg_m2);
        if head.kind == HeadKind::Hinged {
            let (torque, angle) = (head.torque_n_m.as_ref(), head.angle_rad.as_ref());
            list.signal("head.torque_n_m", "N m", "torque of the motor of the hinged head", torque, Finite::constant);
            list.signal("head.angle_rad", "rad", "commanded angle of the hinged head", angle, Finite::constant);
        }
        list.given("head.largest_torque_n_m", "N m", "largest torque of the motor", head.largest_torque_n_m);
        list.given("start.ramp_s", "s", "duration of the ramp", self.start.ramp_s);
        if let Some(medium) = &self.medium {
            list.add("medium.viscosity_pa_s", "Pa s", "dynamic viscosity of the medium", medium.viscosity_pa_s);
            list.add("medium.density_kg_m3", "kg/m^3", "density of the medium", medium.density_kg_m3);
            let descriptions = ["background velocity of the medium, x", "background velocity of the medium, y"];
            if let Some(flow) = medium.steady_flow() {
                list.pair("medium.flow_m_s", "m/s", descriptions, flow.map(Finite::constant));
            }
            if let Some(beyond) = &medium.beyond {
                list.add("medium.beyond.offset_m", "m", "where the interface is along its normal", beyond.offset_m);
                list.add("medium.beyond.thickness_m", "m", "thickness of the interface", beyond.thickness_m);
                list.add("medium.beyond.viscosity_pa_s", "Pa s", "dynamic viscosity beyond", beyond.viscosity_pa_s);
                list.add("medium.beyond.density_kg_m3", "kg/m^3", "density beyond", beyond.density_kg_m3);
            }
            if let Some(shear) = &medium.shear {
                list.add("medium.shear.rate_per_s", "1/s", "shear rate of the flow", shear.rate_per_s);
            }
        }
        if let Some(drag) = &self.drag {
            let numbers = [
                ("drag.slender_length_m", "m", "length in the logarithm of the drag", drag.slender_length_m),
                ("drag.ratio", "1", "drag across the rod over drag along it", drag.ratio),
                ("drag.height_m", "m", "height above the wall", drag.height_m),
            ];
            for (key, unit, description, value) in numbers {
                list.given(key, unit, description, value);
            }
            let profiles = [
                ("drag.along_n_s_m2", "drag along the rod per length and speed", &drag.along_n_s_m2),
                ("drag.across_n_s_m2", "drag across the rod per length and speed", &drag.across_n_s_m2),
            ];
            for (key, description, value) in profiles {
                if let Some(value) = value {
                    list.along(key, "N s/m^2", description, value);
                }
            }
            let factors = [
                ("drag.form_drag", "form drag", drag.form_drag),
                ("drag.thinning", "thinning of the boundary layer by cross-flow", drag.thinning),
                ("drag.skin_friction", "factor of the boundary layer's friction", drag.skin_friction),
                ("drag.turbulent_friction", "coefficient of turbulent friction", drag.turbulent_friction),
            ];
            for (key, description, value) in factors {
                list.given(key, "1", description, value);
            }
            if let (Some(weight), Some(length)) = (drag.head_weight, drag.head_length_m) {
                list.add("drag.head_weight", "1", "weight of the drag on the head", weight);
                list.add("drag.head_length_m", "m", "arc length up to which that weight holds", length);
            }
        }
        if let Some(reactive) = self.reactive.as_ref().filter(|reactive| !reactive.auto) {
            list.add("reactive.shedding", "1", "share of the theory's wake that leaves the tail", reactive.shedding);
        }
        self.body_parameters(&mut list);
        if let Some(gravity) = self.loads.as_ref().and_then(|loads| loads.gravity_m_s2) {
            list.pair("loads.gravity_m_s2", "m/s^2", ["gravity, x", "gravity, y"], gravity);
        }
        list.given("solver.time_step_s", "s", "largest internal step", self.solver.time_step_s);
        list.given("solver.tolerance", "1", "largest estimated error of an internal step", self.solver.tolerance);
        list.add(
            "solver.newton_tolerance",
            "1",
            "largest last increment of Newton's method over the length",
            Tolerance::constant(self.newton_tolerance()),
        );
        if let Ok((method, values)) = self.method() {
            for (parameter, value) in method.parameters.iter().zip(values) {
                list.0.push(ScalarParameter {
                    key: format!("solver.{}", parameter.name),
                    component: None,
                    unit: "1",
                    description: format!("{} of the method {}", parameter.name, method.name),
                    value,
                    range: parameter.range[0]..=parameter.range[1],
                });
            }
        }
        list.0
    }

    /// The reason why a key of the scene is not one of its [`parameters`](Self::parameters): a function of time is not a number.
    pub fn not_a_number(&self, key: &str) -> Option<String> {
        let parts: Vec<&str> = key.split('.').collect();
        let signal = match parts[..] {
            ["tendons", place, "tension_n", ..] => self.tendons.get(place.parse::<usize>().ok()?)?.tension_n.as_ref(),
            ["tendons", place, "length_m", ..] => self.tendons.get(place.parse::<usize>().ok()?)?.length_m.as_ref(),
            ["head", "torque_n_m", ..] => self.head.torque_n_m.as_ref(),
            ["head", "angle_rad", ..] => self.head.angle_rad.as_ref(),
            _ => None,
        };
        let ScalarSignal(signal) = signal?;
        let given = parts.iter().take(if parts[0] == "tendons" { 3 } else { 2 }).copied().collect::<Vec<_>>().join(".");
        match (parts[0], self.head.kind, signal.formula()) {
            ("head", HeadKind::Driven, _) => Some(format!("{given} moves the head and has no derivative yet")),
            (_, _, Some(Signal::Sinusoid { .. })) => {
                Some(format!("{given} changes in time; there are derivatives by its amplitude, phase_rad and offset"))
            }
            (_, _, None) => Some(format!("{given} is a table, and has no derivative")),
            _ => None,
        }
    }

    /// The key or table by which this scene differs from `other` in more than tunable parameters, if any. Names, folders,
    /// durations and recording are ignored.
    pub fn differs_beyond_tuning(&self, other: &Self) -> Option<String> {
        let parameters = other.parameters();
        let fixed = self.parameters().into_iter().filter(|parameter| !parameter.is_tunable());
        for parameter in fixed {
            let of_other = parameters.iter().find(|of_other| of_other.name() == parameter.name());
            if of_other.is_some_and(|of_other| of_other.value != parameter.value) {
                return Some(parameter.name());
            }
        }
        let [a, b] = [self, other].map(|scene| {
            let mut scene = scene.clone();
            scene.set_tunable(Positive::constant(1.0));
            scene.solver.duration_s = Positive::constant(1.0);
            scene
        });
        let tables = [
            ("rod.nodes", a.rod.nodes == b.rod.nodes),
            ("rod", a.rod == b.rod),
            ("actuation", a.actuation == b.actuation),
            ("tendons", a.tendons == b.tendons && a.contents == b.contents),
            ("start", a.start == b.start),
            ("medium", a.medium == b.medium),
            ("drag", a.drag == b.drag),
            ("reactive", a.reactive == b.reactive),
            ("head_body", a.head_body == b.head_body),
            ("loads", a.loads == b.loads),
            ("head", a.head == b.head && a.contents == b.contents),
            ("solver", a.solver == b.solver),
        ];
        tables.iter().find(|(_, same)| !same).map(|(table, _)| table.to_string())
    }

    /// Sets every given [tunable](ScalarParameter::is_tunable) value to `one`, and also the factors of drag that have defaults.
    fn set_tunable(&mut self, one: Positive) {
        fn set<T>(value: &mut Option<T>, one: T) {
            if value.is_some() {
                *value = Some(one);
            }
        }
        set(&mut self.rod.youngs_modulus_pa, one);
        for stiffness in [&mut self.rod.axial_stiffness_n, &mut self.rod.bending_stiffness_n_m2] {
            if stiffness.as_ref().is_some_and(|stiffness| stiffness.number().is_some()) {
                *stiffness = Some(NumberOrProfile::<Positive>::constant(1.0));
            }
        }
        let factor = NotNegative::constant(1.0);
        if self.rod.damping_time_s.as_ref().is_some_and(|time| time.number().is_some()) {
            self.rod.damping_time_s = Some(DampingTime::constant(1.0));
        }
        if let Some(drag) = &mut self.drag {
            for value in [&mut drag.ratio, &mut drag.slender_length_m, &mut drag.height_m, &mut drag.head_length_m] {
                set(value, one);
            }
            for value in [&mut drag.along_n_s_m2, &mut drag.across_n_s_m2] {
                if value.as_ref().is_some_and(|value| value.number().is_some()) {
                    *value = Some(NumberOrProfile::<NotNegative>::constant(1.0));
                }
            }
            let factors = [
                &mut drag.form_drag,
                &mut drag.thinning,
                &mut drag.skin_friction,
                &mut drag.turbulent_friction,
                &mut drag.head_weight,
            ];
            // They have defaults if they are not given.
            factors.into_iter().for_each(|value| *value = Some(factor));
        }
        if let Some(reactive) = &mut self.reactive {
            reactive.shedding = Share::constant(1.0);
        }
    }

    /// The profiles of this scene, except phases and factors of the stiffness.
    pub fn profiles(&self) -> Vec<ProfileParameter> {
        fn points<T: Copy>(along: &NumberOrProfile<T>) -> Option<Vec<[f64; 2]>> {
            along.points().map(<[_]>::to_vec)
        }
        let (rod, drag) = (&self.rod, self.drag.as_ref());
        let factors = self.actuation.as_ref().and_then(|actuation| actuation.amplitude_profile.as_ref());
        let amplitude = factors.map(|points| points.iter().map(|point| point.map(NotNegative::get)).collect());
        [
            ("rod.outer_radius_m", "m", rod.outer_radius_m.as_ref().and_then(points)),
            ("rod.inner_radius_m", "m", points(&rod.inner_radius_m)),
            ("rod.depth_m", "m", rod.depth_m.as_ref().and_then(points)),
            ("rod.density_kg_m3", "kg/m^3", rod.density_kg_m3.as_ref().and_then(points)),
            ("rod.axial_stiffness_n", "N", rod.axial_stiffness_n.as_ref().and_then(points)),
            ("rod.bending_stiffness_n_m2", "N m^2", rod.bending_stiffness_n_m2.as_ref().and_then(points)),
            ("rod.mass_per_length_kg_m", "kg/m", rod.mass_per_length_kg_m.as_ref().and_then(points)),
            ("rod.mass_profile", "1", rod.mass_profile.as_ref().and_then(points)),
            (DAMPING_TIME, "s", rod.damping_time_s.as_ref().and_then(DampingTime::points).map(<[_]>::to_vec)),
            ("rod.loss_factor", "1", rod.loss_factor.as_ref().and_then(points)),
            ("actuation.amplitude_profile", "1", amplitude),
            ("drag.along_n_s_m2", "N s/m^2", drag.and_then(|drag| drag.along_n_s_m2.as_ref()).and_then(points)),
            ("drag.across_n_s_m2", "N s/m^2", drag.and_then(|drag| drag.across_n_s_m2.as_ref()).and_then(points)),
        ]
        .into_iter()
        .filter_map(|(key, unit, points)| Some(ProfileParameter { key, unit, points: points? }))
        .collect()
    }
}

/// The overrides ([`Document::set`](super::Document::set)) that change the values of `parameters` to `values`.
pub fn overrides(parameters: &[ScalarParameter], values: &[f64]) -> Vec<String> {
    let all: Vec<(&ScalarParameter, f64)> = parameters.iter().zip(values.iter().copied()).collect();
    let mut overrides = Vec::new();
    for (i, (parameter, value)) in all.iter().enumerate() {
        match parameter.component {
            None if *value != parameter.value => overrides.push(format!("{}={value:e}", parameter.key)),
            Some(0) => {
                let further =
                    all[i + 1..].iter().take_while(|(parameter, _)| parameter.component.is_some_and(|i| i > 0));
                let together = &all[i..=i + further.count()];
                if together.iter().any(|(parameter, value)| *value != parameter.value) {
                    let texts: Vec<String> = together.iter().map(|(_, value)| format!("{value:e}")).collect();
                    overrides.push(format!("{}=[{}]", parameter.key, texts.join(",")));
                }
            }
            _ => {}
        }
    }
    overrides
}
