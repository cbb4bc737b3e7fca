//! `[medium]`, `[drag]` and `[reactive]`: the fluid of a scene, its drag law and its added mass.

use std::fmt;
use std::sync::Arc;

use nalgebra::Vector2;
use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};

use super::key_error::KeyError;
use super::keys_by_choice::KeysByChoice;
use super::layers::{LayerTable, ShearTable};
use super::solver::FormKey;
use super::value::{self, NotNegative, NumberOrProfile, Positive, SignalValue, VectorSignal};
use super::{HeadKind, LoadsTable, NODES, Scene};
use crate::error::{Result as Read, nearest};
use crate::fluid::laws::{
    self, Dependence, DragLaw, ForcesByCause, LAWS, LawInputs, MIN_LOG_SLENDERNESS, SectionInput,
};
use crate::fluid::reactive::{self, Wake};
use crate::fluid::uncertainty::Uncertainty;
use crate::fluid::validity::{FlowConditions, TransverseMotion};
use crate::fluid::warnings;
use crate::fluid::{Buoyancy, Fluid, Force, Forces, FroudeKrylov, HeadWeight, Reactive, Spray};
use crate::head::Signal;
use crate::model::bending;
use crate::reduced::fluid_estimates::{ShortRun, ShortRunResult, nodes, simulate};
use crate::reduced::{FluidChoice, FluidEstimates, MotionAndPower};
use crate::regime::Regime;
use crate::rod::{Rod, Shape};
use crate::spectrum::{Spectrum, SpectrumPurpose};

/// `[medium]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct MediumTable {
    /// Dynamic viscosity, Pa s.
    pub viscosity_pa_s: Positive,
    /// Density, kg/m³. It enters added mass, quadratic drag, buoyancy and the Reynolds number.
    pub density_kg_m3: Positive,
    /// Velocity of the uniform background flow, m/s. By default [0, 0].
    #[serde(default = "still")]
    pub flow_m_s: VectorSignal,
    /// A second fluid beyond an interface.
    pub beyond: Option<LayerTable>,
    /// Several fluids beyond parallel interfaces, in order.
    #[serde(default)]
    pub layers: Vec<LayerTable>,
    /// A linear shear flow.
    pub shear: Option<ShearTable>,
}

fn still() -> VectorSignal {
    VectorSignal([0.0; 2].map(|still| SignalValue::Formula(Signal::Constant(still))))
}

impl MediumTable {
    /// The fluid, with the flow at time zero.
    fn fluid(&self, flow: &[Signal; 2]) -> Fluid {
        let [x, y] = flow.each_ref().map(|signal| signal.at(0.0));
        Fluid {
            viscosity: self.viscosity_pa_s.get(),
            density: self.density_kg_m3.get(),
            flow: Vector2::new(x.value, y.value),
            acceleration: Vector2::new(x.rate, y.rate),
        }
    }

    /// The velocity of the flow if it is steady, m/s.
    pub(super) fn steady_flow(&self) -> Option<[f64; 2]> {
        match &self.flow_m_s.0 {
            [SignalValue::Formula(Signal::Constant(x)), SignalValue::Formula(Signal::Constant(y))] => Some([*x, *y]),
            _ => None,
        }
    }
}

/// `[drag]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct DragTable {
    /// The drag law. By default `cox`, or `stokes-like` if `ratio` is given.
    pub law: Option<String>,
    /// Ratio of the normal to the tangential drag coefficient, for `stokes-like`.
    pub ratio: Option<Positive>,
    /// Length in the logarithm of slender-body laws, m. By default, the shorter of rod and wavelength.
    pub slender_length_m: Option<Positive>,
    /// Tangential drag coefficient for `coefficients`, N s/m².
    pub along_n_s_m2: Option<NumberOrProfile<NotNegative>>,
    /// Normal drag coefficient for `coefficients`, N s/m².
    pub across_n_s_m2: Option<NumberOrProfile<NotNegative>>,
    /// Height above a wall, m, for `wall` and `nonlocal`.
    pub height_m: Option<Positive>,
    /// The law of the viscous part, for `cross-flow`. By default `cox`.
    pub viscous: Option<String>,
    /// Form drag coefficient C_d, for `cross-flow`. By default, that of the cross-section.
    pub form_drag: Option<NotNegative>,
    /// Coefficient τ by which cross-flow thins the boundary layer along the rod, for `cross-flow`. By default, that of the
    /// cross-section.
    pub thinning: Option<NotNegative>,
    /// Factor of the laminar skin friction, for `cross-flow`. By default 3.5.
    pub skin_friction: Option<NotNegative>,
    /// Turbulent skin friction coefficient C_f, for `cross-flow`. By default 0.
    pub turbulent_friction: Option<NotNegative>,
    /// Factor of the drag on the head part of the rod. By default 1.
    pub head_weight: Option<NotNegative>,
    /// Arc length of the head part that `head_weight` applies to, m.
    pub head_length_m: Option<Positive>,
}

/// `[reactive]`, or `reactive = "auto"`.
#[derive(Debug, Clone, PartialEq)]
pub struct ReactiveTable {
    /// Fraction χ of the momentum that the tail sheds into the wake in Lighthill's theory: 1 for a sharp end, 0 for a pointed
    /// one.
    pub shedding: value::Share,
    /// True if the program decides whether added mass matters, by estimates from the scene's own motion.
    pub auto: bool,
}

impl<'de> Deserialize<'de> for ReactiveTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct ReactiveKeys {
            #[serde(default = "sharp")]
            shedding: value::Share,
        }
        struct TableOrAuto;
        impl<'de> Visitor<'de> for TableOrAuto {
            type Value = ReactiveTable;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a table, or \"auto\"")
            }

            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<ReactiveTable, E> {
                match text {
                    "auto" => Ok(ReactiveTable { shedding: sharp(), auto: true }),
                    _ => Err(E::invalid_value(Unexpected::Str(text), &self)),
                }
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<ReactiveTable, A::Error> {
                let ReactiveKeys { shedding } = ReactiveKeys::deserialize(MapAccessDeserializer::new(map))?;
                Ok(ReactiveTable { shedding, auto: false })
            }
        }
        deserializer.deserialize_any(TableOrAuto)
    }
}

#[cfg(feature = "schema")]
impl schemars::JsonSchema for ReactiveTable {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "ReactiveTable".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "anyOf": [
            { "const": "auto", "description": "present only if it matters, by estimates from the scene's own motion" },
            {
                "type": "object",
                "properties": { "shedding": {
                    "type": "number", "minimum": 0, "maximum": 1, "default": 1.0,
                    "description": "Fraction of the momentum that the tail sheds into the wake in Lighthill's theory: 1 for a sharp end, 0 for a pointed one."
                } },
                "additionalProperties": false
            }
        ] })
    }
}

/// The largest number of nodes for short runs with nonlocal drag, whose steps cost N³.
const MAX_NONLOCAL_NODES: u64 = 17;

fn sharp() -> value::Share {
    value::Share::constant(1.0)
}

impl DragTable {
    /// The keys that belong to a law, or to the law of its viscous part.
    pub(super) const KEYS_BY_LAW: KeysByChoice = KeysByChoice {
        table: "drag",
        choices: &["law", "viscous"],
        keys: || LAWS.iter().flat_map(|law| law.keys).copied().collect(),
        accepted: |chosen| {
            let law = DragLaw::named(&chosen("law")?)?;
            let viscous = chosen("viscous").filter(|_| law.keys.contains(&"viscous"));
            Some(Self::accepted_by(law, viscous.map_or(Some(laws::DEFAULT), |name| DragLaw::named(&name))?))
        },
    };

    /// The name of its law.
    pub fn law_name(&self) -> &str {
        let default = if self.ratio.is_some() { laws::stokes_like::LAW.name } else { laws::DEFAULT.name };
        self.law.as_deref().unwrap_or(default)
    }

    /// Its law.
    pub(super) fn law(&self) -> Result<&'static DragLaw, KeyError> {
        named(self.law_name(), "drag.law", |_| true)
    }

    fn viscous(&self) -> Result<&'static DragLaw, KeyError> {
        let Some(name) = &self.viscous else { return Ok(laws::DEFAULT) };
        named(name, "drag.viscous", |law| law.resistance.is_some())
    }

    /// The given keys that apply to some laws only.
    fn given(&self) -> impl Iterator<Item = &'static str> {
        let keys = [
            ("ratio", self.ratio.is_some()),
            ("slender_length_m", self.slender_length_m.is_some()),
            ("along_n_s_m2", self.along_n_s_m2.is_some()),
            ("across_n_s_m2", self.across_n_s_m2.is_some()),
            ("height_m", self.height_m.is_some()),
            ("viscous", self.viscous.is_some()),
            ("form_drag", self.form_drag.is_some()),
            ("thinning", self.thinning.is_some()),
            ("skin_friction", self.skin_friction.is_some()),
            ("turbulent_friction", self.turbulent_friction.is_some()),
        ];
        keys.into_iter().filter_map(|(key, given)| given.then_some(key))
    }

    /// The keys that its law accepts: its own, and those of the law of its viscous part.
    fn allowed(&self) -> Result<Vec<&'static str>, KeyError> {
        Ok(Self::accepted_by(self.law()?, self.viscous()?))
    }

    /// The keys that `law` accepts, with those of its `viscous` part if it has one.
    fn accepted_by(law: &DragLaw, viscous: &DragLaw) -> Vec<&'static str> {
        let of_parts = if law.keys.contains(&"viscous") { viscous.keys } else { &[] };
        [law.keys, of_parts].concat()
    }

    /// The given keys that `law` does not accept.
    pub(crate) fn excluded_by(&self, law: &'static DragLaw) -> Vec<&'static str> {
        let kept: Vec<_> = self.with_law(law).0.given().collect();
        self.given().filter(|key| !kept.contains(key)).collect()
    }

    fn check(&self, scene: &Scene) -> Result<(), KeyError> {
        let fault = |key: &str, problem: String| Err(KeyError { key: format!("drag.{key}"), problem });
        let law = self.law()?;
        let allowed = self.allowed()?;
        let strays: Vec<&str> = self.given().filter(|key| !allowed.contains(key)).collect();
        if let [key, others @ ..] = &strays[..] {
            let owners = || LAWS.iter().filter(|law| law.keys.contains(key));
            let mut allowed = owners().map(|law| law.name).collect::<Vec<_>>().join(", ");
            let parts =
                owners().filter(|law| law.resistance.is_some()).map(|law| format!("viscous = \"{}\"", law.name));
            let parts: Vec<String> = parts.collect();
            if law.keys.contains(&"viscous") && !parts.is_empty() {
                allowed += &format!(", or with {}", parts.join(", "));
            }
            let strays = others.iter().fold("it".to_string(), |all, other| format!("{all} and drag.{other}"));
            let problem = format!("found with law = \"{}\"; allowed: only with {allowed}; remove {strays}", law.name);
            return fault(key, problem);
        }
        for (key, profile) in [("along_n_s_m2", &self.along_n_s_m2), ("across_n_s_m2", &self.across_n_s_m2)] {
            if let Some(found) = profile.as_ref().and_then(NumberOrProfile::disorder) {
                return fault(key, value::refused(found, "points [xi, number] with rising xi from 0 to 1"));
            }
        }
        let viscous = self.viscous()?;
        let needs =
            if law.keys.contains(&"viscous") { [law.needs, viscous.needs].concat() } else { law.needs.to_vec() };
        if let Some(key) = needs.into_iter().find(|key| !self.given().any(|given| given == *key)) {
            let asking = if law.needs.contains(&key) { ("law", law) } else { ("viscous", viscous) };
            return fault(key, format!("missing; {} = \"{}\" has no default for it", asking.0, asking.1.name));
        }
        if self.head_weight.is_some_and(|weight| weight.get() != 1.0) && self.head_length_m.is_none() {
            return fault("head_length_m", "missing; a head_weight other than 1 needs the head's length".into());
        }
        if scene.rod.shape() == Shape::Rectangle {
            let of_parts = if law.keys.contains(&"viscous") { Some(("viscous", viscous)) } else { None };
            for (key, law) in std::iter::once(("law", law)).chain(of_parts) {
                if law.takes == SectionInput::Round {
                    let others = LAWS.iter().filter(|law| law.takes != SectionInput::Round);
                    let others = others.filter(|law| key == "law" || law.resistance.is_some()).map(|law| law.name);
                    let allowed = others.collect::<Vec<_>>().join(", ");
                    return fault(
                        key,
                        format!(
                            "found {:?} with rod.section = \"rectangle\"; it is valid for round rods only; allowed: {allowed}, or another section",
                            law.name
                        ),
                    );
                }
            }
        }
        let rod = scene.rod_on(NODES[0] as usize); // sections and length are independent of the mesh
        let law_inputs = self.law_inputs(scene, &rod)?;
        let radius = rod.sections.largest_radius();
        if let Some(slender) = law.slender.map(|slender| slender(&law_inputs)).filter(|slender| slender.is_finite()) {
            let logarithm = (slender / radius).ln();
            if logarithm < MIN_LOG_SLENDERNESS {
                let allowed = format!("a body with ln(length/radius) of at least {MIN_LOG_SLENDERNESS}");
                let found = format!("ln({slender:.4e} m / {radius:.4e} m) = {logarithm:.3}");
                return fault("law", value::refused(found, allowed));
            }
        }
        // The plane of motion is parallel to the wall.
        let reach = rod.sections.reach_across();
        if self.height_m.is_some_and(|height| height.get() <= reach) {
            let allowed = format!("above what the rod reaches across the plane of motion, {reach:e} m");
            return fault("height_m", value::refused(format!("{:e} m", law_inputs.height), allowed));
        }
        match law.reach {
            Dependence::Edge => Ok(()),
            Dependence::Rod { least_spacing, most_nodes } => {
                self.check_nonlocal(scene, law, least_spacing(&law_inputs), most_nodes)
            }
        }
    }

    /// Checks the limits of a nonlocal `law`: at most `most` nodes, spaced at least `least` (m).
    fn check_nonlocal(&self, scene: &Scene, law: &DragLaw, least: f64, most: usize) -> Result<(), KeyError> {
        let name = law.name;
        let fault = |key: &str, problem: String| Err(KeyError { key: key.to_string(), problem });
        let (length, nodes) = (scene.rod.length_m.get(), scene.rod.nodes.get());
        let spacing = length / (nodes - 1) as f64;
        if spacing < least || nodes > most {
            let found = format!("{nodes} nodes, {spacing:.4e} m apart");
            let most = most.min((length / least) as usize + 1);
            let allowed =
                format!("with law = \"{name}\", at most {most}, at least half a blob of √e radii apart, {least:.4e} m");
            return fault("rod.nodes", value::refused(found, allowed));
        }
        if self.head_weight.is_some_and(|weight| weight.get() != 1.0) {
            let problem =
                format!("found with law = \"{name}\", which has no local drag; remove it, or add [head_body]");
            return fault("drag.head_weight", problem);
        }
        if scene.medium.as_ref().is_some_and(|medium| medium.stack().is_some()) {
            let problem = format!(
                "{name:?} found in a medium with layers or shear; it is valid in a uniform fluid only: remove them, or use another law"
            );
            return fault("drag.law", problem);
        }
        if scene.head.kind == HeadKind::Hinged {
            let problem = format!(
                "{name:?} found with head.kind = \"hinged\", whose angle its matrix does not include; use another law, or another kind of head"
            );
            return fault("drag.law", problem);
        }
        if scene.solver.form == FormKey::Chain {
            let problem = format!(
                "\"chain\" found with law = \"{name}\", whose matrix is not banded; allowed: \"positions\" or \"auto\""
            );
            return fault("solver.form", problem);
        }
        Ok(())
    }

    fn law_inputs<'a>(&self, scene: &Scene, rod: &'a Rod) -> Result<LawInputs<'a>, KeyError> {
        let get = |number: Option<NotNegative>| number.map(NotNegative::get);
        let profile =
            |along: &Option<NumberOrProfile<NotNegative>>| along.as_ref().map_or(0.0.into(), NumberOrProfile::profile);
        Ok(LawInputs {
            taken: scene.fluid_choice.as_ref().and_then(|taken| taken.law),
            wavelength: scene.wavelength(),
            frequency: if self.law()? == &laws::weak_inertia::LAW { scene.spectrum().strongest() } else { None },
            head: HeadWeight {
                weight: self.head_weight.map_or(1.0, NotNegative::get),
                length: self.head_length_m.map_or(0.0, Positive::get),
            },
            viscous: self.viscous()?,
            slender_length: self.slender_length_m.map(Positive::get),
            ratio: self.ratio.map_or(1.0, Positive::get),
            along: profile(&self.along_n_s_m2),
            across: profile(&self.across_n_s_m2),
            height: self.height_m.map_or(f64::INFINITY, Positive::get),
            form_drag: get(self.form_drag),
            thinning: get(self.thinning),
            skin_friction: get(self.skin_friction),
            turbulent_friction: get(self.turbulent_friction),
            ..LawInputs::plain(rod)
        })
    }

    /// The table with another law, and the number of keys that this law does not accept.
    pub(super) fn with_law(&self, law: &'static DragLaw) -> (Self, usize) {
        let mut table = Self { law: Some(law.name.to_string()), ..self.clone() };
        let before = table.given().count();
        // A law with keys of its own, such as the height above a wall, becomes the viscous part of a law that has one.
        let own = self.law().ok().filter(|own| !own.needs.is_empty() && !own.published.table.is_empty());
        if let Some(own) = own.filter(|own| law.keys.contains(&"viscous") && own.resistance.is_some()) {
            table.viscous = Some(own.name.to_string());
        }
        if !law.keys.contains(&"viscous") {
            table.viscous = None;
        }
        // The keys of its viscous part are accepted too, if they can be determined.
        let allowed = table.allowed().unwrap_or_else(|_| law.keys.to_vec());
        let keep = |key: &str| allowed.contains(&key);
        macro_rules! drop_others {
            ($($key:ident),*) => { $(if !keep(stringify!($key)) { table.$key = None; })* };
        }
        drop_others!(
            ratio,
            slender_length_m,
            along_n_s_m2,
            across_n_s_m2,
            height_m,
            form_drag,
            thinning,
            skin_friction,
            turbulent_friction
        );
        let dropped = before.saturating_sub(table.given().count());
        (table, dropped)
    }

    fn build(&self, scene: &Scene, rod: &Rod) -> Result<Box<dyn Force>, KeyError> {
        Ok((self.law()?.build)(&self.law_inputs(scene, rod)?))
    }
}

/// The law with this name, if `allowed`.
fn named(name: &str, key: &str, allowed: impl Fn(&DragLaw) -> bool) -> Result<&'static DragLaw, KeyError> {
    let names = || LAWS.iter().filter(|law| allowed(law)).map(|law| law.name);
    match DragLaw::named(name).filter(|law| allowed(law)) {
        Some(law) => Ok(law),
        None => {
            let near = nearest(name, names()).map_or(String::new(), |near| format!("; did you mean `{near}`?"));
            let listed = names().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
            let problem = value::refused(format_args!("{name:?}"), format_args!("{listed}{near}"));
            Err(KeyError { key: key.to_string(), problem })
        }
    }
}

impl Scene {
    /// True if drag is nonlocal: at each node it depends on the motion of the whole rod.
    pub fn has_nonlocal_drag(&self) -> bool {
        self.drag.as_ref().and_then(|drag| drag.law().ok()).is_some_and(DragLaw::is_nonlocal)
    }

    /// The scene in a steady flow of this velocity, m/s. Without effect if there is no medium.
    pub fn with_flow(&self, flow: [f64; 2]) -> Self {
        let mut scene = self.clone();
        if let Some(medium) = &mut scene.medium {
            medium.flow_m_s = VectorSignal(flow.map(|x| SignalValue::Formula(Signal::Constant(x))));
        }
        scene
    }

    /// The scene with or without added mass.
    pub fn with_reactive(&self, reactive: bool) -> Self {
        let own = self
            .reactive
            .clone()
            .filter(|reactive| !reactive.auto)
            .unwrap_or(ReactiveTable { shedding: sharp(), auto: false });
        Self { reactive: reactive.then_some(own), ..self.clone() }
    }

    /// The scene with the drag `law`, with or without added mass, and with the full model if it leaves the model to the program. Also
    /// returns the number of keys of `[drag]` that this law does not accept.
    ///
    /// # Errors
    /// The reason why there is no such scene.
    pub fn with_fluid(&self, law: &'static DragLaw, reactive: bool) -> Result<(Self, usize), String> {
        let mut scene = self.with_reactive(reactive).named_model();
        scene.fluid_choice = None;
        let (drag, dropped) = self.drag.clone().unwrap_or_default().with_law(law);
        scene.drag = Some(drag);
        scene.check().map_err(|KeyError { key, problem }| format!("{key}: {problem}"))?;
        Ok((scene, dropped))
    }

    /// Its drag law, after the choice by `auto`, and whether it has added mass.
    pub fn fluid_model(&self, rod: &Rod) -> (Option<&'static DragLaw>, bool) {
        let law = self.drag.as_ref().and_then(|drag| {
            let law = drag.law().ok()?;
            if law != &laws::auto::LAW { Some(law) } else { Some(laws::auto::taken(&drag.law_inputs(self, rod).ok()?)) }
        });
        (law, self.reactive_on().is_some())
    }

    /// Forces on `rod` whose sum is the total force of the fluid, by their cause; `Err` as for the scene itself.
    ///
    /// # Errors
    /// Errors of [`model`](Self::model).
    pub fn parts_of_fluid(&self, rod: &Rod) -> Read<ForcesByCause> {
        let parts = || -> Result<ForcesByCause, KeyError> {
            let mut parts = ForcesByCause::new();
            let mut others = self.forces(rod)?.0;
            if let Some(drag) = &self.drag {
                parts = drag.law()?.parts(&drag.law_inputs(self, rod)?);
                others.remove(0);
            }
            parts.extend(others.into_iter().map(|force| {
                let name = match force.name() {
                    "reactive" => "added mass",
                    "wake" => "shedding",
                    other => other,
                };
                (name, force)
            }));
            Ok(parts)
        };
        parts().map_err(|KeyError { key, problem }| self.error(&key, problem))
    }

    /// The published uncertainty of its drag law at its Reynolds number, and of omitted effects of the fluid, if known.
    pub fn uncertainty(&self, rod: &Rod) -> Option<Uncertainty> {
        let reynolds = self.regime().ok()?.reynolds;
        let (law, reactive) = self.fluid_model(rod);
        law?.uncertainty(reynolds, reactive)
    }

    /// The scene with the mass of the rod multiplied by `factor`.
    pub fn with_rod_density(&self, factor: f64) -> Self {
        let mut scene = self.clone();
        for mass in [&mut scene.rod.density_kg_m3, &mut scene.rod.mass_per_length_kg_m] {
            *mass = mass.as_ref().map(|mass| mass.times(factor));
        }
        scene
    }

    /// Checks the tables of the fluid.
    pub(super) fn check_fluid(&self) -> Result<(), KeyError> {
        let fault = |key: &str, problem: &str| Err(KeyError { key: key.to_string(), problem: problem.to_string() });
        if self.medium.is_none() {
            if self.drag.is_some() {
                return fault("drag", "found without [medium], which has the viscosity; add it or remove [drag]");
            }
            if self.reactive.is_some() {
                return fault("reactive", "found without [medium], which has the density; add it or remove [reactive]");
            }
            if self.loads.as_ref().is_some_and(|loads| loads.buoyancy) {
                return fault("loads.buoyancy", "found without [medium], which has the density; add it");
            }
        }
        if let Some(medium) = &self.medium {
            medium.check(self)?;
        }
        self.drag.as_ref().map_or(Ok(()), |drag| drag.check(self))
    }

    /// The spectrum of its drives. Head, flow or tendons are omitted if their tables cannot be read.
    pub fn spectrum(&self) -> Spectrum {
        self.spectrum_for(SpectrumPurpose::Steps)
    }

    /// The same for a purpose.
    pub fn spectrum_for(&self, purpose: SpectrumPurpose) -> Spectrum {
        let waves = self.wavelength().map_or(1.0, |wave| self.rod.length_m.get() / wave);
        let rod = self.rod_on(nodes(waves) as usize);
        let head = self.head_motion().ok().flatten();
        let flow = self.fluid().ok().and_then(|(_, flow)| flow);
        let moments = self.has_active_moments();
        let wave = self.drive(&rod).map(|(wave, drive)| (if moments { bending(&*wave, &rod) } else { wave }, drive));
        let wave = wave.as_ref().map(|(wave, drive)| (&**wave, *drive));
        let tendons = self.tendons_on(&rod).unwrap_or_default();
        let hinge = self.hinge().ok().flatten();
        Spectrum::of(purpose, &rod, wave, head.as_ref(), flow.as_ref(), &tendons, hinge.as_ref())
    }

    /// The fluid, and its flow if it is unsteady; [`Fluid::NONE`] without a medium.
    ///
    /// # Errors
    /// [`Error::Read`](crate::Error::Read) or [`Error::Scene`](crate::Error::Scene) for the table of a flow.
    pub(super) fn fluid(&self) -> Read<(Fluid, Option<[Signal; 2]>)> {
        let Some(medium) = &self.medium else { return Ok((Fluid::NONE, None)) };
        let flow = self.vector_signal(&medium.flow_m_s)?;
        let fluid = medium.fluid(&flow);
        Ok((fluid, medium.steady_flow().is_none().then_some(flow)))
    }

    /// The number of nodes for a short run, and the part of the scene's run that it covers.
    fn short_run_mesh(&self) -> (u64, ShortRun) {
        let waves = self.wavelength().map_or(1.0, |wave| self.rod.length_m.get() / wave);
        let most = if self.has_nonlocal_drag() { MAX_NONLOCAL_NODES } else { u64::MAX };
        let ramp = self.start.ramp_s.map_or(0.0, Positive::get);
        let nodes = nodes(waves).min(self.rod.nodes.get() as u64).min(most);
        (nodes, ShortRun::of(&self.spectrum(), self.solver.duration_s.get(), ramp))
    }

    /// Returns an error if the run is too short to compare laws of the fluid.
    ///
    /// # Errors
    /// The reason.
    pub fn check_run_length(&self) -> Result<(), String> {
        self.short_run_mesh().1.check_run_length(self.solver.duration_s.get())
    }

    /// Its motion and power in a short run, and the flow around the rod in that motion.
    fn short_run(&self) -> Result<(MotionAndPower, Regime), String> {
        let (nodes, span) = self.short_run_mesh();
        let model = self.clone().named_model().with_nodes(nodes).model().map_err(|error| error.to_string())?;
        let (model, strongest) = (Arc::new(model), self.spectrum().strongest());
        let ShortRunResult { means, motion } = simulate(&model, span).map_err(|error| error.to_string())?;
        Ok((means, Regime::of(&model.rod, strongest, &motion)))
    }

    /// The flow around its rod, from a short run.
    ///
    /// # Errors
    /// The reason why it is unknown.
    pub fn regime(&self) -> Result<Regime, String> {
        if self.medium.is_none() {
            return Err("there is no fluid".to_string());
        }
        Ok(self.short_run()?.1)
    }

    /// The flow conditions of `rod` with this cross-flow, which determine the validity of forces.
    pub fn motion<'a>(&self, rod: &'a Rod, across: TransverseMotion) -> FlowConditions<'a> {
        FlowConditions {
            rod,
            across,
            frequency: self.spectrum().strongest().filter(|frequency| *frequency > 0.0),
            wavelength: self.wavelength(),
            height: self.drag.as_ref().and_then(|drag| drag.height_m).map(Positive::get),
        }
    }

    /// The part of an advice about the keys of `[drag]` that `law` does not accept, or `None` if the scene cannot have this law.
    pub fn without(&self, law: &'static DragLaw) -> Option<String> {
        self.with_fluid(law, self.reactive_on().is_some()).ok()?;
        let keys = self.drag.iter().flat_map(|drag| drag.excluded_by(law));
        let keys: Vec<String> = keys.map(|key| format!("drag.{key}")).collect();
        Some(if keys.is_empty() { String::new() } else { format!(", without {},", keys.join(" and ")) })
    }

    /// `[reactive]`, if added mass is present. With `auto`, it is present if estimates from the scene's own motion show that it
    /// matters, or if there are no estimates and the model supports it.
    pub fn reactive_on(&self) -> Option<&ReactiveTable> {
        let matters = self.fluid_choice.as_ref().map_or(!self.excludes_added_mass(), |taken| taken.reactive);
        self.reactive.as_ref().filter(|reactive| !reactive.auto || matters)
    }

    /// Whether the scene leaves the drag law, and the added mass, to the program.
    pub(super) fn leaves_fluid_to_program(&self) -> [bool; 2] {
        let drag = self.drag.as_ref().is_some_and(|drag| drag.law_name() == laws::auto::LAW.name);
        [drag, self.reactive.as_ref().is_some_and(|reactive| reactive.auto)]
    }

    /// The drag law that the program has chosen, and the reason. `None` if the scene specifies the law, or if there are no
    /// estimates.
    pub fn fluid_choice(&self) -> Option<&FluidChoice> {
        self.fluid_choice.as_ref()
    }

    /// What a host should know before it moves the rod: that the program chose the fluid for a rod at rest, because nothing in
    /// the scene moves it. Every interface reports it: `check` and the notes of a run, Python as a warning, the FMU in its log, C
    /// by `caudal_note`.
    pub fn fluid_note(&self) -> Option<String> {
        let choice = self.fluid_choice.as_ref().filter(|choice| choice.at_rest)?;
        let [asked, remedy] = match self.leaves_fluid_to_program() {
            [true, true] => [
                "drag.law = \"auto\" and reactive = \"auto\" estimate the flow",
                "set drag.law (\"cross-flow\" with [reactive] for water)",
            ],
            [true, false] => ["drag.law = \"auto\" estimates the flow", "set drag.law (\"cross-flow\" for water)"],
            _ => ["reactive = \"auto\" estimates the flow", "write [reactive] (for water), or omit it"],
        };
        Some(format!(
            "{asked} from the scene's own motion, but nothing in the scene moves this rod: {} was chosen for a rod at rest and stays in use whatever a host does; {remedy}, or give the scene a typical motion",
            choice.name()
        ))
    }

    /// The choice of the fluid, by estimates or by its Reynolds number.
    pub(super) fn fluid_choice_or_fixed(&self) -> Option<FluidChoice> {
        self.fluid_choice.clone().or_else(|| {
            let (law, reactive) = self.fluid_model(&self.model().ok()?.rod);
            Some(FluidChoice::without_estimates(law, reactive, "that of the original scene".to_string()))
        })
    }

    /// Sets the choice of the fluid, if the scene leaves it to the program.
    pub(super) fn set_fluid_choice(&mut self, fluid: FluidChoice) {
        self.fluid_choice = Some(fluid).filter(|_| self.leaves_fluid_to_program().contains(&true));
    }

    /// Chooses the drag law by estimates, if the scene leaves it to the program.
    pub(super) fn choose_fluid(&mut self) {
        let [law_left, reactive_left] = self.leaves_fluid_to_program();
        if !law_left && !reactive_left {
            return;
        }
        let estimates = match self.fluid_estimates() {
            Ok(estimates) => estimates,
            Err(reason) => {
                let rod = self.rod_on(NODES[0] as usize);
                let (law, reactive) = self.fluid_model(&rod);
                let left_out = if reactive && reactive_left { self.beyond_added_mass(&rod) } else { None };
                let of_water = left_out
                    .as_ref()
                    .map_or(String::new(), |beyond| format!("; added mass is left out, because {beyond}"));
                let reason = format!("no estimates: {reason}{of_water}");
                self.fluid_choice = Some(FluidChoice::without_estimates(law, reactive && left_out.is_none(), reason));
                return;
            }
        };
        let fixed = self.drag.as_ref().and_then(|drag| drag.law().ok());
        let reactive = self.reactive.is_some();
        let rod = self.rod_on(NODES[0] as usize);
        let motion = self.motion(&rod, estimates.regime.across);
        let counts = reactive::COUNTS.value_outside(&motion).is_none();
        self.fluid_choice = FluidChoice::of(&estimates, |law, with| {
            let drag = if law_left { laws::auto::CANDIDATES.contains(&law) } else { fixed == Some(law) };
            let water = if reactive_left { counts || !with } else { with == reactive };
            drag && water && !(with && self.excludes_added_mass())
        });
        let is_below = LAWS.iter().any(|law| law.is_nonlocal() && law.validity.holds(&motion));
        if let Some((law, changes)) = is_below.then(|| self.nonlocal_drag()).flatten()
            && let Some(taken) = &mut self.fluid_choice
        {
            taken.count(law, changes, &estimates);
        }
    }

    /// The reason why the water's inertia is better omitted around `rod`, if so: its boundary layer would be thicker than the
    /// rod.
    fn beyond_added_mass(&self, rod: &Rod) -> Option<String> {
        let at_rest = |fluid| TransverseMotion { speed: 0.0, per_depth: 0.0, along: 0.0, body: 0.0, fluid };
        let across = match self.regime() {
            Ok(regime) => regime.across,
            Err(_) => at_rest(self.fluid().ok()?.0),
        };
        let number = reactive::COUNTS.value_outside(&self.motion(rod, across))?;
        Some(format!("{} is {number:.3e} (allowed: {})", reactive::COUNTS.number.words(), reactive::COUNTS.limits()))
    }

    /// Notes about those of `forces` on its `rod` whose range of validity a motion leaves.
    pub fn range_notes(&self, forces: &Forces, rod: &Rod, across: TransverseMotion) -> Vec<String> {
        let mut left = warnings::out_of_range(forces, &self.motion(rod, across), |law| self.without(law));
        let is_estimated = self.fluid_choice.as_ref().is_some_and(|choice| choice.errors.is_some());
        if is_estimated && self.reactive.as_ref().is_some_and(|reactive| reactive.auto) {
            let of_water = left.iter_mut().filter(|note| note.starts_with(reactive::NAME));
            of_water.for_each(|note| {
                *note += "; reactive = \"auto\" includes it nevertheless, because leaving it out causes a larger error"
            });
        }
        left
    }

    /// Estimates for the laws that `auto` chooses from, and for the scene's own law, each with and without added mass, from short
    /// runs.
    ///
    /// # Errors
    /// The reason why there are no estimates.
    pub fn fluid_estimates(&self) -> Result<FluidEstimates, String> {
        if self.medium.is_none() {
            return Err("there is no fluid".to_string());
        }
        let (nodes, span) = self.short_run_mesh();
        let strongest = self.spectrum().strongest();
        let held = self.head.kind != HeadKind::Free;
        let fixed = self.drag.as_ref().and_then(|drag| drag.law().ok()).filter(|law| *law != &laws::auto::LAW);
        // The highest law first, because its motion decides which of the others are valid.
        let mut wanted: Vec<_> = laws::auto::CANDIDATES.iter().rev().copied().collect();
        wanted.extend(fixed.filter(|law| !laws::auto::CANDIDATES.contains(law)));
        let (rod, mut found, mut regime) = (self.rod_on(nodes as usize), Vec::new(), None);
        for law in wanted {
            for reactive in [true, false] {
                let known = |regime: &Regime| {
                    let holds = law.validity.holds(&self.motion(&rod, regime.across));
                    law.uncertainty(regime.reynolds, reactive).filter(|_| holds)
                };
                // A law outside its range is not a candidate.
                let holds = regime.as_ref().is_none_or(|regime| known(regime).is_some());
                if !holds && fixed != Some(law) {
                    continue;
                }
                let Ok((scene, dropped)) = self.with_fluid(law, reactive) else { continue };
                let model = Arc::new(scene.with_nodes(nodes).model().map_err(|error| error.to_string())?);
                match simulate(&model, span) {
                    Ok(ShortRunResult { means, motion }) => {
                        let regime = regime.get_or_insert_with(|| Regime::of(&model.rod, strongest, &motion));
                        let counts =
                            !reactive || reactive::COUNTS.value_outside(&self.motion(&rod, regime.across)).is_none();
                        found.push((law, reactive, means, dropped, known(regime).filter(|_| counts)));
                    }
                    // A law outside its range may fail in this motion.
                    Err(_) if !holds => {}
                    Err(error) => return Err(format!("under {} {error}", law.name)),
                }
            }
        }
        found.reverse();
        let regime = regime.ok_or("no law holds")?;
        // The highest law: it drops the fewest keys of the scene, includes the inertia of the water, and has the smallest
        // uncertainty and the widest range.
        let rank = |(law, .., dropped, known): &(&DragLaw, bool, MotionAndPower, usize, Option<Uncertainty>),
                    reactive: bool| {
            (*dropped, !reactive, known.map_or(f64::INFINITY, |known| known.measured(held)[0]), -law.reynolds)
        };
        let order = |a: &usize, b: &usize| {
            let [a, b] = [a, b].map(|i| rank(&found[*i], found[*i].1));
            a.0.cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.total_cmp(&b.2)).then(a.3.total_cmp(&b.3))
        };
        let known = (0..found.len()).filter(|i| found[*i].4.is_some());
        let highest = known.min_by(order).ok_or("no law with a published uncertainty is valid")?;
        let uncertainty = found[highest].4.map_or([f64::INFINITY; 2], |known| known.measured(held));
        let last = found.remove(highest);
        found.push(last);
        let measured = |known: Option<Uncertainty>| known.map(|known| known.measured(held));
        let found = found.into_iter().map(|(law, reactive, means, _, known)| (law, reactive, means, measured(known)));
        let found = found.collect();
        FluidEstimates::of(found, uncertainty, held, regime)
            .ok_or_else(|| "the estimated motion is not finite".to_string())
    }

    /// The relative changes of motion and power by nonlocal drag in a short run, if nonlocal drag is valid but not chosen.
    pub fn nonlocal_drag(&self) -> Option<(&'static DragLaw, [f64; 2])> {
        if self.has_nonlocal_drag() {
            return None;
        }
        let (_, reactive) = self.fluid_model(&self.rod_on(NODES[0] as usize));
        let coarse = self.with_nodes_up_to(MAX_NONLOCAL_NODES);
        let (own, regime) = coarse.short_run().ok()?;
        let rod = coarse.rod_on(coarse.rod.nodes.get());
        let motion = coarse.motion(&rod, regime.across);
        let law = LAWS.iter().copied().find(|law| law.is_nonlocal() && law.validity.holds(&motion))?;
        let (means, _) = coarse.with_fluid(law, reactive).ok()?.0.short_run().ok()?;
        Some((law, means.differences(&own)))
    }

    /// The forces of the fluid on `rod`, and the loads that follow the rod.
    pub(super) fn forces(&self, rod: &Rod) -> Result<Forces, KeyError> {
        let mut forces = Vec::new();
        if let Some(drag) = &self.drag {
            let law = drag.build(self, rod)?;
            forces.extend(self.body_drag(law.is_linear()));
            forces.insert(0, law);
        }
        if let Some(reactive) = self.reactive_on() {
            forces.push(Box::new(Reactive::new(rod)));
            forces.push(Box::new(Wake::new(rod, reactive.shedding.get())));
            forces.extend(self.body_inertia());
            forces.push(Box::new(FroudeKrylov::new(rod)));
        }
        if self.medium.as_ref().is_some_and(|medium| medium.interfaces().next().is_some()) {
            if self.reactive_on().is_some() {
                forces.push(Box::new(Spray::new(rod)));
            }
            if let Some(gravity) = self.loads.as_ref().and_then(LoadsTable::buoyed_by) {
                forces.push(Box::new(Buoyancy::new(rod, gravity)));
            }
        }
        if let Some(loads) = &self.loads {
            forces.extend(loads.followers(rod).map(|loads| Box::new(loads) as Box<dyn Force>));
        }
        Ok(Forces(forces))
    }
}
