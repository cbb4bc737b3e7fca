//! `[rod]`: mesh, cross-sections and material.

use std::f64::consts::PI;
use std::ops::RangeInclusive;

use serde::Deserialize;

use super::key_error::KeyError;
use super::material::DampingTime;
use super::value::{self, BoundedInteger, Gradient, NotNegative, NumberOrProfile, Positive};
use super::{HeadKind, NODES, Scene};
use crate::rod::{DampedRate, MassLumping, Material, Measured, Profile, Rod, Section, Sections, Shape, Stiffness};

/// `[rod]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RodTable {
    /// Number of nodes. A `[head_body]` adds one.
    pub nodes: BoundedInteger<{ NODES[0] }, { NODES[1] }>,
    /// Length of the rod, m.
    pub length_m: Positive,
    /// Shape of the cross-section. By default, `ellipse` if `depth_m` is given and `round` otherwise. A `round` section whose
    /// depth differs from the diameter is a round core with a thin membrane, which only affects the forces of the fluid.
    pub section: Option<Shape>,
    /// Outer radius, or half the thickness in the plane of motion, m.
    ///
    /// It may be omitted if measured stiffness and mass are given and no force of a fluid requires it; the rod then counts as
    /// round, with the radius 2√(EI/EA).
    pub outer_radius_m: Option<NumberOrProfile<Positive>>,
    /// Inner radius, or half the thickness of a hole of the same shape, m. By default 0: a solid rod.
    #[serde(default = "solid")]
    pub inner_radius_m: NumberOrProfile<NotNegative>,
    /// Depth perpendicular to the plane of motion, m. By default, twice the outer radius.
    pub depth_m: Option<NumberOrProfile<NotNegative>>,
    /// Young's modulus, Pa. Without it, the stiffness is given by `axial_stiffness_n` and `bending_stiffness_n_m2`.
    pub youngs_modulus_pa: Option<Positive>,
    /// Density of the material, kg/m³. Without it, the mass is given by `mass_per_length_kg_m`.
    pub density_kg_m3: Option<NumberOrProfile<Positive>>,
    /// Measured axial stiffness EA, N, instead of Young's modulus times the area.
    pub axial_stiffness_n: Option<NumberOrProfile<Positive>>,
    /// Measured bending stiffness EI, N m², instead of Young's modulus times the second moment of area.
    pub bending_stiffness_n_m2: Option<NumberOrProfile<Positive>>,
    /// Measured mass per length, kg/m, instead of density times the area.
    pub mass_per_length_kg_m: Option<NumberOrProfile<Positive>>,
    /// Factor of the mass along the rod.
    pub mass_profile: Option<NumberOrProfile<NotNegative>>,
    /// Linear taper of the stiffness: a in EI(1 + a(1 − ξ)). By default 0.
    pub stiffness_gradient: Option<Gradient>,
    /// Factor of EI along the rod, as points [ξ, factor]: linear between them, constant beyond.
    #[serde(default, deserialize_with = "value::optional_pairs")]
    pub stiffness_profile: Option<Vec<[NotNegative; 2]>>,
    /// Kelvin-Voigt damping: the time τ = η/E, s, in the moment EI (κ + τ dκ/dt) and the tension EA (ε + τ dε/dt), as a number, as
    /// points [ξ, τ], or as { stretch, bending }.
    pub damping_time_s: Option<DampingTime>,
    /// Loss factor tan δ of the material at `loss_frequency_hz`, instead of `damping_time_s`: τ = tan δ/(2πf).
    pub loss_factor: Option<NumberOrProfile<NotNegative>>,
    /// Frequency of the loss factor, Hz. By default, that of the actuation or of the head's motion.
    pub loss_frequency_hz: Option<Positive>,
    /// The rate of curvature that is damped. By default `whole`, for passive material parallel to the drive of the rod; `elastic`
    /// excludes the rate of the natural curvature.
    pub damping_of: Option<DampedRate>,
    /// How the mass of an edge is lumped at nodes. By default `tributary`.
    #[serde(default)]
    pub mass_lumping: MassLumping,
}

/// The range of masses, lengths and stiffnesses of a rod in SI units, so that products of a few of them are finite.
pub(super) const SIZES: RangeInclusive<f64> = 1e-100..=1e100;

fn solid() -> NumberOrProfile<NotNegative> {
    NumberOrProfile::<NotNegative>::constant(0.0)
}

impl RodTable {
    /// Checks profiles.
    pub(super) fn check(&self) -> Result<(), KeyError> {
        self.check_measured()?;
        self.check_sections()?;
        self.check_damping()?;
        let Some(profile) = &self.stiffness_profile else { return Ok(()) };
        let key = "rod.stiffness_profile";
        if self.stiffness_gradient.is_some() {
            let problem = "found together with stiffness_gradient; allowed: one of the two".into();
            return Err(KeyError { key: key.into(), problem });
        }
        let allowed = "points [xi, factor] with rising xi from 0 to 1 and positive factors";
        check_points(key, profile.iter().map(|point| point.map(NotNegative::get)), allowed, |factor| factor > 0.0)
    }

    /// The shape of its cross-section.
    pub fn shape(&self) -> Shape {
        self.section.unwrap_or(if self.depth_m.is_some() { Shape::Ellipse } else { Shape::Round })
    }

    fn sections(&self) -> Sections {
        let outer =
            self.outer_radius_m.as_ref().map_or_else(|| self.equivalent_radius().into(), NumberOrProfile::profile);
        let measured = Measured {
            axial: self.axial_stiffness_n.as_ref().map(NumberOrProfile::profile),
            bending: self.bending_stiffness_n_m2.as_ref().map(NumberOrProfile::profile),
            mass: self.mass_per_length_kg_m.as_ref().map(NumberOrProfile::profile),
        };
        let mean_density = || {
            let mass = measured.mass.as_ref().map_or(1.0, |mass| mass.at(0.5));
            mass / (PI * outer.at(0.5).powi(2))
        };
        Sections {
            shape: self.shape(),
            density: self.density_kg_m3.as_ref().map_or_else(|| mean_density().into(), NumberOrProfile::profile),
            outer,
            inner: self.inner_radius_m.profile(),
            depth: self.depth_m.as_ref().map(NumberOrProfile::profile),
            measured,
            mass_factor: self.mass_profile.as_ref().map_or(1.0.into(), NumberOrProfile::profile),
        }
    }

    /// Checks profiles and the thickness of the wall.
    fn check_sections(&self) -> Result<(), KeyError> {
        let fault = |key: &str, problem: String| Err(KeyError { key: format!("rod.{key}"), problem });
        fn of<T: Copy>(value: &Option<NumberOrProfile<T>>) -> Option<String> {
            value.as_ref().and_then(NumberOrProfile::disorder)
        }
        let disorders = [
            ("outer_radius_m", of(&self.outer_radius_m)),
            ("inner_radius_m", self.inner_radius_m.disorder()),
            ("depth_m", of(&self.depth_m)),
            ("density_kg_m3", of(&self.density_kg_m3)),
            ("axial_stiffness_n", of(&self.axial_stiffness_n)),
            ("bending_stiffness_n_m2", of(&self.bending_stiffness_n_m2)),
            ("mass_per_length_kg_m", of(&self.mass_per_length_kg_m)),
            ("mass_profile", of(&self.mass_profile)),
        ];
        for (key, disorder) in disorders {
            if let Some(found) = disorder {
                return fault(key, value::refused(found, "points [xi, number] with rising xi from 0 to 1"));
            }
        }
        let sections = self.sections();
        // Both are linear in between, so it suffices to check their points.
        for xi in sections.outer.places().chain(sections.inner.places()) {
            let section = sections.at(xi);
            if section.inner >= section.outer {
                let at = if sections.outer.is_even() && sections.inner.is_even() {
                    String::new()
                } else {
                    format!(" at xi = {xi}")
                };
                let allowed = format!("from 0 to below outer_radius_m = {}{at}", section.outer);
                return fault("inner_radius_m", value::refused(section.inner, allowed));
            }
        }
        if let Some(depth) = &sections.depth {
            // Outside its points a profile is constant, so a 0 at xi = 0 or 1 occurs at an end only.
            let inside = |xi: &f64| depth.is_even() || (*xi > 0.0 && *xi < 1.0);
            if let Some(xi) = depth.places().filter(inside).find(|xi| depth.at(*xi) <= 0.0) {
                let at = if depth.is_even() { "no depth".to_string() } else { format!("no depth at xi = {xi}") };
                return fault("depth_m", value::refused(at, "a positive depth, 0 at the ends only"));
            }
            // A fin may vanish at an end.
            let is_hidden = |xi: &f64| depth.at(*xi) < 2.0 * sections.outer.at(*xi) * (1.0 - 1e-9);
            let places = depth.places().chain(sections.outer.places()).filter(inside);
            if sections.shape == Shape::Round
                && let Some(xi) = places.into_iter().find(is_hidden)
            {
                let found =
                    format!("{} at xi = {xi}, less than the core's {}", depth.at(xi), 2.0 * sections.outer.at(xi));
                let allowed = "a membrane that is deeper than its core, or section = \"ellipse\"";
                return fault("depth_m", value::refused(found, allowed));
            }
        }
        if self.mass_profile.is_some() && sections.mass_factor.at(0.5) <= 0.0 {
            return fault("mass_profile", value::refused("no mass in the middle", "positive factors"));
        }
        Ok(())
    }

    /// Checks that all masses and stiffnesses of the rod are positive and finite.
    pub(super) fn check_sizes(&self, held_head: bool) -> Result<(), KeyError> {
        let (sections, stiffness) = (self.sections(), self.stiffness());
        let part = 1.0 / (self.nodes.get() - 1) as f64;
        let (spacing, youngs) = (self.length_m.get() * part, self.youngs_modulus());
        // The first and the last position at which nodes, edges and joints are evaluated, because profiles may vanish beyond
        // them.
        let nodes = match self.mass_lumping {
            MassLumping::Uniform => [0.0, 1.0],
            MassLumping::Tributary => [0.25 * part, 1.0 - 0.25 * part],
        };
        let edges = [0.5 * part, 1.0 - 0.5 * part];
        let joints = [if held_head { 0.0 } else { part }, 1.0 - part];
        // Products of positive piecewise linear functions are smallest at a point of one of them.
        let stiffer = self.stiffness_profile.iter().flatten().map(|[xi, _]| xi.get());
        let places = sections.profiles().flat_map(Profile::places).chain(stiffer).chain([0.0, 1.0]);
        let even = sections.profiles().all(Profile::is_even);
        for place in places {
            let at = |[first, last]: [f64; 2]| place.clamp(first, last);
            let (inertia, mass) = (sections.at(at(joints)).inertia(), sections.line_density(at(nodes)) * spacing);
            let bending = sections.bending_stiffness(youngs, at(joints)) * stiffness.factor(at(joints)) / spacing;
            let stretching = sections.axial_stiffness_at(youngs, at(edges)) / spacing;
            // The second moment vanishes with either dimension; if the depth vanishes, that is the key to change.
            let (side, size) = match sections.at(at(joints)) {
                section if section.depth < section.outer && section.shape != Shape::Round => ("depth_m", section.depth),
                _ => ("outer_radius_m", sections.outer.at(place)),
            };
            let sizes = [
                (side, size, "second moment of area", inertia, "m^4"),
                ("length_m", self.length_m.get(), "spacing of the nodes", spacing, "m"),
                ("density_kg_m3", sections.density.at(place), "mass per node", mass, "kg"),
                ("youngs_modulus_pa", youngs, "stiffness of a joint", bending, "N m"),
                ("youngs_modulus_pa", youngs, "stiffness of an edge", stretching, "N/m"),
            ];
            for (key, found, what, size, unit) in sizes {
                if !SIZES.contains(&size) {
                    let [low, high] = [SIZES.start(), SIZES.end()];
                    let at = if even { String::new() } else { format!(" at xi = {place}") };
                    let found = format_args!("{found:e}, which makes the {what} {size:e} {unit}{at}");
                    let allowed = format_args!("what makes it {low:e} to {high:e} {unit}");
                    return Err(KeyError { key: format!("rod.{key}"), problem: value::refused(found, allowed) });
                }
            }
        }
        Ok(())
    }

    /// The bending stiffness along the rod.
    fn stiffness(&self) -> Stiffness {
        match (&self.stiffness_profile, self.stiffness_gradient) {
            (Some(points), _) => {
                let points = points.iter().map(|point| point.map(NotNegative::get)).collect();
                Profile::through(points).map_or(Stiffness::Gradient(0.0), Stiffness::Profile)
            }
            (None, gradient) => Stiffness::Gradient(gradient.unwrap_or(Gradient::constant(0.0)).get()),
        }
    }
}

impl RodTable {
    /// Young's modulus, Pa; for a rod of measured stiffness, that of a material with the same bending stiffness in the middle.
    pub fn youngs_modulus(&self) -> f64 {
        let measured = || {
            let bending = self.bending_stiffness_n_m2.as_ref().map_or(1.0, |bending| bending.profile().at(0.5));
            let radius = self.outer_radius_m.as_ref().map(|outer| outer.profile().at(0.5));
            bending / Section::round(radius.unwrap_or_else(|| self.equivalent_radius()), 0.0).inertia()
        };
        self.youngs_modulus_pa.map_or_else(measured, Positive::get)
    }

    /// The radius (m) of the solid round section whose EI is R²/4 times its EA, in the middle of the rod.
    pub(super) fn equivalent_radius(&self) -> f64 {
        let middle = |value: &Option<NumberOrProfile<Positive>>| value.as_ref().map(|value| value.profile().at(0.5));
        let stiffness = middle(&self.bending_stiffness_n_m2).zip(middle(&self.axial_stiffness_n));
        stiffness.map_or(1.0, |(bending, axial)| 2.0 * (bending / axial).sqrt())
    }

    /// Returns an error for a rod without radius if any of `asks`, each with its name, needs the radius.
    pub(super) fn ask_for_radius<const N: usize>(&self, asks: [(&str, bool); N]) -> Result<(), KeyError> {
        match asks.into_iter().find(|(_, found)| self.outer_radius_m.is_none() && *found) {
            Some((what, _)) => {
                let problem =
                    format!("missing; {what} needs it; allowed: a positive number, or points [[xi, number], …]");
                Err(KeyError { key: "rod.outer_radius_m".into(), problem })
            }
            None => Ok(()),
        }
    }

    /// Checks that stiffness and mass are given exactly once each.
    pub(super) fn check_measured(&self) -> Result<(), KeyError> {
        let fault =
            |key: &str, problem: &str| Err(KeyError { key: format!("rod.{key}"), problem: problem.to_string() });
        let [axial, bending] = [self.axial_stiffness_n.is_some(), self.bending_stiffness_n_m2.is_some()];
        match (self.youngs_modulus_pa.is_some(), axial && bending) {
            (true, true) => {
                return fault(
                    "youngs_modulus_pa",
                    "found together with axial_stiffness_n and bending_stiffness_n_m2; allowed: with only one of them, to give the other",
                );
            }
            (false, false) if bending => {
                return fault(
                    "axial_stiffness_n",
                    "missing with bending_stiffness_n_m2; allowed: a positive number, or youngs_modulus_pa in its place; if it was not measured, that of a solid strip is 12 times the bending stiffness over the square of the thickness, and it hardly affects a slender tail",
                );
            }
            (false, false) => {
                return fault(
                    "youngs_modulus_pa",
                    "missing; allowed: a positive number, or axial_stiffness_n and bending_stiffness_n_m2 in its place",
                );
            }
            _ => {}
        }
        match (self.density_kg_m3.is_some(), self.mass_per_length_kg_m.is_some()) {
            (true, true) => {
                return fault("mass_per_length_kg_m", "found together with density_kg_m3; allowed: one of the two");
            }
            (false, false) => {
                return fault(
                    "density_kg_m3",
                    "missing; allowed: a positive number, or mass_per_length_kg_m in its place",
                );
            }
            _ => {}
        }
        let asks = [
            ("youngs_modulus_pa", self.youngs_modulus_pa.is_some()),
            ("density_kg_m3", self.density_kg_m3.is_some()),
            ("section", self.section.is_some()),
            ("depth_m", self.depth_m.is_some()),
            ("inner_radius_m", self.inner_radius_m.number().is_none_or(|radius| radius.get() > 0.0)),
        ];
        self.ask_for_radius(asks)
    }

    /// Checks the keys of the damping against each other.
    pub(super) fn check_damping(&self) -> Result<(), KeyError> {
        let fault = |key: &str, problem: String| Err(KeyError { key: format!("rod.{key}"), problem });
        let allowed = "points [xi, number] with rising xi from 0 to 1";
        let times = self.damping_time_s.iter().flat_map(|time| [&time.stretch, &time.bending]);
        if let Some(found) = times.into_iter().find_map(NumberOrProfile::disorder) {
            return fault("damping_time_s", value::refused(found, allowed));
        }
        if let Some(found) = self.loss_factor.as_ref().and_then(NumberOrProfile::disorder) {
            return fault("loss_factor", value::refused(found, allowed));
        }
        let damped = self.damping_time_s.is_some() || self.loss_factor.is_some();
        let faults = [
            (
                "loss_factor",
                self.loss_factor.is_some() && self.damping_time_s.is_some(),
                "found together with damping_time_s; allowed: one of the two",
            ),
            (
                "loss_frequency_hz",
                self.loss_frequency_hz.is_some() && self.loss_factor.is_none(),
                "found without loss_factor; allowed: only with it",
            ),
            (
                "damping_of",
                self.damping_of.is_some() && !damped,
                "found without damping_time_s and loss_factor; allowed: with one of the two",
            ),
        ];
        match faults.into_iter().find(|(_, found, _)| *found) {
            Some((key, _, problem)) => fault(key, problem.to_string()),
            None => Ok(()),
        }
    }
}

/// Checks that the ξ of a profile rise from 0 to 1, and that its values are `ok`.
pub(super) fn check_points(
    key: &str,
    points: impl Iterator<Item = [f64; 2]>,
    allowed: &str,
    ok: impl Fn(f64) -> bool,
) -> Result<(), KeyError> {
    let fault = |found: String| Err(KeyError { key: key.to_string(), problem: value::refused(found, allowed) });
    let mut last = None;
    for [xi, value] in points {
        let after = last.filter(|last| xi <= *last);
        if after.is_some() || !(0.0..=1.0).contains(&xi) || !ok(value) {
            let after = after.map_or(String::new(), |last| format!(" after {last}"));
            return fault(format!("the point [{xi}, {value}]{after}"));
        }
        last = Some(xi);
    }
    if last.is_none() { fault("no points".to_string()) } else { Ok(()) }
}

impl Scene {
    /// Its rod on a mesh of `nodes` nodes, behind its body.
    pub(crate) fn rod_on(&self, nodes: usize) -> Rod {
        let table = &self.rod;
        let material = Material {
            sections: table.sections(),
            youngs: table.youngs_modulus(),
            stiffness: table.stiffness(),
            damping: self.damping(),
        };
        let held = self.head.kind != HeadKind::Free;
        self.behind_body(Rod::new(nodes, table.length_m.get(), &material, table.mass_lumping, held))
    }
}
