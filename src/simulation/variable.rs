//! The table of variables: inputs, outputs and parameters with name, unit, causality and meaning.
//!
//! The command, output files and bindings all use it. A new output is one line of [`VARIABLES`].

use nalgebra::Vector2;

use crate::cycle::{self, CycleDifference, CycleMeasure, Cycles};
use crate::error::{Error, nearest};
use crate::fluid::{DENSITY, Force, Layer, Layers, PowerKind};
use crate::head::{HeadInput, Hinge, Sample};
use crate::metrics::RunMetrics;
use crate::model::{Dynamics, Inputs, Mechanics, Model};
use crate::newton::SolverWork;
use crate::rod::{DampedRate, bend, node};
use crate::scene::parameter::MATERIAL;
use crate::system::{Form, State};
use crate::tendons::MAX_TENDONS;

/// What determines the value of a variable.
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
    /// The term of the FMI standard.
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
    /// One per node.
    Nodes,
    /// One per joint. A held head adds the half-cell joint at node 0, which comes first.
    Joints,
}

/// The quantities that variables are read from.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// Time of the host, s.
    pub time: f64,
    /// The model.
    pub dynamics: &'a Dynamics,
    /// Inputs.
    pub inputs: &'a Inputs,
    /// State.
    pub state: &'a State,
    /// Measurements.
    pub metrics: &'a RunMetrics,
    /// The last whole cycles.
    pub cycles: &'a Cycles,
    /// Work of Newton's method.
    pub work: SolverWork,
    /// Largest internal step, s.
    pub time_step: f64,
    /// The change of the angle (rad) and of the angular velocity (rad/s) of a held head, in a view of a differential; zero in a
    /// view of the current state.
    pub head_turn: [f64; 2],
}

impl View<'_> {
    fn model(&self) -> &Model {
        &self.dynamics.model
    }

    /// Displacement of node `k` along axis `i` since the start.
    fn displacement(&self, k: usize, i: usize) -> f64 {
        self.state.q[2 * k + i] - self.metrics.first_positions[2 * k + i]
    }

    /// The mean of `measure` over the last whole cycles: zero before the first and where the measure is undefined, NaN if no
    /// cycles are defined.
    fn average(&self, measure: &CycleMeasure) -> f64 {
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

/// Direct feedthrough: an input that an output depends on immediately, without a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DirectFeedthrough {
    /// Name of the input.
    pub input: &'static str,
    /// The entries of the input that the output depends on.
    pub entries: FeedthroughEntries,
    /// The condition for this feedthrough.
    pub condition: FeedthroughCondition,
}

/// The condition for a direct feedthrough.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FeedthroughCondition {
    /// No condition.
    Always,
    /// Positions are the unknowns. In the chain form the force of an edge is itself an unknown, which changes with the next step.
    InPositions,
    /// The rod is buoyant.
    WithBuoyancy,
    /// The shape model, where moments follow from balance.
    OfShape,
    /// Any other model, where moments follow from the curvature.
    OfElasticity,
    /// As [`OfElasticity`](Self::OfElasticity), and the moment or the force on the head does work at once: the head is turned,
    /// not free on a hinge, or positions are the unknowns.
    OfHeadWork,
    /// As [`OfElasticity`](Self::OfElasticity), and the actuation sets natural curvatures rather than active moments.
    OfNaturalCurvature,
    /// The model stores bending energy: as [`OfElasticity`](Self::OfElasticity), or any model with active moments.
    OfBending,
    /// The rate of the wave matters: any model except [`OfElasticity`](Self::OfElasticity) with active moments.
    OfWaveRate,
    /// As [`OfElasticity`](Self::OfElasticity), with a material that resists the rate of its elastic curvature only: moments
    /// follow the rate of the natural curvature.
    OfElasticDamping,
    /// As [`OfElasticDamping`](Self::OfElasticDamping), with a limited or lagging drive: the rate of its output follows its
    /// command.
    OfFilter,
}

impl FeedthroughCondition {
    fn holds(self, dynamics: &Dynamics, form: Form) -> bool {
        let shape = dynamics.mechanics == Mechanics::Shape;
        match self {
            Self::Always => true,
            Self::InPositions => form != Form::Chain && !shape,
            Self::WithBuoyancy => {
                let model = &dynamics.model;
                let in_layers = |force: &dyn Force| {
                    force.power_kind() == Some(PowerKind::Load) && force.parameters().contains(&DENSITY)
                };
                model.buoyancy.is_some() || model.forces.iter().any(in_layers)
            }
            Self::OfShape => shape,
            Self::OfElasticity => !shape,
            Self::OfHeadWork => !shape && (form != Form::Chain || !has_hinge(&dynamics.model)),
            Self::OfNaturalCurvature => !shape && !dynamics.model.active_moments,
            Self::OfBending => !shape || dynamics.model.active_moments,
            Self::OfWaveRate => shape || !dynamics.model.active_moments,
            Self::OfFilter => dynamics.model.filters_drive() && Self::OfElasticDamping.holds(dynamics, form),
            Self::OfElasticDamping => {
                let damping = &dynamics.model.rod.damping;
                !shape && damping.as_ref().is_some_and(|damping| damping.rate == DampedRate::Elastic)
            }
        }
    }
}

/// The entries of an input that an entry of an output depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FeedthroughEntries {
    /// All entries.
    All,
    /// The entry of the same node.
    Own,
    /// The entries of the first nodes.
    First(usize),
}

const fn always(input: &'static str, entries: FeedthroughEntries) -> DirectFeedthrough {
    DirectFeedthrough { input, entries, condition: FeedthroughCondition::Always }
}

const fn in_positions(input: &'static str, entries: FeedthroughEntries) -> DirectFeedthrough {
    DirectFeedthrough { input, entries, condition: FeedthroughCondition::InPositions }
}

const fn with_buoyancy(input: &'static str) -> DirectFeedthrough {
    DirectFeedthrough { input, entries: FeedthroughEntries::All, condition: FeedthroughCondition::WithBuoyancy }
}

const fn elastic(input: &'static str, entries: FeedthroughEntries) -> DirectFeedthrough {
    DirectFeedthrough { input, entries, condition: FeedthroughCondition::OfElasticity }
}

const fn elastically_damped(input: &'static str) -> DirectFeedthrough {
    DirectFeedthrough { input, entries: FeedthroughEntries::All, condition: FeedthroughCondition::OfElasticDamping }
}

const fn of_head_work(feed: DirectFeedthrough) -> DirectFeedthrough {
    DirectFeedthrough { condition: FeedthroughCondition::OfHeadWork, ..feed }
}

/// The same feedthrough for the shape model.
const fn of_shape<const N: usize>(feeds: &[DirectFeedthrough]) -> [DirectFeedthrough; N] {
    let mut all = [feeds[0]; N];
    let mut i = 0;
    while i < N {
        all[i] = DirectFeedthrough {
            entries: FeedthroughEntries::All,
            condition: FeedthroughCondition::OfShape,
            ..feeds[i]
        };
        i += 1;
    }
    all
}

/// The concatenation of `a` and `b`, with `N` entries in total.
const fn join<const N: usize>(a: &[DirectFeedthrough], b: &[DirectFeedthrough]) -> [DirectFeedthrough; N] {
    let mut all = [a[0]; N];
    let mut i = 0;
    while i < N {
        all[i] = if i < a.len() { a[i] } else { b[i - a.len()] };
        i += 1;
    }
    all
}

const FLUID: [DirectFeedthrough; 16] = [
    always("viscosity_pa_s", FeedthroughEntries::All),
    always("density_kg_m3", FeedthroughEntries::All),
    always("flow_x_m_s", FeedthroughEntries::All),
    always("flow_y_m_s", FeedthroughEntries::All),
    always("interface_1_offset_m", FeedthroughEntries::All),
    always("beyond_1_viscosity_pa_s", FeedthroughEntries::All),
    always("beyond_1_density_kg_m3", FeedthroughEntries::All),
    always("interface_2_offset_m", FeedthroughEntries::All),
    always("beyond_2_viscosity_pa_s", FeedthroughEntries::All),
    always("beyond_2_density_kg_m3", FeedthroughEntries::All),
    always("interface_3_offset_m", FeedthroughEntries::All),
    always("beyond_3_viscosity_pa_s", FeedthroughEntries::All),
    always("beyond_3_density_kg_m3", FeedthroughEntries::All),
    always("interface_4_offset_m", FeedthroughEntries::All),
    always("beyond_4_viscosity_pa_s", FeedthroughEntries::All),
    always("beyond_4_density_kg_m3", FeedthroughEntries::All),
];
const WAVE: [DirectFeedthrough; 3] = [
    elastic("actuation_amplitude", FeedthroughEntries::All),
    elastic("actuation_moment_n_m", FeedthroughEntries::All),
    elastic("actuation_phase_rad", FeedthroughEntries::All),
];
const NATURAL: &[DirectFeedthrough] = &[
    WAVE[0],
    DirectFeedthrough { condition: FeedthroughCondition::OfNaturalCurvature, ..WAVE[2] },
    DirectFeedthrough {
        input: "natural_curvature_1_m",
        entries: FeedthroughEntries::All,
        condition: FeedthroughCondition::OfBending,
    },
];
/// The tensions that a host adds to those of the tendons.
const TENSIONS: [DirectFeedthrough; MAX_TENDONS] = [
    always("tendon_1_added_tension_n", FeedthroughEntries::All),
    always("tendon_2_added_tension_n", FeedthroughEntries::All),
    always("tendon_3_added_tension_n", FeedthroughEntries::All),
    always("tendon_4_added_tension_n", FeedthroughEntries::All),
];
/// The lengths that a host adds to those that winches give the tendons.
pub(crate) const WINCHES: [&str; MAX_TENDONS] =
    ["tendon_1_added_length_m", "tendon_2_added_length_m", "tendon_3_added_length_m", "tendon_4_added_length_m"];
const TENSION_1: &[DirectFeedthrough] = TENSIONS.split_at(1).0;
const TENSION_2: &[DirectFeedthrough] = TENSIONS.split_at(1).1.split_at(1).0;
const TENSION_3: &[DirectFeedthrough] = TENSIONS.split_at(2).1.split_at(1).0;
const TENSION_4: &[DirectFeedthrough] = TENSIONS.split_at(3).1;
/// The torque and the commanded angle that a host adds to those of a hinge.
const HINGE_INPUTS: &[DirectFeedthrough] = &[
    always("hinge_added_torque_n_m", FeedthroughEntries::All),
    always("hinge_added_angle_rad", FeedthroughEntries::All),
];
const FORCES: &[DirectFeedthrough] =
    &[always("force_x_n", FeedthroughEntries::All), always("force_y_n", FeedthroughEntries::All)];
/// The feedthrough of quantities that follow from balance in the shape model.
const BALANCE: [DirectFeedthrough; 18] = of_shape(&join::<18>(&FLUID, FORCES));
const NATURAL_RATE: [DirectFeedthrough; 28] = join(
    &join::<22>(&BALANCE, &TENSIONS),
    &[
        always("actuation_amplitude", FeedthroughEntries::All),
        always("actuation_moment_n_m", FeedthroughEntries::All),
        elastic("active_moment_n_m", FeedthroughEntries::All),
        always("actuation_phase_rad", FeedthroughEntries::All),
        DirectFeedthrough { condition: FeedthroughCondition::OfWaveRate, ..DRIVE_FREQUENCY },
        NATURAL[2],
    ],
);
const DRIVE_FREQUENCY: DirectFeedthrough = elastically_damped("actuation_frequency_hz");
const MATERIAL_POWER: [DirectFeedthrough; 4] = [
    elastically_damped("actuation_amplitude"),
    elastically_damped("actuation_phase_rad"),
    DRIVE_FREQUENCY,
    DirectFeedthrough { condition: FeedthroughCondition::OfFilter, ..NATURAL[2] },
];
/// Feedthrough of the moments at these entries of joints.
const fn of_joints(entries: FeedthroughEntries) -> [DirectFeedthrough; 28] {
    let own = [
        elastic("natural_curvature_1_m", entries),
        elastic("active_moment_n_m", entries),
        WAVE[0],
        WAVE[1],
        WAVE[2],
        DRIVE_FREQUENCY,
    ];
    join(&BALANCE, &join::<10>(&own, &TENSIONS))
}
const OWN_NATURAL: [DirectFeedthrough; 28] = of_joints(FeedthroughEntries::Own);
const HEAD_NATURAL: [DirectFeedthrough; 28] = of_joints(FeedthroughEntries::First(1));
const LOADS: [DirectFeedthrough; 11] = join(
    &[
        with_buoyancy("density_kg_m3"),
        with_buoyancy("interface_1_offset_m"),
        with_buoyancy("beyond_1_density_kg_m3"),
        with_buoyancy("interface_2_offset_m"),
        with_buoyancy("beyond_2_density_kg_m3"),
        with_buoyancy("interface_3_offset_m"),
        with_buoyancy("beyond_3_density_kg_m3"),
        with_buoyancy("interface_4_offset_m"),
        with_buoyancy("beyond_4_density_kg_m3"),
    ],
    FORCES,
);
const HEAD: [DirectFeedthrough; 26] = join(
    &join::<20>(&FLUID, &TENSIONS),
    &[
        in_positions("natural_curvature_1_m", FeedthroughEntries::First(2)),
        in_positions("active_moment_n_m", FeedthroughEntries::First(2)),
        in_positions("actuation_amplitude", FeedthroughEntries::All),
        in_positions("actuation_moment_n_m", FeedthroughEntries::All),
        in_positions("actuation_phase_rad", FeedthroughEntries::All),
        DRIVE_FREQUENCY,
    ],
);
const HEAD_X: [DirectFeedthrough; 28] = join(&HEAD, &[always("force_x_n", FeedthroughEntries::First(1)), BALANCE[16]]);
const HEAD_Y: [DirectFeedthrough; 28] = join(&HEAD, &[always("force_y_n", FeedthroughEntries::First(1)), BALANCE[17]]);
const HEAD_POWER: [DirectFeedthrough; 34] = join(
    &join::<22>(&join::<20>(&FLUID, &TENSIONS), HINGE_INPUTS),
    &[
        of_head_work(WAVE[0]),
        of_head_work(WAVE[1]),
        of_head_work(WAVE[2]),
        of_head_work(HEAD_NATURAL[18]),
        of_head_work(HEAD_NATURAL[19]),
        HEAD[20],
        HEAD[21],
        always("force_x_n", FeedthroughEntries::First(1)),
        always("force_y_n", FeedthroughEntries::First(1)),
        BALANCE[16],
        BALANCE[17],
        DRIVE_FREQUENCY,
    ],
);

/// Reads a variable, or its entry at a node.
type Get = fn(&View<'_>, usize) -> f64;
/// The differential of a variable, from the current view and its differential.
type DerivativeOf = fn(&View<'_>, &View<'_>, usize) -> f64;
/// Sets a variable at a time.
type Set = fn(&mut Dynamics, f64, &[f64]);
/// Sets the entries of an array from an index on.
type SetEntries = fn(&mut Dynamics, usize, &[f64]);

/// Tests whether a value is allowed, with a description of the allowed values.
type Allowed = (fn(f64) -> bool, &'static str);

/// A variable.
#[derive(Debug)]
pub struct Variable {
    /// Name, ending in its unit.
    pub name: &'static str,
    /// SI unit, or `1` if dimensionless.
    pub unit: &'static str,
    /// What determines its value.
    pub causality: Causality,
    /// Description.
    pub description: &'static str,
    /// Its number of values.
    pub size: Size,
    /// True if it is a column of trajectory.csv.
    pub recorded: bool,
    /// The inputs that it depends on immediately.
    pub feedthrough: &'static [DirectFeedthrough],
    fed_in: fn(&Model) -> bool,
    /// True if it is the stiffness of the rod, or depends on it directly.
    elastic: bool,
    /// True if it is the rotation of a held head, a function of time alone.
    turned: bool,
    /// True if it is a total since the start or over whole cycles, rather than a value at one time.
    total: bool,
    needs: Requirement,
    get: Get,
    /// Its differential, if it is not linear in state and measurements.
    tangent: Option<DerivativeOf>,
    set: Option<Set>,
    set_entries: Option<SetEntries>,
    /// For an input of a held head: the coordinate (x, y, angle) and the order of its time derivative.
    head: Option<[usize; 2]>,
    /// Allowed values, in addition to being finite.
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
            feedthrough: &[],
            fed_in: |_| true,
            elastic: false,
            turned: false,
            total: false,
            needs: Requirement { met: |_| true, what: "" },
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

    const fn when(self, needs: Requirement) -> Self {
        Self { needs, ..self }
    }

    const fn fed(self, feedthrough: &'static [DirectFeedthrough]) -> Self {
        Self { feedthrough, ..self }
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

    const fn total(self) -> Self {
        Self { total: true, ..self }
    }

    const fn changing(self, tangent: DerivativeOf) -> Self {
        Self { tangent: Some(tangent), ..self }
    }

    const fn at_least_zero(self) -> Self {
        Self { allowed: Some((|x| x >= 0.0, "a number that is not negative")), ..self }
    }

    /// True if a scene with `model` has this variable.
    pub fn exists_in(&self, model: &Model) -> bool {
        (self.needs.met)(model)
    }

    /// Its lower bound, if any.
    pub fn least(&self) -> Option<f64> {
        self.allowed.map(|_| 0.0)
    }

    /// True if a host sets it.
    pub fn is_input(&self) -> bool {
        self.causality == Causality::Input
    }

    /// True if it is a total since the start or over whole cycles, and therefore not a function of state and inputs at one time.
    pub fn is_total(&self) -> bool {
        self.total
    }

    /// The nodes of the entries of `input` that its entry at node `k` immediately depends on, in `dynamics` solved in `form`. A
    /// dependence on poses that are given for the end of a step acts through that step.
    pub fn follows(&self, k: usize, input: &Self, dynamics: &Dynamics, form: Form) -> std::ops::Range<usize> {
        let model = &*dynamics.model;
        if model.head_input == HeadInput::AtEnd && input.head.is_some() && self.causality == Causality::Output {
            return 0..1; // through the step that led to the pose
        }
        // Of the output of a drive with a lag, only the rate follows the command, in the same way as the rate of a drive without
        // lag follows the frequency.
        let asked = match input.name {
            "actuation_frequency_hz" if model.lag.is_some() => return 0..0,
            "actuation_amplitude" | "actuation_moment_n_m" | "actuation_phase_rad" => true,
            "natural_curvature_1_m" => !model.active_moments,
            "active_moment_n_m" => model.active_moments,
            _ => false,
        };
        if asked && model.lag.is_some() && !self.is_fed_by("actuation_frequency_hz", dynamics, form) {
            return 0..0;
        }
        self.fed_entries(k, input, dynamics, form)
    }

    /// The same for a drive without lag.
    fn fed_entries(&self, k: usize, input: &Self, dynamics: &Dynamics, form: Form) -> std::ops::Range<usize> {
        let model = &*dynamics.model;
        let entries = input.entries(model);
        // The length set by a winch acts through the tension that it causes.
        let by_tension = TENSIONS.iter().zip(WINCHES).find(|(_, winch)| *winch == input.name);
        let name = by_tension.map_or(input.name, |(tension, _)| tension.input);
        let feeds = self.feedthrough.iter().filter(|feed| feed.input == name && (self.fed_in)(model));
        let entries = feeds.filter(|feed| feed.condition.holds(dynamics, form)).map(|feed| match feed.entries {
            FeedthroughEntries::Own => k..k + 1,
            FeedthroughEntries::First(count) if input.size != Size::Scalar => 0..count,
            FeedthroughEntries::All | FeedthroughEntries::First(_) => entries.clone(),
        });
        let entries = entries.max_by_key(std::ops::Range::len).unwrap_or(0..0);
        entries.start.max(entries.start)..entries.end.min(entries.end).max(entries.start.max(entries.start))
    }

    /// True if an entry immediately depends on an entry of the input `name`.
    fn is_fed_by(&self, name: &str, dynamics: &Dynamics, form: Form) -> bool {
        let mut feeds = self.feedthrough.iter().filter(|feed| feed.input == name && (self.fed_in)(&dynamics.model));
        feeds.any(|feed| feed.condition.holds(dynamics, form))
    }

    /// True if it immediately depends on the tunable parameter `key` of the scene, see
    /// [`is_tunable`](crate::scene::parameter::ScalarParameter::is_tunable): moments on the stiffness, forces of the fluid on their coefficients.
    pub fn follows_parameter(&self, key: &str, dynamics: &Dynamics, form: Form) -> bool {
        match key {
            _ if MATERIAL.contains(&key) => {
                // Active moments bend a stiffer rod less, in the shape model too.
                let moments = dynamics.model.active_moments && self.is_fed_by("actuation_moment_n_m", dynamics, form);
                self.elastic || moments || self.is_fed_by("natural_curvature_1_m", dynamics, form)
            }
            _ => self.is_fed_by("viscosity_pa_s", dynamics, form),
        }
    }

    /// True if it depends explicitly on time at a given state: through the drive, a time-dependent flow, or a driven head.
    pub fn follows_time(&self, dynamics: &Dynamics, form: Form) -> bool {
        let model = &*dynamics.model;
        let drive = model.actuation.is_some() && self.is_fed_by("actuation_phase_rad", dynamics, form);
        let inputs = [
            "tendon_1_added_tension_n",
            "tendon_2_added_tension_n",
            "tendon_3_added_tension_n",
            "tendon_4_added_tension_n",
        ];
        let pulled = inputs[..model.tendons.len()].iter().any(|input| self.is_fed_by(input, dynamics, form));
        let flow = model.flow.is_some() && self.is_fed_by("flow_x_m_s", dynamics, form);
        let head = model.head.is_some() && model.hinge.is_none() && self.turned;
        let torque = model.hinge.is_some() && self.is_fed_by("hinge_added_torque_n_m", dynamics, form);
        self.causality == Causality::Output && (drive || pulled || flow || head || torque)
    }

    /// The nodes of its entries. A scalar has one entry.
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

    /// Its value at node `k`, or `None` if that is not one of its [`entries`](Self::entries).
    #[inline]
    pub fn at(&self, view: &View<'_>, k: usize) -> Option<f64> {
        self.entries(view.model()).contains(&k).then(|| (self.get)(view, k))
    }

    /// Its differential at node `k`, for a differential `change` of the view `now`. It must not be a parameter.
    pub(crate) fn change(&self, now: &View<'_>, change: &View<'_>, k: usize) -> f64 {
        match (self.causality, self.tangent) {
            (Causality::Parameter, _) => 0.0,
            (_, Some(tangent)) => tangent(now, change, k),
            (_, None) => match self.head {
                None => (self.get)(change, k),
                // The head values given by a host change with time only.
                Some([i, order]) => change.time * given_head(now, i, order + 1),
            },
        }
    }

    /// Its first value.
    pub fn first(&self, view: &View<'_>) -> f64 {
        (self.get)(view, self.entries(view.model()).start)
    }

    /// For an input of a held head: the coordinate (x, y, angle) and the order of its time derivative.
    pub fn of_head(&self) -> Option<[usize; 2]> {
        self.head
    }

    /// Sets its entries from index `first` on at time `t` (s). The caller must have checked values and length.
    pub(crate) fn write(&self, dynamics: &mut Dynamics, t: f64, first: usize, values: &[f64]) {
        if let Some([i, order]) = self.head {
            dynamics.set_head_derivative(t, i, order, values[0], false);
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

    /// The first value that is not allowed, with a description of the allowed ones.
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

/// An input with one value per joint or node.
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
    variable.when(if i == 2 { TURNED_HEAD } else { HELD_HEAD })
}

const fn output(name: &'static str, unit: &'static str, description: &'static str, get: Get) -> Variable {
    Variable::new(Causality::Output, name, unit, description, get)
}

/// A mean over the last whole cycles. It has no direct feedthrough, and is zero before the end of the first cycle.
const fn average(measure: &CycleMeasure, get: Get) -> Variable {
    output(measure.key, measure.unit, measure.description, get).changing(|_, _, _| 0.0).total()
}

/// A requirement of a variable on the scene.
#[derive(Debug, Clone, Copy)]
struct Requirement {
    met: fn(&Model) -> bool,
    /// Its description.
    what: &'static str,
}

const ACTUATION: Requirement = Requirement { met: has_actuation, what: "an [actuation]" };
const CURVATURES: Requirement =
    Requirement { met: has_natural_curvature, what: "an [actuation] with kappa_amp or slope" };
const MOMENTS: Requirement = Requirement { met: has_moments, what: "an [actuation] with moment_amp_n_m" };
const WHOLE_RATE: Requirement =
    Requirement { met: resists_no_elastic_rate, what: r#"a rod without damping_of = "elastic""# };
const BODY: Requirement = Requirement { met: has_body, what: "a [head_body]" };
const DENSE_FLUID: Requirement = Requirement {
    met: has_dense_fluid,
    what: "a force that depends on the density of the fluid: buoyancy, [reactive], or a drag law with inertia",
};
const FLUID_THERE: Requirement = Requirement { met: has_fluid, what: "a [medium] that acts on the rod" };
const HELD_HEAD: Requirement =
    Requirement { met: has_held_head, what: r#"a held head: [head] with kind = "clamped", "driven" or "hinged""# };
const TURNED_HEAD: Requirement = Requirement {
    met: has_turned_head,
    what: r#"a head whose angle is held: [head] with kind = "clamped" or "driven""#,
};
const HINGE: Requirement = Requirement { met: has_hinge, what: r#"a [head] with kind = "hinged""# };
const SERVO: Requirement = Requirement { met: has_servo, what: "a hinged [head] with stiffness_n_m" };
const INERTIAL_FLUID: Requirement =
    Requirement { met: has_inertial_fluid, what: "a fluid that the rod accelerates: [reactive]" };
const OTHER_FORCES: Requirement = Requirement { met: has_other_forces, what: "a user-defined force" };
const DAMPED: Requirement = Requirement {
    met: is_damped,
    what: "a damped material: rod.damping_time_s or rod.loss_factor, or a hinged [head] with damping_n_m_s",
};
const SPRAY: Requirement = Requirement { met: has_spray, what: "[reactive] and a medium with interfaces" };
const FREE: Requirement = Requirement { met: is_free, what: "a free head" };
const FLOW_X: Requirement = Requirement { met: has_flow::<0>, what: "a [medium] that may flow along this axis" };
const FLOW_Y: Requirement = Requirement { met: has_flow::<1>, what: "a [medium] that may flow along this axis" };
const TENDON_1: Requirement = Requirement { met: has_tendon::<1>, what: "one of [[tendons]]" };
const TENDON_2: Requirement = Requirement { met: has_tendon::<2>, what: "two of [[tendons]]" };
const TENDON_3: Requirement = Requirement { met: has_tendon::<3>, what: "three of [[tendons]]" };
const TENDON_4: Requirement = Requirement { met: has_tendon::<4>, what: "four of [[tendons]]" };
const PULLED_1: Requirement =
    Requirement { met: is_pulled::<1, false>, what: "tendon 1 of [[tendons]], without a winch" };
const WINCH_1: Requirement =
    Requirement { met: is_pulled::<1, true>, what: "tendon 1 of [[tendons]], with a winch (stiffness_n_m)" };
const PULLED_2: Requirement =
    Requirement { met: is_pulled::<2, false>, what: "tendon 2 of [[tendons]], without a winch" };
const WINCH_2: Requirement =
    Requirement { met: is_pulled::<2, true>, what: "tendon 2 of [[tendons]], with a winch (stiffness_n_m)" };
const PULLED_3: Requirement =
    Requirement { met: is_pulled::<3, false>, what: "tendon 3 of [[tendons]], without a winch" };
const WINCH_3: Requirement =
    Requirement { met: is_pulled::<3, true>, what: "tendon 3 of [[tendons]], with a winch (stiffness_n_m)" };
const PULLED_4: Requirement =
    Requirement { met: is_pulled::<4, false>, what: "tendon 4 of [[tendons]], without a winch" };
const WINCH_4: Requirement =
    Requirement { met: is_pulled::<4, true>, what: "tendon 4 of [[tendons]], with a winch (stiffness_n_m)" };
const INTERFACE_1: Requirement =
    Requirement { met: has_interface::<1>, what: "[medium.beyond] or one of [[medium.layers]]" };
const INTERFACE_2: Requirement = Requirement { met: has_interface::<2>, what: "two layers in [[medium.layers]]" };
const INTERFACE_3: Requirement = Requirement { met: has_interface::<3>, what: "three layers in [[medium.layers]]" };
const INTERFACE_4: Requirement = Requirement { met: has_interface::<4>, what: "four layers in [[medium.layers]]" };

fn has_actuation(model: &Model) -> bool {
    model.actuation.is_some()
}

fn has_natural_curvature(model: &Model) -> bool {
    has_actuation(model) && !model.active_moments
}

fn has_moments(model: &Model) -> bool {
    model.active_moments
}

fn resists_no_elastic_rate(model: &Model) -> bool {
    model.rod.damping.as_ref().is_none_or(|damping| damping.rate != DampedRate::Elastic)
}

fn has_fluid(model: &Model) -> bool {
    model.forces.iter().any(Force::is_of_fluid)
}

/// True if a host may set the flow along this axis. There is no flow across an interface.
fn has_flow<const AXIS: usize>(model: &Model) -> bool {
    let crosses = |layers: Layers| layers.iter().len() > 0 && layers.normal[AXIS] != 0.0;
    has_fluid(model) && !model.layers.is_some_and(crosses)
}

/// True if the medium has at least this many interfaces and forces act in it.
fn has_interface<const COUNT: usize>(model: &Model) -> bool {
    !model.forces.is_empty() && model.layers.is_some_and(|layers| layers.iter().len() >= COUNT)
}

/// True if tendon number `COUNT` exists and is, or is not, pulled by a winch (`BY_WINCH`).
fn is_pulled<const COUNT: usize, const BY_WINCH: bool>(model: &Model) -> bool {
    model.tendons.get(COUNT - 1).is_some_and(|tendon| tendon.winch().is_some() == BY_WINCH)
}

/// True if a rod has at least that many tendons.
fn has_tendon<const COUNT: usize>(model: &Model) -> bool {
    model.tendons.len() >= COUNT
}

/// The differential of the power of tendon `i`.
fn tendon_power_change(now: &View<'_>, change: &View<'_>, i: usize) -> f64 {
    let [now, change] = [now, change].map(|view| view.metrics.now.tendons[i]);
    -change.tension * now.length_rate - now.tension * change.length_rate
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

fn is_damped(model: &Model) -> bool {
    model.is_damped()
}

fn has_spray(model: &Model) -> bool {
    model.forces.iter().any(|force| force.power_kind() == Some(PowerKind::Spray))
}

fn has_other_forces(model: &Model) -> bool {
    model.forces.are_others()
}

fn has_body(model: &Model) -> bool {
    model.rod.body.is_some()
}

/// Direction of the body's axis from +x, in (−π, π], rad.
fn body_angle(state: &State) -> f64 {
    let [x, y] = [0, 1].map(|i| state.q[2 + i] - state.q[i]);
    y.atan2(x)
}

/// Its differential: n·δe/ℓ.
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

fn has_turned_head(model: &Model) -> bool {
    has_held_head(model) && !has_hinge(model)
}

fn has_hinge(model: &Model) -> bool {
    model.hinge.is_some()
}

fn has_servo(model: &Model) -> bool {
    model.hinge.as_ref().is_some_and(|hinge| hinge.stiffness > 0.0)
}

/// The differential of the power of the motor of a hinge.
fn hinge_power_change(now: &View<'_>, change: &View<'_>, _: usize) -> f64 {
    let [now, change] = [now, change].map(|view| view.metrics.now.hinge);
    change.torque * now.spin + now.torque * change.spin
}

/// The derivative of order `order` of coordinate `i` (x, y, angle) of the head: the last value given by the host, or else that of
/// its motion.
fn given_head(view: &View<'_>, i: usize, order: usize) -> f64 {
    let host = view.inputs.head.as_ref().and_then(|host| host.axes[i].as_ref());
    host.and_then(|axis| axis.given_derivative(order)).unwrap_or_else(|| head(view, i, order))
}

/// The derivative of order `order` of coordinate `i` of the head's motion.
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

/// Angle and angular velocity at an end of the rod, node `k`: of a held head, or of the edge at that end.
fn turn(view: &View<'_>, k: usize) -> [f64; 2] {
    match &view.dynamics.held {
        Some([_, _, angle]) if k == 0 => [angle.value, angle.rate],
        _ => {
            let [edge, velocity] = [&view.state.q, &view.state.v].map(|values| across(values, k));
            [edge.y.atan2(edge.x), edge.perp(&velocity) / edge.norm_squared()]
        }
    }
}

/// The differential of [`turn`].
fn turn_change(now: &View<'_>, change: &View<'_>, k: usize) -> [f64; 2] {
    match &now.dynamics.held {
        Some(_) if k == 0 && has_hinge(now.model()) => {
            let rod = &now.model().rod;
            let Sample { value, rate, .. } = Hinge::angle(change.state, rod.nodes, rod.length);
            [value, rate]
        }
        Some(_) if k == 0 => change.head_turn,
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

/// The difference of `values` over the edge at the end `k` of the rod.
fn across(values: &[f64], k: usize) -> Vector2<f64> {
    let first = k.saturating_sub(1);
    node(values, first + 1) - node(values, first)
}

/// Sets the forces of a host along axis `i` on the nodes from `first` on.
fn set_force(dynamics: &mut Dynamics, i: usize, first: usize, values: &[f64]) {
    let nodes = dynamics.model.rod.nodes;
    let force = dynamics.inputs.force.get_or_insert_with(|| vec![0.0; 2 * nodes]);
    for (k, value) in values.iter().enumerate() {
        force[2 * (first + k) + i] = *value;
    }
}

/// Sets the array `of` the inputs at the joints from `first` on.
fn set_joints(dynamics: &mut Dynamics, of: fn(&mut Inputs) -> &mut Option<Vec<f64>>, first: usize, values: &[f64]) {
    let (joints, nodes) = (dynamics.model.rod.joints(), dynamics.model.rod.nodes);
    let own = of(&mut dynamics.inputs).get_or_insert_with(|| vec![0.0; nodes]);
    own[joints.start + first..][..values.len()].copy_from_slice(values);
}

/// The differential of the mean efficiency over the last whole cycles, through the drag of the straight rod in the current fluid.
fn efficiency_change(now: &View<'_>, change: &View<'_>, _: usize) -> f64 {
    let cycles = now.cycles.whole(now.state.t);
    let (fluid, by) = (&now.inputs.fluid, &change.inputs.fluid);
    if cycles.is_empty() || change.time != 0.0 || now.model().head.is_some() {
        return 0.0; // past cycles and the current fluid do not change with time; a held head has no drag to compare with
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
    let (kappa, moment) = (now.metrics.now.kappa[k], now.metrics.now.moment[k]);
    let (turned, more) = (change.metrics.now.kappa[k], change.metrics.now.moment[k]);
    more * bend::curvature_per_turning(kappa) + moment * 0.5 * kappa * turned
}

fn of(values: &Option<Vec<f64>>, i: usize) -> f64 {
    values.as_ref().map_or(0.0, |values| values[i])
}

/// The error for an unknown variable `name`: what the scene lacks for it, or the most similar name of the existing ones, `there`.
pub(crate) fn unknown(name: &str, there: impl Iterator<Item = &'static str>) -> Error {
    let elsewhere = VARIABLES.iter().find(|variable| variable.name == name && !variable.needs.what.is_empty());
    let needs = elsewhere.map(|variable| variable.needs.what);
    Error::UnknownVariable {
        name: name.to_string(),
        nearest: nearest(name, there.filter(|other| *other != name)),
        needs,
    }
}

/// All variables, in the order of display. Names end in their SI units.
///
/// Positions and velocities are in the frame of the scene, x to the right and y up; angles and curvatures are positive to the
/// left (anticlockwise), angles from +x. The tail begins at its head, node 0, and a straight tail lies along +x from there, so a
/// positive curvature bends the tip towards +y. Forces and moments named `head_…` are those of the tail on a held head; those
/// named after a part of the fluid act on the rod. Powers and works named `actuation_…`, `load_…`, `head_…`, `flow_…` and
/// `other_…` are supplied, those named `material_…`, `viscous_…`, `wake_…` and `spray_…` are dissipated; in the balance of energy
/// the former are added and the latter subtracted. `cycle_…` are means over the last whole cycles. [`Variable::exists_in`] tells
/// whether a scene has a variable, [`Variable::is_input`] whether a host sets it.
#[rustfmt::skip]
pub static VARIABLES: &[Variable] = &[
    Variable::new(Causality::Independent, "time_s", "s", "time", |v, _| v.time).recorded(),

    output("x_com_m", "m", "centre of mass, x", |v, _| v.metrics.now.com.x).recorded(),
    output("y_com_m", "m", "centre of mass, y", |v, _| v.metrics.now.com.y).recorded(),
    output("vx_com_m_s", "m/s", "velocity of the centre of mass, x", |v, _| com_velocity(v, 0)),
    output("vy_com_m_s", "m/s", "velocity of the centre of mass, y", |v, _| com_velocity(v, 1)),
    output("stretching_energy_j", "J", "stretching energy", |v, _| v.metrics.now.energy.stretching).recorded().elastic(),
    output("bending_energy_j", "J", "bending energy", |v, _| v.metrics.now.energy.bending).fed(NATURAL).recorded(),
    output("kinetic_energy_j", "J", "kinetic energy", |v, _| v.metrics.now.energy.kinetic).recorded(),
    output("fluid_energy_j", "J", "energy of the fluid that the rod accelerates", |v, _| v.metrics.now.energy.fluid).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("actuation_power_w", "W", "power supplied by the moving natural curvature, by active moments and by tendons", |v, _| v.metrics.now.power.actuation).fed(&NATURAL_RATE).recorded(),
    output("material_power_w", "W", "power dissipated by the damped material", |v, _| v.metrics.now.power.material).when(DAMPED).fed(&MATERIAL_POWER).recorded().elastic(),
    output("viscous_power_w", "W", "power dissipated by drag", |v, _| v.metrics.now.power.viscous).fed(&FLUID).recorded(),
    output("wake_power_w", "W", "power lost to the wake", |v, _| v.metrics.now.power.wake).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("spray_power_w", "W", "power lost to the spray at interfaces", |v, _| v.metrics.now.power.spray).when(SPRAY).fed(&FLUID).recorded(),
    output("other_power_w", "W", "power supplied by other forces, such as loads that follow the rod", |v, _| v.metrics.now.power.other).when(OTHER_FORCES).recorded(),
    output("load_power_w", "W", "power supplied by gravity, point loads that keep their direction, and host forces", |v, _| v.metrics.now.power.load).fed(&LOADS).recorded(),
    output("head_power_w", "W", "power supplied by the held head", |v, _| v.metrics.now.power.head).fed(&HEAD_POWER).fed_in(has_held_head).recorded(),
    output("flow_power_w", "W", "power supplied by the background flow", |v, _| v.metrics.now.power.flow).fed(&FLUID).recorded(),
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
    output("pose_x_m", "m", "actual position of the head, x", |v, _| v.state.q[0]),
    output("pose_y_m", "m", "actual position of the head, y", |v, _| v.state.q[1]),
    output("pose_angle_rad", "rad", "actual direction of the head, from +x; of a free head within a half turn", |v, _| turn(v, 0)[0]).changing(|now, change, _| turn_change(now, change, 0)[0]).turned(),
    output("pose_vx_m_s", "m/s", "actual velocity of the head, x", |v, _| v.state.v[0]),
    output("pose_vy_m_s", "m/s", "actual velocity of the head, y", |v, _| v.state.v[1]),
    output("pose_spin_rad_s", "rad/s", "actual angular velocity of the head", |v, _| turn(v, 0)[1]).changing(|now, change, _| turn_change(now, change, 0)[1]).turned(),
    output("head_force_x_n", "N", "force of the tail on the held head, x", |v, _| v.metrics.now.head_force.x).when(HELD_HEAD).fed(&HEAD_X).recorded(),
    output("head_force_y_n", "N", "force of the tail on the held head, y", |v, _| v.metrics.now.head_force.y).when(HELD_HEAD).fed(&HEAD_Y).recorded(),
    output("head_moment_n_m", "N m", "moment of the tail on the held head about node 0", |v, _| v.metrics.now.head_moment).when(HELD_HEAD).fed(&HEAD_NATURAL).recorded(),
    output("body_x_m", "m", "centre of the head body, x", |v, _| v.state.q[0]).when(BODY).recorded(),
    output("body_y_m", "m", "centre of the head body, y", |v, _| v.state.q[1]).when(BODY).recorded(),
    output("body_angle_rad", "rad", "direction of the head body's axis, along which the rod begins, from +x", |v, _| body_angle(v.state)).when(BODY).changing(body_angle_change).recorded(),
    output("drag_force_x_n", "N", "force of drag on the rod, x", |v, _| v.metrics.now.resultants.drag.x).when(FLUID_THERE).fed(&FLUID).recorded(),
    output("drag_force_y_n", "N", "force of drag on the rod, y", |v, _| v.metrics.now.resultants.drag.y).when(FLUID_THERE).fed(&FLUID).recorded(),
    output("reactive_force_x_n", "N", "force of the accelerated fluid on the rod, without the wake, x", |v, _| v.metrics.now.resultants.inertia.x).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("reactive_force_y_n", "N", "force of the accelerated fluid on the rod, without the wake, y", |v, _| v.metrics.now.resultants.inertia.y).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("wake_force_x_n", "N", "force of the shed wake on the tip, x", |v, _| v.metrics.now.resultants.wake.x).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("wake_force_y_n", "N", "force of the shed wake on the tip, y", |v, _| v.metrics.now.resultants.wake.y).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("rod_momentum_x_n_s", "N s", "momentum of the rod, x", |v, _| v.metrics.now.momentum.rod.x).when(INERTIAL_FLUID).recorded(),
    output("rod_momentum_y_n_s", "N s", "momentum of the rod, y", |v, _| v.metrics.now.momentum.rod.y).when(INERTIAL_FLUID).recorded(),
    output("fluid_momentum_x_n_s", "N s", "momentum of the fluid that the rod accelerates, relative to the flow, x", |v, _| v.metrics.now.momentum.fluid.x).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("fluid_momentum_y_n_s", "N s", "momentum of the fluid that the rod accelerates, relative to the flow, y", |v, _| v.metrics.now.momentum.fluid.y).when(INERTIAL_FLUID).fed(&FLUID).recorded(),
    output("drag_impulse_x_n_s", "N s", "impulse of drag since the start, x", |v, _| v.metrics.totals.impulse.drag.x).when(INERTIAL_FLUID).total(),
    output("drag_impulse_y_n_s", "N s", "impulse of drag since the start, y", |v, _| v.metrics.totals.impulse.drag.y).when(INERTIAL_FLUID).total(),
    output("wake_impulse_x_n_s", "N s", "impulse of the wake since the start, x", |v, _| v.metrics.totals.impulse.wake.x).when(INERTIAL_FLUID).total(),
    output("wake_impulse_y_n_s", "N s", "impulse of the wake since the start, y", |v, _| v.metrics.totals.impulse.wake.y).when(INERTIAL_FLUID).total(),
    output("flow_impulse_x_n_s", "N s", "impulse of the pressure of a flow that accelerates since the start, x", |v, _| v.metrics.totals.impulse.flow.x).when(INERTIAL_FLUID).fed(&FLUID).total(),
    output("flow_impulse_y_n_s", "N s", "impulse of the pressure of a flow that accelerates since the start, y", |v, _| v.metrics.totals.impulse.flow.y).when(INERTIAL_FLUID).fed(&FLUID).total(),
    output("load_impulse_x_n_s", "N s", "impulse of loads since the start, x", |v, _| v.metrics.totals.impulse.load.x).when(INERTIAL_FLUID).total(),
    output("load_impulse_y_n_s", "N s", "impulse of loads since the start, y", |v, _| v.metrics.totals.impulse.load.y).when(INERTIAL_FLUID).total(),
    output("head_impulse_x_n_s", "N s", "impulse of the held head since the start, x", |v, _| v.metrics.totals.impulse.head.x).when(INERTIAL_FLUID).total(),
    output("head_impulse_y_n_s", "N s", "impulse of the held head since the start, y", |v, _| v.metrics.totals.impulse.head.y).when(INERTIAL_FLUID).total(),
    output("momentum_defect_x_n_s", "N s", "defect of the balance of momentum since the start, x", |v, _| v.metrics.momentum_defect().x).when(INERTIAL_FLUID).total(),
    output("momentum_defect_y_n_s", "N s", "defect of the balance of momentum since the start, y", |v, _| v.metrics.momentum_defect().y).when(INERTIAL_FLUID).total(),
    output("hinge_angle_rad", "rad", "angle of the hinged head, from +x; not limited to a half turn", |v, _| turn(v, 0)[0]).when(HINGE).changing(|now, change, _| turn_change(now, change, 0)[0]).recorded(),
    output("hinge_spin_rad_s", "rad/s", "angular velocity of the hinged head", |v, _| turn(v, 0)[1]).when(HINGE).changing(|now, change, _| turn_change(now, change, 0)[1]).recorded(),
    output("hinge_torque_n_m", "N m", "torque of the motor of the hinged head, with that of its servo and within its limit", |v, _| v.metrics.now.hinge.torque).when(HINGE).fed(HINGE_INPUTS).recorded(),
    output("hinge_power_w", "W", "power supplied by the motor of the hinged head", |v, _| v.metrics.now.hinge.power()).when(HINGE).fed(HINGE_INPUTS).changing(hinge_power_change).recorded(),
    output("tendon_1_tension_n", "N", "tension of tendon 1", |v, _| v.metrics.now.tendons[0].tension).when(TENDON_1).fed(TENSION_1).recorded(),
    output("tendon_1_length_m", "m", "length of tendon 1", |v, _| v.metrics.now.tendons[0].length).when(TENDON_1).recorded(),
    output("tendon_1_power_w", "W", "power supplied by the drive of tendon 1", |v, _| v.metrics.now.tendons[0].power()).when(TENDON_1).fed(TENSION_1).changing(|now, change, _| tendon_power_change(now, change, 0)).recorded(),
    output("tendon_2_tension_n", "N", "tension of tendon 2", |v, _| v.metrics.now.tendons[1].tension).when(TENDON_2).fed(TENSION_2).recorded(),
    output("tendon_2_length_m", "m", "length of tendon 2", |v, _| v.metrics.now.tendons[1].length).when(TENDON_2).recorded(),
    output("tendon_2_power_w", "W", "power supplied by the drive of tendon 2", |v, _| v.metrics.now.tendons[1].power()).when(TENDON_2).fed(TENSION_2).changing(|now, change, _| tendon_power_change(now, change, 1)).recorded(),
    output("tendon_3_tension_n", "N", "tension of tendon 3", |v, _| v.metrics.now.tendons[2].tension).when(TENDON_3).fed(TENSION_3).recorded(),
    output("tendon_3_length_m", "m", "length of tendon 3", |v, _| v.metrics.now.tendons[2].length).when(TENDON_3).recorded(),
    output("tendon_3_power_w", "W", "power supplied by the drive of tendon 3", |v, _| v.metrics.now.tendons[2].power()).when(TENDON_3).fed(TENSION_3).changing(|now, change, _| tendon_power_change(now, change, 2)).recorded(),
    output("tendon_4_tension_n", "N", "tension of tendon 4", |v, _| v.metrics.now.tendons[3].tension).when(TENDON_4).fed(TENSION_4).recorded(),
    output("tendon_4_length_m", "m", "length of tendon 4", |v, _| v.metrics.now.tendons[3].length).when(TENDON_4).recorded(),
    output("tendon_4_power_w", "W", "power supplied by the drive of tendon 4", |v, _| v.metrics.now.tendons[3].power()).when(TENDON_4).fed(TENSION_4).changing(|now, change, _| tendon_power_change(now, change, 3)).recorded(),
    output("net_displacement_m", "m", "x of the centre of mass since the start", |v, _| v.metrics.net_displacement()),
    output("max_lateral_excursion_m", "m", "largest |y| of the centre of mass so far", |v, _| v.metrics.totals.max_lateral).total(),
    output("actuation_work_j", "J", "work done by the moving natural curvature, by active moments and by tendons since the start", |v, _| v.metrics.totals.work.actuation).fed(NATURAL).recorded().total(),
    output("material_work_j", "J", "work dissipated by the damped material since the start", |v, _| v.metrics.totals.work.material).when(DAMPED).recorded().total(),
    output("viscous_work_j", "J", "work dissipated by drag since the start", |v, _| v.metrics.totals.work.viscous).recorded().total(),
    output("wake_work_j", "J", "work lost to the wake since the start", |v, _| v.metrics.totals.work.wake).when(INERTIAL_FLUID).recorded().total(),
    output("spray_work_j", "J", "work lost to the spray at interfaces since the start", |v, _| v.metrics.totals.work.spray).when(SPRAY).recorded().total(),
    output("other_work_j", "J", "work done by other forces since the start", |v, _| v.metrics.totals.work.other).when(OTHER_FORCES).recorded().total(),
    output("load_work_j", "J", "work done by loads since the start", |v, _| v.metrics.totals.work.load).recorded().total(),
    output("head_work_j", "J", "work done by the held head since the start", |v, _| v.metrics.totals.work.head).recorded().total(),
    output("flow_work_j", "J", "work done by the background flow since the start", |v, _| v.metrics.totals.work.flow).fed(&FLUID).fed_in(has_inertial_fluid).recorded().total(),
    output("numerical_dissipation_j", "J", "defect of the energy balance since the start", |v, _| v.metrics.numerical_dissipation()).recorded().total(),
    output("steps", "1", "number of steps", |v, _| v.metrics.totals.steps as f64).total(),
    output("newton_iterations", "1", "number of Newton iterations", |v, _| v.work.newton_iterations as f64).total(),
    output("step_halvings", "1", "number of halved steps", |v, _| v.metrics.totals.halvings as f64).total(),
    output("x_m", "m", "nodes, x", |v, k| v.state.q[2 * k]).sized(Size::Nodes),
    output("y_m", "m", "nodes, y", |v, k| v.state.q[2 * k + 1]).sized(Size::Nodes),
    output("vx_m_s", "m/s", "velocity of the nodes, x", |v, k| v.state.v[2 * k]).sized(Size::Nodes),
    output("vy_m_s", "m/s", "velocity of the nodes, y", |v, k| v.state.v[2 * k + 1]).sized(Size::Nodes),
    output("curvature_1_m", "1/m", "curvature at the joints", |v, k| v.metrics.now.kappa[k] / (v.model().rod.joint_part(k) * v.model().rod.spacing)).sized(Size::Joints),
    output("joint_moment_n_m", "N m", "bending moment at the joints, the couple that passes through them", |v, k| v.metrics.now.moment[k] * bend::curvature_per_turning(v.metrics.now.kappa[k])).sized(Size::Joints).fed(&OWN_NATURAL).changing(joint_moment_change),

    output("cycles_used", "1", "number of whole cycles over which the averages named cycle_... are taken", |v, _| v.cycles.whole(v.state.t).len() as f64).changing(|_, _, _| 0.0).total(),
    output("cycles_periodic", "1", "1 if these cycles differ by at most 1 %, otherwise 0", |v, _| f64::from(CycleDifference::largest(v.cycles.whole(v.state.t), v.dynamics.model.rod.length).is_some_and(|d| d.is_periodic()))).changing(|_, _, _| 0.0).total(),
    average(&cycle::PERIOD, |v, _| v.average(&cycle::PERIOD)),
    average(&cycle::SPEED, |v, _| v.average(&cycle::SPEED)),
    average(&cycle::FORWARD_SPEED, |v, _| v.average(&cycle::FORWARD_SPEED)),
    average(&cycle::DIRECTION, |v, _| v.average(&cycle::DIRECTION)),
    average(&cycle::BODY_LENGTHS, |v, _| v.average(&cycle::BODY_LENGTHS)),
    average(&cycle::TIP_EXCURSION, |v, _| v.average(&cycle::TIP_EXCURSION)),
    average(&cycle::STROUHAL, |v, _| v.average(&cycle::STROUHAL)),
    average(&cycle::SLIP, |v, _| v.average(&cycle::SLIP)).when(ACTUATION),
    average(&cycle::THRUST, |v, _| v.average(&cycle::THRUST)).when(HELD_HEAD),
    average(&cycle::DRAG_THRUST, |v, _| v.average(&cycle::DRAG_THRUST)).when(INERTIAL_FLUID),
    average(&cycle::REACTIVE_THRUST, |v, _| v.average(&cycle::REACTIVE_THRUST)).when(INERTIAL_FLUID),
    average(&cycle::HEAD_FORCE_X, |v, _| v.average(&cycle::HEAD_FORCE_X)).when(HELD_HEAD),
    average(&cycle::HEAD_FORCE_Y, |v, _| v.average(&cycle::HEAD_FORCE_Y)).when(HELD_HEAD),
    average(&cycle::HEAD_MOMENT, |v, _| v.average(&cycle::HEAD_MOMENT)).when(HELD_HEAD),
    average(&cycle::HINGE_TORQUE, |v, _| v.average(&cycle::HINGE_TORQUE)).when(HINGE),
    average(&cycle::HINGE_POWER, |v, _| v.average(&cycle::HINGE_POWER)).when(HINGE),
    average(&cycle::HINGE_ANGLE, |v, _| v.average(&cycle::HINGE_ANGLE)).when(HINGE),
    average(&cycle::HINGE_AMPLITUDE, |v, _| v.average(&cycle::HINGE_AMPLITUDE)).when(HINGE),
    average(&cycle::TRACKING_ERROR, |v, _| v.average(&cycle::TRACKING_ERROR)).when(SERVO),
    average(&cycle::ACTUATION_POWER, |v, _| v.average(&cycle::ACTUATION_POWER)),
    average(&cycle::MATERIAL_POWER, |v, _| v.average(&cycle::MATERIAL_POWER)).when(DAMPED),
    average(&cycle::VISCOUS_POWER, |v, _| v.average(&cycle::VISCOUS_POWER)),
    average(&cycle::WAKE_POWER, |v, _| v.average(&cycle::WAKE_POWER)).when(INERTIAL_FLUID),
    average(&cycle::LOAD_POWER, |v, _| v.average(&cycle::LOAD_POWER)),
    average(&cycle::HEAD_POWER, |v, _| v.average(&cycle::HEAD_POWER)),
    average(&cycle::FLOW_POWER, |v, _| v.average(&cycle::FLOW_POWER)),
    average(&cycle::OTHER_POWER, |v, _| v.average(&cycle::OTHER_POWER)).when(OTHER_FORCES),
    average(&cycle::COST_OF_TRANSPORT, |v, _| v.average(&cycle::COST_OF_TRANSPORT)).when(FREE),
    average(&cycle::EFFICIENCY, |v, _| v.average(&cycle::EFFICIENCY)).fed(&FLUID).changing(efficiency_change),

    input("actuation_amplitude", "1", "amplitude kappa_amp of the actuation, a turning per reference length; of a sine-wave a factor of its curvature", |v, _| v.inputs.drive.amplitude, |d, _, x| d.inputs.drive.amplitude = x[0]).when(CURVATURES),
    input("actuation_moment_n_m", "N m", "amplitude of the actuation's active moment", |v, _| v.inputs.drive.amplitude, |d, _, x| d.inputs.drive.amplitude = x[0]).when(MOMENTS),
    input("actuation_frequency_hz", "Hz", "frequency of the actuation; the phase stays continuous when it changes", |v, _| v.inputs.drive.frequency, |d, t, x| d.inputs.set_frequency(x[0], t)).when(ACTUATION).at_least_zero(),
    input("actuation_phase_rad", "rad", "phase subtracted inside the wave's sine", |v, _| v.inputs.phase_offset, |d, _, x| d.inputs.phase_offset = x[0]).when(ACTUATION),
    input_array("natural_curvature_1_m", "1/m", "the host's own natural curvature at the joints, in addition to the actuation's", Size::Joints, |v, k| of(&v.inputs.natural, k), |d, first, x| set_joints(d, |inputs| &mut inputs.natural, first, x)),
    input_array("active_moment_n_m", "N m", "the host's own active moment at the joints, in addition to the actuation's, which bends them against their stiffness; the shape model uses the resulting curvature", Size::Joints, |v, k| of(&v.inputs.moment, k), |d, first, x| set_joints(d, |inputs| &mut inputs.moment, first, x)).when(WHOLE_RATE),
    input("hinge_added_torque_n_m", "N m", "torque that the host adds to that of the motor of the hinged head, before its limit", |v, _| v.inputs.hinge.torque, |d, _, x| d.inputs.hinge.torque = x[0]).when(HINGE),
    input("hinge_added_angle_rad", "rad", "angle that the host adds to the command of the servo of the hinged head", |v, _| v.inputs.hinge.angle, |d, _, x| d.inputs.hinge.angle = x[0]).when(SERVO),
    input("tendon_1_added_tension_n", "N", "tension that the host adds to that of tendon 1; together they are at least 0", |v, _| v.inputs.tension[0], |d, _, x| d.inputs.tension[0] = x[0]).when(PULLED_1),
    input("tendon_1_added_length_m", "m", "length that the host adds to that which the winch gives tendon 1", |v, _| v.inputs.winch[0], |d, _, x| d.inputs.winch[0] = x[0]).when(WINCH_1),
    input("tendon_2_added_tension_n", "N", "tension that the host adds to that of tendon 2; together they are at least 0", |v, _| v.inputs.tension[1], |d, _, x| d.inputs.tension[1] = x[0]).when(PULLED_2),
    input("tendon_2_added_length_m", "m", "length that the host adds to that which the winch gives tendon 2", |v, _| v.inputs.winch[1], |d, _, x| d.inputs.winch[1] = x[0]).when(WINCH_2),
    input("tendon_3_added_tension_n", "N", "tension that the host adds to that of tendon 3; together they are at least 0", |v, _| v.inputs.tension[2], |d, _, x| d.inputs.tension[2] = x[0]).when(PULLED_3),
    input("tendon_3_added_length_m", "m", "length that the host adds to that which the winch gives tendon 3", |v, _| v.inputs.winch[2], |d, _, x| d.inputs.winch[2] = x[0]).when(WINCH_3),
    input("tendon_4_added_tension_n", "N", "tension that the host adds to that of tendon 4; together they are at least 0", |v, _| v.inputs.tension[3], |d, _, x| d.inputs.tension[3] = x[0]).when(PULLED_4),
    input("tendon_4_added_length_m", "m", "length that the host adds to that which the winch gives tendon 4", |v, _| v.inputs.winch[3], |d, _, x| d.inputs.winch[3] = x[0]).when(WINCH_4),
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
    head_input("head_x_m", "m", "head position, x, now or at the end of the next step as head.input says; set before the first step, the run starts there. Derivatives by a pose at the end are those through the step that led there", |v, _| given_head(v, 0, 0), 0, 0),
    head_input("head_y_m", "m", "head position, y", |v, _| given_head(v, 1, 0), 1, 0),
    head_input("head_angle_rad", "rad", "head angle from +x", |v, _| given_head(v, 2, 0), 2, 0),
    head_input("head_vx_m_s", "m/s", "head velocity, x, at the time of the position; where it is not set it follows from the positions, and is zero where the run starts with a position", |v, _| given_head(v, 0, 1), 0, 1),
    head_input("head_vy_m_s", "m/s", "head velocity, y", |v, _| given_head(v, 1, 1), 1, 1),
    head_input("head_spin_rad_s", "rad/s", "angular velocity of the head", |v, _| given_head(v, 2, 1), 2, 1),
    head_input("head_ax_m_s2", "m/s^2", "head acceleration, x, at the time of the position; where it is not set it follows from positions and velocities", |v, _| given_head(v, 0, 2), 0, 2),
    head_input("head_ay_m_s2", "m/s^2", "head acceleration, y", |v, _| given_head(v, 1, 2), 1, 2),
    head_input("head_spin_rate_rad_s2", "rad/s^2", "angular acceleration of the head", |v, _| given_head(v, 2, 2), 2, 2),

    parameter("nodes", "1", "number of nodes; node 0 is the centre of a head body", |v, _| v.model().rod.nodes as f64),
    parameter("length_m", "m", "length of the rod", |v, _| v.model().rod.length),
    parameter("mass_kg", "kg", "mass of the rod, and of a head body", |v, _| v.model().rod.total_mass()),
    parameter("stretching_stiffness_n", "N", "stretching stiffness EA", |v, _| v.model().rod.ea).elastic(),
    parameter("bending_stiffness_n_m2", "N m^2", "bending stiffness EI before the profile", |v, _| v.model().rod.ei).elastic(),
    parameter("joint_stiffness_n_m2", "N m^2", "bending stiffness EI at the joints", |v, k| v.model().rod.joint_stiffness(k)).sized(Size::Joints).elastic(),
    parameter("time_step_s", "s", "largest internal step", |v, _| v.time_step),
];
