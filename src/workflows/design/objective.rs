//! The objective of a dynamic goal and its derivatives: distance from a target trajectory, distance travelled, efficiency, or a
//! mean over cycles. Least squares use forward sensitivities, scalars the adjoint.

use nalgebra::DVector;
use serde::{Deserialize, Serialize};

use super::design_vector::DesignVector;
use super::markers::Markers;
use super::table::{Aggregate, DesignTable, Goal};
use crate::cycle::{CycleMeasure, MEASURES};
use crate::error::{Error, Result};
use crate::scene::{Document, Scene};
use crate::sensitivity::scene_parameter::{SceneParameter, finite_differences};
use crate::sensitivity::{Output, Parameter, Problem, Quantity, Sensitivities, WorkKind};

/// A target is reached if the root mean square distance from it is below this fraction of the length.
pub(super) const TARGET_TOLERANCE: f64 = 1e-9;

/// The objective function of a dynamic goal.
#[derive(Debug)]
pub struct Objective {
    pub(super) goal: Goal,
    /// -1 if the quantity is to be minimised, or the direction is -x.
    sign: f64,
    /// Target samples: step, and coordinates of the tip or of all nodes (m).
    pub(super) target: Vec<(usize, Vec<f64>)>,
    /// Standard deviation of the target about smooth paths, m, if there are enough samples.
    pub(super) noise: Option<f64>,
    /// Stride: all target samples are at multiples of this number of steps.
    every: usize,
    outputs: Vec<Output>,
    pub(super) length: f64,
    /// True if the objective is the distance from a target trajectory.
    pub(super) fits: bool,
    /// True if the objective is the signed square root of an efficiency.
    rooted: bool,
    smaller_is_better: bool,
    /// The scene, if numbers of it are unknown.
    document: Option<Document>,
    numbers: Vec<SceneParameter>,
}

/// The value of the objective for one design.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct ObjectiveValue {
    /// The value that is minimised.
    pub f: f64,
    /// Derivatives with respect to the parameters, later to the unknowns.
    pub by: Vec<f64>,
    /// Residuals and the rows of their Jacobian, for a least-squares objective.
    pub residuals: Option<(Vec<f64>, Vec<Vec<f64>>)>,
    /// Values and derivatives of all scenarios, if the worst of them counts.
    pub cases: Vec<(f64, Vec<f64>)>,
}

impl ObjectiveValue {
    /// Aggregates the values of several scenarios.
    pub fn of(robust: Aggregate, each: &[Self]) -> Self {
        let sum = |weight: &dyn Fn(usize) -> f64| {
            let mut sum = Self { by: vec![0.0; each[0].by.len()], ..Self::default() };
            for (i, value) in each.iter().enumerate() {
                sum.f += weight(i) * value.f;
                sum.by.iter_mut().zip(&value.by).for_each(|(sum, by)| *sum += weight(i) * by);
            }
            sum
        };
        match robust {
            Aggregate::Mean => sum(&|_| 1.0 / each.len() as f64),
            Aggregate::Worst => {
                let worst = (0..each.len()).max_by(|a, b| each[*a].f.total_cmp(&each[*b].f));
                let cases = each.iter().map(|value| (value.f, value.by.clone())).collect();
                Self { cases, ..sum(&|i| f64::from(u8::from(worst == Some(i)))) }
            }
        }
    }

    /// The part of the gradient with respect to `n` unknowns that all scenarios share: zero if there are scenarios.
    pub fn common(&self, n: usize) -> DVector<f64> {
        if self.cases.is_empty() { DVector::from_column_slice(&self.by) } else { DVector::zeros(n) }
    }
}

impl Objective {
    /// The objective of a scene's design, with the `target` trajectory if there is one.
    ///
    /// # Errors
    /// [`Error::Design`] if the times of the target are not at steps, and for the distance of a held head.
    pub fn new(table: &DesignTable, problem: &Problem, target: Option<&Markers>) -> Result<Self> {
        let nodes = problem.model().rod.nodes;
        let held = problem.model().head.is_some();
        let backwards = table.direction.as_deref() == Some("-x") || table.better.as_deref() == Some("smaller");
        let sign = if backwards { -1.0 } else { 1.0 };
        let along = Output::from(Quantity::CentreOfMass(0)).since_start();
        let fits = table.fits_positions();
        if held && matches!(table.goal, Goal::Distance | Goal::Efficiency) {
            let reason = "a held head does not swim: distance and efficiency need a free one".to_string();
            return Err(Error::Design { reason });
        }
        if table.goal == Goal::Efficiency && problem.model().is_in_flow() {
            let reason = "the goal \"efficiency\" is distance² over work, and in a flow the distance over ground says nothing about \
                          swimming; try \"cycle_efficiency\", which is relative to the flow"
                .to_string();
            return Err(Error::Design { reason });
        }
        let outputs = match table.goal {
            Goal::TrackTip => [0, 1].map(|axis| Quantity::Position(nodes - 1, axis).into()).into(),
            Goal::Identify => {
                let marked = (0..nodes).step_by(target.map_or(1, |markers| markers.every.max(1)));
                marked.flat_map(|k| [0, 1].map(|axis| Quantity::Position(k, axis).into())).collect()
            }
            Goal::Distance => vec![along],
            Goal::Cycle(_) => Vec::new(),
            _ => vec![along, WorkKind::Actuation.into()],
        };
        let times = problem.times();
        let step = |time: f64| {
            let n = times.partition_point(|t| *t < time - 1e-9 * times[times.len() - 1]);
            times.get(n).filter(|t| (**t - time).abs() <= 1e-6 * times[1]).map(|_| n)
        };
        let width = outputs.len();
        let identifies = target.filter(|_| table.goal == Goal::Identify);
        let noise = identifies.and_then(|markers| Some(markers.smooth(None).ok()?.noise));
        let target = match target {
            Some(markers) if fits => {
                let rows = markers.times.iter().zip(&markers.positions);
                let sample = |(time, row): (&f64, &Vec<f64>)| {
                    let off = || Error::Design {
                        reason: format!(
                            "the sample at t = {time} s does not coincide with a time step of the scene, {} s; use a solver.time_step_s that divides the times of all samples",
                            times[1]
                        ),
                    };
                    Ok((step(*time).ok_or_else(off)?, row[row.len() - width..].to_vec()))
                };
                rows.map(sample).collect::<Result<Vec<_>>>()?
            }
            _ => Vec::new(),
        };
        let every = target.iter().fold(0, |all, (n, _)| gcd(all, *n)).max(1);
        let length = problem.model().rod.length;
        Ok(Self {
            goal: table.goal,
            sign,
            target,
            noise,
            every,
            outputs,
            length,
            fits,
            rooted: table.goal == Goal::Efficiency && (table.over.is_none() || table.aggregate() == Aggregate::Worst),
            smaller_is_better: table.smaller_is_better(),
            document: None,
            numbers: table.numbers.clone(),
        })
    }

    /// The measure whose mean over cycles is the objective.
    fn measured(&self) -> Option<CycleMeasure> {
        let Goal::Cycle(key) = self.goal else { return None };
        MEASURES.into_iter().find(|measure| measure.key == key)
    }

    /// Checks that the scene has the mean over cycles.
    ///
    /// # Errors
    /// [`Error::Design`]; those of the simulation.
    pub fn check(&self, problem: &mut Problem) -> Result<()> {
        let Some(measure) = self.measured() else { return Ok(()) };
        if problem.cycle_mean(&measure, &[])?.is_some() {
            return Ok(());
        }
        let why = problem.no_cycle()?.unwrap_or_else(|| {
            "this scene's motion has no such mean; is its head held where it needs a free one?".into()
        });
        Err(Error::Design { reason: format!("no {}: {why}", measure.key) })
    }

    /// The same objective for a scene with unknown numbers.
    pub fn of_document(self, document: &Document) -> Self {
        Self { document: Some(document.clone()), ..self }
    }

    /// The same objective for the scene of `other`.
    pub(super) fn like(self, other: &Self) -> Self {
        Self { document: other.document.clone(), ..self }
    }

    /// True if a smaller value is better.
    pub fn smaller_is_better(&self) -> bool {
        self.smaller_is_better
    }

    /// Name of the goal.
    pub fn name(&self) -> &'static str {
        self.goal.into()
    }

    /// Scale of the residuals: the sum of their squares is the mean square distance per node.
    pub(super) fn scale(&self) -> f64 {
        (2.0 / (self.target.len() * self.outputs.len()) as f64).sqrt()
    }

    /// Least squares: half the mean square distance of the tip, or of all nodes, from the target.
    fn tracked(&self, found: &Sensitivities) -> ObjectiveValue {
        let scale = self.scale();
        let (mut residuals, mut rows) = (Vec::new(), Vec::new());
        for (n, positions) in &self.target {
            let n = n / self.every;
            for (o, x) in positions.iter().enumerate() {
                residuals.push(scale * (found.value(n, o) - x));
                rows.push(found.row(n, o).iter().map(|d| scale * d).collect::<Vec<f64>>());
            }
        }
        let f = 0.5 * residuals.iter().map(|r| r * r).sum::<f64>();
        let width = rows.first().map_or(0, Vec::len);
        let by = (0..width).map(|j| residuals.iter().zip(&rows).map(|(r, row)| r * row[j]).sum()).collect();
        ObjectiveValue { f, by, residuals: Some((residuals, rows)), ..ObjectiveValue::default() }
    }

    /// The objective as a function of the distance in the direction of the goal and, for efficiency, of the work of the actuation; with its derivatives with respect to them.
    fn scalar(&self, found: &[f64]) -> (f64, Vec<f64>) {
        let moved = self.sign * found[0];
        match found.get(1) {
            None => (-moved, vec![-self.sign]),
            // D|D|/W, since efficiency is a constant times D²/W. Its root D/√W increases with it, and has a slope also at D = 0, so
            // that a search can leave designs that swim in the wrong direction; a mean over cases has no root.
            Some(work) if self.rooted => {
                let f = -moved / work.sqrt();
                (f, vec![-self.sign / work.sqrt(), -0.5 * f / work])
            }
            Some(work) => {
                let f = -moved * moved.abs() / work;
                (f, vec![-2.0 * self.sign * moved.abs() / work, -f / work])
            }
        }
    }

    /// Sets the design of `problem`.
    pub(super) fn set(&self, problem: &mut Problem, profile: &DesignVector) -> Result<()> {
        self.set_with(problem, profile, &[])
    }

    /// Sets the design of `problem`, prepared for derivatives with respect to `parameters`.
    pub(super) fn set_with(
        &self,
        problem: &mut Problem,
        profile: &DesignVector,
        parameters: &[Parameter],
    ) -> Result<()> {
        if let Some(document) = &self.document {
            let directions = std::mem::take(&mut problem.directions);
            *problem = Problem::of(&profile.numbers_in(document, &self.numbers)?)?;
            problem.directions = directions;
            if parameters.iter().any(|parameter| matches!(parameter, Parameter::OfScene(_))) {
                problem.finite_differences = finite_differences(document, &self.numbers, &profile.values())?;
            }
        }
        if !profile.stiffness_n_m2.is_empty() {
            problem.set_stiffness(&profile.stiffness_n_m2)?;
        }
        problem.set_actuation(&profile.amplitude, &profile.phase_rad)
    }

    /// The objective and its derivatives with respect to `parameters`: by forward sensitivities for least squares, otherwise by the
    /// adjoint. `None` if the simulation fails.
    pub(super) fn at(
        &self,
        problem: &mut Problem,
        profile: &DesignVector,
        parameters: &[Parameter],
    ) -> Option<ObjectiveValue> {
        self.set_with(problem, profile, parameters).ok()?;
        let value = if self.fits {
            self.tracked(&problem.forward(parameters, &self.outputs, self.every, |_| {}).ok()?)
        } else if let Some(measure) = self.measured() {
            let (mean, mut by) = problem.cycle_mean(&measure, parameters).ok()??;
            by.iter_mut().for_each(|by| *by *= -self.sign);
            ObjectiveValue { f: -self.sign * mean, by, ..ObjectiveValue::default() }
        } else {
            let mut checkpoints = problem.checkpoints();
            let found = problem.forward(&[], &self.outputs, usize::MAX, |state| checkpoints.push(state)).ok()?;
            let (f, slopes) = self.scalar(&found.values[found.values.len() - self.outputs.len()..]);
            let mut by = Vec::new();
            if !parameters.is_empty() {
                let mut weights = vec![0.0; self.outputs.len() * problem.times().len()];
                let last = weights.len() - slopes.len();
                weights[last..].copy_from_slice(&slopes);
                by = problem.adjoint_of(parameters, &self.outputs, &weights, &checkpoints).ok()?;
            }
            ObjectiveValue { f, by, ..ObjectiveValue::default() }
        };
        (value.f.is_finite() && value.by.iter().all(|x| x.is_finite())).then_some(value)
    }

    /// The reported objective for a minimised value: rms distance (m), distance (m), or D²/W (m²/J).
    pub fn shown(&self, f: f64) -> f64 {
        match self.goal {
            _ if self.fits => (2.0 * f).sqrt(),
            Goal::Cycle(_) => -self.sign * f,
            _ if self.rooted => -f * f.abs(),
            _ => -f,
        }
    }

    /// The reported objective of a design; `None` if the simulation fails.
    pub fn measure(&self, problem: &mut Problem, profile: &DesignVector) -> Option<f64> {
        self.at(problem, profile, &[]).map(|value| self.shown(value.f))
    }

    /// The reported objective of a design and its derivatives with respect to `parameters`; `None` if the simulation fails.
    pub fn derivatives(
        &self,
        problem: &mut Problem,
        profile: &DesignVector,
        parameters: &[Parameter],
    ) -> Option<(f64, Vec<f64>)> {
        let value = self.at(problem, profile, parameters)?;
        let shown = self.shown(value.f);
        let slope = match self.goal {
            Goal::TrackTip => 1.0 / shown,
            Goal::Cycle(_) => -self.sign,
            _ if self.rooted => -2.0 * value.f.abs(),
            _ => -1.0,
        };
        Some((shown, value.by.iter().map(|by| slope * by).collect()))
    }

    pub(super) fn is_met(&self, f: f64) -> bool {
        self.fits && self.shown(f) < TARGET_TOLERANCE * self.length
    }
}

/// The objective of `table` in the `scene` of `document`, and the simulation problem.
///
/// # Errors
/// [`Error::Design`] if the scene has no such objective; those of [`Problem::of`].
pub(super) fn objective_of(
    document: &Document,
    scene: &Scene,
    table: &DesignTable,
    target: Option<&Markers>,
) -> Result<(Objective, Problem)> {
    let mut problem = Problem::of(scene)?;
    let objective = Objective::new(table, &problem, target)?;
    objective.check(&mut problem)?;
    let whole = table.numbers.is_empty();
    Ok((if whole { objective } else { objective.of_document(document) }, problem))
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}
