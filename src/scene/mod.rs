//! Scenes: what a user edits. TOML with units in the keys; unknown keys and values out of range are refused.

mod document;
pub mod fluid;
pub mod parameter;
mod table;
pub mod value;

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;
use twox_hash::XxHash3_128;

pub use document::{Document, Fault};
pub use fluid::{DragTable, MediumTable, ReactiveTable};
use value::{Along, Finite, Gradient, NotNegative, Positive, ScalarSignal, Tolerance, VectorSignal, Wanted, Whole};

use crate::actuation::{Actuation, TravellingWave};
use crate::error::{Error, Result, nearest};
use crate::fluid::Fluid;
use crate::head::{Motion, Signal};
use crate::integrator::{Integrator, METHODS, Method, Pace};
use crate::linear::Choice;
use crate::model::{Drive, Model, chain};
use crate::reduced::estimate::Run;
use crate::reduced::{self, Estimates, Measure, RUNGS, Rung};
use crate::rod::{MassLumping, Material, Profile, Rod, Sections, Stiffness};
use crate::start::Start;
use crate::system::Form;

/// Fewest and most nodes a scene may have.
pub const NODES: [u64; 2] = [3, 10_000_000];

/// Most steps a scene may have; integers are exact well beyond.
const MOST_STEPS: f64 = 1e15;

/// Masses, lengths and stiffnesses of a rod, in SI units: products of a few of them are numbers still.
const SIZES: RangeInclusive<f64> = 1e-100..=1e100;

/// Most rows that `record.interval_s` may ask for.
const MOST_ROWS: f64 = 1e9;

/// A scene: everything there is to say about a run.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name; the file's where the scene has none.
    #[serde(default)]
    pub name: String,
    /// The rod.
    pub rod: RodTable,
    /// Actuation; absent: a passive rod.
    pub actuation: Option<ActuationTable>,
    /// How the run starts.
    #[serde(default)]
    pub start: StartTable,
    /// The fluid.
    pub medium: Option<MediumTable>,
    /// Drag; absent: none.
    pub drag: Option<DragTable>,
    /// The water that the rod accelerates; absent: no added mass.
    pub reactive: Option<ReactiveTable>,
    /// Gravity and point loads; absent: none.
    pub loads: Option<LoadsTable>,
    /// The head; absent: free.
    #[serde(default)]
    pub head: HeadTable,
    /// How it is solved.
    pub solver: SolverTable,
    /// What is recorded.
    #[serde(default)]
    pub record: RecordTable,
    /// What `caudal design` is asked for; a run takes no notice of it.
    pub design: Option<toml::Table>,
    /// Folder that tables are looked for in.
    #[serde(skip)]
    pub folder: PathBuf,
    /// True where the tables in that folder have numbers as names, see [`Document::packed`].
    #[serde(skip)]
    pub packed: bool,
    /// The file that says it, as errors name it.
    #[serde(skip)]
    file: PathBuf,
    /// Names the contents of its tables when it was read.
    #[serde(skip)]
    contents: u128,
}

/// `[rod]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RodTable {
    /// Number of nodes.
    pub nodes: Whole<{ NODES[0] }, { NODES[1] }>,
    /// Length, m.
    pub length_m: Positive,
    /// Outer radius, m; half the breadth in the plane of motion.
    pub outer_radius_m: Along<Positive>,
    /// Inner radius, m; 0, a solid rod, where it is not given.
    #[serde(default = "solid")]
    pub inner_radius_m: Along<NotNegative>,
    /// Depth across the plane of motion, m; twice the outer radius where it is not given.
    pub depth_m: Option<Along<NotNegative>>,
    /// Young's modulus, Pa.
    pub youngs_modulus_pa: Positive,
    /// Density, kg/m³.
    pub density_kg_m3: Along<Positive>,
    /// Points [ξ, factor] of the mass, linear in between, constant outside.
    pub mass_profile: Option<Along<NotNegative>>,
    /// a in EI(1 + a(1−ξ)); 0 where neither this nor a profile is given.
    pub stiffness_gradient: Option<Gradient>,
    /// Points [ξ, factor] of EI, linear in between, constant outside.
    #[serde(default, deserialize_with = "value::optional_pairs")]
    pub stiffness_profile: Option<Vec<[NotNegative; 2]>>,
    /// Lumping of the mass.
    #[serde(default)]
    pub mass_lumping: MassLumping,
}

/// `[actuation]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuationTable {
    /// Kind of actuation.
    pub kind: ActuationKind,
    /// Amplitude, a turning per reference length.
    pub kappa_amp: Finite,
    /// Reference length, m; 1 m makes the amplitude a curvature in 1/m.
    #[serde(default = "one_metre")]
    pub kappa_reference_length_m: Positive,
    /// Frequency, Hz.
    pub frequency_hz: NotNegative,
    /// Wavelength, m.
    pub wavelength_m: Positive,
    /// [e₀, e₁]: amplitude e₀ + e₁ξ along the rod; [1, 0] where it is not given.
    #[serde(default = "even_envelope", deserialize_with = "value::pair")]
    pub envelope: [Finite; 2],
    /// Points (ξ, factor) of what the amplitude is multiplied by, linear in between.
    pub amplitude_profile: Option<Vec<[NotNegative; 2]>>,
    /// Points (ξ, rad) of a phase that is subtracted inside the sine, linear in between.
    pub phase_profile_rad: Option<Vec<[Finite; 2]>>,
}

/// Kinds of actuation; adding one is its file and its line here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ActuationKind {
    /// See [`TravellingWave`].
    TravellingWave,
}

/// `[start]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartTable {
    /// Kind of start.
    #[serde(default)]
    pub kind: StartKind,
    /// Duration of a ramp, s.
    pub ramp_s: Option<Positive>,
    /// Spin of the whole rod about its centre of mass at the start, rad/s; only of a free rod.
    pub spin_rad_s: Option<Finite>,
}

/// Kinds of start, see [`Start`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StartKind {
    /// See [`Start::Jump`].
    Jump,
    /// See [`Start::Ramp`].
    Ramp,
    /// See [`Start::Shaped`].
    #[default]
    Shaped,
}

/// `[loads]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadsTable {
    /// Gravity, m/s²; a neutrally buoyant tail has none.
    #[serde(default, deserialize_with = "value::optional_pair")]
    pub gravity_m_s2: Option<[Finite; 2]>,
    /// True where the medium carries the rod.
    #[serde(default)]
    pub buoyancy: bool,
    /// Forces on single nodes.
    #[serde(default)]
    pub point: Vec<PointLoad>,
}

/// `[[loads.point]]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointLoad {
    /// Node; a negative one counts from the tip, −1.
    pub node: i64,
    /// Force, N.
    #[serde(deserialize_with = "value::pair")]
    pub force_n: [Finite; 2],
}

/// `[head]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadTable {
    /// Kind of head.
    #[serde(default)]
    pub kind: HeadKind,
    /// Position of a driven head, m.
    pub position_m: Option<VectorSignal>,
    /// Angle of a driven head from +x, rad.
    pub angle_rad: Option<ScalarSignal>,
}

/// Kinds of head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HeadKind {
    /// Nothing holds it.
    #[default]
    Free,
    /// Held at the origin, along +x.
    Clamped,
    /// Held where the scene or a host says.
    Driven,
}

/// `[solver]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct SolverTable {
    /// Name of the method; see [`Scene::integrator_name`] for scenes that say nothing.
    pub integrator: Option<String>,
    /// The rung of the ladder of models, or `auto`.
    #[serde(default = "full")]
    pub model: String,
    /// Largest estimated error of the model that `auto` takes.
    #[serde(default = "default_accuracy")]
    pub accuracy: Positive,
    /// What that error is of; all that the scene has where it is not given.
    pub accuracy_of: Option<Vec<Measure>>,
    /// Step size, s.
    pub time_step_s: Option<Positive>,
    /// Largest estimated error of an adaptive step, see [`Pace::Adaptive`].
    pub tolerance: Option<Tolerance>,
    /// Duration of the run, s.
    pub duration_s: Positive,
    /// Largest displacement increment of Newton's last iteration over the length.
    #[serde(default = "default_tolerance")]
    pub newton_tolerance: Tolerance,
    /// The linear solver.
    #[serde(default)]
    pub linear: Choice,
    /// What Newton's method takes as unknowns.
    #[serde(default)]
    pub form: FormKey,
    /// The method's own parameters.
    #[serde(flatten)]
    pub parameters: BTreeMap<String, toml::Value>,
}

/// Choices of the [`Form`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FormKey {
    /// Positions where their rounding error stays below [`chain::ACCURACY`], else the chain form.
    #[default]
    Auto,
    /// See [`Form::Positions`].
    Positions,
    /// See [`Form::Chain`].
    Chain,
}

/// `[record]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordTable {
    /// Steps between recorded times, 1 where it is not given; the first and the last time are always recorded.
    pub every: Option<Whole<1, 1_000_000_000>>,
    /// Time between recorded times, s, whatever the steps.
    pub interval_s: Option<Positive>,
    /// First time of the table of nodes, s.
    #[serde(default = "from_start")]
    pub nodes_from_s: NotNegative,
    /// The nodes of that table; a negative one counts from the tip, −1. All where it is not given.
    pub nodes: Option<Vec<i64>>,
    /// Form of that table; by default up to 200 nodes have a CSV file and more have none.
    pub nodes_table: Option<NodesTable>,
}

/// Forms of the table of node positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NodesTable {
    /// nodes.csv: one row a time, two columns a node.
    Csv,
    /// nodes.parquet: one row a time and node.
    Parquet,
    /// No table.
    None,
}

impl Default for RecordTable {
    fn default() -> Self {
        Self { every: None, interval_s: None, nodes_from_s: from_start(), nodes: None, nodes_table: None }
    }
}

/// The keys of `[solver]` beside the methods' parameters.
const SOLVER_KEYS: [&str; 10] = [
    "integrator",
    "time_step_s",
    "tolerance",
    "duration_s",
    "newton_tolerance",
    "linear",
    "form",
    "model",
    "accuracy",
    "accuracy_of",
];

/// Refuses a key of `[solver]` that is neither its own nor a parameter of any method.
fn check_solver_key(key: &str, integrator: Option<&str>) -> std::result::Result<(), Fault> {
    let parameters = |method: &'static Method| method.parameters.iter().map(|parameter| parameter.name);
    if SOLVER_KEYS.contains(&key) || METHODS.iter().any(|method| parameters(method).any(|name| name == key)) {
        return Ok(());
    }
    let mut keys = SOLVER_KEYS.to_vec();
    keys.extend(integrator.and_then(Method::named).into_iter().flat_map(parameters));
    let near = nearest(key, keys.iter().copied());
    let problem = document::unknown_key(&format!("`{}`", keys.join("`, `")), near);
    Err(Fault { key: format!("solver.{key}"), problem })
}

/// The model that the program chooses.
const AUTO: &str = "auto";

/// The errors of cheaper models are estimated on no more nodes than this.
const ESTIMATES_UP_TO: u64 = 17;

/// Part of the accuracy that is the tolerance of the cheaper model that `auto` takes, so that its steps add nothing to its
/// error: measured on three scenes, the overdamped model's displacement is off by up to 30 times its tolerance.
const STEPS_OF_ACCURACY: f64 = 0.01;

/// Up to this many nodes nodes.csv is written unless asked otherwise.
const NODES_CSV_UP_TO: usize = 200;

/// The method of a scene that names none: without a step of its own; with one; and with one where the rod is released into
/// its natural curvature at once, on which methods that damp little fail.
const DEFAULT_INTEGRATORS: [&str; 3] = ["esdirk3", "generalized-alpha", "implicit-euler"];

/// The tolerance of a scene that gives neither step nor tolerance.
const DEFAULT_TOLERANCE: f64 = 1e-3;

/// The tolerance of [`Scene::whole`], and its Newton's method's: forces of stiff rods are differences of tiny stretches.
const WHOLE_TOLERANCE: f64 = 1e-6;
const WHOLE_NEWTON_TOLERANCE: f64 = 1e-13;

fn full() -> String {
    "full".to_string()
}

fn default_accuracy() -> Positive {
    Positive::constant(1e-3)
}

fn default_tolerance() -> Tolerance {
    Tolerance::constant(1e-10)
}

fn solid() -> Along<NotNegative> {
    Along::<NotNegative>::constant(0.0)
}

fn one_metre() -> Positive {
    Positive::constant(1.0)
}

fn even_envelope() -> [Finite; 2] {
    [Finite::constant(1.0), Finite::constant(0.0)]
}

fn from_start() -> NotNegative {
    NotNegative::constant(0.0)
}

impl Scene {
    /// Reads and checks a scene file.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::Scene`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Document::read(path.as_ref())?.scene()
    }

    /// Checks what no single key can tell.
    fn check(&self) -> std::result::Result<(), Fault> {
        let fault = |key: &str, problem: String| Err(Fault { key: key.to_string(), problem });
        if let Some(bad) = self.name.chars().find(|c| c.is_control() || ['/', '\\'].contains(c)) {
            return fault("name", value::refused(format_args!("{bad:?} in it"), "a name that can be a folder's"));
        }
        if ["", ".", ".."].contains(&self.name.trim()) {
            return fault("name", value::refused(format_args!("{:?}", self.name), "a name that can be a folder's"));
        }
        let rod = &self.rod;
        rod.check_sections()?;
        if let Some(profile) = &rod.stiffness_profile {
            if rod.stiffness_gradient.is_some() {
                return fault(
                    "rod.stiffness_profile",
                    "found beside stiffness_gradient; allowed: one of the two".into(),
                );
            }
            let allowed = "points [xi, factor] with rising xi from 0 to 1 and positive factors";
            let points = profile.iter().map(|point| point.map(NotNegative::get));
            check_points("rod.stiffness_profile", points, allowed, |factor| factor > 0.0)?;
        }
        if let Some(actuation) = &self.actuation {
            if let Some(profile) = &actuation.amplitude_profile {
                let allowed = "points [xi, factor] with rising xi from 0 to 1";
                let points = profile.iter().map(|point| point.map(NotNegative::get));
                check_points("actuation.amplitude_profile", points, allowed, |_| true)?;
            }
            if let Some(profile) = &actuation.phase_profile_rad {
                let allowed = "points [xi, phase] with rising xi from 0 to 1";
                let points = profile.iter().map(|point| point.map(Finite::get));
                check_points("actuation.phase_profile_rad", points, allowed, |_| true)?;
            }
        }
        match (self.start.kind, &self.start.ramp_s) {
            (StartKind::Ramp, None) => return fault("start.ramp_s", "missing; a ramp has no default duration".into()),
            (StartKind::Jump | StartKind::Shaped, Some(_)) => {
                return fault("start.ramp_s", "found without kind = \"ramp\"; allowed: only with it".into());
            }
            _ => {}
        }
        if self.start.spin_rad_s.is_some() && self.head.kind != HeadKind::Free {
            return fault("start.spin_rad_s", "found with a held head; allowed: only with a free one".into());
        }
        self.check_fluid()?;
        let nodes = rod.nodes.get() as i64;
        let allowed_nodes = format_args!("a node from 0 to {}, or from -1 (the tip) to {}", nodes - 1, -nodes);
        for (i, load) in self.loads.iter().flat_map(|loads| &loads.point).enumerate() {
            if !(-nodes..nodes).contains(&load.node) {
                return fault(&format!("loads.point.{i}.node"), value::refused(load.node, allowed_nodes));
            }
        }
        if let Some(bad) = self.record.nodes.iter().flatten().find(|node| !(-nodes..nodes).contains(node)) {
            return fault("record.nodes", value::refused(bad, allowed_nodes));
        }
        if self.record.nodes.as_ref().is_some_and(Vec::is_empty) {
            return fault("record.nodes", value::refused("no node", allowed_nodes));
        }
        match (self.head.kind, &self.head) {
            (HeadKind::Free | HeadKind::Clamped, HeadTable { position_m: Some(_), .. }) => {
                return fault("head.position_m", "found without kind = \"driven\"; allowed: only with it".into());
            }
            (HeadKind::Free | HeadKind::Clamped, HeadTable { angle_rad: Some(_), .. }) => {
                return fault("head.angle_rad", "found without kind = \"driven\"; allowed: only with it".into());
            }
            _ => {}
        }
        self.check_sizes()?;
        let duration = self.solver.duration_s.get();
        if let Some(step) = self.solver.time_step_s.map(Positive::get).filter(|step| duration > MOST_STEPS * step) {
            let allowed =
                format!("at least {:e}, so that duration_s has at most {MOST_STEPS:e} steps", duration / MOST_STEPS);
            return fault("solver.time_step_s", value::refused(format_args!("{step:e}"), allowed));
        }
        if self.record.every.is_some() && self.record.interval_s.is_some() {
            return fault("record.interval_s", "found beside every; allowed: one of the two".into());
        }
        if let Some(interval) = self.record.interval_s.map(Positive::get).filter(|x| duration > MOST_ROWS * x) {
            let allowed = format!("at least {:e}, so that there are at most {MOST_ROWS:e} rows", duration / MOST_ROWS);
            let found = format_args!("{interval:e}, which makes {:.1e} rows", duration / interval);
            return fault("record.interval_s", value::refused(found, allowed));
        }
        let rung = self.rung()?;
        if rung.is_some_and(|rung| rung.needs_drag) && self.drag.is_none() {
            let problem = format!("found {:?} without [drag]; add it, or take another model", self.solver.model);
            return fault("solver.model", problem);
        }
        if rung.is_some_and(|rung| rung.needs_drag) && !self.is_dragged() {
            let problem = format!(
                "found 0 with solver.model = {:?}: without inertia nothing says how nodes without drag move; allowed: a positive weight, or another model",
                self.solver.model
            );
            return fault("drag.head_weight", problem);
        }
        if let (Some(rung), Some(_)) = (rung.filter(|rung| rung.method.is_some()), &self.reactive) {
            let problem =
                format!("found {:?} with [reactive], which only the whole model holds; remove one", rung.name);
            return fault("solver.model", problem);
        }
        let held = self.head.kind != HeadKind::Free;
        match &self.solver.accuracy_of {
            Some(measures) if !measures.iter().any(|measure| measure.exists(held)) => {
                let problem = "found nothing that this scene has; allowed: \"displacement\", \"tip\", and with a held head \"force\", \"moment\"";
                return fault("solver.accuracy_of", problem.into());
            }
            _ => {}
        }
        let (method, _) = self.method()?;
        let adaptive = || METHODS.iter().filter(|other| other.adaptive).map(|other| other.name).collect::<Vec<_>>();
        let own_method = rung.is_some_and(|rung| rung.method.is_some());
        match (self.solver.time_step_s, self.solver.tolerance) {
            (Some(_), Some(_)) => {
                return fault("solver.tolerance", "found beside time_step_s; allowed: one of the two".into());
            }
            (None, Some(_)) if !method.adaptive && !own_method => {
                let problem = format!(
                    "found with integrator = \"{}\"; allowed: only with {}",
                    method.name,
                    adaptive().join(", ")
                );
                return fault("solver.tolerance", problem);
            }
            (None, None) if !method.adaptive && !own_method => {
                return fault(
                    "solver.time_step_s",
                    format!("missing; integrator = \"{}\" has no default", method.name),
                );
            }
            _ => {}
        }
        if self.solver.form == FormKey::Chain && !method.implicit {
            let problem =
                format!("found \"chain\" with integrator = \"{}\"; allowed: with implicit methods only", method.name);
            return fault("solver.form", problem);
        }
        Ok(())
    }

    /// Refuses numbers so large or so small that the rod made of them has a mass or a stiffness that is none.
    fn check_sizes(&self) -> std::result::Result<(), Fault> {
        let table = &self.rod;
        let sections = table.sections();
        let section = sections.at(0.0);
        let spacing = table.length_m.get() / (table.nodes.get() - 1) as f64;
        let (youngs, density) = (table.youngs_modulus_pa.get(), sections.density.at(0.0));
        let bending = youngs * section.inertia() / spacing;
        let sizes = [
            ("rod.outer_radius_m", section.outer, "second moment of area", section.inertia(), "m^4"),
            ("rod.length_m", table.length_m.get(), "spacing of the nodes", spacing, "m"),
            ("rod.density_kg_m3", density, "mass per node", density * section.area() * spacing, "kg"),
            ("rod.youngs_modulus_pa", youngs, "stiffness of a joint", bending, "N m"),
            ("rod.youngs_modulus_pa", youngs, "stiffness of an edge", youngs * section.area() / spacing, "N/m"),
        ];
        for (key, found, what, size, unit) in sizes {
            if !SIZES.contains(&size) {
                let [low, high] = [SIZES.start(), SIZES.end()];
                let found = format_args!("{found:e}, which makes the {what} {size:e} {unit}");
                let allowed = format_args!("what makes it {low:e} to {high:e} {unit}");
                return Err(Fault { key: key.to_string(), problem: value::refused(found, allowed) });
            }
        }
        Ok(())
    }

    /// True where every node that is free to move has drag.
    fn is_dragged(&self) -> bool {
        let Some(drag) = &self.drag else { return false };
        let weightless = drag.head_weight.is_some_and(|weight| weight.get() == 0.0);
        let bare = if weightless { drag.head_length_m.map_or(0.0, Positive::get) } else { 0.0 };
        let spacing = self.rod.length_m.get() / (self.rod.nodes.get() - 1) as f64;
        let first = if self.head.kind == HeadKind::Free { 0.5 } else { 1.5 };
        bare < first * spacing
    }

    /// Why a run of it cannot begin, as `error` says, with the key that is most likely to blame.
    pub(crate) fn cannot_start(&self, error: &Error) -> Error {
        let bent = |what: String| format!("{what} in the first shape; allowed: a weaker one, or more nodes");
        let (key, problem) = match error {
            Error::FoldOver { node, .. } => {
                let turned = *node == 0 && self.head.angle_rad.is_some() || self.actuation.is_none();
                let key = if turned { "head.angle_rad" } else { "actuation.kappa_amp" };
                (key, bent(format!("the rod folds over at node {node}")))
            }
            Error::EdgeCollapse { node, .. } => {
                ("actuation.kappa_amp", bent(format!("the edge after node {node} collapses")))
            }
            Error::NotFinite { node, what, .. } => {
                let problem = format!("{what} is not finite at node {node} at the start; try a less extreme number");
                (self.extreme(), problem)
            }
            Error::NotConverged { residual_n, node, .. } => {
                let problem = format!(
                    "no accelerations at the start balance the forces: {residual_n:e} N are left at node {node}; try a less extreme number"
                );
                (self.extreme(), problem)
            }
            other => return other.clone(),
        };
        self.error(key, problem)
    }

    /// The key of the number that is the furthest from 1 of those that make forces.
    fn extreme(&self) -> &'static str {
        let rod = &self.rod;
        let (actuation, medium) = (self.actuation.as_ref(), self.medium.as_ref());
        let numbers = [
            ("rod.youngs_modulus_pa", Some(rod.youngs_modulus_pa.get())),
            ("rod.density_kg_m3", Some(rod.density_kg_m3.profile().largest())),
            ("rod.length_m", Some(rod.length_m.get())),
            ("rod.outer_radius_m", Some(rod.outer_radius_m.profile().largest())),
            ("actuation.kappa_amp", actuation.map(|table| table.kappa_amp.get().abs())),
            ("actuation.frequency_hz", actuation.map(|table| table.frequency_hz.get())),
            ("medium.viscosity_pa_s", medium.map(|table| table.viscosity_pa_s.get())),
        ];
        let far = numbers.into_iter().filter_map(|(key, number)| Some((key, number.filter(|x| *x > 0.0)?.ln().abs())));
        far.max_by(|a, b| a.1.total_cmp(&b.1)).map_or("rod.youngs_modulus_pa", |(key, _)| key)
    }

    /// The rung of the ladder of models it names, none where the program chooses.
    fn rung(&self) -> std::result::Result<Option<&'static Rung>, Fault> {
        let model = self.solver.model.as_str();
        let rung = Rung::named(model);
        if rung.is_none() && model != AUTO {
            let allowed = RUNGS.iter().map(|rung| rung.name).chain([AUTO]).collect::<Vec<_>>().join(", ");
            return Err(Fault {
                key: "solver.model".into(),
                problem: value::refused(format_args!("{model:?}"), allowed),
            });
        }
        Ok(rung)
    }

    /// How far the cheaper models of it are from the whole one; of a fine mesh, on a coarser one.
    ///
    /// # Errors
    /// Those of [`model`](Self::model) and [`integrator`](Self::integrator).
    pub fn estimates(&self) -> Result<Estimates> {
        if self.reactive.is_some() {
            return Ok(Estimates::none("it cannot hold the reactive force"));
        }
        let nodes = (self.rod.nodes.get() as u64).min(ESTIMATES_UP_TO);
        let step = self.typical_step();
        let (method, _) = self.method().map_err(|Fault { key, problem }| self.error(&key, problem))?;
        let iterations = match (method.implicit, self.integrator()?.rule(step)) {
            (false, _) => 1.0,
            (true, Some(_)) => 2.0,
            (true, None) => 6.0,
        };
        let run = Run {
            duration: self.solver.duration_s.get(),
            nodes: self.rod.nodes.get(),
            pace: [self.pace(), self.cheaper_pace()],
            iterations,
        };
        Ok(Estimates::of(&Arc::new(self.with_nodes(nodes).model()?), run))
    }

    /// The rung that it names, or the cheapest one that is accurate enough.
    ///
    /// # Errors
    /// Those of [`estimates`](Self::estimates).
    pub fn choice(&self) -> Result<reduced::Choice> {
        match self.rung().map_err(|Fault { key, problem }| self.error(&key, problem))? {
            Some(rung) if rung.method.is_some() => {
                match (rung.refuses)(&Arc::new(self.model()?), self.solver.duration_s.get()) {
                    Some(reason) => Err(self.error("solver.model", format!("found {:?}, but {reason}", rung.name))),
                    None => Ok(reduced::Choice::asked(rung)),
                }
            }
            Some(rung) => Ok(reduced::Choice::asked(rung)),
            None => {
                let measures = self.solver.accuracy_of.as_deref().unwrap_or(&Measure::ALL);
                let accuracy = self.solver.accuracy.get();
                Ok(reduced::Choice::of(self.estimates()?, accuracy, measures, self.is_dragged()))
            }
        }
    }

    /// How a cheaper model that `auto` takes chooses its steps: for itself, so that they add nothing to its error.
    fn cheaper_pace(&self) -> Pace {
        let most = STEPS_OF_ACCURACY * self.solver.accuracy.get();
        Pace::Adaptive(self.solver.tolerance.map_or(DEFAULT_TOLERANCE, Tolerance::get).min(most))
    }

    /// The method and the values of its parameters.
    pub(crate) fn method(&self) -> std::result::Result<(&'static Method, Vec<f64>), Fault> {
        let solver = &self.solver;
        let names = || METHODS.iter().map(|method| method.name);
        let Some(method) = Method::named(self.integrator_name()) else {
            let allowed = names().collect::<Vec<_>>().join(", ");
            let problem = value::refused(format_args!("{:?}", self.integrator_name()), allowed);
            return Err(Fault { key: "solver.integrator".into(), problem });
        };
        for key in solver.parameters.keys() {
            if method.parameters.iter().any(|parameter| parameter.name == key) {
                continue;
            }
            check_solver_key(key, Some(method.name))?;
            let owners = METHODS.iter().filter(|other| other.parameters.iter().any(|p| p.name == key));
            let owners = owners.map(|other| other.name).collect::<Vec<_>>().join(", ");
            let problem = format!("found with integrator = \"{}\"; allowed: only with {owners}", method.name);
            return Err(Fault { key: format!("solver.{key}"), problem });
        }
        let mut values = Vec::new();
        for parameter in method.parameters {
            let value = match solver.parameters.get(parameter.name) {
                None => parameter.default,
                Some(toml::Value::Float(x)) => *x,
                Some(toml::Value::Integer(x)) => *x as f64,
                Some(_) => f64::NAN,
            };
            if !(parameter.range[0]..=parameter.range[1]).contains(&value) {
                let found = solver.parameters.get(parameter.name).map_or(String::new(), ToString::to_string);
                let problem = value::refused(found, parameter.allowed);
                return Err(Fault { key: format!("solver.{}", parameter.name), problem });
            }
            values.push(value);
        }
        Ok((method, values))
    }

    /// The name of its method: a scene that names none takes one that fits the step it gives and its start, or one that
    /// chooses steps for itself.
    pub fn integrator_name(&self) -> &str {
        let [without_step, with_step, released] = DEFAULT_INTEGRATORS;
        let default = match self.solver.time_step_s {
            None => without_step,
            Some(_) if self.start.kind == StartKind::Jump && self.actuation.is_some() => released,
            Some(_) => with_step,
        };
        self.solver.integrator.as_deref().unwrap_or(default)
    }

    /// How its steps are chosen.
    pub fn pace(&self) -> Pace {
        match (self.solver.time_step_s, self.solver.tolerance) {
            (Some(step), _) => Pace::Fixed(step.get()),
            (None, tolerance) => Pace::Adaptive(tolerance.map_or(DEFAULT_TOLERANCE, Tolerance::get)),
        }
    }

    /// The size of its steps, s; where they are adaptive, about what is usual: a fiftieth of a period or of the run.
    pub fn typical_step(&self) -> f64 {
        let period = self.actuation.as_ref().map_or(f64::INFINITY, |actuation| 1.0 / actuation.frequency_hz.get());
        match self.pace() {
            Pace::Fixed(step) => step,
            Pace::Adaptive(_) => period.min(self.solver.duration_s.get()) / 50.0,
        }
    }

    /// The form in which `rod`, its own, is solved.
    pub fn form(&self, rod: &Rod) -> Form {
        match (self.solver.form, Method::named(self.integrator_name())) {
            (FormKey::Positions, _) | (_, Some(Method { implicit: false, .. })) => Form::Positions,
            (FormKey::Chain, _) => Form::Chain,
            (FormKey::Auto, _) => chain::form(rod, self.typical_step()),
        }
    }

    /// Its integrator.
    ///
    /// # Errors
    /// [`Error::Scene`]; none for a scene that was read by [`Document::scene`].
    pub fn integrator(&self) -> Result<Box<dyn Integrator>> {
        let (method, values) = self.method().map_err(|Fault { key, problem }| self.error(&key, problem))?;
        Ok((method.build)(&values))
    }

    fn error(&self, key: &str, problem: String) -> Error {
        Error::Scene { place: self.file.display().to_string(), key: key.to_string(), problem }
    }

    /// The bending stiffness along the rod.
    fn stiffness(&self) -> Stiffness {
        match (&self.rod.stiffness_profile, self.rod.stiffness_gradient) {
            (Some(points), _) => {
                let points = points.iter().map(|point| point.map(NotNegative::get)).collect();
                Profile::through(points).map_or(Stiffness::Gradient(0.0), Stiffness::Profile)
            }
            (None, gradient) => Stiffness::Gradient(gradient.unwrap_or(Gradient::constant(0.0)).get()),
        }
    }

    /// Its rod on a mesh of `nodes` nodes.
    fn rod_on(&self, nodes: usize) -> Rod {
        let table = &self.rod;
        let material =
            Material { sections: table.sections(), youngs: table.youngs_modulus_pa.get(), stiffness: self.stiffness() };
        let held = self.head.kind != HeadKind::Free;
        Rod::new(nodes, table.length_m.get(), &material, table.mass_lumping, held)
    }

    /// The model it describes.
    ///
    /// # Errors
    /// [`Error::Read`] or [`Error::Scene`] for the table of a driven head.
    pub fn model(&self) -> Result<Model> {
        let rod = self.rod_on(self.rod.nodes.get());
        let loads = self.loads.as_ref();
        Ok(Model {
            actuation: self.actuation.as_ref().map(|actuation| actuation.build(&rod)),
            start: match (self.start.kind, self.start.ramp_s) {
                (StartKind::Ramp, Some(duration)) => Start::Ramp { duration: duration.get() },
                (StartKind::Jump, _) => Start::Jump,
                _ => Start::Shaped,
            },
            forces: self.forces(&rod).map_err(|Fault { key, problem }| self.error(&key, problem))?,
            fluid: self.medium.as_ref().map_or(Fluid::NONE, MediumTable::fluid),
            load: loads.and_then(|loads| loads.build(&rod)),
            buoyancy: loads.and_then(|loads| loads.buoyancy(&rod)),
            head: self.head_motion()?,
            spin: self.start.spin_rad_s.map_or(0.0, Finite::get),
            rod,
        })
    }

    fn head_motion(&self) -> Result<Option<Motion>> {
        let still = Signal::Constant(0.0);
        match self.head.kind {
            HeadKind::Free => Ok(None),
            HeadKind::Clamped => Ok(Some([still.clone(), still.clone(), still])),
            HeadKind::Driven => {
                let signal = |wanted: &Wanted, column, columns| self.signal(wanted, column, columns);
                let (x, y) = match &self.head.position_m {
                    Some(VectorSignal([x, y])) => {
                        let columns =
                            if matches!((x, y), (Wanted::Table(a), Wanted::Table(b)) if a == b) { 2 } else { 1 };
                        (signal(x, 0, columns)?, signal(y, columns - 1, columns)?)
                    }
                    None => (still.clone(), still.clone()),
                };
                let angle = match &self.head.angle_rad {
                    Some(ScalarSignal(angle)) => signal(angle, 0, 1)?,
                    None => still,
                };
                Ok(Some([x, y, angle]))
            }
        }
    }

    /// A signal; from a table it takes value `column` of `columns`.
    fn signal(&self, wanted: &Wanted, column: usize, columns: usize) -> Result<Signal> {
        Ok(match wanted {
            Wanted::Formula(signal) => signal.clone(),
            Wanted::Table(file) => table::read(&self.table_path(file), column, columns, self.solver.duration_s.get())?,
        })
    }

    /// The tables that it names, each once, in the order of their keys.
    pub fn tables(&self) -> Vec<&str> {
        let position = self.head.position_m.iter().flat_map(|VectorSignal(signals)| signals);
        let angle = self.head.angle_rad.iter().map(|ScalarSignal(signal)| signal);
        let mut tables: Vec<&str> = Vec::new();
        for wanted in position.chain(angle) {
            if let Wanted::Table(file) = wanted
                && !tables.contains(&file.as_str())
            {
                tables.push(file);
            }
        }
        tables
    }

    /// Where a table that it names is.
    pub fn table_path(&self, file: &str) -> PathBuf {
        match self.tables().iter().position(|other| *other == file) {
            Some(i) if self.packed => self.folder.join(format!("table-{i}.csv")),
            _ => self.folder.join(file),
        }
    }

    /// The files beside it that it reads.
    pub fn files(&self) -> Vec<PathBuf> {
        self.tables().into_iter().map(|table| self.table_path(table)).collect()
    }

    /// Names what this scene says, the contents of its tables when it was read, and the version of the program; not where
    /// it stands, nor its name, which may be the file's.
    pub fn fingerprint(&self) -> u128 {
        let mut nowhere = self.clone();
        (nowhere.name, nowhere.folder, nowhere.file) = <_>::default();
        nowhere.packed = false;
        // The text of what is left has every part of the scene, and every number to the bit.
        XxHash3_128::oneshot(format!("{} {nowhere:?}", env!("CARGO_PKG_VERSION")).as_bytes())
    }

    /// The same scene on another number of nodes; point loads go to the nearest.
    pub fn with_nodes(&self, nodes: u64) -> Self {
        let mut scene = self.clone();
        scene.rod.nodes = Whole::nearest(nodes);
        let (old, new) = (self.rod.nodes.get(), scene.rod.nodes.get());
        for load in scene.loads.iter_mut().flat_map(|loads| &mut loads.point) {
            let node = load.node.rem_euclid(old as i64) as f64;
            load.node = (node * (new - 1) as f64 / (old - 1) as f64).round() as i64;
        }
        scene
    }

    /// The same scene by the whole model, with steps whose error is small: what cheaper models are compared with.
    pub fn whole(&self) -> Self {
        let mut scene = self.clone();
        scene.solver = SolverTable {
            integrator: Some(DEFAULT_INTEGRATORS[0].to_string()),
            model: full(),
            time_step_s: None,
            tolerance: Some(Tolerance::constant(WHOLE_TOLERANCE)),
            newton_tolerance: scene.solver.newton_tolerance.at_most(WHOLE_NEWTON_TOLERANCE),
            parameters: BTreeMap::new(),
            ..scene.solver
        };
        scene
    }

    /// The same scene over another duration (s).
    pub fn with_duration(&self, duration: f64) -> Self {
        let mut scene = self.clone();
        scene.solver.duration_s = Positive::constant(duration);
        scene
    }

    /// The same scene with other steps; only an adaptive method takes a tolerance.
    pub fn with_pace(&self, pace: Pace) -> Self {
        let mut scene = self.clone();
        scene.solver.integrator = Some(self.integrator_name().to_string());
        (scene.solver.time_step_s, scene.solver.tolerance) = match pace {
            Pace::Fixed(step) => (Some(Positive::constant(step)), None),
            Pace::Adaptive(tolerance) => (None, Some(Tolerance::constant(tolerance))),
        };
        scene
    }

    /// The same scene by the whole model and another method, with `values` for its parameters, in their order.
    pub fn with_method(&self, method: &Method, values: &[f64]) -> Self {
        let mut scene = self.clone();
        scene.solver.model = full();
        scene.solver.integrator = Some(method.name.to_string());
        let named = method.parameters.iter().zip(values);
        scene.solver.parameters = named.map(|(p, value)| (p.name.to_string(), toml::Value::Float(*value))).collect();
        scene
    }

    /// The same scene by a rung of the ladder of models.
    pub fn with_model(&self, rung: &Rung) -> Self {
        let mut scene = self.clone();
        scene.solver.model = rung.name.to_string();
        scene
    }

    /// The same scene as its run takes it by `choice`: a cheaper model that `auto` takes has steps of its own, and solves as
    /// well as what it is compared with.
    pub fn taken(&self, choice: &reduced::Choice) -> Self {
        if choice.reason.is_none() || choice.rung.method.is_none() {
            return self.with_model(choice.rung);
        }
        let mut scene = self.with_pace(self.cheaper_pace()).with_model(choice.rung);
        scene.solver.newton_tolerance = scene.solver.newton_tolerance.at_most(WHOLE_NEWTON_TOLERANCE);
        scene
    }

    /// The same scene with Young's modulus times `factor`.
    pub fn with_modulus(&self, factor: f64) -> Self {
        let mut scene = self.clone();
        scene.rod.youngs_modulus_pa = Positive::constant(self.rod.youngs_modulus_pa.get() * factor);
        scene
    }

    /// The same scene with the actuation's amplitude times `factor`.
    pub fn with_amplitude(&self, factor: f64) -> Self {
        let mut scene = self.clone();
        if let Some(actuation) = &mut scene.actuation {
            actuation.kappa_amp = Finite::constant(actuation.kappa_amp.get() * factor);
        }
        scene
    }

    /// The same scene with a spin (rad/s) of the free rod at the start.
    pub fn with_spin(&self, spin: f64) -> Self {
        let mut scene = self.clone();
        scene.start.spin_rad_s = Some(Finite::constant(spin));
        scene
    }

    /// The nodes whose positions are tabled, in the order asked for.
    pub fn recorded_nodes(&self) -> Vec<usize> {
        let nodes = self.rod.nodes.get();
        match &self.record.nodes {
            Some(chosen) => chosen.iter().map(|node| node.rem_euclid(nodes as i64) as usize).collect(),
            None => (0..nodes).collect(),
        }
    }

    /// The form of the table of nodes.
    pub fn nodes_table(&self) -> NodesTable {
        let recorded = self.record.nodes.as_ref().map_or(self.rod.nodes.get(), Vec::len);
        let default = if recorded <= NODES_CSV_UP_TO { NodesTable::Csv } else { NodesTable::None };
        self.record.nodes_table.unwrap_or(default)
    }

    /// The lengths (s) of the calls of `do_step` that make its run: one of whole steps of Δt, and one of the shorter last
    /// step if there is one; one in all where steps are adaptive.
    pub fn spans(&self) -> impl Iterator<Item = f64> {
        let duration = self.solver.duration_s.get();
        let Pace::Fixed(step) = self.pace() else { return [Some(duration), None].into_iter().flatten() };
        let (whole, last) = whole_steps(duration, step);
        [(whole > 0).then_some(whole as f64 * step), last].into_iter().flatten()
    }

    /// The number of its steps; none is known before where they are adaptive.
    pub fn steps(&self) -> Option<u64> {
        let Pace::Fixed(step) = self.pace() else { return None };
        let (whole, last) = whole_steps(self.solver.duration_s.get(), step);
        Some(whole + u64::from(last.is_some()))
    }
}

/// The whole steps in `duration` (s), and the shorter last one (s) if there is one: together the duration.
pub(crate) fn whole_steps(duration: f64, step: f64) -> (u64, Option<f64>) {
    let whole = (duration / step).round();
    if (whole * step - duration).abs() <= 1e-9 * duration {
        return (whole as u64, None);
    }
    let whole = (duration / step).floor();
    (whole as u64, Some(duration - whole * step))
}

impl ActuationTable {
    /// The points of the profiles of amplitude and phase; none where they are not given.
    pub(crate) fn profiles(&self) -> [Vec<[f64; 2]>; 2] {
        let amplitude = self.amplitude_profile.iter().flatten().map(|point| point.map(NotNegative::get));
        let phase = self.phase_profile_rad.iter().flatten().map(|point| point.map(Finite::get));
        [amplitude.collect(), phase.collect()]
    }

    fn build(&self, rod: &Rod) -> (Box<dyn Actuation>, Drive) {
        let drive = Drive { amplitude: self.kappa_amp.get(), frequency: self.frequency_hz.get() };
        let actuation: Box<dyn Actuation> = match self.kind {
            ActuationKind::TravellingWave => Box::new(TravellingWave::new(
                rod.nodes,
                rod.spacing,
                self.envelope.map(Finite::get),
                self.wavelength_m.get(),
                self.kappa_reference_length_m.get(),
            )),
        };
        if self.amplitude_profile.is_none() && self.phase_profile_rad.is_none() {
            return (actuation, drive);
        }
        let [amplitude, phase] = self.profiles();
        let along = |points: &[[f64; 2]], default: f64| -> Vec<f64> {
            let xi = (0..rod.nodes).map(|k| k as f64 / (rod.nodes - 1) as f64);
            let profile = Profile::through(points.to_vec()).unwrap_or(default.into());
            xi.map(|xi| profile.at(xi)).collect()
        };
        (actuation.profiled(&along(&amplitude, 1.0), &along(&phase, 0.0)), drive)
    }
}

/// Refuses a profile whose ξ do not rise from 0 to 1, or with a value that is not `ok`.
fn check_points(
    key: &str,
    points: impl Iterator<Item = [f64; 2]>,
    allowed: &str,
    ok: impl Fn(f64) -> bool,
) -> std::result::Result<(), Fault> {
    let fault = |found: String| Err(Fault { key: key.to_string(), problem: value::refused(found, allowed) });
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

impl RodTable {
    fn sections(&self) -> Sections {
        Sections {
            outer: self.outer_radius_m.profile(),
            inner: self.inner_radius_m.profile(),
            depth: self.depth_m.as_ref().map(Along::profile),
            density: self.density_kg_m3.profile(),
            mass_factor: self.mass_profile.as_ref().map_or(1.0.into(), Along::profile),
        }
    }

    /// Refuses profiles that are none, and a rod without wall.
    fn check_sections(&self) -> std::result::Result<(), Fault> {
        let fault = |key: &str, problem: String| Err(Fault { key: format!("rod.{key}"), problem });
        let disorders = [
            ("outer_radius_m", self.outer_radius_m.disorder()),
            ("inner_radius_m", self.inner_radius_m.disorder()),
            ("depth_m", self.depth_m.as_ref().and_then(Along::disorder)),
            ("density_kg_m3", self.density_kg_m3.disorder()),
            ("mass_profile", self.mass_profile.as_ref().and_then(Along::disorder)),
        ];
        for (key, disorder) in disorders {
            if let Some(found) = disorder {
                return fault(key, value::refused(found, "points [xi, number] with rising xi from 0 to 1"));
            }
        }
        let sections = self.sections();
        // Both are linear in between, so it is enough to look where either bends.
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
        if self.depth_m.is_some() && sections.depth_at(0.5) <= 0.0 {
            return fault("depth_m", value::refused("no depth in the middle", "a positive depth, 0 at the ends only"));
        }
        if self.mass_profile.is_some() && sections.mass_factor.at(0.5) <= 0.0 {
            return fault("mass_profile", value::refused("no mass in the middle", "positive factors"));
        }
        Ok(())
    }
}

impl HeadTable {
    /// Its functions of time that are formulas.
    fn formulas(&self) -> impl Iterator<Item = &Signal> {
        let position = self.position_m.iter().flat_map(|VectorSignal(signals)| signals);
        let angle = self.angle_rad.iter().map(|ScalarSignal(signal)| signal);
        position.chain(angle).filter_map(|wanted| match wanted {
            Wanted::Formula(signal) => Some(signal),
            Wanted::Table(_) => None,
        })
    }
}

impl LoadsTable {
    /// Buoyancy in a fluid of density 1 kg/m³ (N), two entries per node: −V g with the volume V of every node.
    fn buoyancy(&self, rod: &Rod) -> Option<Vec<f64>> {
        let gravity = self.gravity_m_s2.map_or([0.0; 2], |gravity| gravity.map(Finite::get));
        if !self.buoyancy || gravity == [0.0; 2] {
            return None;
        }
        let mut force = vec![0.0; 2 * rod.nodes];
        for (e, halves) in rod.halves().enumerate() {
            for (i, half) in halves.iter().enumerate() {
                for (axis, g) in gravity.iter().enumerate() {
                    force[2 * (e + i) + axis] -= half.displaced * half.length * g;
                }
            }
        }
        Some(force)
    }

    /// The forces of gravity and point loads (N), two entries a node; none where there are no loads.
    fn build(&self, rod: &Rod) -> Option<Vec<f64>> {
        let gravity = self.gravity_m_s2.map_or([0.0; 2], |gravity| gravity.map(Finite::get));
        if gravity == [0.0; 2] && self.point.is_empty() {
            return None;
        }
        let mut force: Vec<f64> = rod.mass.iter().flat_map(|mass| gravity.map(|g| g * mass)).collect();
        for load in &self.point {
            let node = load.node.rem_euclid(rod.nodes as i64) as usize;
            for (i, component) in load.force_n.iter().enumerate() {
                force[2 * node + i] += component.get();
            }
        }
        Some(force)
    }
}
