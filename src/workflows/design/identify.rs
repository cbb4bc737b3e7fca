//! Identification of stiffness from tracked markers: one convex quadratic program on the moment balances of the joints.
//!
//! Turning all nodes beyond node k about it stretches no edge and changes κ_k only, so that EI_k c_k = m_k at every time,
//! exactly for the discrete rod: c_k = (κ_k − κ̄_k)(1 + κ_k²/4)/ΔL, m_k = −Σ_{j>k} (x_j − x_k) × (M a_j + drag_j − W_j), or +Σ
//! over j < k of a free rod, whichever side has fewer nodes. Neither EA nor tension appears.
//!
//! Positions and κ̄ are smoothed by the same filter (local polynomials). Noise of the positions is propagated through it exactly to
//! first order, including overlapping windows. It gives the standard deviation of each joint, its weight in the program, and the bias of
//! Σc² by noise, which is subtracted (errors in variables; Fuller, Measurement Error Models, 1987).

use nalgebra::{DMatrix, Vector2};
use serde::Serialize;

use super::basis::{Basis, second_differences};
use super::markers::{Markers, SmoothedMotion};
use super::qp::{Constraint, QuadraticProgram};
use super::refit::Refit;
use super::table::DesignTable;
use crate::error::{Error, Result};
use crate::fluid::force::{EdgeForce, TipForce};
use crate::linear::Direction;
use crate::model::Dynamics;
use crate::rod::{add, bend, node};
use crate::system::{State, System};

/// A parameter counts as identified if its standard deviation is at most this fraction of it.
pub(super) const MAX_RELATIVE_DEVIATION: f64 = 0.1;

/// Least ratio of Σc² beyond noise to the contribution of noise. Below it, the estimate would depend on how well the noise is
/// known.
const MIN_SIGNAL_TO_NOISE: f64 = 5.0;

/// Weight of the prior, over the least information in the data: joints without information keep the scene's own stiffness.
const PRIOR_WEIGHT: f64 = 1e-8;

/// Fraction of the window that is tried if joints do not fit. Of 40 random tails, 6 are reported not to fit their own data without
/// it, and 1 with it (tests/design/verdicts.rs).
const SHORTER_WINDOW: f64 = 0.8;

/// A joint does not fit if the mean square of its residual exceeds that of noise by more than this.
const MAX_MISFIT: f64 = 1.5;

/// The actuation gain is searched on this logarithmic grid around the scene's: number of steps to either side, and step.
const GAIN_STEPS: i32 = 70;
const GAIN_STEP: f64 = 0.1;

/// Iterations of reweighted least squares, since the weights depend on the stiffness.
const REWEIGHTINGS: usize = 3;

/// How well the data determine a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Identifiability {
    /// The data determine it.
    Identified,
    /// The data contribute little; smoothness, knots, order or mean decide.
    PriorDriven,
    /// It is at a bound.
    AtABound,
    /// The data determine it only together with others.
    NotToldApart,
    /// The residual exceeds noise: the scene differs from that of the data.
    DoesNotFit,
    /// The search ended before it was stationary.
    NotConverged,
    /// The data determine it, but mesh and steps of the simulation move it by more than a tenth.
    TooCoarse,
    /// Neither the data nor a prior determines it.
    Unobservable,
}

impl Identifiability {
    /// Its description.
    pub fn words(self) -> &'static str {
        match self {
            Self::Identified => "identified",
            Self::PriorDriven => "prior-driven",
            Self::AtABound => "at a bound",
            Self::NotToldApart => "not told apart",
            Self::DoesNotFit => "does not fit",
            Self::NotConverged => "not converged",
            Self::TooCoarse => "mesh or steps too coarse",
            Self::Unobservable => "unobservable",
        }
    }
}

/// The estimate for one joint.
#[derive(Debug, Clone, Serialize)]
pub struct JointEstimate {
    /// Index of its node.
    pub node: usize,
    /// s/L.
    pub xi: f64,
    /// EI, N m².
    pub stiffness_n_m2: f64,
    /// Standard deviation from the noise of the positions, N m².
    pub deviation_n_m2: f64,
    /// Signal-to-noise ratio: Σc² over the contribution of noise.
    pub signal_to_noise: f64,
    /// Root mean square of EI c − m over the contribution of noise: about 1 if the scene matches the data.
    pub residual_over_noise: f64,
    /// Its identifiability.
    pub verdict: Identifiability,
}

impl JointEstimate {
    /// True if its curvature beyond the natural one is below the noise.
    pub fn is_below_noise(&self) -> bool {
        self.signal_to_noise <= MIN_SIGNAL_TO_NOISE
    }
}

/// The result of identification.
#[derive(Debug, Clone, Serialize)]
pub struct Identification {
    /// The joints.
    pub joints: Vec<JointEstimate>,
    /// Actuation gain over the scene's, if it was also identified.
    pub actuation_gain: Option<f64>,
    /// True if the gain is at the edge of the search grid.
    pub gain_at_edge: bool,
    /// Standard deviation of the positions, m, as given or as estimated.
    pub noise_m: f64,
    /// Half the smoothing filter's window, in samples.
    pub window_samples: usize,
    /// Number of samples used.
    pub samples: usize,
    /// Root mean square of EI c − m over that of m: how well the moment balance closes.
    pub misfit: f64,
    /// Comparison of its simulation with the markers; `None` if there is none.
    pub refit: Option<Refit>,
    /// For a free rod: root mean squares of the sums of forces (N, x and y) and moments (N m), which must vanish, over those of
    /// their parts.
    pub balances: Option<[f64; 3]>,
    /// Active constraints, with their duals.
    pub active: Vec<(String, f64)>,
    /// Square roots of the eigenvalues of the data's part of the scaled Hessian, in descending order: how many parameters the data
    /// determine, and how well (the inverse is a standard deviation over the reference stiffness).
    pub singular_values: Vec<f64>,
    /// Samples without a marker, and outliers.
    pub missing: Vec<String>,
    /// Descriptions of other samples that were left out.
    pub left_out: Vec<String>,
}

impl Identification {
    /// Updates the estimates by their simulation: deviations grow by the stiffness change that the simulation requires. If the
    /// residual exceeds noise, the scene does not match the data, which balances of single joints may hide.
    pub fn judge(&mut self, refit: Refit) {
        for (joint, stiffer) in self.joints.iter_mut().zip(&refit.stiffer_n_m2) {
            let left = if refit.fits() { 1.0 } else { refit.residual_over_noise };
            joint.deviation_n_m2 = (left * joint.deviation_n_m2).hypot(*stiffer);
            if joint.verdict == Identifiability::Identified && !refit.fits() {
                joint.verdict = Identifiability::DoesNotFit;
            }
        }
        self.refit = Some(refit);
    }
}

/// Directions in which forces are differentiated, in the order of [`Moves`].
const DIRECTIONS: [Direction; 3] = [Direction::POSITIONS, Direction::VELOCITIES, Direction::ACCELERATIONS];

/// Derivatives of a number with respect to positions: index of the coordinate, and derivatives with respect to its value, velocity
/// and acceleration.
type Moves = Vec<(usize, [f64; 3])>;

/// Curvatures and moments of one joint at all samples.
pub(super) struct JointSeries {
    /// The parts of c that do and do not scale with the actuation: c = still − gain·driven.
    still: Vec<f64>,
    driven: Vec<f64>,
    /// m.
    pub(super) moment: Vec<f64>,
    /// Derivatives with respect to the positions, one list per sample. The first is of c, for unit stiffness, the second of −m.
    by: [Vec<Moves>; 2],
}

impl JointSeries {
    pub(super) fn curvature(&self, gain: f64) -> Vec<f64> {
        self.still.iter().zip(&self.driven).map(|(still, driven)| still - gain * driven).collect()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The cross product z × r.
fn turned(r: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-r.y, r.x)
}

/// Evaluates c and m of each joint, and the balances of a free rod.
pub(super) fn series(
    dynamics: &mut Dynamics,
    markers: &Markers,
    motion: &SmoothedMotion,
) -> Result<(Vec<JointSeries>, Option<[f64; 3]>)> {
    let nodes = dynamics.nodes();
    let joints = dynamics.model.rod.joints();
    let held = dynamics.model.head.is_some();
    let spacing = dynamics.model.rod.spacing;
    let mut state = State::zeros(2 * nodes);
    // Prescribed natural curvatures and active moments.
    let given: Vec<[Vec<f64>; 2]> = markers
        .times
        .iter()
        .map(|t| {
            dynamics.move_to(*t, &mut state);
            match &dynamics.active {
                None => [dynamics.natural.clone(), vec![0.0; nodes]],
                Some(active) => [active.natural.clone(), active.moment.clone()],
            }
        })
        .collect();
    let mut all: Vec<JointSeries> = joints
        .clone()
        .map(|_| JointSeries { still: vec![], driven: vec![], moment: vec![], by: [vec![], vec![]] })
        .collect();
    let (mut sums, mut parts) = ([0.0; 3], [0.0; 3]);
    let mut by_moment = [0, 1, 2].map(|_| vec![0.0; 2 * nodes]);
    let mut levers = vec![Vector2::zeros(); nodes];
    for sample in &motion.samples {
        let time = markers.times[sample.index];
        dynamics.move_to(time, &mut state);
        state.q.copy_from_slice(&sample.q);
        state.v.copy_from_slice(&sample.v);
        state.a.copy_from_slice(&sample.a);
        let bent = dynamics.shape(&state)?;
        let (dynamics, rod) = (bent.dynamics, &bent.dynamics.model.rod);
        let mut force: Vec<Vector2<f64>> =
            (0..nodes).map(|k| node(&sample.a, k) * rod.mass[k] - dynamics.load(k)).collect();
        let moving = bent.kinematics();
        let edges = 0..moving.edges.len();
        // Forces on the edges and on the tip, with their derivatives with respect to positions, velocities and accelerations.
        let along = DIRECTIONS.map(|direction| {
            let mut on = vec![EdgeForce::ZERO; moving.edges.len()];
            dynamics.model.forces.on_edges(&moving, Some(direction), edges.clone(), |e, acting| on[e] = *acting);
            let tips: Vec<TipForce> = dynamics.model.forces.on_tip(&moving, Some(direction)).collect();
            (on, tips)
        });
        for (e, on) in along[0].0.iter().enumerate() {
            (0..2).for_each(|i| force[e + i] += on.force(i));
        }
        along[0].1.iter().for_each(|tip| force[nodes - 1] += tip.force);
        let position = |k: usize| node(&state.q, k);
        for (i, k) in joints.clone().enumerate() {
            let kappa = bent.kappa()[k];
            let first = sample.index - motion.half;
            let [natural, active] = [0, 1]
                .map(|i| sample.weights.iter().zip(&given[first..]).map(|(w, given)| w[0] * given[i][k]).sum::<f64>());
            let s = bend::curvature_per_turning(kappa);
            let scale = s / (dynamics.model.rod.joint_part(k) * spacing);
            let series = &mut all[i];
            series.still.push(kappa * scale);
            series.driven.push(natural * scale);
            // c changes with the turning angle between the edges at k.
            let edges = bent.edges();
            let mut by_c = Vec::with_capacity(6);
            let mut turn = |e: usize, sign: f64| {
                let slope = edges[e].n() * (sign * scale * s * edges[e].per_length);
                for (n, slope) in [(e, -slope), (e + 1, slope)] {
                    by_c.push((2 * n, [slope.x, 0.0, 0.0]));
                    by_c.push((2 * n + 1, [slope.y, 0.0, 0.0]));
                }
            };
            if k > 0 {
                turn(k - 1, -1.0);
            }
            turn(k, 1.0);
            // m from the side with fewer nodes, e = EI c − m.
            let tail = held || nodes - 1 - k <= k;
            let (side, sign) = if tail { (k + 1..nodes, 1.0) } else { (0..k, -1.0) };
            let (mut moment, mut total) = (0.0, Vector2::zeros());
            by_moment.iter_mut().for_each(|by| by.fill(0.0));
            levers.fill(Vector2::zeros());
            for j in side.clone() {
                let r = position(j) - position(k);
                moment -= sign * r.perp(&force[j]);
                total += force[j];
                levers[j] = turned(r) * sign;
                add(&mut by_moment[2], j, levers[j] * rod.mass[j]);
                add(&mut by_moment[0], j, -turned(force[j]) * sign);
            }
            add(&mut by_moment[0], k, turned(total) * sign);
            for ((on, tips), by) in along.iter().zip(&mut by_moment) {
                for e in side.start.saturating_sub(1)..side.end.min(on.len()) {
                    for end in 0..2 {
                        let [first, second] = on[e].change_transposed(end, levers[e + end]);
                        add(by, e, first);
                        add(by, e + 1, second);
                    }
                }
                for tip in tips {
                    let [first, second] = tip.edges.map(|by| by.tr_mul(&levers[nodes - 1]));
                    add(by, nodes - 3, -first);
                    add(by, nodes - 2, first - second);
                    add(by, nodes - 1, second + tip.own.tr_mul(&levers[nodes - 1]));
                }
            }
            let entry = |i: usize| (i, [0, 1, 2].map(|order| by_moment[order][i]));
            let by_m: Moves = (0..2 * nodes).map(entry).filter(|(_, by)| *by != [0.0; 3]).collect();
            // EI c is the transmitted moment plus the active moment.
            series.moment.push(moment + active * s);
            series.by[0].push(by_c);
            series.by[1].push(by_m);
        }
        let centre = rod.mean(&state.q);
        let sum: Vector2<f64> = force.iter().sum();
        let moment: f64 = (0..nodes).map(|k| (position(k) - centre).perp(&force[k])).sum();
        for (i, (sum, part)) in [
            (sum.x, force.iter().map(|f| f.x.abs()).sum::<f64>()),
            (sum.y, force.iter().map(|f| f.y.abs()).sum()),
            (moment, (0..nodes).map(|k| (position(k) - centre).perp(&force[k]).abs()).sum()),
        ]
        .into_iter()
        .enumerate()
        {
            sums[i] += sum * sum;
            parts[i] += part * part;
        }
    }
    let balances = (!held).then(|| std::array::from_fn(|i| (sums[i] / parts[i]).sqrt()));
    Ok((all, balances))
}

/// Variance of Σ_i u_i e_i for unit noise in each position; `by` lists the derivatives of e at a sample.
fn variance(
    motion: &SmoothedMotion,
    entries: usize,
    u: &[f64],
    by: impl Fn(usize, &mut dyn FnMut(usize, [f64; 3])),
) -> f64 {
    // The coefficient of every position of every sample in the sum.
    let count = motion.samples.last().map_or(0, |sample| sample.index + motion.half + 1);
    let mut counts = vec![0.0; count * entries];
    for (i, sample) in motion.samples.iter().enumerate() {
        let first = sample.index - motion.half;
        by(i, &mut |entry, by| {
            for (l, w) in sample.weights.iter().enumerate() {
                counts[(first + l) * entries + entry] += u[i] * (by[0] * w[0] + by[1] * w[1] + by[2] * w[2]);
            }
        });
    }
    dot(&counts, &counts)
}

/// Information about a joint: Σc², its part from noise, Σcm, and the variance of Σc(EI c − m).
struct JointInformation {
    square: f64,
    noise: f64,
    product: f64,
    variance: f64,
}

impl JointInformation {
    /// Σc² beyond noise over the contribution of noise.
    fn signal(&self) -> f64 {
        (self.square - self.noise) / self.noise.max(f64::MIN_POSITIVE)
    }
}

fn known(
    series: &JointSeries,
    motion: &SmoothedMotion,
    entries: usize,
    gain: f64,
    ei: f64,
    sigma: f64,
) -> JointInformation {
    let c = series.curvature(gain);
    let of_c = |i: usize| {
        let gain = motion.samples[i].weights.iter().map(|w| w[0] * w[0]).sum::<f64>();
        // The middle node occurs twice in the list, once per edge.
        let mut by: Vec<(usize, f64)> = series.by[0][i].iter().map(|(entry, by)| (*entry, by[0])).collect();
        by.sort_by_key(|(entry, _)| *entry);
        by.dedup_by(|next, kept| {
            next.0 == kept.0 && {
                kept.1 += next.1;
                true
            }
        });
        gain * by.iter().map(|(_, by)| by * by).sum::<f64>()
    };
    let noise = sigma * sigma * (0..c.len()).map(of_c).sum::<f64>();
    let by = |i: usize, visit: &mut dyn FnMut(usize, [f64; 3])| {
        for (entry, by) in &series.by[0][i] {
            visit(*entry, by.map(|by| ei * by));
        }
        for (entry, by) in &series.by[1][i] {
            visit(*entry, *by);
        }
    };
    JointInformation {
        square: dot(&c, &c),
        noise,
        product: dot(&c, &series.moment),
        variance: sigma * sigma * variance(motion, entries, &c, by),
    }
}

/// The expected Σ(EI c − m)² from noise alone.
fn noise_left(series: &JointSeries, motion: &SmoothedMotion, entries: usize, ei: f64, sigma: f64) -> f64 {
    let mut moves = vec![[0.0; 3]; entries];
    let of_residual = |i: usize| {
        moves.fill([0.0; 3]);
        let [by_c, by_m] = [&series.by[0][i], &series.by[1][i]];
        let all =
            by_c.iter().map(|(entry, by)| (entry, by.map(|by| ei * by))).chain(by_m.iter().map(|(e, by)| (e, *by)));
        for (entry, by) in all {
            (0..3).for_each(|order| moves[*entry][order] += by[order]);
        }
        let weights = &motion.samples[i].weights;
        let gram = |a: usize, b: usize| weights.iter().map(|w| w[a] * w[b]).sum::<f64>();
        let gram: [[f64; 3]; 3] = std::array::from_fn(|a| std::array::from_fn(|b| gram(a, b)));
        let square =
            |by: &[f64; 3]| (0..3).map(|a| (0..3).map(|b| by[a] * by[b] * gram[a][b]).sum::<f64>()).sum::<f64>();
        moves.iter().map(square).sum::<f64>()
    };
    sigma * sigma * (0..motion.samples.len()).map(of_residual).sum::<f64>()
}

/// The actuation gain with the least residual EI c − m, with the best stiffness of each joint, and whether it is at the edge of the
/// grid.
fn best_gain(all: &[JointSeries]) -> (f64, bool) {
    let misfit = |gain: f64| -> f64 {
        let of = |series: &JointSeries| {
            let c = series.curvature(gain);
            let (cm, mm) = (dot(&c, &series.moment), dot(&series.moment, &series.moment));
            (1.0 - cm * cm / (dot(&c, &c) * mm)).max(0.0)
        };
        all.iter().map(of).sum()
    };
    // Golden-section search in the logarithm, after a scan for the right minimum.
    let at = |i: i32| f64::from(i) * GAIN_STEP;
    let middle =
        (-GAIN_STEPS..=GAIN_STEPS).min_by(|a, b| misfit(at(*a).exp()).total_cmp(&misfit(at(*b).exp()))).unwrap_or(0);
    let (mut low, mut high) = (at(middle - 1), at(middle + 1));
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    for _ in 0..60 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if misfit(a.exp()) < misfit(b.exp()) { high = b } else { low = a }
    }
    ((0.5 * (low + high)).exp(), middle.abs() == GAIN_STEPS)
}

/// Bounds, order and mean of the stiffness over `reference` as constraints of the unknowns.
pub fn constraints(table: &DesignTable, basis: &Basis, equal_mean: bool) -> Vec<Constraint> {
    let mut constraints = Vec::new();
    let place = |i: usize| match &table.knots {
        Some(knots) => format!("knot xi = {}", knots[i]),
        None => format!("joint {}", i + 1),
    };
    for i in 0..basis.unknowns {
        let [low, high] = table.bounds;
        constraints.push(Constraint::at_most(format!("{} at least {low}", place(i)), vec![(i, -1.0)], -low));
        constraints.push(Constraint::at_most(format!("{} at most {high}", place(i)), vec![(i, 1.0)], high));
    }
    if table.monotone {
        for i in 1..basis.unknowns {
            let name = format!("{} not above {}", place(i), place(i - 1));
            constraints.push(Constraint::at_most(name, vec![(i, 1.0), (i - 1, -1.0)], 0.0));
        }
    }
    if let Some(mean) = table.mean {
        let mut row = vec![0.0; basis.unknowns];
        for (i, w) in basis.rows.iter().flatten() {
            row[*i] += w / basis.rows.len() as f64;
        }
        let row = row.into_iter().enumerate().collect();
        constraints.push(if equal_mean {
            Constraint::equal(format!("mean = {mean}"), row, mean)
        } else {
            Constraint::at_most(format!("mean at most {mean}"), row, mean)
        });
    }
    constraints
}

/// Adds λ‖D₂x‖² over the joints.
pub fn smooth(programme: &mut QuadraticProgram, basis: &Basis, weight: f64) {
    for row in second_differences(basis).filter(|_| weight > 0.0) {
        programme.add_square(&row, 0.0, weight);
    }
}

/// Identifies the stiffness with which `markers` moved in the scene of `dynamics`.
///
/// A window over which positions fit may still be too long for accelerations. The error that it leaves in a balance falls with its
/// sixth power, whereas an error of the scene does not. If joints do not fit and all of them do in a somewhat shorter window, that
/// window is used.
///
/// # Errors
/// [`Error::Design`] if the data or constraints allow no answer; those of [`Dynamics::shape`].
pub fn identify(dynamics: &mut Dynamics, markers: &Markers, table: &DesignTable) -> Result<Identification> {
    let step = {
        let mut steps: Vec<f64> = markers.times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps[steps.len() / 2]
    };
    let fits = |found: &Identification| found.joints.iter().all(|j| j.verdict != Identifiability::DoesNotFit);
    let motion = markers.smooth(table.window_s.map(|window| (0.5 * window / step).round() as usize))?;
    let found = identify_in(dynamics, markers, table, &motion)?;
    if table.window_s.is_some() || fits(&found) {
        return Ok(found);
    }
    let shorter = markers.smooth(Some((SHORTER_WINDOW * motion.half as f64).round() as usize))?;
    if shorter.half == motion.half {
        return Ok(found); // the shortest window
    }
    let other = identify_in(dynamics, markers, table, &shorter)?;
    Ok(if fits(&other) { other } else { found })
}

/// Identifies the stiffness from the smoothed `motion` of the markers.
fn identify_in(
    dynamics: &mut Dynamics,
    markers: &Markers,
    table: &DesignTable,
    motion: &SmoothedMotion,
) -> Result<Identification> {
    let (all, balances) = series(dynamics, markers, motion)?;
    let rod = &dynamics.model.rod;
    let (entries, reference) = (2 * rod.nodes, rod.ei);
    let sigma = table.noise_m.unwrap_or(motion.noise);
    if table.actuation_gain && all.iter().all(|series| series.driven.iter().all(|x| *x == 0.0)) {
        return Err(Error::Design { reason: "actuation_gain is given, but nothing is actuated".to_string() });
    }
    let (gain, at_edge) = if table.actuation_gain { best_gain(&all) } else { (1.0, false) };
    let basis = Basis::of(table, rod);
    let demands = constraints(table, &basis, true);
    let own: Vec<f64> = rod.joints().map(|k| rod.joint_stiffness(k)).collect();
    let mut stiffness = own.clone();
    let mut found = None;
    let mut data = QuadraticProgram::new(0);
    for _ in 0..REWEIGHTINGS {
        let knowns: Vec<JointInformation> =
            (all.iter().zip(&stiffness)).map(|(series, ei)| known(series, motion, entries, gain, *ei, sigma)).collect();
        let mut programme = QuadraticProgram::new(basis.unknowns);
        // Information (1/variance) of EI/reference.
        let informations: Vec<f64> = knowns
            .iter()
            .map(|known| {
                let square = known.square - known.noise;
                let speaks = square > MIN_SIGNAL_TO_NOISE * known.noise && square > 0.0;
                if speaks { (reference * square).powi(2) / known.variance.max(f64::MIN_POSITIVE) } else { 0.0 }
            })
            .collect();
        let least = informations.iter().copied().filter(|i| *i > 0.0).fold(f64::INFINITY, f64::min);
        data = QuadraticProgram::new(basis.unknowns);
        let weak = PRIOR_WEIGHT * if least.is_finite() { least } else { 1.0 };
        for (((known, row), information), own) in knowns.iter().zip(&basis.rows).zip(&informations).zip(&own) {
            if *information > 0.0 {
                let square = known.square - known.noise;
                programme.add_square(row, known.product / square / reference, *information);
                data.add_square(row, 0.0, *information);
            }
            programme.add_square(row, own / reference, weak);
        }
        smooth(&mut programme, &basis, table.smoothness);
        programme.constraints.clone_from(&demands);
        let solution = programme.solve()?;
        stiffness = basis.joints(&solution.x).iter().map(|x| x * reference).collect();
        found = Some((programme, solution, knowns));
    }
    let Some((programme, solution, knowns)) = found else {
        return Err(Error::Design { reason: "nothing was solved".to_string() });
    };
    let n = basis.unknowns;
    let hessian = DMatrix::from_row_slice(n, n, &data.hessian);
    let mut singular_values: Vec<f64> = hessian.symmetric_eigenvalues().iter().map(|x| x.max(0.0).sqrt()).collect();
    singular_values.sort_by(|a, b| b.total_cmp(a));
    let active = programme.active(&solution);
    let prior = table.smoothness > 0.0 || table.knots.is_some() || table.monotone || table.mean.is_some();
    // The squared residuals of the balances: in total, and beyond possible noise; and the squared moments.
    let independent = (motion.samples.len() as f64 / (motion.half + 1) as f64).max(1.0);
    let allowed = MAX_MISFIT + 4.0 * (2.0 / independent).sqrt();
    let left: Vec<[f64; 4]> = (all.iter().zip(&stiffness).zip(&knowns))
        .map(|((series, ei), known)| {
            let noise = noise_left(series, motion, entries, *ei, sigma);
            let c = series.curvature(gain);
            let square: f64 = c.iter().zip(&series.moment).map(|(c, m)| (ei * c - m).powi(2)).sum();
            // If noise exceeds the bending signal, the residual cannot be judged.
            let beyond = if known.signal() > MIN_SIGNAL_TO_NOISE { (square - noise * allowed).max(0.0) } else { 0.0 };
            [square, beyond, dot(&series.moment, &series.moment), noise]
        })
        .collect();
    let sum = |i: usize| left.iter().map(|left| left[i]).sum::<f64>();
    // An error of the scene at one joint also exists at others, where noise may hide it.
    let lacking = (sum(1) / sum(2).max(f64::MIN_POSITIVE)).sqrt();
    let joints: Vec<JointEstimate> = (rod.joints().zip(&stiffness).zip(knowns.iter().zip(&left)))
        .map(|((k, ei), (known, [own, beyond, _, noise]))| {
            let square = known.square - known.noise;
            let signal = known.signal();
            let residual = (own / noise.max(f64::MIN_POSITIVE)).sqrt();
            let deviation = if square > 0.0 {
                // Noise, and the misfit, which more samples do not reduce.
                (known.variance / (square * square) + beyond / square + (lacking * ei).powi(2)).sqrt()
            } else {
                f64::INFINITY
            };
            let factor = ei / reference;
            let bound = table.bounds.iter().any(|bound| (factor / bound - 1.0).abs() < 1e-6);
            let verdict = if bound {
                Identifiability::AtABound
            } else if *beyond > 0.0 {
                Identifiability::DoesNotFit
            } else if at_edge {
                Identifiability::NotToldApart
            } else if signal > MIN_SIGNAL_TO_NOISE && deviation <= MAX_RELATIVE_DEVIATION * ei {
                Identifiability::Identified
            } else if prior {
                Identifiability::PriorDriven
            } else {
                Identifiability::Unobservable
            };
            JointEstimate {
                node: k,
                xi: rod.xi(k),
                stiffness_n_m2: *ei,
                deviation_n_m2: deviation,
                signal_to_noise: signal,
                residual_over_noise: residual,
                verdict,
            }
        })
        .collect();
    Ok(Identification {
        joints,
        actuation_gain: table.actuation_gain.then_some(gain),
        noise_m: sigma,
        window_samples: motion.half,
        samples: motion.samples.len(),
        gain_at_edge: at_edge,
        misfit: (sum(0) / sum(2).max(f64::MIN_POSITIVE)).sqrt(),
        refit: None,
        left_out: motion.left_out.clone(),
        balances,
        active,
        singular_values,
        missing: markers.missing.clone(),
    })
}
