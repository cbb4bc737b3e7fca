//! The one table of variables: inputs, outputs and parameters with name, unit, causality and meaning.
//!
//! Every face of the program (command, files, bindings) reads it. Adding an output is one line of [`VARIABLES`].

use nalgebra::Vector2;

use crate::cycle::{self, Cycles, Measure};
use crate::error::{Error, nearest};
use crate::fluid::{DENSITY, Force, Layer, Layers, PowerKind};
use crate::metrics::Meter;
use crate::model::{Dynamics, Inputs, Mechanics, Model};
use crate::newton::Work;
use crate::rod::{bend, node};
use crate::system::{Form, State};

/// Who decides a variable's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Causality {
    /// Fixed by the scene.
    Parameter,
    /// Set by the host.
    Input,
    /// Computed.
    Output,
    /// Time.
    Independent,
}

impl Causality {
    /// The FMI standard's word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parameter => "parameter",
            Self::Input => "input",
            Self::Output => "output",
            Self::Independent => "independent",
        }
    }
}

/// Number of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// One.
    Scalar,
    /// One a node.
    Nodes,
    /// One a joint; a held head has one more, the half-cell joint at node 0, which comes first.
    Joints,
}

/// What variables are read from.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// Time as the host counts it, s.
    pub time: f64,
    /// The model.
    pub dynamics: &'a Dynamics,
    /// Inputs.
    pub inputs: &'a Inputs,
    /// State.
    pub state: &'a State,
    /// Measurements.
    pub meter: &'a Meter,
    /// The last whole cycles.
    pub cycles: &'a Cycles,
    /// Work of Newton's method.
    pub work: Work,
    /// Largest internal step, s.
    pub time_step: f64,
}

impl View<'_> {
    fn model(&self) -> &Model {
        &self.dynamics.model
    }

    /// Displacement of node `k` since the start along axis `i`.
    fn displacement(&self, k: usize, i: usize) -> f64 {
        self.state.q[2 * k + i] - self.meter.first_positions[2 * k + i]
    }

    /// The mean of `measure` over the last whole cycles; zero before the first, NaN where none can be known.
    fn average(&self, measure: &Measure) -> f64 {
        let cycles = self.cycles.whole(self.state.t);
        if cycles.is_empty() {
            if self.cycles.are_unknown(self.dynamics) { f64::NAN } else { 0.0 }
        } else {
            measure.mean(cycles, self.dynamics).unwrap_or(0.0)
        }
    }

    fn middle(&self) -> usize {
        (self.model().rod.nodes - 1) / 2
    }

    fn tip(&self) -> usize {
        self.model().rod.nodes - 1
    }
}

/// An input that an output follows at once, before any step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Feed {
    /// Its name.
    pub input: &'static str,
    /// Which of its entries.
    pub reach: Reach,
    /// Where it does.
    pub only: Only,
}

/// Where an output follows an input at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Only {
    /// Everywhere.
    Always,
    /// Where positions are the unknowns: in the chain form an edge's force is one itself, and waits for the step.
    InPositions,
    /// Where the rod is buoyant.
    WithBuoyancy,
    /// Where the rod takes its natural curvature: moments follow from balance then.
    OfShape,
    /// Where it does not: moments follow from the curvature.
    OfElasticity,
}

impl Only {
    fn holds(self, dynamics: &Dynamics, form: Form) -> bool {
        let shape = dynamics.mechanics == Mechanics::Shape;
        match self {
            Self::Always => true,
            Self::InPositions => form != Form::Chain && !shape,
            Self::WithBuoyancy => {
                let model = &dynamics.model;
                let in_layers =
                    |force: &dyn Force| force.sink() == Some(PowerKind::Load) && force.parameters().contains(&DENSITY);
                model.buoyancy.is_some() || model.forces.iter().any(in_layers)
            }
            Self::OfShape => shape,
            Self::OfElasticity => !shape,
        }
    }
}

/// Which entries of an input an entry of an output follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// All.
    All,
    /// That of its own node.
    Own,
    /// Those of the first nodes.
    First(usize),
}

const fn feed(input: &'static str, reach: Reach) -> Feed {
    Feed { input, reach, only: Only::Always }
}

const fn bent(input: &'static str, reach: Reach) -> Feed {
    Feed { input, reach, only: Only::InPositions }
}

const fn afloat(input: &'static str) -> Feed {
    Feed { input, reach: Reach::All, only: Only::WithBuoyancy }
}

const fn elastic(input: &'static str, reach: Reach) -> Feed {
    Feed { input, reach, only: Only::OfElasticity }
}

/// The same where the rod takes its natural curvature.
const fn of_shape<const N: usize>(feeds: &[Feed]) -> [Feed; N] {
    let mut all = [feeds[0]; N];
    let mut i = 0;
    while i < N {
        all[i] = Feed { reach: Reach::All, only: Only::OfShape, ..feeds[i] };
        i += 1;
    }
    all
}

/// `a`, then `b`: `N` in all.
const fn join<const N: usize>(a: &[Feed], b: &[Feed]) -> [Feed; N] {
    let mut all = [a[0]; N];
    let mut i = 0;
    while i < N {
        all[i] = if i < a.len() { a[i] } else { b[i - a.len()] };
        i += 1;
    }
    all
}

const FLUID: [Feed; 16] = [
    feed("viscosity_pa_s", Reach::All),
    feed("density_kg_m3", Reach::All),
    feed("flow_x_m_s", Reach::All),
    feed("flow_y_m_s", Reach::All),
    feed("interface_1_offset_m", Reach::All),
    feed("beyond_1_viscosity_pa_s", Reach::All),
    feed("beyond_1_density_kg_m3", Reach::All),
    feed("interface_2_offset_m", Reach::All),
    feed("beyond_2_viscosity_pa_s", Reach::All),
    feed("beyond_2_density_kg_m3", Reach::All),
    feed("interface_3_offset_m", Reach::All),
    feed("beyond_3_viscosity_pa_s", Reach::All),
    feed("beyond_3_density_kg_m3", Reach::All),
    feed("interface_4_offset_m", Reach::All),
    feed("beyond_4_viscosity_pa_s", Reach::All),
    feed("beyond_4_density_kg_m3", Reach::All),
];
const WAVE: [Feed; 2] = [elastic("actuation_amplitude", Reach::All), elastic("actuation_phase_rad", Reach::All)];
const NATURAL: &[Feed] = &[WAVE[0], WAVE[1], elastic("natural_curvature_1_m", Reach::All)];
const FORCES: &[Feed] = &[feed("force_x_n", Reach::All), feed("force_y_n", Reach::All)];
/// What the balance of a rod follows that takes its natural curvature.
const BALANCE: [Feed; 18] = of_shape(&join::<18>(&FLUID, FORCES));
const NATURAL_RATE: [Feed; 22] = join(
    &BALANCE,
    &[
        feed("actuation_amplitude", Reach::All),
        feed("actuation_phase_rad", Reach::All),
        feed("actuation_frequency_hz", Reach::All),
        NATURAL[2],
    ],
);
const OWN_NATURAL: [Feed; 21] = join(&BALANCE, &[WAVE[0], WAVE[1], elastic("natural_curvature_1_m", Reach::Own)]);
const HEAD_NATURAL: [Feed; 21] = join(&BALANCE, &[WAVE[0], WAVE[1], elastic("natural_curvature_1_m", Reach::First(1))]);
const LOADS: [Feed; 11] = join(
    &[
        afloat("density_kg_m3"),
        afloat("interface_1_offset_m"),
        afloat("beyond_1_density_kg_m3"),
        afloat("interface_2_offset_m"),
        afloat("beyond_2_density_kg_m3"),
        afloat("interface_3_offset_m"),
        afloat("beyond_3_density_kg_m3"),
        afloat("interface_4_offset_m"),
        afloat("beyond_4_density_kg_m3"),
    ],
    FORCES,
);
const HEAD: [Feed; 19] = join(
    &FLUID,
    &[
        bent("actuation_amplitude", Reach::All),
        bent("actuation_phase_rad", Reach::All),
        bent("natural_curvature_1_m", Reach::First(2)),
    ],
);
const HEAD_X: [Feed; 21] = join(&HEAD, &[feed("force_x_n", Reach::First(1)), BALANCE[16]]);
const HEAD_Y: [Feed; 21] = join(&HEAD, &[feed("force_y_n", Reach::First(1)), BALANCE[17]]);
const HEAD_POWER: [Feed; 24] = join(
    &FLUID,
    &[
        WAVE[0],
        WAVE[1],
        HEAD_NATURAL[20],
        HEAD[18],
        feed("force_x_n", Reach::First(1)),
        feed("force_y_n", Reach::First(1)),
        BALANCE[16],
        BALANCE[17],
    ],
);

/// Reads a variable, or one entry of it: the index is a node.
type Get = fn(&View<'_>, usize) -> f64;
/// The first change of a variable, from what is read now and its change.
type Tangent = fn(&View<'_>, &View<'_>, usize) -> f64;
/// Sets a variable at a time.
type Set = fn(&mut Dynamics, f64, &[f64]);
/// Sets the entries of an array from an index on.
type SetEntries = fn(&mut Dynamics, usize, &[f64]);

/// Decides whether a value is allowed, and says in words what is.
type Allowed = (fn(f64) -> bool, &'static str);

/// One variable.
#[derive(Debug)]
pub struct Variable {
    /// Name, ending in its unit.
    pub name: &'static str,
    /// SI unit; `1` where there is none.
    pub unit: &'static str,
    /// Who decides it.
    pub causality: Causality,
    /// What it is.
    pub description: &'static str,
    /// How many values it has.
    pub size: Size,
    /// True where trajectory.csv has it.
    pub recorded: bool,
    /// The inputs that it follows at once.
    pub feeds: &'static [Feed],
    fed_in: fn(&Model) -> bool,
    /// It is the stiffness of the rod, or follows it otherwise than by a curvature.
    elastic: bool,
    /// It is how a held head is turned, which follows from the time alone.
    turned: bool,
    needs: Needs,
    get: Get,
    /// Where it is not linear in state and readings; else its change is what is read of theirs.
    tangent: Option<Tangent>,
    set: Option<Set>,
    set_entries: Option<SetEntries>,
    /// For an input of a held head: the coordinate (x, y, angle) and the order of its derivative by time.
    head: Option<[usize; 2]>,
    /// Values that are allowed, beyond being finite.
    allowed: Option<Allowed>,
}

impl Variable {
    const fn new(
        causality: Causality,
        name: &'static str,
        unit: &'static str,
        description: &'static str,
        get: Get,
    ) -> Self {
        Self {
            name,
            unit,
            causality,
            description,
            size: Size::Scalar,
            recorded: false,
            feeds: &[],
            fed_in: |_| true,
            elastic: false,
            turned: false,
            needs: Needs { met: |_| true, what: "" },
            get,
            tangent: None,
            set: None,
            set_entries: None,
            head: None,
            allowed: None,
        }
    }

    const fn sized(self, size: Size) -> Self {
        Self { size, ..self }
    }

    const fn recorded(self) -> Self {
        Self { recorded: true, ..self }
    }

    const fn when(self, needs: Needs) -> Self {
        Self { needs, ..self }
    }

    const fn fed(self, feeds: &'static [Feed]) -> Self {
        Self { feeds, ..self }
    }

    const fn fed_in(self, fed_in: fn(&Model) -> bool) -> Self {
        Self { fed_in, ..self }
    }

    const fn elastic(self) -> Self {
        Self { elastic: true, ..self }
    }

    const fn turned(self) -> Self {
        Self { turned: true, ..self }
    }

    const fn changing(self, tangent: Tangent) -> Self {
        Self { tangent: Some(tangent), ..self }
    }

    const fn at_least_zero(self) -> Self {
        Self { allowed: Some((|x| x >= 0.0, "a number that is not negative")), ..self }
    }

    /// True where a scene with `model` has it.
    pub fn exists_in(&self, model: &Model) -> bool {
        (self.needs.met)(model)
    }

    /// Its smallest value, where there is one.
    pub fn least(&self) -> Option<f64> {
        self.allowed.map(|_| 0.0)
    }

    /// True if it is set by a host.
    pub fn is_input(&self) -> bool {
        self.causality == Causality::Input
    }

    /// The nodes of the entries of `input` that its own entry at node `k` follows at once in `dynamics` that are solved in `form`.
    pub fn follows(&self, k: usize, input: &Self, dynamics: &Dynamics, form: Form) -> std::ops::Range<usize> {
        let model = &*dynamics.model;
        let entries = input.entries(model);
        let feeds = self.feeds.iter().filter(|feed| feed.input == input.name && (self.fed_in)(model));
        let reach = feeds.filter(|feed| feed.only.holds(dynamics, form)).map(|feed| match feed.reach {
            Reach::Own => k..k + 1,
            Reach::First(count) if input.size != Size::Scalar => 0..count,
            Reach::All | Reach::First(_) => entries.clone(),
        });
        let reach = reach.max_by_key(std::ops::Range::len).unwrap_or(0..0);
        reach.start.max(entries.start)..reach.end.min(entries.end).max(entries.start.max(reach.start))
    }

    /// True where an entry follows some entry of the input called `name` at once.
    fn is_fed_by(&self, name: &str, dynamics: &Dynamics, form: Form) -> bool {
        let mut feeds = self.feeds.iter().filter(|feed| feed.input == name && (self.fed_in)(&dynamics.model));
        feeds.any(|feed| feed.only.holds(dynamics, form))
    }

    /// True where it follows the scene's tunable parameter of this `key` at once, see
    /// [`is_tunable`](crate::scene::parameter::Parameter::is_tunable): moments follow the stiffness, forces of the fluid their coefficients.
    pub fn follows_parameter(&self, key: &str, dynamics: &Dynamics, form: Form) -> bool {
        match key {
            "rod.youngs_modulus_pa" => self.elastic || self.is_fed_by("natural_curvature_1_m", dynamics, form),
            _ => self.is_fed_by("viscosity_pa_s", dynamics, form),
        }
    }

    /// True where it follows the time at once, in a state that stays: by the drive, a flow that changes by itself, or a head that
    /// is moved.
    pub fn follows_time(&self, dynamics: &Dynamics, form: Form) -> bool {
        let model = &*dynamics.model;
        let drive = model.actuation.is_some() && self.is_fed_by("actuation_phase_rad", dynamics, form);
        let flow = model.flow.is_some() && self.is_fed_by("flow_x_m_s", dynamics, form);
        let head = model.head.is_some() && self.turned;
        self.causality == Causality::Output && (drive || flow || head)
    }

    /// The nodes of its entries; a scalar has one entry.
    pub fn entries(&self, model: &Model) -> std::ops::Range<usize> {
        match self.size {
            Size::Scalar => 0..1,
            Size::Nodes => 0..model.rod.nodes,
            Size::Joints => model.rod.joints(),
        }
    }

    /// Number of values in `model`.
    pub fn len(&self, model: &Model) -> usize {
        self.entries(model).len()
    }

    /// Writes its values to `out`, which has [`len`](Self::len) entries.
    pub fn read(&self, view: &View<'_>, out: &mut [f64]) {
        for (value, k) in out.iter_mut().zip(self.entries(view.model())) {
            *value = (self.get)(view, k);
        }
    }

    /// Its value at node `k`; none where that is none of its [`entries`](Self::entries).
    #[inline]
    pub fn at(&self, view: &View<'_>, k: usize) -> Option<f64> {
        self.entries(view.model()).contains(&k).then(|| (self.get)(view, k))
    }

    /// The first change of what is no parameter at node `k` when what is read `now` changes by `change`.
    pub(crate) fn change(&self, now: &View<'_>, change: &View<'_>, k: usize) -> f64 {
        match (self.causality, self.tangent) {
            (Causality::Parameter, _) => 0.0,
            (_, Some(tangent)) => tangent(now, change, k),
            (_, None) => match self.head {
                None => (self.get)(change, k),
                // What a host says of its head changes by time only.
                Some([i, order]) => change.time * head_said(now, i, order + 1),
            },
        }
    }

    /// Its value, or its first.
    pub fn first(&self, view: &View<'_>) -> f64 {
        (self.get)(view, self.entries(view.model()).start)
    }

    /// The coordinate (x, y, angle) of a held head whose derivative by time it is, and the order of that.
    pub fn of_head(&self) -> Option<[usize; 2]> {
        self.head
    }

    /// Sets its entries from index `first` on at time `t` (s); the caller has checked values and length.
    pub(crate) fn write(&self, dynamics: &mut Dynamics, t: f64, first: usize, values: &[f64]) {
        if let Some([i, order]) = self.head {
            dynamics.say_head(t, i, order, values[0], false);
        }
        if let Some(set) = self.set {
            set(dynamics, t, values);
        }
        if let Some(set) = self.set_entries {
            set(dynamics, first, values);
        }
    }

    /// Sets `count` of its entries from index `first` on to zero at time `t` (s).
    pub(crate) fn clear(&self, dynamics: &mut Dynamics, t: f64, first: usize, count: usize) {
        let mut zeros = std::mem::take(&mut dynamics.unused);
        zeros.clear();
        zeros.resize(count, 0.0);
        self.write(dynamics, t, first, &zeros);
        dynamics.unused = zeros;
    }

    /// The first value that is not allowed, and what is.
    pub fn refused(&self, values: &[f64]) -> Option<(f64, &'static str)> {
        let (ok, allowed) = self.allowed.unwrap_or((|_| true, "a finite number"));
        values.iter().find(|x| !x.is_finite() || !ok(**x)).map(|x| (*x, allowed))
    }
}

const fn parameter(name: &'static str, unit: &'static str, description: &'static str, get: Get) -> Variable {
    Variable::new(Causality::Parameter, name, unit, description, get)
}

const fn input(name: &'static str, unit: &'static str, description: &'static str, get: Get, set: Set) -> Variable {
    let mut variable = Variable::new(Causality::Input, name, unit, description, get);
    variable.set = Some(set);
    variable
}

/// An input of one value a joint or node.
const fn input_array(
    name: &'static str,
    unit: &'static str,
    description: &'static str,
    size: Size,
    get: Get,
    set: SetEntries,
) -> Variable {
    let mut variable = Variable::new(Causality::Input, name, unit, description, get);
    variable.set_entries = Some(set);
    variable.sized(size)
}

/// An input of a held head: the derivative of order `order` of its coordinate `i`.
const fn head_input(
    name: &'static str,
    unit: &'static str,
    description: &'static str,
    get: Get,
    i: usize,
    order: usize,
) -> Variable {
    let mut variable = Variable::new(Causality::Input, name, unit, description, get);
    variable.head = Some([i, order]);
    variable.when(HELD_HEAD)
}

const fn output(name: &'static str, unit: &'static str, description: &'static str, get: Get) -> Variable {
    Variable::new(Causality::Output, name, unit, description, get)
}

/// A mean over the last whole cycles, which no input changes at once; zero before the first is over.
const fn average(measure: &Measure, get: Get) -> Variable {
    output(measure.key, measure.unit, measure.description, get).changing(|_, _, _| 0.0)
}

/// What a scene must have for a variable to be there.
#[derive(Debug, Clone, Copy)]
struct Needs {
    met: fn(&Model) -> bool,
    /// In words.
    what: &'static str,
}

const ACTUATION: Needs = Needs { met: has_actuation, what: "an [actuation]" };
const BODY: Needs = Needs { met: has_body, what: "a [head_body]" };
const DENSE_FLUID: Needs = Needs {
    met: has_dense_fluid,
    what: "a force that depends on the density of the fluid: buoyancy, [reactive], or a drag law with inertia",
};
const FLUID_THERE: Needs = Needs { met: has_fluid, what: "a [medium] that acts on the rod" };
const HELD_HEAD: Needs = Needs { met: has_held_head, what: r#"a held head: [head] with kind = "clamped" or "driven""# };
const INERTIAL_FLUID: Needs = Needs { met: has_inertial_fluid, what: "a fluid that the rod accelerates: [reactive]" };
const OTHER_FORCES: Needs = Needs { met: has_other_forces, what: "a force of your own" };
const SPRAY: Needs = Needs { met: has_spray, what: "[reactive] and a medium with interfaces" };
const FREE: Needs = Needs { met: is_free, what: "a free head" };
const FLOW_X: Needs = Needs { met: has_flow::<0>, what: "a [medium] that may flow along this axis" };
const FLOW_Y: Needs = Needs { met: has_flow::<1>, what: "a [medium] that may flow along this axis" };
const INTERFACE_1: Needs = Needs { met: has_interface::<1>, what: "[medium.beyond] or one of [[medium.layers]]" };
const INTERFACE_2: Needs = Needs { met: has_interface::<2>, what: "two layers in [[medium.layers]]" };
const INTERFACE_3: Needs = Needs { met: has_interface::<3>, what: "three layers in [[medium.layers]]" };
const INTERFACE_4: Needs = Needs { met: has_interface::<4>, what: "four layers in [[medium.layers]]" };

fn has_actuation(model: &Model) -> bool {
    model.actuation.is_some()
}

fn has_fluid(model: &Model) -> bool {
    model.forces.iter().any(Force::is_of_fluid)
}

/// True where a host may make the fluid flow along that axis: never across an interface.
fn has_flow<const AXIS: usize>(model: &Model) -> bool {
    let crosses = |layers: Layers| layers.iter().len() > 0 && layers.normal[AXIS] != 0.0;
    has_fluid(model) && !model.layers.is_some_and(crosses)
}

/// True where the medium has at least that many interfaces that a force feels.
fn has_interface<const COUNT: usize>(model: &Model) -> bool {
    !model.forces.is_empty() && model.layers.is_some_and(|layers| layers.iter().len() >= COUNT)
}

/// Interface `j` with the fluid beyond.
fn layer<'a>(view: &View<'a>, j: usize) -> Option<&'a Layer> {
    view.inputs.layers.as_ref()?.get(j)
}

fn set_layer(dynamics: &mut Dynamics, j: usize, set: impl FnOnce(&mut Layer)) {
    if let Some(layer) = dynamics.inputs.layers.as_mut().and_then(|layers| layers.get_mut(j)) {
        set(layer);
    }
}

fn has_dense_fluid(model: &Model) -> bool {
    model.buoyancy.is_some() || model.forces.iter().any(|force| force.parameters().contains(&DENSITY))
}

fn has_inertial_fluid(model: &Model) -> bool {
    model.forces.are_inertial()
}

fn has_spray(model: &Model) -> bool {
    model.forces.iter().any(|force| force.sink() == Some(PowerKind::Spray))
}

fn has_other_forces(model: &Model) -> bool {
    model.forces.iter().any(|force| !force.is_of_fluid() && force.sink() != Some(PowerKind::Load))
}

fn has_body(model: &Model) -> bool {
    model.rod.body.is_some()
}

/// Direction of the body's axis from +x, in (−π, π], rad.
fn body_angle(state: &State) -> f64 {
    let [x, y] = [0, 1].map(|i| state.q[2 + i] - state.q[i]);
    y.atan2(x)
}

/// Its change: n·δe/ℓ.
fn body_angle_change(now: &View<'_>, change: &View<'_>, _: usize) -> f64 {
    let along = |state: &State| [0, 1].map(|i| state.q[2 + i] - state.q[i]);
    let ([x, y], [dx, dy]) = (along(now.state), along(change.state));
    (x * dy - y * dx) / (x * x + y * y)
}

fn is_free(model: &Model) -> bool {
    model.head.is_none()
}

fn has_held_head(model: &Model) -> bool {
    model.head.is_some()
}

/// The derivative of order `order` of coordinate `i` (x, y, angle) of the head: what the host gave last, else as it moves.
fn head_said(view: &View<'_>, i: usize, order: usize) -> f64 {
    let host = view.inputs.head.as_ref().and_then(|host| host.axes[i].as_ref());
    host.and_then(|axis| axis.said(order)).unwrap_or_else(|| head(view, i, order))
}

/// How the head moves.
fn head(view: &View<'_>, i: usize, order: usize) -> f64 {
    let Some(pose) = &view.dynamics.held else { return 0.0 };
    let sample = &pose[i];
    [sample.value, sample.rate, sample.acceleration].get(order).copied().unwrap_or_default()
}

/// Velocity of the centre of mass along `axis`, m/s.
fn com_velocity(view: &View<'_>, axis: usize) -> f64 {
    let rod = &view.dynamics.model.rod;
    let momentum = rod.mass.iter().zip(view.state.v.chunks_exact(2)).map(|(mass, v)| mass * v[axis]);
    momentum.sum::<f64>() / rod.total_mass()
}

/// Angle and spin at an end of the rod, node `k`: of a held head, else of the edge there.
fn turn(view: &View<'_>, k: usize) -> [f64; 2] {
    match &view.dynamics.held {
        Some([_, _, angle]) if k == 0 => [angle.value, angle.rate],
        _ => {
            let [edge, velocity] = [&view.state.q, &view.state.v].map(|values| across(values, k));
            [edge.y.atan2(edge.x), edge.perp(&velocity) / edge.norm_squared()]
        }
    }
}

/// The change of that.
fn turn_change(now: &View<'_>, change: &View<'_>, k: usize) -> [f64; 2] {
    match &now.dynamics.held {
        Some([_, _, angle]) if k == 0 => [angle.rate, angle.acceleration].map(|rate| rate * change.time),
        _ => {
            let [edge, velocity] = [&now.state.q, &now.state.v].map(|values| across(values, k));
            let [moved, faster] = [&change.state.q, &change.state.v].map(|values| across(values, k));
            let square = edge.norm_squared();
            let spin = edge.perp(&velocity) / square;
            let turned = edge.perp(&moved) / square;
            [turned, (moved.perp(&velocity) + edge.perp(&faster) - 2.0 * spin * edge.dot(&moved)) / square]
        }
    }
}

/// The difference over the edge at the end `k` of the rod.
fn across(values: &[f64], k: usize) -> Vector2<f64> {
    let first = k.saturating_sub(1);
    node(values, first + 1) - node(values, first)
}

/// A host's forces along axis `i` on the nodes from `first` on.
fn set_force(dynamics: &mut Dynamics, i: usize, first: usize, values: &[f64]) {
    let nodes = dynamics.model.rod.nodes;
    let force = dynamics.inputs.force.get_or_insert_with(|| vec![0.0; 2 * nodes]);
    for (k, value) in values.iter().enumerate() {
        force[2 * (first + k) + i] = *value;
    }
}

fn set_natural_curvature(dynamics: &mut Dynamics, first: usize, values: &[f64]) {
    let (joints, nodes) = (dynamics.model.rod.joints(), dynamics.model.rod.nodes);
    let natural = dynamics.inputs.natural.get_or_insert_with(|| vec![0.0; nodes]);
    natural[joints.start + first..][..values.len()].copy_from_slice(values);
}

/// The change of the mean efficiency of the last whole cycles: of the drag of the straight rod in the fluid as it is now.
fn efficiency_change(now: &View<'_>, change: &View<'_>, _: usize) -> f64 {
    let cycles = now.cycles.whole(now.state.t);
    let (fluid, by) = (&now.inputs.fluid, &change.inputs.fluid);
    if cycles.is_empty() || change.time != 0.0 {
        return 0.0; // the cycles that are over stay, and are those of this fluid
    }
    let at = |share: f64| {
        let mut fluid = *fluid;
        fluid.add(by, share);
        cycle::efficiency(cycles, now.dynamics, fluid).unwrap_or(0.0)
    };
    let size = (by.viscosity / fluid.viscosity).abs().max((by.density / fluid.density).abs());
    let share = 1e-5 / if size > 0.0 && size.is_finite() { size } else { 1.0 };
    (at(share) - at(-share)) / (2.0 * share)
}

fn joint_moment_change(now: &View<'_>, change: &View<'_>, k: usize) -> f64 {
    let (kappa, moment) = (now.meter.now.kappa[k], now.meter.now.moment[k]);
    let (turned, more) = (change.meter.now.kappa[k], change.meter.now.moment[k]);
    more * bend::curvature_per_turning(kappa) + moment * 0.5 * kappa * turned
}

fn of(values: &Option<Vec<f64>>, i: usize) -> f64 {
    values.as_ref().map_or(0.0, |values| values[i])
}

/// That no variable of a scene has this `name`: what it would need, or which of those that are `there` has a similar name.
pub(crate) fn unknown(name: &str, there: impl Iterator<Item = &'static str>) -> Error {
    let elsewhere = VARIABLES.iter().find(|variable| variable.name == name && !variable.needs.what.is_empty());
    let needs = elsewhere.map(|variable| variable.needs.what);
    Error::UnknownVariable {
        name: name.to_string(),
        nearest: nearest(name, there.filter(|other| *other != name)),
        needs,
    }
}

/// All variables, in the order in which every face shows them.
#[rustfmt::skip]
pub static VARIABLES: &[Variable] = &[
    Variable::new(Causality::Independent, "time_s", "s", "time", |v, _| v.time).recorded(),

    output("x_com_m", "m", "centre of mass, x", |v, _| v.meter.now.com.x).recorded(),
    output("y_com_m", "m", "centre of mass, y", |v, _| v.meter.now.com.y).recorded(),
    output("vx_com_m_s", "m/s", "velocity of the centre of mass, x", |v, _| com_velocity(v, 0)),
    output("vy_com_m_s", "m/s", "velocity of the centre of mass, y", |v, _| com_velocity(v, 1)),
    output("stretching_energy_j", "J", "stretching energy", |v, _| v.meter.now.energy.stretching).recorded().elastic(),
    output("bending_energy_j", "J", "bending energy", |v, _| v.meter.now.energy.bending).fed(NATURAL).recorded(),
    output("kinetic_energy_j", "J", "kinetic energy", |v, _| v.meter.now.energy.kinetic).recorded(),
    output("fluid_energy_j", "J", "energy of the fluid that the rod accelerates", |v, _| v.meter.now.energy.fluid).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("actuation_power_w", "W", "power put in by the moving natural curvature", |v, _| v.meter.now.power.actuation).fed(&NATURAL_RATE).recorded(),
    output("viscous_power_w", "W", "power taken by viscosity", |v, _| v.meter.now.power.viscous).fed(&FLUID).recorded(),
    output("wake_power_w", "W", "power taken by the wake", |v, _| v.meter.now.power.wake).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("spray_power_w", "W", "power taken by the spray at interfaces", |v, _| v.meter.now.power.spray).when(SPRAY).fed(&FLUID).recorded(),
    output("other_power_w", "W", "power put in by other forces", |v, _| v.meter.now.power.other).when(OTHER_FORCES).recorded(),
    output("load_power_w", "W", "power put in by gravity, point loads and host forces", |v, _| v.meter.now.power.load).fed(&LOADS).recorded(),
    output("head_power_w", "W", "power put in by the held head", |v, _| v.meter.now.power.head).fed(&HEAD_POWER).fed_in(has_held_head).recorded(),
    output("flow_power_w", "W", "power put in by the background flow", |v, _| v.meter.now.power.flow).fed(&FLUID).recorded(),
    output("head_dx_m", "m", "displacement of node 0, the head or the centre of a head body, since the start, x", |v, _| v.displacement(0, 0)).recorded(),
    output("head_dy_m", "m", "displacement of node 0 since the start, y", |v, _| v.displacement(0, 1)).recorded(),
    output("mid_dx_m", "m", "displacement of the middle node since the start, x", |v, _| v.displacement(v.middle(), 0)).recorded(),
    output("mid_dy_m", "m", "displacement of the middle node since the start, y", |v, _| v.displacement(v.middle(), 1)).recorded(),
    output("tip_dx_m", "m", "displacement of the tip node since the start, x", |v, _| v.displacement(v.tip(), 0)).recorded(),
    output("tip_dy_m", "m", "displacement of the tip node since the start, y", |v, _| v.displacement(v.tip(), 1)).recorded(),
    output("tip_x_m", "m", "tip node, x", |v, _| v.state.q[2 * v.tip()]),
    output("tip_y_m", "m", "tip node, y", |v, _| v.state.q[2 * v.tip() + 1]),
    output("tip_angle_rad", "rad", "direction of the tip, from +x, within a half turn", |v, _| turn(v, v.tip())[0]).changing(|now, change, _| turn_change(now, change, now.tip())[0]),
    output("tip_vx_m_s", "m/s", "velocity of the tip node, x", |v, _| v.state.v[2 * v.tip()]),
    output("tip_vy_m_s", "m/s", "velocity of the tip node, y", |v, _| v.state.v[2 * v.tip() + 1]),
    output("tip_spin_rad_s", "rad/s", "angular velocity of the tip", |v, _| turn(v, v.tip())[1]).changing(|now, change, _| turn_change(now, change, now.tip())[1]),
    output("pose_x_m", "m", "position of the head as it moves, x", |v, _| v.state.q[0]),
    output("pose_y_m", "m", "position of the head as it moves, y", |v, _| v.state.q[1]),
    output("pose_angle_rad", "rad", "direction of the head as it moves, from +x; of a free one within a half turn", |v, _| turn(v, 0)[0]).changing(|now, change, _| turn_change(now, change, 0)[0]).turned(),
    output("pose_vx_m_s", "m/s", "velocity of the head as it moves, x", |v, _| v.state.v[0]),
    output("pose_vy_m_s", "m/s", "velocity of the head as it moves, y", |v, _| v.state.v[1]),
    output("pose_spin_rad_s", "rad/s", "angular velocity of the head as it moves", |v, _| turn(v, 0)[1]).changing(|now, change, _| turn_change(now, change, 0)[1]).turned(),
    output("head_force_x_n", "N", "force of the tail on the held head, x", |v, _| v.meter.now.head_force.x).when(HELD_HEAD).fed(&HEAD_X).recorded(),
    output("head_force_y_n", "N", "force of the tail on the held head, y", |v, _| v.meter.now.head_force.y).when(HELD_HEAD).fed(&HEAD_Y).recorded(),
    output("head_moment_n_m", "N m", "moment of the tail on the held head about node 0", |v, _| v.meter.now.head_moment).when(HELD_HEAD).fed(&HEAD_NATURAL).recorded(),
    output("body_x_m", "m", "centre of the head body, x", |v, _| v.state.q[0]).when(BODY).recorded(),
    output("body_y_m", "m", "centre of the head body, y", |v, _| v.state.q[1]).when(BODY).recorded(),
    output("body_angle_rad", "rad", "direction of the head body's axis, along which the rod begins, from +x", |v, _| body_angle(v.state)).when(BODY).changing(body_angle_change).recorded(),
    output("drag_force_x_n", "N", "force of drag on the rod, x", |v, _| v.meter.now.push.drag.x).when(FLUID_THERE).fed(&FLUID).recorded(),
    output("drag_force_y_n", "N", "force of drag on the rod, y", |v, _| v.meter.now.push.drag.y).when(FLUID_THERE).fed(&FLUID).recorded(),
    output("reactive_force_x_n", "N", "force on the rod of the fluid that it accelerates, the wake apart, x", |v, _| v.meter.now.push.inertia.x).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("reactive_force_y_n", "N", "force on the rod of the fluid that it accelerates, the wake apart, y", |v, _| v.meter.now.push.inertia.y).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("wake_force_x_n", "N", "force on the tip of the wake that leaves it, x", |v, _| v.meter.now.push.wake.x).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("wake_force_y_n", "N", "force on the tip of the wake that leaves it, y", |v, _| v.meter.now.push.wake.y).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("rod_momentum_x_n_s", "N s", "momentum of the rod, x", |v, _| v.meter.now.momentum.rod.x).when(INERTIAL_FLUID).recorded(),
    output("rod_momentum_y_n_s", "N s", "momentum of the rod, y", |v, _| v.meter.now.momentum.rod.y).when(INERTIAL_FLUID).recorded(),
    output("fluid_momentum_x_n_s", "N s", "momentum of the fluid that the rod accelerates, against the flow, x", |v, _| v.meter.now.momentum.fluid.x).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("fluid_momentum_y_n_s", "N s", "momentum of the fluid that the rod accelerates, against the flow, y", |v, _| v.meter.now.momentum.fluid.y).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("drag_impulse_x_n_s", "N s", "impulse of drag since the start, x", |v, _| v.meter.totals.impulse.drag.x).when(INERTIAL_FLUID),
    output("drag_impulse_y_n_s", "N s", "impulse of drag since the start, y", |v, _| v.meter.totals.impulse.drag.y).when(INERTIAL_FLUID),
    output("wake_impulse_x_n_s", "N s", "impulse of the wake since the start, x", |v, _| v.meter.totals.impulse.wake.x).when(INERTIAL_FLUID),
    output("wake_impulse_y_n_s", "N s", "impulse of the wake since the start, y", |v, _| v.meter.totals.impulse.wake.y).when(INERTIAL_FLUID),
    output("flow_impulse_x_n_s", "N s", "impulse of the pressure of a flow that accelerates since the start, x", |v, _| v.meter.totals.impulse.flow.x).when(INERTIAL_FLUID).fed(&FLUID),
    output("flow_impulse_y_n_s", "N s", "impulse of the pressure of a flow that accelerates since the start, y", |v, _| v.meter.totals.impulse.flow.y).when(INERTIAL_FLUID).fed(&FLUID),
    output("load_impulse_x_n_s", "N s", "impulse of loads since the start, x", |v, _| v.meter.totals.impulse.load.x).when(INERTIAL_FLUID),
    output("load_impulse_y_n_s", "N s", "impulse of loads since the start, y", |v, _| v.meter.totals.impulse.load.y).when(INERTIAL_FLUID),
    output("head_impulse_x_n_s", "N s", "impulse of the held head since the start, x", |v, _| v.meter.totals.impulse.head.x).when(INERTIAL_FLUID),
    output("head_impulse_y_n_s", "N s", "impulse of the held head since the start, y", |v, _| v.meter.totals.impulse.head.y).when(INERTIAL_FLUID),
    output("momentum_defect_x_n_s", "N s", "defect of the balance of momentum since the start, x", |v, _| v.meter.momentum_defect().x).when(INERTIAL_FLUID),
    output("momentum_defect_y_n_s", "N s", "defect of the balance of momentum since the start, y", |v, _| v.meter.momentum_defect().y).when(INERTIAL_FLUID),
    output("net_displacement_m", "m", "x of the centre of mass since the start", |v, _| v.meter.net_displacement()),
    output("max_lateral_excursion_m", "m", "largest |y| of the centre of mass so far", |v, _| v.meter.totals.max_lateral),
    output("actuation_work_j", "J", "work put in by the moving natural curvature since the start", |v, _| v.meter.totals.work.actuation).fed(NATURAL).recorded(),
    output("viscous_work_j", "J", "work taken by viscosity since the start", |v, _| v.meter.totals.work.viscous).recorded(),
    output("wake_work_j", "J", "work taken by the wake since the start", |v, _| v.meter.totals.work.wake).when(INERTIAL_FLUID).recorded(),
    output("spray_work_j", "J", "work taken by the spray at interfaces since the start", |v, _| v.meter.totals.work.spray).when(SPRAY).recorded(),
    output("other_work_j", "J", "work put in by other forces since the start", |v, _| v.meter.totals.work.other).when(OTHER_FORCES).recorded(),
    output("load_work_j", "J", "work put in by loads since the start", |v, _| v.meter.totals.work.load).recorded(),
    output("head_work_j", "J", "work put in by the held head since the start", |v, _| v.meter.totals.work.head).recorded(),
    output("flow_work_j", "J", "work put in by the background flow since the start", |v, _| v.meter.totals.work.flow).fed(&FLUID).fed_in(has_inertial_fluid).recorded(),
    output("numerical_dissipation_j", "J", "defect of the energy balance since the start", |v, _| v.meter.numerical_dissipation()).recorded(),
    output("steps", "1", "steps made", |v, _| v.meter.totals.steps as f64),
    output("newton_iterations", "1", "Newton iterations made", |v, _| v.work.newton_iterations as f64),
    output("step_halvings", "1", "times that a step was halved", |v, _| v.meter.totals.halvings as f64),
    output("x_m", "m", "nodes, x", |v, k| v.state.q[2 * k]).sized(Size::Nodes),
    output("y_m", "m", "nodes, y", |v, k| v.state.q[2 * k + 1]).sized(Size::Nodes),
    output("vx_m_s", "m/s", "velocity of the nodes, x", |v, k| v.state.v[2 * k]).sized(Size::Nodes),
    output("vy_m_s", "m/s", "velocity of the nodes, y", |v, k| v.state.v[2 * k + 1]).sized(Size::Nodes),
    output("curvature_1_m", "1/m", "curvature at the joints", |v, k| v.meter.now.kappa[k] / (v.model().rod.joint_part(k) * v.model().rod.spacing)).sized(Size::Joints),
    output("joint_moment_n_m", "N m", "bending moment at the joints, the couple that passes through them", |v, k| v.meter.now.moment[k] * bend::curvature_per_turning(v.meter.now.kappa[k])).sized(Size::Joints).fed(&OWN_NATURAL).changing(joint_moment_change),

    output("cycles_used", "1", "whole cycles that the averages named cycle_... are over", |v, _| v.cycles.whole(v.state.t).len() as f64).changing(|_, _, _| 0.0),
    output("cycles_periodic", "1", "1 where these cycles are alike to 1 %, else 0", |v, _| f64::from(cycle::is_periodic(v.cycles.whole(v.state.t)) == Some(true))).changing(|_, _, _| 0.0),
    average(&cycle::PERIOD, |v, _| v.average(&cycle::PERIOD)),
    average(&cycle::SPEED, |v, _| v.average(&cycle::SPEED)),
    average(&cycle::FORWARD_SPEED, |v, _| v.average(&cycle::FORWARD_SPEED)),
    average(&cycle::DIRECTION, |v, _| v.average(&cycle::DIRECTION)),
    average(&cycle::BODY_LENGTHS, |v, _| v.average(&cycle::BODY_LENGTHS)),
    average(&cycle::STROUHAL, |v, _| v.average(&cycle::STROUHAL)),
    average(&cycle::SLIP, |v, _| v.average(&cycle::SLIP)).when(ACTUATION),
    average(&cycle::THRUST, |v, _| v.average(&cycle::THRUST)).when(HELD_HEAD),
    average(&cycle::DRAG_THRUST, |v, _| v.average(&cycle::DRAG_THRUST)).when(INERTIAL_FLUID),
    average(&cycle::REACTIVE_THRUST, |v, _| v.average(&cycle::REACTIVE_THRUST)).when(INERTIAL_FLUID),
    average(&cycle::HEAD_FORCE_X, |v, _| v.average(&cycle::HEAD_FORCE_X)).when(HELD_HEAD),
    average(&cycle::HEAD_FORCE_Y, |v, _| v.average(&cycle::HEAD_FORCE_Y)).when(HELD_HEAD),
    average(&cycle::HEAD_MOMENT, |v, _| v.average(&cycle::HEAD_MOMENT)).when(HELD_HEAD),
    average(&cycle::ACTUATION_POWER, |v, _| v.average(&cycle::ACTUATION_POWER)),
    average(&cycle::VISCOUS_POWER, |v, _| v.average(&cycle::VISCOUS_POWER)),
    average(&cycle::WAKE_POWER, |v, _| v.average(&cycle::WAKE_POWER)).when(INERTIAL_FLUID),
    average(&cycle::LOAD_POWER, |v, _| v.average(&cycle::LOAD_POWER)),
    average(&cycle::HEAD_POWER, |v, _| v.average(&cycle::HEAD_POWER)),
    average(&cycle::FLOW_POWER, |v, _| v.average(&cycle::FLOW_POWER)),
    average(&cycle::COST_OF_TRANSPORT, |v, _| v.average(&cycle::COST_OF_TRANSPORT)).when(FREE),
    average(&cycle::EFFICIENCY, |v, _| v.average(&cycle::EFFICIENCY)).when(FREE).fed(&FLUID).changing(efficiency_change),

    input("actuation_amplitude", "1", "amplitude kappa_amp of the actuation, a turning per reference length; of a sine-wave a factor of its curvature", |v, _| v.inputs.drive.amplitude, |d, _, x| d.inputs.drive.amplitude = x[0]).when(ACTUATION),
    input("actuation_frequency_hz", "Hz", "frequency of the actuation; a change keeps the phase", |v, _| v.inputs.drive.frequency, |d, t, x| d.inputs.set_frequency(x[0], t)).when(ACTUATION).at_least_zero(),
    input("actuation_phase_rad", "rad", "phase subtracted inside the wave's sine", |v, _| v.inputs.phase_offset, |d, _, x| d.inputs.phase_offset = x[0]).when(ACTUATION),
    input_array("natural_curvature_1_m", "1/m", "the host's own natural curvature at the joints, beside the actuation's", Size::Joints, |v, k| of(&v.inputs.natural, k), set_natural_curvature),
    input_array("force_x_n", "N", "the host's forces on the nodes, x", Size::Nodes, |v, k| of(&v.inputs.force, 2 * k), |d, first, x| set_force(d, 0, first, x)),
    input_array("force_y_n", "N", "the host's forces on the nodes, y", Size::Nodes, |v, k| of(&v.inputs.force, 2 * k + 1), |d, first, x| set_force(d, 1, first, x)),
    input("viscosity_pa_s", "Pa s", "dynamic viscosity of the medium", |v, _| v.inputs.fluid.viscosity, |d, _, x| d.inputs.fluid.viscosity = x[0]).when(FLUID_THERE).at_least_zero(),
    input("density_kg_m3", "kg/m^3", "density of the medium", |v, _| v.inputs.fluid.density, |d, _, x| d.inputs.fluid.density = x[0]).when(DENSE_FLUID).at_least_zero(),
    input("flow_x_m_s", "m/s", "background velocity of the medium, x", |v, _| v.inputs.fluid.flow.x, |d, _, x| d.take_over_flow().x = x[0]).when(FLOW_X),
    input("flow_y_m_s", "m/s", "background velocity of the medium, y", |v, _| v.inputs.fluid.flow.y, |d, _, x| d.take_over_flow().y = x[0]).when(FLOW_Y),
    input("interface_1_offset_m", "m", "where interface 1 is along its normal", |v, _| layer(v, 0).map_or(0.0, |layer| layer.offset), |d, _, x| set_layer(d, 0, |layer| layer.offset = x[0])).when(INTERFACE_1),
    input("beyond_1_viscosity_pa_s", "Pa s", "dynamic viscosity beyond interface 1", |v, _| layer(v, 0).map_or(0.0, |layer| layer.fluid.viscosity), |d, _, x| set_layer(d, 0, |layer| layer.fluid.viscosity = x[0])).when(INTERFACE_1).at_least_zero(),
    input("beyond_1_density_kg_m3", "kg/m^3", "density beyond interface 1", |v, _| layer(v, 0).map_or(0.0, |layer| layer.fluid.density), |d, _, x| set_layer(d, 0, |layer| layer.fluid.density = x[0])).when(INTERFACE_1).at_least_zero(),
    input("interface_2_offset_m", "m", "where interface 2 is along its normal", |v, _| layer(v, 1).map_or(0.0, |layer| layer.offset), |d, _, x| set_layer(d, 1, |layer| layer.offset = x[0])).when(INTERFACE_2),
    input("beyond_2_viscosity_pa_s", "Pa s", "dynamic viscosity beyond interface 2", |v, _| layer(v, 1).map_or(0.0, |layer| layer.fluid.viscosity), |d, _, x| set_layer(d, 1, |layer| layer.fluid.viscosity = x[0])).when(INTERFACE_2).at_least_zero(),
    input("beyond_2_density_kg_m3", "kg/m^3", "density beyond interface 2", |v, _| layer(v, 1).map_or(0.0, |layer| layer.fluid.density), |d, _, x| set_layer(d, 1, |layer| layer.fluid.density = x[0])).when(INTERFACE_2).at_least_zero(),
    input("interface_3_offset_m", "m", "where interface 3 is along its normal", |v, _| layer(v, 2).map_or(0.0, |layer| layer.offset), |d, _, x| set_layer(d, 2, |layer| layer.offset = x[0])).when(INTERFACE_3),
    input("beyond_3_viscosity_pa_s", "Pa s", "dynamic viscosity beyond interface 3", |v, _| layer(v, 2).map_or(0.0, |layer| layer.fluid.viscosity), |d, _, x| set_layer(d, 2, |layer| layer.fluid.viscosity = x[0])).when(INTERFACE_3).at_least_zero(),
    input("beyond_3_density_kg_m3", "kg/m^3", "density beyond interface 3", |v, _| layer(v, 2).map_or(0.0, |layer| layer.fluid.density), |d, _, x| set_layer(d, 2, |layer| layer.fluid.density = x[0])).when(INTERFACE_3).at_least_zero(),
    input("interface_4_offset_m", "m", "where interface 4 is along its normal", |v, _| layer(v, 3).map_or(0.0, |layer| layer.offset), |d, _, x| set_layer(d, 3, |layer| layer.offset = x[0])).when(INTERFACE_4),
    input("beyond_4_viscosity_pa_s", "Pa s", "dynamic viscosity beyond interface 4", |v, _| layer(v, 3).map_or(0.0, |layer| layer.fluid.viscosity), |d, _, x| set_layer(d, 3, |layer| layer.fluid.viscosity = x[0])).when(INTERFACE_4).at_least_zero(),
    input("beyond_4_density_kg_m3", "kg/m^3", "density beyond interface 4", |v, _| layer(v, 3).map_or(0.0, |layer| layer.fluid.density), |d, _, x| set_layer(d, 3, |layer| layer.fluid.density = x[0])).when(INTERFACE_4).at_least_zero(),
    head_input("head_x_m", "m", "head position, x, now or at the end of the next step as head.input says; set before the first step, the run starts there", |v, _| head_said(v, 0, 0), 0, 0),
    head_input("head_y_m", "m", "head position, y", |v, _| head_said(v, 1, 0), 1, 0),
    head_input("head_angle_rad", "rad", "head angle from +x", |v, _| head_said(v, 2, 0), 2, 0),
    head_input("head_vx_m_s", "m/s", "head velocity, x, at the time of the position; where it is not set it follows from the positions, and is zero where the run starts with a position", |v, _| head_said(v, 0, 1), 0, 1),
    head_input("head_vy_m_s", "m/s", "head velocity, y", |v, _| head_said(v, 1, 1), 1, 1),
    head_input("head_spin_rad_s", "rad/s", "angular velocity of the head", |v, _| head_said(v, 2, 1), 2, 1),
    head_input("head_ax_m_s2", "m/s^2", "head acceleration, x, at the time of the position; where it is not set it follows from positions and velocities", |v, _| head_said(v, 0, 2), 0, 2),
    head_input("head_ay_m_s2", "m/s^2", "head acceleration, y", |v, _| head_said(v, 1, 2), 1, 2),
    head_input("head_spin_rate_rad_s2", "rad/s^2", "angular acceleration of the head", |v, _| head_said(v, 2, 2), 2, 2),

    parameter("nodes", "1", "number of nodes; node 0 is the centre of a head body", |v, _| v.model().rod.nodes as f64),
    parameter("length_m", "m", "length of the rod", |v, _| v.model().rod.length),
    parameter("mass_kg", "kg", "mass of the rod, and of a head body", |v, _| v.model().rod.total_mass()),
    parameter("stretching_stiffness_n", "N", "stretching stiffness EA", |v, _| v.model().rod.ea).elastic(),
    parameter("bending_stiffness_n_m2", "N m^2", "bending stiffness EI before the profile", |v, _| v.model().rod.ei).elastic(),
    parameter("joint_stiffness_n_m2", "N m^2", "bending stiffness EI at the joints", |v, k| v.model().rod.joint_stiffness(k)).sized(Size::Joints).elastic(),
    parameter("time_step_s", "s", "largest internal step", |v, _| v.time_step),
];
