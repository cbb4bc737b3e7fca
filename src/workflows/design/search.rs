//! The search for a design: sequential quadratic programming (SQP) with a trust region and an exact penalty, on simulated objectives with
//! exact sensitivities.
//!
//! Each step solves min gᵀd + ½dᵀHd subject to bounds, order and linearised means and limits. A step without sufficient decrease of the
//! merit function, or whose simulation fails, is rejected. Roughness adds its own matrix to H. The rest of H is
//!
//! - for a tracked tip, in compliances, the Levenberg-Marquardt matrix JᵀJ + μfM with M = 1 + (0.3 L)⁴ D₂ᵀD₂. M makes steps smooth
//!   wherever the tip does not require otherwise, since they would follow narrow curved valleys. The damping decreases with the
//!   objective f (half the mean square), so that it does not slow the final convergence (Yamashita & Fukushima, Computing Suppl. 15,
//!   2001); μ follows the gain ratio (Nielsen, IMM-REP-1999-05);
//! - otherwise, in logarithms, a damped BFGS matrix of the Lagrangian (Nocedal & Wright, Numerical Optimization, 2006, section
//!   18.3), with the trust region |d_i| ≤ Δ.
//!
//! The maximum over several scenarios is not differentiable where another one becomes the worst. The program therefore has another
//! variable t, and a constraint f_i + g_iᵀd ≤ t per scenario i, whose duals weight the scenarios in the Lagrangian.

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::checkpoint::Checkpoint;
use super::design_vector::DesignVector;
use super::identify::{Identifiability, MAX_RELATIVE_DEVIATION};
use super::limits::{LimitUse, LimitValue, Limits, NEUTRAL_SIDES, PenaltyGroups, total_violation};
use super::objective::{Objective, ObjectiveValue, TARGET_TOLERANCE};
use super::qp::{Constraint, QuadraticProgram};
use super::refit::max_misfit;
use super::scenarios::{Scenario, evaluate_all};
use super::table::{DesignTable, DesignVariable, Goal};
use super::tolerance::{Tolerance, tolerance};
use super::unknowns::{FIXED_UNKNOWN, RANK_TOLERANCE, Unknowns};
use crate::error::{Error, Result};
use crate::sensitivity::{Parameter, Problem};

/// Tolerances of stationarity: the largest component of the Lagrangian's gradient over the objective, or for least squares the
/// cosine between residuals and columns of the Jacobian, as in MINPACK. A search continues down to the first, and has converged at
/// the second; it stops there if the next step predicts a reduction below [`NEGLIGIBLE_REDUCTION`].
const STATIONARITY_TOLERANCE: [f64; 2] = [1e-7, 1e-6];

/// Least standard deviation of a target's coordinates, over the length.
const MIN_TARGET_DEVIATION: f64 = 1e-6;

/// Unknowns with a larger component in a poorly determined direction are reported as part of it.
const MIN_COMPONENT: f64 = 0.2;

/// Initial Levenberg-Marquardt damping μ.
const INITIAL_DAMPING: f64 = 1.0;

/// Length over which steps of a tracked tip are smoothed, over the rod's length.
const SMOOTHING_LENGTH: f64 = 0.3;

/// Default of the largest number of iterations per start.
pub(super) const DEFAULT_MAX_ITERATIONS: usize = 200;

/// After this many quasi-Newton updates the Hessian is recomputed by finite differences of the gradient, with this step; its
/// eigenvalues are at least this fraction of the largest.
const HESSIAN_REFRESH_INTERVAL: usize = 15;
const FINITE_DIFFERENCE_STEP: f64 = 1e-4;
const MIN_RELATIVE_EIGENVALUE: f64 = 1e-6;

/// A limit that is violated by less than this counts as kept.
pub(super) const FEASIBILITY_TOLERANCE: f64 = 1e-6;

/// Penalty parameter of the exact penalty function, in units of the objective.
const INITIAL_PENALTY: f64 = 10.0;
const MAX_PENALTY: f64 = 1e6;

/// Trust-region radius; the search ends when it shrinks below the smallest.
const INITIAL_TRUST_RADIUS: f64 = 0.5;
const MAX_TRUST_RADIUS: f64 = 2.0;
const MIN_TRUST_RADIUS: f64 = 1e-9;

/// Predicted reductions below this fraction of the objective are indistinguishable from rounding.
const ROUNDING_REDUCTION: f64 = 1e-13;

/// Ratio of actual to predicted reduction below which the trust region shrinks, and a second-order correction is tried: along
/// curved limits an exact penalty would otherwise reject all but the shortest steps (Maratos effect; Nocedal & Wright, section
/// 18.3).
const POOR_REDUCTION_RATIO: f64 = 0.25;

/// Below this predicted reduction a step is judged by the gradients at both of its ends, since differences of values are rounding
/// errors: near an optimum gradients determine it with twice as many digits (Hager & Zhang, SIAM J. Optim. 16, 2005).
const GRADIENT_CRITERION_BELOW: f64 = 1e-9;

/// Predicted reductions below this fraction of the objective are not worth a simulation.
const NEGLIGIBLE_REDUCTION: f64 = 1e-11;

/// Least ratio of actual to predicted reduction of an accepted step.
const SUFFICIENT_DECREASE: f64 = 1e-4;

/// Two starts reached the same optimum if their objectives differ by less than the first, relative, or all unknowns by less than the second
/// (logarithms, or rad).
pub(super) const SAME_OPTIMUM: [f64; 2] = [1e-4, 1e-2];

/// Number of designs that are evaluated for each start except the first.
const SAMPLES_PER_START: usize = 12;

/// Restarts, with a higher penalty, of a start that ends with a violated limit.
const MAX_RESTARTS: usize = 3;

/// Largest Levenberg-Marquardt damping.
const MAX_DAMPING: f64 = 1e12;

/// Identification ends if the predicted reduction is below this fraction of the cost of one standard deviation of an unknown: then
/// only unknowns that the data do not determine would still change.
const NEGLIGIBLE_FIT_REDUCTION: f64 = 1e-4;

/// Reason for the end of a search that reached the maximum number of iterations.
pub(super) const ITERATIONS_EXHAUSTED: &str = "the maximum number of iterations was reached";

/// Name of the trust region's constraints, which are not reported.
const TRUST_REGION: &str = "trust region";

/// Prefix of the names of constraints of scenarios that are among the worst.
pub(super) const WORST_SCENARIO: &str = "among the worst cases: ";

/// One iteration of a search, for progress and figures.
#[derive(Debug, Clone, Serialize)]
pub struct SearchIteration {
    /// Index of the start.
    pub start: usize,
    /// Index of the iteration.
    pub iteration: usize,
    /// The reported objective.
    pub objective: f64,
    /// Stationarity: norm of the Lagrangian's gradient over the objective, or for least squares the cosine between residuals and
    /// Jacobian.
    pub stationarity: f64,
    /// The largest component of the step.
    pub step: f64,
    /// False for a rejected step.
    pub accepted: bool,
}

/// The result of a search.
#[derive(Debug, Clone, Serialize)]
pub struct SearchResult {
    /// The best design.
    #[serde(flatten)]
    pub profile: DesignVector,
    /// Reported objective of the best design.
    pub objective: f64,
    /// Stationarity of the best design.
    pub stationarity: f64,
    /// True if it is stationary, the target is reached, or only noise remains to be fitted.
    pub converged: bool,
    /// Why the search ended.
    pub why: String,
    /// True if all limits are kept.
    pub kept: bool,
    /// The objective at the end of each start.
    pub starts: Vec<f64>,
    /// Index of the optimum that each start reached, from 1, the best; `None` if it did not converge.
    pub optima: Vec<Option<usize>>,
    /// All iterations.
    pub history: Vec<SearchIteration>,
    /// Active constraints, with their duals over the objective.
    pub active: Vec<(String, f64)>,
    /// EI of the baseline's joints, N m².
    pub own_stiffness_n_m2: Vec<f64>,
    /// For a tracked tip: relative standard deviation of each joint's stiffness, if each coordinate of the target has the standard
    /// deviation of the residual, or a millionth of the length.
    pub deviations: Vec<f64>,
    /// For a tracked tip: singular values of the Jacobian (m), in descending order.
    pub singular_values: Vec<f64>,
    /// The estimated numbers of the scene.
    pub numbers: Vec<EstimatedNumber>,
    /// For identification: groups of unknowns that the data determine only together, or single ones that they do not determine.
    pub confused: Vec<Vec<String>>,
    /// For identification: standard deviation of a marker coordinate, m, as given or from the residual.
    pub noise_m: Option<f64>,
    /// For identification: residual over noise, if it is larger than noise allows.
    pub misfit: Option<f64>,
    /// Limits other than bounds, and how much of them is used.
    pub limits: Vec<LimitUse>,
    /// True if the search was interrupted.
    pub interrupted: bool,
    /// Tolerances of the unknowns; empty for a target trajectory and after an interruption.
    pub tolerances: Vec<Tolerance>,
    /// The unknowns and their values.
    #[serde(skip)]
    pub(super) at: Box<(Unknowns, Vec<f64>)>,
    /// The Jacobian (m) of the target's coordinates with respect to the unknowns there; `None` if there is no target.
    #[serde(skip)]
    pub(super) jacobian: Option<Box<DMatrix<f64>>>,
}

/// An estimated number of the scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EstimatedNumber {
    /// Its key.
    pub key: String,
    /// SI unit; `1` where there is none.
    pub unit: &'static str,
    /// Its value in the scene.
    pub own: f64,
    /// Its estimated value.
    pub value: f64,
    /// Standard deviation, for a target trajectory; `None` if it is unbounded. [`discretisation`](Self::discretisation) is part of it.
    pub deviation: Option<f64>,
    /// The change of the number if mesh and step errors are removed, for identification; `None` if it is unknown.
    pub discretisation: Option<f64>,
    /// Its identifiability, for a target trajectory.
    pub verdict: Option<Identifiability>,
}

/// An iterate of the search.
#[derive(Clone)]
struct Iterate {
    x: DVector<f64>,
    value: ObjectiveValue,
    limits: Vec<LimitValue>,
}

impl Iterate {
    /// The sum of all violations.
    fn violation(&self, priced: PenaltyGroups) -> f64 {
        total_violation(&priced.groups(&self.limits), |i| self.limits[i].excess)
    }

    /// True if all limits are kept.
    fn is_kept(&self) -> bool {
        self.violation(PenaltyGroups::Together) <= FEASIBILITY_TOLERANCE
    }
}

/// The end of the search from one start.
struct StartResult {
    point: Iterate,
    stationarity: f64,
    active: Vec<(String, f64)>,
    /// Reason for its end.
    why: String,
    interrupted: bool,
    /// True if only noise remains to be fitted.
    settled: bool,
}

/// The search for a design by sequential quadratic programming.
pub struct Search<'a> {
    /// The design table.
    pub(super) table: &'a DesignTable,
    /// The objective.
    pub(super) objective: &'a Objective,
    /// The simulation problem.
    pub(super) problem: Problem,
    /// The scenarios; empty if the design is for the scene alone.
    pub(super) scenarios: Vec<Scenario>,
    /// The stored results.
    pub(super) checkpoint: Checkpoint,
    /// EI of the joints in the scene, N m², and EI without its profile.
    pub(super) own_stiffness: Vec<f64>,
    pub(super) reference: f64,
}

impl<'a> Search<'a> {
    /// A search for the scene of `problem`.
    pub fn new(table: &'a DesignTable, objective: &'a Objective, problem: Problem) -> Self {
        let (own_stiffness, reference) = (problem.stiffness(), problem.model().rod.ei);
        Self {
            table,
            objective,
            problem,
            scenarios: Vec::new(),
            checkpoint: Checkpoint::default(),
            own_stiffness,
            reference,
        }
    }

    /// The objective of a design with its derivatives, and its limits; `None` if a simulation fails.
    fn at(
        &mut self,
        limits: &Limits,
        profile: &DesignVector,
        parameters: &[Parameter],
    ) -> Option<(ObjectiveValue, Vec<LimitValue>)> {
        if self.objective.fits {
            return self.simulated(limits, profile, parameters); // contains all derivatives at all times
        }
        let floor = self.table.floor.as_ref().map(|floor| (floor.of.goal, floor.value, floor.size));
        let asked = format!("{:?} {floor:?} {profile:?} {}", self.table.goal, parameters.len());
        self.cached(asked, |search| search.simulated(limits, profile, parameters))
    }

    /// The stored result for the key `asked`; if there is none, the result of `make`.
    fn cached<T: Serialize + DeserializeOwned>(
        &mut self,
        asked: String,
        make: impl FnOnce(&mut Self) -> Option<T>,
    ) -> Option<T> {
        let mut checkpoint = std::mem::take(&mut self.checkpoint);
        let found = checkpoint.get_or_compute(|| asked, || make(self));
        self.checkpoint = checkpoint;
        found
    }

    fn simulated(
        &mut self,
        limits: &Limits,
        profile: &DesignVector,
        parameters: &[Parameter],
    ) -> Option<(ObjectiveValue, Vec<LimitValue>)> {
        if self.scenarios.is_empty() {
            let value = self.objective.at(&mut self.problem, profile, parameters)?;
            return Some((value, limits.at(&mut self.problem, profile, parameters)?));
        }
        self.objective.set_with(&mut self.problem, profile, parameters).ok()?;
        let mut all = limits.at(&mut self.problem, profile, parameters)?;
        let (values, of_cases): (Vec<ObjectiveValue>, Vec<_>) =
            evaluate_all(&mut self.scenarios, profile, parameters)?.into_iter().unzip();
        all.extend(of_cases.into_iter().flatten());
        Some((ObjectiveValue::of(self.table.aggregate(), &values), all))
    }

    /// The reported objective of a design in each scenario; `None` if a simulation fails.
    pub(super) fn in_scenarios(&mut self, profile: &DesignVector) -> Option<Vec<f64>> {
        let all = evaluate_all(&mut self.scenarios, profile, &[])?;
        Some(all.into_iter().map(|(value, _)| self.objective.shown(value.f)).collect())
    }

    /// The reported objective of a design; `None` if a simulation fails.
    pub(super) fn value(&mut self, profile: &DesignVector) -> Option<f64> {
        let asked = format!("{:?} of {profile:?}", self.table.goal);
        self.cached(asked, |search| {
            if search.scenarios.is_empty() {
                return search.objective.measure(&mut search.problem, profile);
            }
            let values = search.in_scenarios(profile)?;
            search.table.aggregate().of(&values, search.table.smaller_is_better())
        })
    }

    /// The limits of the scene itself, and whether any limit, here or on the motion in the scenarios, needs a simulation.
    fn limits(&mut self) -> Result<(Limits, bool)> {
        let mut limits = Limits::of(self.table, &mut self.problem, self.objective)?;
        let are_simulated = limits.are_simulated();
        if !self.scenarios.is_empty() {
            limits.keep_body_only();
        }
        Ok((limits, are_simulated))
    }

    /// The limit that a design uses most, in the scene or in any scenario; `None` if there are none or a simulation fails.
    pub(super) fn most_used(&mut self, profile: &DesignVector) -> Option<LimitUse> {
        let (limits, are_simulated) = self.limits().ok()?;
        if limits.are_none() && !are_simulated {
            return None;
        }
        let (_, limits) = self.at(&limits, profile, &[])?;
        LimitUse::most(LimitUse::of(&limits))
    }

    fn point(&mut self, unknowns: &Unknowns, limits: &Limits, x: Vec<f64>) -> Option<Iterate> {
        let (profile, parameters) = (unknowns.profile(&x), unknowns.parameters());
        let directions = unknowns.directions(&self.problem.model().rod, &x);
        self.scenarios.iter_mut().for_each(|scenario| scenario.set_directions(&directions));
        self.problem.directions = directions;
        let (mut value, mut limits) = self.at(limits, &profile, &parameters)?;
        limits.iter_mut().for_each(|limit| limit.by = unknowns.chain(&x, &limit.by));
        value.by = unknowns.chain(&x, &value.by);
        value.cases.iter_mut().for_each(|(_, by)| *by = unknowns.chain(&x, by));
        if let Some((_, rows)) = &mut value.residuals {
            rows.iter_mut().for_each(|row| *row = unknowns.chain(&x, row));
        }
        Some(Iterate { x: x.into(), value, limits })
    }

    /// Finds the best design from several starts. `tell` is called after each iteration, and without one between the simulations
    /// that choose a start. It may stop the search, which then returns the best design so far.
    ///
    /// # Errors
    /// [`Error::Design`] if no start can be simulated, or a quadratic program cannot be solved.
    pub fn run(&mut self, tell: impl FnMut(Option<&SearchIteration>) -> ControlFlow<()>) -> Result<SearchResult> {
        self.run_from(None, tell)
    }

    /// Runs the search from the start `only`.
    pub(super) fn run_start(
        &mut self,
        only: usize,
        tell: impl FnMut(Option<&SearchIteration>) -> ControlFlow<()>,
    ) -> Result<SearchResult> {
        self.run_starts(None, Some(only), tell)
    }

    /// Runs the search from the unknowns `from`, if given.
    pub(super) fn run_from(
        &mut self,
        from: Option<Vec<f64>>,
        tell: impl FnMut(Option<&SearchIteration>) -> ControlFlow<()>,
    ) -> Result<SearchResult> {
        self.run_starts(from, None, tell)
    }

    fn run_starts(
        &mut self,
        from: Option<Vec<f64>>,
        only: Option<usize>,
        mut tell: impl FnMut(Option<&SearchIteration>) -> ControlFlow<()>,
    ) -> Result<SearchResult> {
        let own_stiffness_n_m2 = self.own_stiffness.clone();
        let unknowns = Unknowns::of(self.table, self.problem.model(), own_stiffness_n_m2.clone());
        let (limits, sampled) = self.limits()?;
        let n = unknowns.count();
        let starts = if from.is_some() { 1 } else { self.table.start_count() };
        let mut roughness = None;
        let mut interrupted = false;
        let mut history = Vec::new();
        let mut ends: Vec<StartResult> = Vec::new();
        for start in 0..starts {
            if only.is_some_and(|only| only < start || only > start && roughness.is_some()) {
                continue; // the first one that can be simulated sets the weight of roughness for all
            }
            let x = match &from {
                Some(x) => unknowns.kept(x.clone()),
                None if sampled && start > 0 => {
                    match self.best_sampled_start((&unknowns, &limits), start, || tell(None)) {
                        ControlFlow::Continue(x) => x,
                        ControlFlow::Break(()) => {
                            interrupted = true;
                            break;
                        }
                    }
                }
                None => unknowns.first(start),
            };
            let Some(first) = self.point(&unknowns, &limits, x) else { continue };
            let weight = self.table.smoothness * first.value.f.abs();
            let rough = roughness.get_or_insert_with(|| DMatrix::from_row_slice(n, n, &unknowns.roughness(weight)));
            if only.is_some_and(|only| only != start) {
                continue;
            }
            let mut told = |mut iteration: SearchIteration| {
                iteration.start = start;
                let told = tell(Some(&iteration));
                history.push(iteration);
                told
            };
            // Limits on the same quantity share one penalty. If the search ends at an infeasible minimum of the largest violation,
            // separate penalties take another path.
            let [together, alone] = [PenaltyGroups::Together, PenaltyGroups::Alone];
            let several = together.groups(&first.limits) != alone.groups(&first.limits);
            let mut end = self.minimise((&unknowns, &limits, together), rough, first.clone(), &mut told)?;
            if !end.point.is_kept() && !end.interrupted && several {
                let other = self.minimise((&unknowns, &limits, alone), rough, first, &mut told)?;
                if other.interrupted || other.point.violation(together) < end.point.violation(together) {
                    end = other;
                }
            }
            interrupted = end.interrupted;
            ends.push(end);
            if interrupted {
                break;
            }
        }
        let starts: Vec<f64> = ends.iter().map(|end| self.objective.shown(end.point.value.f)).collect();
        let optima = self.optima(&ends);
        let merit = |end: &StartResult| {
            let x = &end.point.x;
            // Feasible designs come first.
            let beyond = if end.point.is_kept() {
                0.0
            } else {
                1e6 * end.point.value.f.abs() * end.point.violation(PenaltyGroups::Together)
            };
            beyond + end.point.value.f + roughness.as_ref().map_or(0.0, |rough| 0.5 * x.dot(&(rough * x)))
        };
        let Some(best) = ends.into_iter().min_by(|a, b| merit(a).total_cmp(&merit(b))) else {
            if interrupted {
                return Err(Error::Interrupted);
            }
            let reason = "no start could be simulated; try other bounds, or a smaller step";
            return Err(Error::Design { reason: reason.into() });
        };
        let converged = self.has_converged(&best);
        let (why, kept) = (best.why.clone(), best.point.is_kept());
        let limits = LimitUse::of(&best.point.limits);
        let value = best.point.value;
        let objective = self.objective.shown(value.f);
        let (mut singular_values, mut deviations) = (Vec::new(), Vec::new());
        let (mut of_numbers, mut confused, mut noise_m) = (Vec::new(), Vec::new(), None);
        let (mut misfit, mut together, mut by_unknowns) = (None, 1.0, None);
        if let Some((residuals, rows)) = &value.residuals {
            let mut by = jacobian(rows, n);
            unknowns.fixed().for_each(|i| by.column_mut(i).fill(0.0)); // fixed unknowns are not estimated
            by_unknowns = Some(Box::new(&by / self.objective.scale()));
            let svd = by.svd(false, true);
            singular_values.extend(svd.singular_values.iter().copied());
            singular_values.sort_by(|a, b| b.total_cmp(a));
            let scale = self.objective.scale();
            let noise = if self.objective.goal == Goal::Identify {
                // Variance per coordinate, from the residual.
                let free = residuals.len().saturating_sub(n).max(1) as f64;
                let left = residuals.iter().map(|r| r * r).sum::<f64>() / free;
                let left = left.sqrt() / scale;
                let own = self.table.noise_m.or(self.objective.noise).unwrap_or(left);
                let over = left / own.max(TARGET_TOLERANCE * self.objective.length);
                noise_m = Some(self.table.noise_m.unwrap_or(left));
                misfit = Some(over).filter(|over| *over > max_misfit(residuals.len() as f64));
                if misfit.is_some() {
                    // A misfit is not noise, and more samples do not reduce it.
                    together = (self.objective.target.len() as f64).sqrt();
                    left.max(own) * scale
                } else {
                    self.table.noise_m.unwrap_or(left) * scale
                }
            } else {
                objective.max(MIN_TARGET_DEVIATION * self.objective.length)
                    / (self.objective.target.len() as f64).sqrt()
            };
            if let Some(v_t) = &svd.v_t {
                let x = best.point.x.as_slice();
                let of = |variable: &DesignVariable| {
                    let size = noise * together;
                    unknowns.deviations(variable, x, v_t, svd.singular_values.as_slice(), size)
                };
                deviations = of(&DesignVariable::Stiffness);
                let names = unknowns.names();
                confused = unidentifiable_groups(&names, v_t, svd.singular_values.as_slice(), noise);
                let fixed: Vec<&String> = unknowns.fixed().map(|i| &names[i]).collect();
                confused.retain(|group| group.iter().any(|name| !fixed.contains(&name)));
                for variable in self.table.variables.iter().filter(|v| matches!(v, DesignVariable::Number(_))) {
                    of_numbers.extend(of(variable));
                }
            }
        }
        let x = best.point.x.as_slice().to_vec();
        let profile = unknowns.profile(&x);
        let values = profile.numbers.iter().zip(&self.table.numbers).enumerate();
        let numbers = values.map(|(i, ((key, value), number))| {
            let [low, high] = self.table.bounds_of(&number.key);
            let deviation = of_numbers.get(i).copied().filter(|_| low < high);
            let bound = [low, high].iter().any(|bound| (value / number.own / bound - 1.0).abs() < 1e-6);
            let together = confused.iter().any(|names| names.len() > 1 && names.contains(key));
            let verdict = match deviation {
                _ if bound => Some(Identifiability::AtABound),
                Some(deviation) if together && deviation > MAX_RELATIVE_DEVIATION => {
                    Some(Identifiability::NotToldApart)
                }
                Some(_) if !converged => Some(Identifiability::NotConverged),
                Some(_) if misfit.is_some() => Some(Identifiability::DoesNotFit),
                Some(deviation) if deviation <= MAX_RELATIVE_DEVIATION => Some(Identifiability::Identified),
                Some(_) => Some(Identifiability::Unobservable),
                None => None,
            };
            let deviation =
                deviation.map(|deviation| deviation * value.abs()).filter(|deviation| deviation.is_finite());
            let (key, unit, own) = (number.label(), number.unit, number.own);
            EstimatedNumber { key, unit, own, value: *value, deviation, discretisation: None, verdict }
        });
        let numbers = numbers.collect();
        Ok(SearchResult {
            profile,
            numbers,
            confused,
            noise_m,
            misfit,
            own_stiffness_n_m2,
            deviations,
            objective,
            stationarity: best.stationarity,
            converged,
            why,
            kept,
            limits,
            starts,
            optima,
            history,
            active: best.active,
            singular_values,
            interrupted,
            tolerances: Vec::new(),
            at: Box::new((unknowns, x)),
            jacobian: by_unknowns,
        })
    }

    /// The first point of `start`, not the first start, of a design with simulated limits: the best of several designs. The
    /// feasible region may consist of several parts, and a search that begins outside of all ends in the nearest. Stops when
    /// `goes_on` is false.
    fn best_sampled_start(
        &mut self,
        (unknowns, limits): (&Unknowns, &Limits),
        start: usize,
        mut goes_on: impl FnMut() -> ControlFlow<()>,
    ) -> ControlFlow<(), Vec<f64>> {
        let own = unknowns.first(start);
        let samples = (start - 1) * SAMPLES_PER_START..start * SAMPLES_PER_START;
        let mut best: Option<([f64; 2], Vec<f64>)> = None;
        for x in std::iter::once(own.clone()).chain(samples.map(|i| unknowns.sampled(i))) {
            goes_on()?;
            let Some((value, limits)) = self.at(limits, &unknowns.profile(&x), &[]) else { continue };
            let point = Iterate { x: DVector::zeros(0), value, limits };
            let beyond = if point.is_kept() { 0.0 } else { point.violation(PenaltyGroups::Together) };
            let rank = [beyond, point.value.f];
            if best.as_ref().is_none_or(|(best, _)| rank < *best) {
                best = Some((rank, x));
            }
        }
        ControlFlow::Continue(best.map_or(own, |(_, x)| x))
    }

    fn has_converged(&self, end: &StartResult) -> bool {
        let met = self.objective.is_met(end.point.value.f);
        end.point.is_kept() && (end.stationarity <= STATIONARITY_TOLERANCE[1] || met || end.settled)
    }

    /// The optimum that each of `ends` reached.
    fn optima(&self, ends: &[StartResult]) -> Vec<Option<usize>> {
        let mut order: Vec<usize> = (0..ends.len()).filter(|i| self.has_converged(&ends[*i])).collect();
        order.sort_by(|a, b| ends[*a].point.value.f.total_cmp(&ends[*b].point.value.f));
        let mut optima = vec![None; ends.len()];
        let mut found: Vec<&Iterate> = Vec::new();
        for i in order {
            let own = &ends[i].point;
            let same = |other: &&Iterate| {
                let (f, x) = ((own.value.f - other.value.f).abs(), (&own.x - &other.x).amax());
                f <= SAME_OPTIMUM[0] * other.value.f.abs() || x <= SAME_OPTIMUM[1]
            };
            let known = found.iter().position(same);
            if known.is_none() {
                found.push(own);
            }
            optima[i] = Some(known.map_or(found.len(), |at| at + 1));
        }
        optima
    }

    /// Minimises from `first`, with penalties for the limits grouped by `priced`. Each quadratic program is in units of the
    /// objective.
    fn minimise(
        &mut self,
        (unknowns, limits, priced): (&Unknowns, &Limits, PenaltyGroups),
        rough: &DMatrix<f64>,
        first: Iterate,
        mut tell: impl FnMut(SearchIteration) -> ControlFlow<()>,
    ) -> Result<StartResult> {
        let n = unknowns.count();
        let merit = |point: &Iterate| point.value.f + 0.5 * point.x.dot(&(rough * &point.x));
        let slope = |point: &Iterate| point.value.common(n) + rough * &point.x;
        let squares = first.value.residuals.is_some();
        let stiff = unknowns.roughness((SMOOTHING_LENGTH * unknowns.joints() as f64).powi(4));
        let metric = DMatrix::identity(n, n) + DMatrix::from_row_slice(n, n, &stiff);
        let mut here = first;
        let mut hessian: Option<DMatrix<f64>> = None;
        let cases = here.value.cases.len();
        let (mut price, mut updates) = (INITIAL_PENALTY, 0);
        let (mut radius, mut damping, mut growth) = (INITIAL_TRUST_RADIUS, INITIAL_DAMPING, 2.0);
        let mut end = (f64::INFINITY, Vec::new(), false);
        let mut why = ITERATIONS_EXHAUSTED.to_string();
        let (mut here_again, mut again, mut settled) = (false, 0, false);
        for iteration in 0..=self.table.iterations.unwrap_or(DEFAULT_MAX_ITERATIONS) {
            let unit = merit(&here).abs().max(f64::MIN_POSITIVE);
            let gradient = slope(&here) / unit;
            let model = rough / unit
                + match (&here.value.residuals, &hessian) {
                    (Some((_, rows)), _) => {
                        let jacobian = jacobian(rows, n);
                        jacobian.tr_mul(&jacobian) / unit
                    }
                    (None, Some(hessian)) => hessian / unit,
                    (None, None) => {
                        let steepest = DVector::from_column_slice(&here.value.by) + rough * &here.x;
                        DMatrix::identity(n, n) * (steepest.norm() / unit / INITIAL_TRUST_RADIUS).max(1e-12)
                    }
                };
            // Variables of the program: the step, the violation of each limit, and the worst case.
            let groups = priced.groups(&here.limits);
            let limited = groups.last().map_or(0, |last| last + 1);
            let width = n + limited + usize::from(cases > 0);
            let mut programme = QuadraticProgram::new(width);
            let damped = if squares { &model + &metric * damping } else { model.clone() };
            for i in 0..n {
                programme.gradient[i] = gradient[i];
                (0..n).for_each(|j| programme.hessian[i * width + j] = damped[(i, j)]);
            }
            // Each violation has a penalty.
            for passed in n..n + limited {
                programme.gradient[passed] = price;
                programme.constraints.push(Constraint::at_most(TRUST_REGION, vec![(passed, -1.0)], 0.0));
            }
            for (limit, group) in here.limits.iter().zip(&groups) {
                let row = limit.by.iter().copied().enumerate().filter(|(_, by)| *by != 0.0);
                let row = row.chain([(n + group, -1.0)]).collect();
                programme.constraints.push(Constraint::at_most(limit.name.clone(), row, -limit.excess));
            }
            for (i, (f, by)) in here.value.cases.iter().enumerate() {
                programme.gradient[n + limited] = 1.0;
                let row = by.iter().map(|by| by / unit).enumerate().filter(|(_, by)| *by != 0.0);
                let row = row.chain([(n + limited, -1.0)]).collect();
                let name = format!("{WORST_SCENARIO}{}", self.scenarios[i].name);
                programme.constraints.push(Constraint::at_most(name, row, (here.value.f - f) / unit));
            }
            for i in (0..n).filter(|_| !squares) {
                for sign in [1.0, -1.0] {
                    programme.constraints.push(Constraint::at_most(TRUST_REGION, vec![(i, sign)], radius));
                }
            }
            unknowns.constrain(&mut programme, here.x.as_slice());
            let solution = match programme.solve() {
                Ok(solution) => solution,
                Err(error) => {
                    // The program of a shorter step is easier to solve.
                    why = format!("the quadratic program of the next step was not solved ({error})");
                    radius *= 0.25;
                    damping *= growth;
                    growth *= 2.0;
                    here_again = true;
                    if radius < MIN_TRUST_RADIUS || damping > MAX_DAMPING {
                        break;
                    }
                    continue;
                }
            };
            // The gradient of the Lagrangian without the trust region's duals.
            let mut lagrangian = gradient.clone();
            for (constraint, dual) in programme.constraints.iter().zip(&solution.duals) {
                let row = constraint.row.iter().filter(|(i, _)| *i < n && constraint.name != TRUST_REGION);
                row.for_each(|(i, c)| lagrangian[*i] += dual * c);
            }
            let mut stationarity = match &here.value.residuals {
                Some((residuals, rows)) => {
                    let (jacobian, size) = (jacobian(rows, n), DVector::from_column_slice(residuals).norm());
                    let cosine =
                        |(slope, column): (&f64, f64)| slope.abs() * unit / (column * size).max(f64::MIN_POSITIVE);
                    let columns = jacobian.column_iter().map(|column| column.norm());
                    lagrangian.iter().zip(columns).map(cosine).fold(0.0, f64::max)
                }
                None => lagrangian.amax(),
            };
            let mut active = programme.active(&solution);
            active.retain(|(name, _)| name != TRUST_REGION && name != FIXED_UNKNOWN);
            active = together(active);
            // A radius that shrinks around a point hides bounds beyond it: the earlier stationarity of the point is kept.
            if here_again && end.0 < stationarity {
                (stationarity, active) = (end.0, end.1);
            }
            let after_limits = limited + here.limits.len();
            let of_limits = solution.duals[limited..after_limits].to_vec();
            let of_cases = solution.duals[after_limits..after_limits + cases].to_vec();
            let mut dear = vec![0.0; limited];
            of_limits.iter().zip(&groups).for_each(|(dual, group)| dear[*group] += dual);
            let dearest = dear.into_iter().fold(0.0, f64::max);
            if dearest > 0.5 * price {
                price = (4.0 * price).min(MAX_PENALTY);
            }
            let step = DVector::from_column_slice(&solution.x[..n]);
            let longest = step.amax();
            let objective = self.objective.shown(here.value.f);
            let mut report =
                SearchIteration { start: 0, iteration, objective, stationarity, step: longest, accepted: true };
            let kept = here.violation(priced) - solution.x[n..n + limited].iter().map(|x| x.max(0.0)).sum::<f64>();
            let worst = solution.x[n + limited..].iter().sum::<f64>();
            let promised = price * kept - (gradient.dot(&step) + worst + 0.5 * step.dot(&(&model * &step)));
            end = (stationarity, active, false);
            settled = here.value.residuals.as_ref().is_some_and(|(residuals, _)| {
                let free = residuals.len().saturating_sub(n).max(1) as f64;
                self.objective.goal == Goal::Identify
                    && damping < INITIAL_DAMPING
                    && promised < NEGLIGIBLE_FIT_REDUCTION / free
            });
            let ends = if self.objective.is_met(here.value.f) {
                Some("the target was reached")
            } else if stationarity <= STATIONARITY_TOLERANCE[usize::from(promised < NEGLIGIBLE_REDUCTION)]
                && here.violation(PenaltyGroups::Together) <= 0.1 * FEASIBILITY_TOLERANCE
            {
                Some("it is stationary")
            } else if promised < ROUNDING_REDUCTION {
                Some("the predicted improvement is smaller than rounding errors")
            } else if longest.min(radius) < MIN_TRUST_RADIUS {
                Some("no step improves the objective, however short")
            } else {
                None
            };
            // If a limit is still violated, the search restarts from there with a higher penalty.
            if ends.is_some() && !here.is_kept() && again < MAX_RESTARTS && !squares {
                again += 1;
                price = (100.0 * price).min(MAX_PENALTY);
                (radius, hessian, here_again) = (INITIAL_TRUST_RADIUS, None, false);
                if tell(report).is_break() {
                    end.2 = true;
                    break;
                }
                continue;
            }
            if let Some(reason) = ends {
                why = reason.to_string();
                end.2 = tell(report).is_break();
                break;
            }
            let mut next = self.point(unknowns, limits, unknowns.kept((&here.x + &step).as_slice().to_vec()));
            let won = |next: &Iterate| {
                if promised >= GRADIENT_CRITERION_BELOW || squares || cases > 0 {
                    return (merit(&here) - merit(next)) / unit
                        + price * (here.violation(priced) - next.violation(priced));
                }
                let moved = &next.x - &here.x;
                let after = |i: usize| {
                    let from = &here.limits[i];
                    let to = from.among(&next.limits).unwrap_or(from);
                    let by = from.by.iter().zip(&to.by).zip(&moved).map(|((from, to), d)| 0.5 * (from + to) * d);
                    from.excess + by.sum::<f64>()
                };
                let kept = here.violation(priced) - total_violation(&groups, after);
                price * kept - 0.5 * (slope(&here) + slope(next)).dot(&moved) / unit
            };
            let mut ratio = next.as_ref().map_or(f64::NEG_INFINITY, |next| won(next) / promised);
            if let Some(tried) = next.as_ref().filter(|_| limited > 0 && ratio < POOR_REDUCTION_RATIO) {
                // Second-order correction for a curved limit: the same step, with the limits at its end.
                let moved = &tried.x - &here.x;
                for (constraint, limit) in programme.constraints[limited..].iter_mut().zip(&here.limits) {
                    if let Some(tried) = limit.among(&tried.limits) {
                        let linear: f64 = limit.by.iter().zip(&moved).map(|(by, d)| by * d).sum();
                        constraint.bound = linear - tried.excess;
                    }
                }
                let corrected = programme.solve().ok().and_then(|solution| {
                    let step = DVector::from_column_slice(&solution.x[..n]);
                    self.point(unknowns, limits, unknowns.kept((&here.x + step).as_slice().to_vec()))
                });
                if let Some(better) = corrected.filter(|corrected| won(corrected) / promised > ratio) {
                    ratio = won(&better) / promised;
                    next = Some(better);
                }
            }
            report.accepted = ratio > SUFFICIENT_DECREASE;
            here_again = !report.accepted;
            if squares {
                if report.accepted {
                    damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).max(0.1);
                    growth = 2.0;
                } else {
                    damping *= growth;
                    growth *= 2.0;
                }
            } else if ratio > 0.75 && longest > 0.9 * radius {
                radius = (2.0 * radius).min(MAX_TRUST_RADIUS);
            } else if ratio < POOR_REDUCTION_RATIO {
                radius = if report.accepted { 0.5 } else { 0.25 } * longest.min(radius);
            }
            if let Some(next) = next.filter(|_| report.accepted) {
                if !squares {
                    let duals = &solution.duals[solution.duals.len() - unknowns.means(here.x.as_slice()).len()..];
                    let curved = |point: &Iterate| {
                        let means = unknowns.means(point.x.as_slice());
                        // A peak that is now far from the limit keeps its value.
                        let limited = here.limits.iter().zip(&of_limits).filter(|(_, dual)| **dual > 0.0);
                        let limited =
                            limited.map(|(limit, dual)| (&limit.among(&point.limits).unwrap_or(limit).by, dual));
                        let mut own = point.value.common(n);
                        for ((_, by), dual) in point.value.cases.iter().zip(&of_cases) {
                            own += DVector::from_column_slice(by) * *dual;
                        }
                        let sum =
                            limited.fold(own, |sum, (by, dual)| sum + DVector::from_column_slice(by) * (dual * unit));
                        means
                            .iter()
                            .zip(duals)
                            .fold(sum, |sum, ((_, by), dual)| sum + DVector::from_column_slice(by) * (dual * unit))
                    };
                    updates += 1;
                    let exact = if updates >= HESSIAN_REFRESH_INTERVAL {
                        self.curvature((unknowns, limits), &next, curved)
                    } else {
                        None
                    };
                    hessian = Some(if let Some(exact) = exact {
                        updates = 0;
                        exact
                    } else {
                        let (moved, turned) = (&next.x - &here.x, curved(&next) - curved(&here));
                        let size = 10.0 * curved(&here).norm();
                        bfgs_update(hessian, &moved, &turned, size.max(1e-12 * unit))
                    });
                }
                here = next;
            }
            end.2 = tell(report).is_break();
            if end.2 {
                break;
            }
        }
        let (stationarity, active, interrupted) = end;
        Ok(StartResult { point: here, stationarity, active, why, interrupted, settled })
    }

    /// The Hessian at a point, by finite differences of the gradient `slope`, with the moduli of its eigenvalues so that the
    /// program is convex; `None` if a simulation fails.
    fn curvature(
        &mut self,
        (unknowns, limits): (&Unknowns, &Limits),
        here: &Iterate,
        slope: impl Fn(&Iterate) -> DVector<f64>,
    ) -> Option<DMatrix<f64>> {
        let n = here.x.len();
        let own = slope(here);
        let mut all = DMatrix::zeros(n, n);
        for i in 0..n {
            let mut x = here.x.as_slice().to_vec();
            x[i] += FINITE_DIFFERENCE_STEP;
            let by = (slope(&self.point(unknowns, limits, x)?) - &own) / FINITE_DIFFERENCE_STEP;
            all.set_column(i, &by);
        }
        let mut eigen = (0.5 * (&all + all.transpose())).symmetric_eigen();
        let least = MIN_RELATIVE_EIGENVALUE * eigen.eigenvalues.amax();
        eigen.eigenvalues.apply(|value| *value = value.abs().max(least));
        let found = eigen.recompose();
        found.iter().all(|x| x.is_finite()).then_some(found)
    }

    /// The tolerance of each unknown of the result `found`.
    pub(super) fn tolerances(&mut self, found: &SearchResult) -> Vec<Tolerance> {
        let (unknowns, x) = &*found.at;
        let smaller = self.objective.smaller_is_better();
        let mut value = |x: &[f64]| self.value(&unknowns.profile(x)).map(|value| if smaller { value } else { -value });
        let Some(own) = value(x) else { return Vec::new() };
        let names = unknowns.names().into_iter().enumerate();
        let of = |(i, name): (usize, String)| {
            tolerance(name, |change| {
                let mut x = x.clone();
                x[i] += change;
                Some((value(&x)? - own) / own.abs())
            })
        };
        names.map(of).collect()
    }

    /// The reported objective with factors of the reference stiffness at the joints and the scene's own actuation; `None` if it
    /// fails.
    pub fn measure(&mut self, factors: &[f64]) -> Option<f64> {
        let reference = self.reference;
        self.value(&DesignVector::of(factors.iter().map(|factor| factor * reference).collect()))
    }

    /// The best profile that is linear in ξ, with the same mean and within the bounds: its slope a in b(1 + a(ξ₀ − ξ)), ξ₀ the mean
    /// of ξ, and the reported objective.
    pub fn best_linear(&mut self) -> Option<(f64, f64)> {
        let rod = &self.problem.model().rod;
        let xi: Vec<f64> = rod.joints().map(|k| rod.xi(k)).collect();
        let centre = xi.iter().sum::<f64>() / xi.len() as f64;
        let even = self.table.mean.unwrap_or(1.0);
        let [low, high] = self.table.bounds;
        let smaller = self.table.smaller_is_better();
        let mut of = |slope: f64| {
            let factors: Vec<f64> = xi.iter().map(|xi| even * (1.0 + slope * (centre - xi))).collect();
            let inside = factors.iter().all(|factor| (low..=high).contains(factor));
            if inside { self.measure(&factors) } else { None }
        };
        let better = |a: f64, b: f64| if smaller { a < b } else { a > b };
        let mut best: Option<(f64, f64)> = None;
        let mut width = 0.2;
        let grid: Vec<f64> = (-10..=10).map(|i| f64::from(i) * 0.2).collect();
        for slope in grid {
            if let Some(value) = of(slope).filter(|value| best.is_none_or(|best| better(*value, best.1))) {
                best = Some((slope, value));
            }
        }
        for _ in 0..8 {
            width *= 0.5;
            let centre = best?.0;
            for slope in [centre - width, centre + width] {
                if let Some(value) = of(slope).filter(|value| best.is_none_or(|best| better(*value, best.1))) {
                    best = Some((slope, value));
                }
            }
        }
        best
    }
}

/// Sums the duals of constraints with the same name, which belong to one limit. If both sides of an equality are active, their
/// duals are arbitrary, and only their difference has a meaning.
fn together(duals: Vec<(String, f64)>) -> Vec<(String, f64)> {
    let mut all = duals.into_iter().fold(Vec::new(), |mut all: Vec<(String, f64)>, (name, dual)| {
        match all.iter_mut().find(|(other, _)| *other == name) {
            Some((_, sum)) => *sum += dual,
            None => all.push((name, dual)),
        }
        all
    });
    if let [Some(above), Some(below)] = NEUTRAL_SIDES.map(|side| all.iter().position(|(name, _)| name == side)) {
        let net = all[above].1 - all[below].1;
        let [kept, dropped] = if net < 0.0 { [below, above] } else { [above, below] };
        all[kept].1 = net.abs();
        all.remove(dropped);
    }
    all
}

/// Groups of unknowns, by `names`, that the data determine only together: those with a large component in a direction whose
/// deviation exceeds [`MAX_RELATIVE_DEVIATION`].
fn unidentifiable_groups(names: &[String], v_t: &DMatrix<f64>, singular: &[f64], noise: f64) -> Vec<Vec<String>> {
    let least = RANK_TOLERANCE * singular.iter().copied().fold(0.0, f64::max);
    let unknown =
        (0..singular.len()).filter(|s| noise > MAX_RELATIVE_DEVIATION * singular[*s] || singular[*s] <= least);
    let group = |s: usize| {
        let shared = (0..names.len()).filter(|i| v_t[(s, *i)].abs() > MIN_COMPONENT);
        shared.map(|i| names[i].clone()).collect::<Vec<_>>()
    };
    unknown.map(group).filter(|group| !group.is_empty()).collect()
}

fn jacobian(rows: &[Vec<f64>], columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns, |i, j| rows[i][j])
}

/// The damped BFGS matrix after a step `s` over which the gradient of the Lagrangian changed by `y`; the first is at most `size`
/// times the identity.
fn bfgs_update(old: Option<DMatrix<f64>>, s: &DVector<f64>, y: &DVector<f64>, size: f64) -> DMatrix<f64> {
    let old = old.unwrap_or_else(|| {
        let secant = y.dot(y) / y.dot(s).abs().max(f64::MIN_POSITIVE);
        DMatrix::identity(s.len(), s.len()) * secant.min(size)
    });
    let hs = &old * s;
    let (shs, sy) = (s.dot(&hs), s.dot(y));
    if shs <= 0.0 {
        return old;
    }
    let theta = if sy >= 0.2 * shs { 1.0 } else { 0.8 * shs / (shs - sy) };
    let r = y * theta + &hs * (1.0 - theta);
    let scale = s.dot(&r);
    old - &hs * hs.transpose() / shs + &r * r.transpose() / scale
}
