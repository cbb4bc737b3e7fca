//! Dynamic goals: sequential quadratic programming on simulated outputs with their exact sensitivities.
//!
//! Unknown is x = ln(EI/EI_ref). Each step solves min gᵀd + ½dᵀ(H + λD₂ᵀD₂)d under bounds, order, the linearised mean and a
//! trust radius |d_i| ≤ Δ. H is JᵀJ for a tracked tip, damped after Marquardt (SIAM J. Appl. Math. 11, 1963) in the place of a
//! changing radius, else a damped BFGS matrix of the Lagrangian (Nocedal & Wright, Numerical
//! Optimization, 2006, section 18.3). A step that does not lower the objective, or whose simulation fails, is rejected and
//! shrinks Δ.

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::identify::smooth;
use super::markers::Markers;
use super::qp::{Constraint, Quadratic};
use super::table::{Basis, Goal, Table};
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::sensitivity::{Output, Parameter, Problem, Quantity, Sensitivities, Work};

/// Stationary in scaled variables: the gradient of the Lagrangian over the objective.
const STATIONARY: f64 = 1e-7;

/// First damping of the tracked tip's JᵀJ, over its diagonal.
const DAMPING: f64 = 1e-3;

/// Largest first trust radius in ln EI, and the smallest worth a step.
const RADIUS: [f64; 2] = [0.5, 1e-9];

/// What a dynamic goal measures.
#[derive(Debug)]
pub struct Objective {
    goal: Goal,
    sign: f64,
    /// Samples of the tip that are to be met: steps, and x, y (m).
    target: Vec<(usize, [f64; 2])>,
    outputs: Vec<Output>,
}

/// The objective at one profile.
#[derive(Debug, Clone)]
struct Value {
    /// What is made small.
    f: f64,
    /// Its derivatives by EI, and those of residuals (a row each) where it is half a sum of squares.
    by: Vec<f64>,
    residuals: Option<(Vec<f64>, Vec<Vec<f64>>)>,
}

impl Objective {
    /// The objective of a scene's design; `target` are the markers of a tip to be tracked.
    ///
    /// # Errors
    /// [`Error::Design`] where the target's times are not those of steps.
    pub fn new(table: &Table, problem: &Problem, target: Option<&Markers>) -> Result<Self> {
        let tip = problem.model().rod.nodes - 1;
        let held = problem.model().head.is_some();
        let sign = if table.direction.as_deref() == Some("-x") { -1.0 } else { 1.0 };
        let along = Output::from(Quantity::CentreOfMass(0)).since_start();
        if held && table.goal != Goal::TrackTip {
            let reason = "a held head goes nowhere: distance and efficiency need a free one".to_string();
            return Err(Error::Design { reason });
        }
        let outputs = match table.goal {
            Goal::TrackTip => vec![Quantity::Position(tip, 0).into(), Quantity::Position(tip, 1).into()],
            Goal::Distance => vec![along],
            _ => vec![along, Work::Actuation.into()],
        };
        let times = problem.times();
        let step = |time: f64| {
            let n = times.partition_point(|t| *t < time - 1e-9 * times[times.len() - 1]);
            times.get(n).filter(|t| (**t - time).abs() <= 1e-6 * times[1]).map(|_| n)
        };
        let target = match target {
            Some(markers) if table.goal == Goal::TrackTip => {
                let rows = markers.times.iter().zip(&markers.positions);
                let sample = |(time, row): (&f64, &Vec<f64>)| {
                    let off =
                        || Error::Design { reason: format!("the sample at t = {time} s is at no step of the scene") };
                    Ok((step(*time).ok_or_else(off)?, [row[row.len() - 2], row[row.len() - 1]]))
                };
                rows.map(sample).collect::<Result<Vec<_>>>()?
            }
            _ => Vec::new(),
        };
        Ok(Self { goal: table.goal, sign, target, outputs })
    }

    fn of(&self, found: &Sensitivities) -> Value {
        let last = found.times.len() - 1;
        let moved = self.sign * if self.goal == Goal::TrackTip { 0.0 } else { found.value(last, 0) };
        match self.goal {
            Goal::TrackTip => {
                let scale = 1.0 / (self.target.len() as f64).sqrt();
                let mut residuals = Vec::new();
                let mut rows = Vec::new();
                for (n, tip) in &self.target {
                    for (o, x) in tip.iter().enumerate() {
                        residuals.push(scale * (found.value(*n, o) - x));
                        rows.push(found.row(*n, o).iter().map(|d| scale * d).collect::<Vec<f64>>());
                    }
                }
                let f = 0.5 * residuals.iter().map(|r| r * r).sum::<f64>();
                let width = rows.first().map_or(0, Vec::len);
                let by = (0..width).map(|j| residuals.iter().zip(&rows).map(|(r, row)| r * row[j]).sum()).collect();
                Value { f, by, residuals: Some((residuals, rows)) }
            }
            Goal::Distance => {
                Value { f: -moved, by: found.row(last, 0).iter().map(|d| -self.sign * d).collect(), residuals: None }
            }
            _ => {
                // D|D|/W, as efficiency is a constant times D²/W.
                let work = found.value(last, 1);
                let f = -moved * moved.abs() / work;
                let by = found.row(last, 0).iter().zip(found.row(last, 1));
                let by = by.map(|(d, w)| -2.0 * moved.abs() * self.sign * d / work - f * w / work).collect();
                Value { f, by, residuals: None }
            }
        }
    }

    /// The objective and its derivatives by the stiffness `ei` of the joints; none where the simulation fails.
    fn at(&self, problem: &mut Problem, ei: &[f64], derivatives: bool) -> Option<Value> {
        problem.set_stiffness(ei).ok()?;
        let parameters: Vec<Parameter> =
            problem.model().rod.joints().filter(|_| derivatives).map(Parameter::Stiffness).collect();
        let every = if self.target.is_empty() { usize::MAX } else { 1 };
        let found = problem.forward(&parameters, &self.outputs, every, |_| {}).ok()?;
        let value = self.of(&found);
        (value.f.is_finite() && value.by.iter().all(|x| x.is_finite())).then_some(value)
    }

    /// What is reported of a value of the objective: tip rms (m), distance (m), or D²/W (m²/J).
    pub fn shown(&self, f: f64) -> f64 {
        if self.goal == Goal::TrackTip { (2.0 * f).sqrt() } else { -f }
    }

    /// The shown objective with the stiffness `ei` (N m²) of the joints; none where the simulation fails.
    pub fn measure(&self, problem: &mut Problem, ei: &[f64]) -> Option<f64> {
        self.at(problem, ei, false).map(|value| self.shown(value.f))
    }
}

/// One iteration, for progress and figures.
#[derive(Debug, Clone, Serialize)]
pub struct Iteration {
    /// Which start.
    pub start: usize,
    /// Which iteration of it.
    pub iteration: usize,
    /// The objective as shown.
    pub objective: f64,
    /// The gradient of the Lagrangian over the objective, in ln EI.
    pub stationarity: f64,
    /// Trust radius.
    pub radius: f64,
    /// False for a rejected step.
    pub accepted: bool,
}

/// What a search finds.
#[derive(Debug, Clone, Serialize)]
pub struct Found {
    /// EI of the joints, N m².
    pub stiffness_n_m2: Vec<f64>,
    /// The objective as shown.
    pub objective: f64,
    /// Its stationarity.
    pub stationarity: f64,
    /// True where that is below the limit.
    pub converged: bool,
    /// The objective of every start's end.
    pub starts: Vec<f64>,
    /// Every iteration.
    pub history: Vec<Iteration>,
    /// Constraints that bind, with their duals over the objective.
    pub active: Vec<(String, f64)>,
    /// Singular values of the tip's derivatives by ln EI (m), falling; of a tracked tip only.
    pub singular_values: Vec<f64>,
    /// True where it was stopped.
    pub interrupted: bool,
}

/// Constraints that bind, with their duals.
type Active = Vec<(String, f64)>;

/// A point of the search.
struct Point {
    x: Vec<f64>,
    value: Value,
}

/// The search of one scene.
pub struct Search<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// What is asked for.
    pub table: &'a Table,
    /// The objective.
    pub objective: &'a Objective,
    /// Its problem.
    pub problem: Problem,
}

impl Search<'_> {
    fn stiffness(&self, basis: &Basis, x: &[f64]) -> Vec<f64> {
        let reference = self.problem.model().rod.ei;
        basis.joints(x).iter().map(|x| reference * x.exp()).collect()
    }

    fn point(&mut self, basis: &Basis, x: Vec<f64>) -> Option<Point> {
        let ei = self.stiffness(basis, &x);
        let mut value = self.objective.at(&mut self.problem, &ei, true)?;
        // By the unknowns: d EI = EI d ln EI.
        let chain = |by: &[f64]| {
            let mut out = vec![0.0; basis.unknowns];
            for ((by, ei), row) in by.iter().zip(&ei).zip(&basis.rows) {
                row.iter().for_each(|(i, w)| out[*i] += by * ei * w);
            }
            out
        };
        value.by = chain(&value.by);
        if let Some((_, rows)) = &mut value.residuals {
            rows.iter_mut().for_each(|row| *row = chain(row));
        }
        Some(Point { x, value })
    }

    /// The mean over the reference, and its derivatives.
    fn mean(&self, basis: &Basis, x: &[f64]) -> (f64, Vec<f64>) {
        let count = basis.rows.len() as f64;
        let factors: Vec<f64> = basis.joints(x).iter().map(|x| x.exp()).collect();
        let mut by = vec![0.0; basis.unknowns];
        for (factor, row) in factors.iter().zip(&basis.rows) {
            row.iter().for_each(|(i, w)| by[*i] += factor * w / count);
        }
        (factors.iter().sum::<f64>() / count, by)
    }

    /// x moved down so that it keeps the mean, and inside its bounds.
    fn kept(&self, basis: &Basis, mut x: Vec<f64>) -> Vec<f64> {
        let [low, high] = self.table.bounds.map(f64::ln);
        for _ in 0..50 {
            x.iter_mut().for_each(|x| *x = x.clamp(low, high));
            let Some(most) = self.table.mean else { break };
            let (mean, by) = self.mean(basis, &x);
            let free: f64 = by.iter().zip(&x).filter(|(_, x)| **x > low).map(|(by, _)| by).sum();
            if mean <= most * (1.0 + 1e-12) || free == 0.0 {
                break;
            }
            let shift = (mean - most) / free;
            x.iter_mut().for_each(|x| *x -= shift);
        }
        x
    }

    /// Starts: even, the study's gradient, its mirror image, then waves of random phase.
    fn first(&self, basis: &Basis, start: usize) -> Vec<f64> {
        let rod = &self.problem.model().rod;
        let xi: Vec<f64> = match &self.table.knots {
            Some(knots) => knots.clone(),
            None => rod.joints().map(|k| k as f64 / (rod.nodes - 1) as f64).collect(),
        };
        let even = self.table.mean.unwrap_or(1.0);
        let factor = |xi: f64| match start {
            0 => 1.0,
            1 => (2.0 - xi) / 1.5,
            2 => (1.0 + xi) / 1.5,
            n => {
                let phase = 2.399_963 * n as f64; // the golden angle
                1.0 + 0.6 * (std::f64::consts::PI * (1.0 + (n % 3) as f64) * xi + phase).cos()
            }
        };
        self.kept(basis, xi.into_iter().map(|xi| (even * factor(xi)).ln()).collect())
    }

    /// The stiffness that makes the objective best, from several starts; `tell` sees every iteration and may stop the search,
    /// which then has the best so far.
    ///
    /// # Errors
    /// [`Error::Design`] where no start can be simulated, or the programme cannot be solved.
    pub fn run(&mut self, mut tell: impl FnMut(&Iteration) -> ControlFlow<()>) -> Result<Found> {
        let basis = self.table.basis(&self.problem.model().rod);
        let starts = self.table.starts.unwrap_or(if self.table.goal == Goal::TrackTip { 1 } else { 3 }).max(1);
        let most = self.table.iterations.unwrap_or(60);
        let mut history = Vec::new();
        let mut ends: Vec<(Point, f64, Active)> = Vec::new();
        let mut interrupted = false;
        for start in 0..starts {
            let first = self.first(&basis, start);
            let Some(mut here) = self.point(&basis, first) else { continue };
            let n = basis.unknowns;
            let mut hessian: Option<DMatrix<f64>> = None;
            let mut radius = RADIUS[0];
            let mut damping = DAMPING;
            let mut last = (f64::INFINITY, Vec::new());
            for iteration in 0..most {
                // The objective in units of itself.
                let unit = match self.table.goal {
                    Goal::TrackTip => here.value.f.max(f64::MIN_POSITIVE),
                    _ => here.value.f.abs().max(1e-12),
                };
                let gradient = DVector::from_iterator(n, here.value.by.iter().map(|g| g / unit));
                let model = match (&here.value.residuals, &hessian) {
                    (Some((_, rows)), _) => {
                        let jacobian = DMatrix::from_fn(rows.len(), n, |i, j| rows[i][j]);
                        let square = jacobian.transpose() * jacobian / unit;
                        // Marquardt's damping: what the tip hardly feels would else lead far down a bent valley.
                        let diagonal = square.diagonal() * damping;
                        square + DMatrix::from_diagonal(&diagonal)
                    }
                    (None, Some(hessian)) => hessian.clone() / unit,
                    (None, None) => DMatrix::identity(n, n) * (gradient.norm() / RADIUS[0]).max(1e-12),
                };
                let mut programme = Quadratic::new(n);
                programme.hessian = model.transpose().iter().copied().collect();
                programme.gradient = gradient.iter().copied().collect();
                smooth(&mut programme, &basis, self.table.smoothness);
                let trusted = self.constrain(&mut programme, &basis, &here.x, radius);
                let solution = programme.solve()?;
                // The gradient of the Lagrangian without the trust region's duals.
                let mut lagrangian: Vec<f64> = gradient.iter().copied().collect();
                for (k, constraint) in programme.constraints.iter().enumerate().skip(trusted) {
                    constraint.row.iter().for_each(|(i, c)| lagrangian[*i] += solution.duals[k] * c);
                }
                let stationarity = lagrangian.iter().fold(0.0, |max: f64, x| max.max(x.abs()));
                let mut active = programme.active(&solution);
                active.retain(|(name, _)| !name.starts_with("trust"));
                last = (stationarity, active);
                let mut report = Iteration {
                    start,
                    iteration,
                    objective: self.objective.shown(here.value.f),
                    stationarity,
                    radius,
                    accepted: true,
                };
                let exact = self.table.goal == Goal::TrackTip && self.objective.shown(here.value.f) < 1e-9;
                if stationarity <= STATIONARY || exact || radius < RADIUS[1] {
                    interrupted = tell(&report).is_break();
                    history.push(report);
                    break;
                }
                let step = DVector::from_column_slice(&solution.x);
                let promised = -(gradient.dot(&step) + 0.5 * step.dot(&(&model * &step)));
                let trial = self.kept(&basis, here.x.iter().zip(step.iter()).map(|(x, d)| x + d).collect());
                let next = self.point(&basis, trial);
                let won = next.as_ref().map_or(f64::NEG_INFINITY, |next| (here.value.f - next.value.f) / unit);
                let longest = step.amax();
                if won > 1e-4 * promised
                    && let Some(next) = next
                {
                    if here.value.residuals.is_none() {
                        let dual =
                            self.table.mean.map_or(0.0, |_| solution.duals.last().copied().unwrap_or(0.0)) * unit;
                        hessian = Some(self.updated(hessian, &here, &next, dual, &basis));
                    }
                    if here.value.residuals.is_some() {
                        damping *= if won > 0.75 * promised {
                            0.1
                        } else if won < 0.25 * promised {
                            4.0
                        } else {
                            1.0
                        };
                    } else if won > 0.75 * promised && longest > 0.9 * radius {
                        radius = (2.0 * radius).min(2.0);
                    } else if won < 0.25 * promised {
                        radius = 0.5 * longest;
                    }
                    here = next;
                } else {
                    report.accepted = false;
                    if here.value.residuals.is_some() && damping < 1e6 {
                        damping *= 3.0;
                    } else {
                        radius = 0.25 * longest.min(radius);
                    }
                }
                interrupted = tell(&report).is_break();
                history.push(report);
                if interrupted {
                    break;
                }
            }
            ends.push((here, last.0, last.1));
            if interrupted {
                break;
            }
        }
        let starts: Vec<f64> = ends.iter().map(|(point, ..)| self.objective.shown(point.value.f)).collect();
        let Some((best, stationarity, active)) = ends.into_iter().min_by(|a, b| a.0.value.f.total_cmp(&b.0.value.f))
        else {
            return Err(Error::Design {
                reason: "no start could be simulated; try other bounds, or a smaller step".into(),
            });
        };
        let singular_values = best.value.residuals.as_ref().map_or(Vec::new(), |(_, rows)| {
            let jacobian = DMatrix::from_fn(rows.len(), basis.unknowns, |i, j| rows[i][j]);
            let mut values: Vec<f64> = jacobian.singular_values().iter().copied().collect();
            values.sort_by(|a, b| b.total_cmp(a));
            values
        });
        Ok(Found {
            stiffness_n_m2: self.stiffness(&basis, &best.x),
            objective: self.objective.shown(best.value.f),
            stationarity,
            converged: stationarity <= 1e-6
                || self.table.goal == Goal::TrackTip && self.objective.shown(best.value.f) < 1e-9,
            starts,
            history,
            active,
            singular_values,
            interrupted,
        })
    }

    /// Adds the constraints of a step from `x`; the trust region's come first, their number is returned. The mean is last.
    fn constrain(&self, programme: &mut Quadratic, basis: &Basis, x: &[f64], radius: f64) -> usize {
        let [low, high] = self.table.bounds;
        let constraints = &mut programme.constraints;
        for i in 0..x.len() {
            for sign in [1.0, -1.0] {
                constraints.push(Constraint::at_most("trust region", vec![(i, sign)], radius));
            }
        }
        let trusted = constraints.len();
        let place = |i: usize| match &self.table.knots {
            Some(knots) => format!("knot xi = {}", knots[i]),
            None => format!("joint {}", i + self.problem.model().rod.first_joint),
        };
        for (i, x) in x.iter().enumerate() {
            constraints.push(Constraint::at_most(
                format!("{} at least {low}", place(i)),
                vec![(i, -1.0)],
                x - low.ln(),
            ));
            constraints.push(Constraint::at_most(
                format!("{} at most {high}", place(i)),
                vec![(i, 1.0)],
                high.ln() - x,
            ));
        }
        for i in (1..x.len()).filter(|_| self.table.monotone) {
            let name = format!("{} not above {}", place(i), place(i - 1));
            constraints.push(Constraint::at_most(name, vec![(i, 1.0), (i - 1, -1.0)], x[i - 1] - x[i]));
        }
        if let Some(most) = self.table.mean {
            let (mean, by) = self.mean(basis, x);
            let row = by.into_iter().enumerate().collect();
            constraints.push(Constraint::at_most(format!("mean at most {most}"), row, (most - mean).max(0.0)));
        }
        trusted
    }

    /// The damped BFGS matrix of the Lagrangian after the step from `here` to `next`; `dual` is that of the mean.
    fn updated(&self, old: Option<DMatrix<f64>>, here: &Point, next: &Point, dual: f64, basis: &Basis) -> DMatrix<f64> {
        let n = here.x.len();
        let vector = |values: &[f64]| DVector::from_column_slice(values);
        let slope = |point: &Point| vector(&point.value.by) + vector(&self.mean(basis, &point.x).1) * dual;
        let (s, y) = (vector(&next.x) - vector(&here.x), slope(next) - slope(here));
        let old = old.unwrap_or_else(|| {
            let size = (y.dot(&y) / y.dot(&s).abs().max(f64::MIN_POSITIVE)).min(10.0 * slope(here).norm());
            DMatrix::identity(n, n) * size.max(1e-12 * here.value.f.abs())
        });
        let hs = &old * &s;
        let (shs, sy) = (s.dot(&hs), s.dot(&y));
        if shs <= 0.0 {
            return old;
        }
        let theta = if sy >= 0.2 * shs { 1.0 } else { 0.8 * shs / (shs - sy) };
        let r = y * theta + &hs * (1.0 - theta);
        let scale = s.dot(&r);
        old - &hs * hs.transpose() / shs + &r * r.transpose() / scale
    }

    /// The objective as shown with factors of the reference at the joints; none where it fails.
    pub fn measure(&mut self, factors: &[f64]) -> Option<f64> {
        let reference = self.problem.model().rod.ei;
        let ei: Vec<f64> = factors.iter().map(|factor| factor * reference).collect();
        self.objective.measure(&mut self.problem, &ei)
    }

    /// The best profile that is linear in ξ, of the same mean and within the bounds: its slope a in b(1 + a(½ − ξ)) and the
    /// objective as shown.
    pub fn best_linear(&mut self) -> Option<(f64, f64)> {
        let rod = &self.problem.model().rod;
        let xi: Vec<f64> = rod.joints().map(|k| k as f64 / (rod.nodes - 1) as f64).collect();
        let centre = xi.iter().sum::<f64>() / xi.len() as f64;
        let even = self.table.mean.unwrap_or(1.0);
        let [low, high] = self.table.bounds;
        let smaller = self.objective.goal == Goal::TrackTip;
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
