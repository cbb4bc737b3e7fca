//! Differentiable simulations with named outputs and parameters: numbers of the scene, and arrays per joint or node.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::checkpoints::{Checkpoints, ReverseStates};
use super::controls::{Controls, Weights};
use super::forward::Sensitivities;
use super::output::Output;
use super::parameter::Parameter;
use super::problem::Problem;
use super::scene_parameter::{self, SceneParameter, SceneParameters};
use super::trajectory::Trajectory;
use crate::cycle::derivatives;
use crate::error::{Error, Result, did_you_mean, nearest};
use crate::scene::{Document, Scene};
use crate::wording::Phrase;

/// An array of numbers: a scalar (no dimension), a list, or a row per time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Array {
    /// Its dimensions.
    pub shape: Vec<usize>,
    /// Its numbers, in row-major order.
    pub values: Vec<f64>,
}

impl From<f64> for Array {
    fn from(value: f64) -> Self {
        Self { shape: Vec::new(), values: vec![value] }
    }
}

impl From<Vec<f64>> for Array {
    fn from(values: Vec<f64>) -> Self {
        Self { shape: vec![values.len()], values }
    }
}

impl Array {
    /// Rows of `width` numbers.
    fn rows(values: Vec<f64>, width: usize) -> Self {
        Self { shape: vec![values.len() / width.max(1), width], values }
    }
}

/// A parameter of the simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
enum WithRespectTo {
    /// Numbers of the scene, by the index of their key.
    Scene(usize),
    Stiffness,
    Amplitude,
    PhaseProfile,
    Phase,
    Natural,
    /// Forces along an axis.
    Force(usize),
    /// Initial positions along an axis.
    Position(usize),
    /// Initial velocities along an axis.
    Velocity(usize),
}

impl WithRespectTo {
    /// True if it is a parameter of the scene's actuation.
    fn is_of_wave(self) -> bool {
        matches!(self, Self::Amplitude | Self::PhaseProfile | Self::Phase)
    }
}

/// Name, unit and meaning of the parameters that are not keys of the scene.
const NODE_PARAMETERS: [(WithRespectTo, &str, &str, &str); 11] = [
    (WithRespectTo::Stiffness, "joint_stiffness_n_m2", "N m^2", "bending stiffness of the joints"),
    (
        WithRespectTo::Amplitude,
        "joint_amplitude_factor",
        "1",
        "what the amplitude of the scene's actuation is multiplied by at the joints",
    ),
    (
        WithRespectTo::PhaseProfile,
        "joint_phase_rad",
        "rad",
        "phases subtracted inside the sine of the scene's actuation at the joints",
    ),
    (WithRespectTo::Phase, "actuation_phase_rad", "rad", "phase subtracted inside the actuation's sine"),
    (
        WithRespectTo::Natural,
        "natural_curvature_1_m",
        "1/m",
        "natural curvature of the joints in addition to the actuation's; may be given over time",
    ),
    (WithRespectTo::Force(0), "force_x_n", "N", "forces on the nodes, x; may be given over time"),
    (WithRespectTo::Force(1), "force_y_n", "N", "forces on the nodes, y; may be given over time"),
    (
        WithRespectTo::Position(0),
        "x_m",
        "m",
        "nodes at the start, x; a held node 0 is where the head is, and has no derivative",
    ),
    (
        WithRespectTo::Position(1),
        "y_m",
        "m",
        "nodes at the start, y; a held node 0 is where the head is, and has no derivative",
    ),
    (
        WithRespectTo::Velocity(0),
        "vx_m_s",
        "m/s",
        "velocity of the nodes at the start, x; a held node 0 moves with the head, and has no derivative",
    ),
    (
        WithRespectTo::Velocity(1),
        "vy_m_s",
        "m/s",
        "velocity of the nodes at the start, y; a held node 0 moves with the head, and has no derivative",
    ),
];

/// A parameter with respect to which a simulation can be differentiated.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedParameter {
    /// Its name: a key of the scene, or the name of an array per joint or node.
    pub name: String,
    /// SI unit, or `1` if dimensionless.
    pub unit: &'static str,
    /// Description.
    pub description: String,
    /// Its value in the scene.
    pub value: Array,
}

/// All parameters with respect to which a simulation of `scene` can be differentiated.
///
/// # Errors
/// Errors of [`Problem::of`].
pub fn parameters(scene: &Scene) -> Result<Vec<NamedParameter>> {
    let (mut problem, known) = (Problem::of(scene)?, DifferentiableParameters::of(scene)?);
    let named = |name: &str| {
        let (by, unit, description) = known.named(name)?;
        let values = known.value(by, &mut problem);
        let shape = if known.is_single(by) { Vec::new() } else { vec![values.len()] };
        Some(NamedParameter { name: name.to_string(), unit, description, value: Array { shape, values } })
    };
    Ok(known.names().into_iter().filter_map(named).collect())
}

/// All parameters of a scene.
#[derive(Debug)]
struct DifferentiableParameters {
    /// The numbers of every key.
    keys: Vec<Vec<SceneParameter>>,
    driven: bool,
    /// True if the drive has a limit or a lag: its wave may be given, but has no derivatives.
    filtered: bool,
}

impl DifferentiableParameters {
    fn of(scene: &Scene) -> Result<Self> {
        let model = scene.model()?;
        let numbers = SceneParameters::of(scene, &model);
        let keys = numbers.keys().into_iter().map(|key| numbers.of_key(key)).collect();
        Ok(Self { keys, driven: model.actuation.is_some(), filtered: model.filters_drive() })
    }

    fn names(&self) -> Vec<&str> {
        let keys = self.keys.iter().map(|numbers| &*numbers[0].key);
        let named = NODE_PARAMETERS.iter().filter(|(by, ..)| !by.is_of_wave() || self.driven && !self.filtered);
        keys.chain(named.map(|named| named.1)).collect()
    }

    /// The parameter `name`, with unit and description.
    fn named(&self, name: &str) -> Option<(WithRespectTo, &'static str, String)> {
        if let Some((by, _, unit, meaning)) = NODE_PARAMETERS.iter().find(|(_, own, ..)| *own == name) {
            return (self.driven || !by.is_of_wave()).then(|| (*by, *unit, meaning.to_string()));
        }
        let i = self.keys.iter().position(|numbers| numbers[0].key == name)?;
        let numbers = &self.keys[i];
        let meanings: Vec<&str> = numbers.iter().map(|number| &*number.description).collect();
        let meaning = if numbers[0].xi.is_some() { meanings[0].to_string() } else { meanings.join("; ") };
        Some((WithRespectTo::Scene(i), numbers[0].unit, meaning))
    }

    /// True if the parameter is a scalar.
    fn is_single(&self, by: WithRespectTo) -> bool {
        match by {
            WithRespectTo::Phase => true,
            WithRespectTo::Scene(i) => self.keys[i][0].place.is_empty(),
            _ => false,
        }
    }

    /// Its current value.
    fn value(&self, by: WithRespectTo, problem: &mut Problem) -> Vec<f64> {
        let (nodes, joints) = (problem.model().rod.nodes, problem.model().rod.joints().len());
        match by {
            WithRespectTo::Scene(i) => self.keys[i].iter().map(|number| number.own).collect(),
            WithRespectTo::Phase => vec![0.0],
            WithRespectTo::Stiffness => problem.stiffness(),
            WithRespectTo::Amplitude => vec![1.0; joints],
            WithRespectTo::PhaseProfile | WithRespectTo::Natural => vec![0.0; joints],
            WithRespectTo::Force(_) => vec![0.0; nodes],
            WithRespectTo::Position(i) => along(&problem.first()[0], i),
            WithRespectTo::Velocity(i) => along(&problem.first()[1], i),
        }
    }

    /// The error for a derivative with respect to an unknown `name`.
    fn refuse(&self, scene: &Scene, name: &str) -> Error {
        let names = self.names();
        let hint = match scene.not_a_number(name) {
            Some(reason) => format!(": {reason}"),
            None => did_you_mean(nearest(name, names.iter().map(AsRef::as_ref))),
        };
        let scene = &scene.name;
        refusal(format!("a simulation of {scene:?} has no derivative by `{name}`{hint}; allowed: {}", names.join(", ")))
    }
}

/// The source of an output.
#[derive(Debug, Clone, Copy)]
enum OutputSource {
    /// The index of an output.
    Output(usize),
    Position(usize),
    Velocity(usize),
}

/// Prefix of the names of means over whole cycles.
const CYCLE_PREFIX: &str = "cycle_";

/// The given position of a held node may deviate from the head by this fraction of the largest given number.
const HELD_ROUNDING: f64 = 1e-12;

/// Outputs that have no derivative with respect to a control over time.
const NEEDS_RATE: [&str; 1] = ["actuation_power_w"];

/// The stored states of a simulation.
#[derive(Debug)]
enum KeptStates {
    /// All states, if they are read.
    All(Trajectory),
    /// The states that derivatives need.
    Checkpoints(Checkpoints),
}

/// A simulation of a scene with named outputs and their derivatives with respect to named parameters. It runs when a result is
/// first requested.
#[derive(Debug)]
pub struct Simulation {
    problem: Problem,
    /// The scene with the given numbers.
    document: Document,
    scene: Scene,
    known: DifferentiableParameters,
    outputs: Vec<Output>,
    reads: Vec<(String, OutputSource)>,
    /// Stiffness of the joints, if given.
    stiffness: Option<Vec<f64>>,
    /// Factors and phases of the actuation.
    factors: Vec<f64>,
    phases: Vec<f64>,
    phase: f64,
    /// Names of the parameters that are given over time.
    over_time: Vec<String>,
    simulated: Option<(KeptStates, Sensitivities)>,
    /// True if a mean over cycles was requested.
    has_mean: bool,
}

impl Simulation {
    /// A simulation of the scene of `document` with these `outputs`: recorded variables, or `x_m`, `y_m`, `vx_m_s`, `vy_m_s` of
    /// the nodes. `values` replace those of the [`parameters`] with these names.
    ///
    /// # Errors
    /// Errors of the scene and of [`Problem::of`]; [`Error::Derivative`], [`Error::WrongLength`] and [`Error::UnknownVariable`].
    pub fn of(document: &Document, outputs: &[&str], values: &[(&str, Array)]) -> Result<Self> {
        let mut document = document.clone();
        let as_is = document.scene()?;
        document.keep_fluid_of(&as_is);
        let known = DifferentiableParameters::of(&as_is)?;
        for (name, value) in values.iter().filter(|(name, _)| !NODE_PARAMETERS.iter().any(|named| named.1 == *name)) {
            finite(name, value)?;
            let Some((WithRespectTo::Scene(i), ..)) = known.named(name) else {
                // The error of the scene suggests a similar key.
                document.set(&format!("{name}={:e}", value.values.first().unwrap_or(&0.0)))?;
                document.scene()?;
                return Err(known.refuse(&as_is, name));
            };
            let (own, found) = (&known.keys[i], value.values.len());
            if own.len() != found {
                return Err(refusal(format!("{name}: found {found} values; allowed: {}", own.len())));
            }
            for (key, value) in scene_parameter::keys_with(own, &value.values) {
                document.set_value("a simulation's values", &key, &value);
            }
        }
        let scene = document.scene()?;
        let (known, problem) = (DifferentiableParameters::of(&scene)?, Problem::of(&scene)?);
        let joints = problem.model().rod.joints().len();
        let mut own = Self {
            problem,
            document,
            scene,
            known,
            outputs: Vec::new(),
            reads: Vec::new(),
            stiffness: None,
            factors: vec![1.0; joints],
            phases: vec![0.0; joints],
            phase: 0.0,
            over_time: Vec::new(),
            simulated: None,
            has_mean: false,
        };
        own.take_values(values)?;
        for name in outputs {
            let read = match *name {
                "x_m" => OutputSource::Position(0),
                "y_m" => OutputSource::Position(1),
                "vx_m_s" => OutputSource::Velocity(0),
                "vy_m_s" => OutputSource::Velocity(1),
                _ => {
                    let output = Output::named(name, own.problem.model()).map_err(|unknown| {
                        if !name.starts_with(CYCLE_PREFIX) {
                            return unknown;
                        }
                        refusal(format!(
                            "{name}: found a mean over cycles, which is a single number per run; allowed: outputs that change in time, or value_and_grad for means"
                        ))
                    })?;
                    own.outputs.push(output);
                    OutputSource::Output(own.outputs.len() - 1)
                }
            };
            own.reads.push((name.to_string(), read));
        }
        Ok(own)
    }

    /// Stores those of `values` that are not numbers of the scene.
    fn take_values(&mut self, values: &[(&str, Array)]) -> Result<()> {
        let (nodes, joints) = (self.nodes(), self.joints());
        let times = self.problem.times().len();
        let (mut natural, mut force) = (None, [None, None]);
        let mut first = Vec::new();
        for (name, value) in values {
            let Some((by, ..)) = self.known.named(name) else { return Err(self.known.refuse(&self.scene, name)) };
            let width = match by {
                WithRespectTo::Scene(_) => continue, // already in the scene
                WithRespectTo::Phase => 1,
                WithRespectTo::Stiffness
                | WithRespectTo::Amplitude
                | WithRespectTo::PhaseProfile
                | WithRespectTo::Natural => joints,
                WithRespectTo::Force(_) | WithRespectTo::Position(_) | WithRespectTo::Velocity(_) => nodes,
            };
            finite(name, value)?;
            if value.values.len() != value.shape.iter().product::<usize>() {
                let found = format!("{} values for the shape {:?}", value.values.len(), value.shape);
                return Err(refusal(format!("{name}: found {found}; allowed: as many as the shape has")));
            }
            let may_be_timed = matches!(by, WithRespectTo::Natural | WithRespectTo::Force(_));
            let timed = match value.shape[..] {
                [] if by == WithRespectTo::Phase => false,
                [n] if n == width => false,
                [t, n] if may_be_timed && t == times && n == width => true,
                _ => {
                    let rows = if may_be_timed { format!(" or ({times}, {width})") } else { String::new() };
                    let found = tuple(&value.shape);
                    return Err(refusal(format!("{name}: found the shape {found}; allowed: ({width},){rows}")));
                }
            };
            let row = value.values.clone();
            let spread = |row: Vec<f64>| if timed { row } else { row.repeat(times) };
            if timed {
                self.over_time.push(name.to_string());
            }
            match by {
                WithRespectTo::Scene(_) => {}
                WithRespectTo::Phase => self.phase = row[0],
                WithRespectTo::Stiffness => {
                    if let Some(bad) = row.iter().find(|ei| **ei <= 0.0) {
                        return Err(refusal(format!("{name}: found {bad}; allowed: positive numbers")));
                    }
                    self.stiffness = Some(row);
                }
                WithRespectTo::Amplitude => self.factors = row,
                WithRespectTo::PhaseProfile => self.phases = row,
                WithRespectTo::Natural => natural = Some(spread(row)),
                WithRespectTo::Force(axis) => force[axis] = Some(spread(row)),
                WithRespectTo::Position(axis) => first.push((false, axis, row)),
                WithRespectTo::Velocity(axis) => first.push((true, axis, row)),
            }
        }
        self.set()?;
        let force = (force != [None, None]).then(|| {
            let [x, y] = force.map(|part| part.unwrap_or_else(|| vec![0.0; times * nodes]));
            x.iter().zip(&y).flat_map(|(x, y)| [*x, *y]).collect()
        });
        self.problem.set_controls(Controls { natural, force })?;
        self.check_held(&first)?;
        first.into_iter().try_for_each(|(velocities, axis, row)| self.problem.set_first(velocities, axis, row))
    }

    /// Returns an error if a `first` state moves the node of a held head. Each entry states whether it holds velocities, and its
    /// axis.
    fn check_held(&mut self, first: &[(bool, usize, Vec<f64>)]) -> Result<()> {
        if self.problem.model().head.is_none() || first.is_empty() {
            return Ok(());
        }
        let state = self.problem.first();
        for (velocities, axis, row) in first {
            let (found, held) = (row[0], state[usize::from(*velocities)][*axis]);
            let size = row.iter().fold(held.abs(), |size, x| size.max(x.abs()));
            if (found - held).abs() > HELD_ROUNDING * size {
                let name = initial_state_name(*velocities, *axis);
                return Err(refusal(format!(
                    "{name}: found {found} at node 0, which the head holds at {held}; allowed: that, or another [head] in the scene"
                )));
            }
        }
        Ok(())
    }

    /// Passes the values to the problem and its perturbed scenes.
    fn set(&mut self) -> Result<()> {
        if let Some(stiffness) = &self.stiffness {
            self.problem.set_stiffness(stiffness)?;
        }
        self.problem.set_phase(self.phase);
        self.problem.set_actuation(&self.factors, &self.phases)
    }

    fn nodes(&self) -> usize {
        self.problem.model().rod.nodes
    }

    fn joints(&self) -> usize {
        self.problem.model().rod.joints().len()
    }

    /// A flag that another thread sets to interrupt the computation, with [`Error::Interrupted`].
    pub fn interrupt(&self) -> Arc<AtomicBool> {
        self.problem.interrupt()
    }

    /// All times, including the start, s.
    pub fn times(&self) -> Vec<f64> {
        self.problem.times()
    }

    /// Simulates, unless this has been done already.
    ///
    /// # Errors
    /// The error of a step that fails; failing steps are not halved.
    pub fn simulate(&mut self) -> Result<()> {
        if self.simulated.is_none() {
            let reads_states = self.reads.iter().any(|(_, read)| !matches!(read, OutputSource::Output(_)));
            self.simulated = Some(if reads_states {
                let (trajectory, values) = self.problem.simulate_with(&self.outputs)?;
                (KeptStates::All(trajectory), values)
            } else {
                let (checkpoints, values) = self.problem.simulate_with_checkpoints(&self.outputs)?;
                (KeptStates::Checkpoints(checkpoints), values)
            });
        }
        Ok(())
    }

    /// The outputs over time, in order: a number per time, or a row per time for `x_m`, `y_m`, `vx_m_s` and `vy_m_s`.
    ///
    /// # Errors
    /// Errors of [`simulate`](Self::simulate).
    pub fn outputs(&mut self) -> Result<Vec<(&str, Array)>> {
        self.simulate()?;
        let (nodes, Some((states, values))) = (self.nodes(), &self.simulated) else { return Ok(Vec::new()) };
        let times = 0..values.times.len();
        let rows = |of: fn(&Trajectory, usize) -> &[f64], i: usize| match states {
            KeptStates::All(trajectory) => {
                Array::rows(times.clone().flat_map(|n| along(of(trajectory, n), i)).collect(), nodes)
            }
            KeptStates::Checkpoints(_) => Array::rows(Vec::new(), nodes), // not read in this case
        };
        let read = |read: OutputSource| match read {
            OutputSource::Output(o) => times.clone().map(|n| values.value(n, o)).collect::<Vec<f64>>().into(),
            OutputSource::Position(i) => rows(Trajectory::positions, i),
            OutputSource::Velocity(i) => rows(Trajectory::velocities, i),
        };
        Ok(self.reads.iter().map(|(name, what)| (&**name, read(*what))).collect())
    }

    /// Notes on a run of the scene: a model, steps or an energy balance out of range; and cycles that are not periodic, if a mean
    /// over them was requested.
    ///
    /// # Errors
    /// Errors of [`simulate`](Self::simulate), and of the scene's [`Assessment`](crate::assessment::Assessment).
    #[cfg(feature = "faer")]
    pub fn notes(&mut self) -> Result<Vec<String>> {
        let warnings =
            crate::assessment::Assessment::of_run(&self.scene, &crate::stepper::Stepper::of(&self.scene)?)?.warnings;
        let (metrics, end) = self.problem.simulate_metrics()?;
        let step_control = self.scene.step_control();
        let mut notes =
            crate::diagnostics::notes(&self.scene, self.problem.model(), &metrics, &end, step_control, &warnings);
        if self.has_mean {
            let (cycles, _) = self.problem.simulate_cycles(|_| {})?;
            let averages = cycles.averages(&self.problem.dynamics);
            notes.extend(match averages.difference {
                Some(difference) if difference.is_periodic() => None,
                Some(difference) => Some(format!(
                    "not periodic yet: {difference} from cycle to cycle, and the means are taken over these cycles"
                )),
                None => Some(
                    "the means are taken over a single cycle, which does not show whether the motion is periodic"
                        .to_string(),
                ),
            });
        }
        Ok(notes)
    }

    /// The parameters with these names.
    fn by(&self, names: &[&str]) -> Result<Vec<WithRespectTo>> {
        let find = |name: &&str| self.known.named(name).map(|named| named.0);
        names.iter().map(|name| find(name).ok_or_else(|| self.known.refuse(&self.scene, name))).collect()
    }

    /// The parameters of the problem for `by`, in order; also prepares their finite differences.
    fn parameters(&mut self, by: &[WithRespectTo]) -> Result<Vec<Parameter>> {
        if by.contains(&WithRespectTo::Amplitude) && self.factors.contains(&0.0) {
            return Err(refusal("joint_amplitude_factor: no derivative where a factor is 0".to_string()));
        }
        let of_scene =
            |by: &WithRespectTo| if let WithRespectTo::Scene(i) = by { &self.known.keys[*i][..] } else { &[] };
        let mut numbers: Vec<SceneParameter> = by.iter().flat_map(of_scene).cloned().collect();
        scene_parameter::assign_indices(&mut numbers);
        let own: Vec<f64> = numbers.iter().map(|number| number.own).collect();
        self.problem.finite_differences = scene_parameter::finite_differences(&self.document, &numbers, &own)?;
        self.set()?;
        let joints = || self.problem.model().rod.joints();
        let mut numbers = numbers.into_iter();
        let of = |by: &WithRespectTo| -> Vec<Parameter> {
            match by {
                WithRespectTo::Scene(i) => {
                    numbers.by_ref().take(self.known.keys[*i].len()).map(|number| number.by).collect()
                }
                WithRespectTo::Phase => vec![Parameter::Phase],
                WithRespectTo::Stiffness => joints().map(Parameter::Stiffness).collect(),
                WithRespectTo::Amplitude => joints().map(Parameter::WaveAmplitude).collect(),
                WithRespectTo::PhaseProfile => joints().map(Parameter::WavePhase).collect(),
                WithRespectTo::Natural
                | WithRespectTo::Force(_)
                | WithRespectTo::Position(_)
                | WithRespectTo::Velocity(_) => Vec::new(),
            }
        };
        Ok(by.iter().flat_map(of).collect())
    }

    /// Collects the derivatives with respect to `by` from those with respect to the parameters of the problem.
    fn take(&self, by: WithRespectTo, from: &mut impl Iterator<Item = f64>) -> Array {
        let joints = self.joints();
        let values: Vec<f64> = match by {
            WithRespectTo::Scene(i) => from.take(self.known.keys[i].len()).collect(),
            WithRespectTo::Phase => from.take(1).collect(),
            WithRespectTo::Stiffness | WithRespectTo::PhaseProfile => from.take(joints).collect(),
            // The parameter is a factor of the current value.
            WithRespectTo::Amplitude => from.take(joints).zip(&self.factors).map(|(by, factor)| by / factor).collect(),
            WithRespectTo::Natural
            | WithRespectTo::Force(_)
            | WithRespectTo::Position(_)
            | WithRespectTo::Velocity(_) => Vec::new(),
        };
        if self.known.is_single(by) { Array { shape: Vec::new(), values } } else { values.into() }
    }

    /// The derivatives with respect to named parameters of Σ w y over all outputs y and times, with `weights` w of the same shape
    /// as each output.
    ///
    /// # Errors
    /// [`Error::Derivative`] for an output or a parameter without derivatives, including an initial state that is not given;
    /// [`Error::WrongLength`] for weights of another shape; errors of [`simulate`](Self::simulate).
    pub fn pull_back(&mut self, weights: &[(&str, Array)], names: &[&str]) -> Result<Vec<Array>> {
        let by = self.by(names)?;
        for (name, by) in names.iter().zip(&by) {
            if let Some((velocities, axis)) = initial_state_axis(*by)
                && !self.problem.has_first(velocities, axis)
            {
                let problem =
                    format!("derivatives by the initial state require it; give {name}, as it is in the scene");
                return Err(refusal(problem));
            }
        }
        self.simulate()?;
        let (times, nodes) = (self.problem.times().len(), self.nodes());
        let count = self.outputs.len();
        let mut all = [vec![0.0; times * count], Vec::new(), Vec::new()];
        for (name, given) in weights {
            let Some((_, read)) = self.reads.iter().find(|(own, _)| own == name) else {
                return Err(refusal(format!("`{name}` was not read")));
            };
            if let Some(control) = names.iter().zip(&by).find(|(own, by)| {
                **by == WithRespectTo::Natural
                    && self.over_time.iter().any(|name| name == *own)
                    && NEEDS_RATE.contains(name)
            }) {
                let control = control.0;
                return Err(refusal(format!(
                    "{name} has no derivative by {control} over time, whose rate is not given"
                )));
            }
            let (list, width, stride, offset) = match read {
                OutputSource::Output(o) => (&mut all[0], 1, count, *o),
                OutputSource::Position(i) => (&mut all[1], nodes, 2 * nodes, *i),
                OutputSource::Velocity(i) => (&mut all[2], nodes, 2 * nodes, *i),
            };
            list.resize(times * stride, 0.0);
            if given.values.len() != times * width {
                let (expected, found) = (times * width, given.values.len());
                return Err(Error::WrongLength { name: "weights", expected, found });
            }
            for (n, row) in given.values.chunks(width).enumerate() {
                for (k, weight) in row.iter().enumerate() {
                    list[n * stride + offset + 2 * k] += weight;
                }
            }
        }
        let parameters = self.parameters(&by)?;
        let Some((states, _)) = &self.simulated else { return Ok(Vec::new()) };
        let states = match states {
            KeptStates::All(trajectory) => ReverseStates::of(trajectory),
            KeptStates::Checkpoints(checkpoints) => checkpoints.states(),
        };
        let weights = Weights { outputs: &all[0], positions: &all[1], velocities: &all[2] };
        let by_natural = by.contains(&WithRespectTo::Natural);
        let by_forces = by.iter().any(|by| matches!(by, WithRespectTo::Force(_)));
        let found = self.problem.backward_pass(&parameters, &self.outputs, weights, states, [by_natural, by_forces])?;
        let mut parts = found.parameters.iter().copied();
        let mut result = Vec::with_capacity(by.len());
        for (name, by) in names.iter().zip(by) {
            let (rows, width) = match by {
                WithRespectTo::Natural => (found.natural.clone(), self.joints()),
                WithRespectTo::Force(i) => (along(&found.force, i), nodes),
                WithRespectTo::Position(i) => (along(&found.start[0], i), nodes),
                WithRespectTo::Velocity(i) => (along(&found.start[1], i), nodes),
                _ => {
                    result.push(self.take(by, &mut parts));
                    continue;
                }
            };
            if self.over_time.iter().any(|own| own == name) {
                result.push(Array::rows(rows, width));
            } else {
                let mut sum = vec![0.0; width];
                rows.chunks(width).for_each(|row| sum.iter_mut().zip(row).for_each(|(sum, x)| *sum += x));
                result.push(sum.into());
            }
        }
        Ok(result)
    }

    /// A mean over the last whole cycles, and its derivatives with respect to named parameters, which are constant over the
    /// simulation.
    ///
    /// # Errors
    /// [`Error::Derivative`] for a mean or a parameter without derivatives; errors of [`simulate`](Self::simulate).
    pub fn cycle_mean(&mut self, measure: &str, names: &[&str]) -> Result<(f64, Vec<Array>)> {
        let by = self.by(names)?;
        let Some(measure) = derivatives::differentiable().find(|own| own.key == measure) else {
            let known: Vec<&str> = derivatives::differentiable().map(|own| own.key).collect();
            return Err(refusal(format!("`{measure}` has no derivative; allowed: {}", known.join(", "))));
        };
        let other = |by: &WithRespectTo| {
            matches!(
                by,
                WithRespectTo::Natural
                    | WithRespectTo::Force(_)
                    | WithRespectTo::Position(_)
                    | WithRespectTo::Velocity(_)
            )
        };
        if let Some((name, _)) = names.iter().zip(&by).find(|(_, by)| other(by)) {
            return Err(refusal(format!("means over cycles have no derivative by {name}")));
        }
        let parameters = self.parameters(&by)?;
        let Some((value, slopes)) = self.problem.cycle_mean(&measure, &parameters)? else {
            let (key, reason) = (measure.key, self.problem.no_mean(&measure)?);
            return Err(refusal(format!("this run has no {key}: {reason}")));
        };
        self.has_mean = true;
        let mut parts = slopes.into_iter();
        Ok((value, by.into_iter().map(|by| self.take(by, &mut parts)).collect()))
    }

    /// The final value of `output`, or the mean over the last whole cycles of that name, with its derivatives with respect to
    /// named parameters. An initial state among the parameters is treated as given.
    ///
    /// # Errors
    /// Errors of [`pull_back`](Self::pull_back) and [`cycle_mean`](Self::cycle_mean).
    pub fn value_and_grad(&mut self, output: &str, names: &[&str]) -> Result<(f64, Vec<Array>)> {
        if output.starts_with(CYCLE_PREFIX) {
            return self.cycle_mean(output, names);
        }
        for (velocities, axis) in self.by(names)?.into_iter().filter_map(initial_state_axis) {
            if !self.problem.has_first(velocities, axis) {
                let first = &self.problem.first()[usize::from(velocities)];
                self.problem.set_first(velocities, axis, along(first, axis))?;
            }
        }
        let values = self.outputs()?.into_iter().find(|(name, _)| *name == output).map(|(_, values)| values);
        let Some(Array { shape, mut values }) = values else { return Err(refusal(format!("`{output}` was not read"))) };
        let Some(value) = values.last().copied().filter(|_| shape.len() == 1) else {
            return Err(refusal(format!("{output} has a number for every node; weigh them in {}", Phrase::PullsBack)));
        };
        values.fill(0.0);
        values.last_mut().into_iter().for_each(|last| *last = 1.0);
        Ok((value, self.pull_back(&[(output, values.into())], names)?))
    }
}

/// The final value of `output` in a simulation of the scene of `document`, and its exact derivatives with respect to the named
/// [`parameters`], in order. `output` is a recorded variable, or a mean over the last whole cycles such as
/// `cycle_forward_speed_m_s`. [`Simulation`] accepts other values of parameters, and provides derivatives of sums over time.
///
/// # Errors
/// Errors of [`Simulation::of`] and [`Simulation::value_and_grad`].
pub fn value_and_grad(document: &Document, output: &str, names: &[&str]) -> Result<(f64, Vec<Array>)> {
    let read = if output.starts_with(CYCLE_PREFIX) { &[][..] } else { &[output] };
    Simulation::of(document, read, &[])?.value_and_grad(output, names)
}

/// Formats a shape as a Python tuple.
fn tuple(shape: &[usize]) -> String {
    match shape {
        [length] => format!("({length},)"),
        _ => format!("({})", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// The name of the initial velocities, or of the initial positions, along an axis.
fn initial_state_name(velocities: bool, axis: usize) -> &'static str {
    let by = if velocities { WithRespectTo::Velocity(axis) } else { WithRespectTo::Position(axis) };
    NODE_PARAMETERS.iter().find(|named| named.0 == by).map_or("the first state", |named| named.1)
}

/// Whether `by` is the initial velocities (true) or positions, and their axis.
fn initial_state_axis(by: WithRespectTo) -> Option<(bool, usize)> {
    match by {
        WithRespectTo::Position(axis) => Some((false, axis)),
        WithRespectTo::Velocity(axis) => Some((true, axis)),
        _ => None,
    }
}

/// The entries along an axis.
fn along(values: &[f64], axis: usize) -> Vec<f64> {
    values.iter().skip(axis).step_by(2).copied().collect()
}

fn refusal(problem: String) -> Error {
    Error::Derivative { problem }
}

fn finite(name: &str, array: &Array) -> Result<()> {
    let bad = array.values.iter().find(|x| !x.is_finite());
    bad.map_or(Ok(()), |bad| Err(refusal(format!("{name}: found {bad}; allowed: finite numbers"))))
}
