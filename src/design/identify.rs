//! Identification: the stiffness with which tracked markers moved, by one convex quadratic programme.
//!
//! Turning all nodes beyond node k about it stretches no edge and changes κ_k only, so that EI_k c_k = m_k at every time,
//! exactly for the discrete rod: c_k = (κ_k − κ̄_k)(1 + κ_k²/4)/ΔL, m_k = −Σ_{j>k} (x_j − x_k) × (M a_j + drag_j − W_j), or +Σ
//! over j < k of a free rod, whichever side has fewer nodes. Neither EA nor tension appears.
//!
//! Positions and κ̄ go through the same filter (local polynomials). Noise of the positions is carried through it exactly to
//! first order, overlapping windows and all: it gives the standard deviation of every joint, its weight in the programme, and
//! what noise adds to Σc², which is taken off again (errors in variables; Fuller, Measurement Error Models, 1987).

use nalgebra::{DMatrix, Vector2};
use serde::Serialize;

use super::markers::{Markers, Motion};
use super::qp::{Constraint, Quadratic};
use super::table::{Basis, Table};
use crate::error::{Error, Result};
use crate::model::Dynamics;
use crate::rod::{bend, node};
use crate::system::{Direction, State, System};

/// A standard deviation above this part of the stiffness identifies nothing.
const IDENTIFIED: f64 = 0.1;

/// Σc² beyond noise must be this many times what noise alone makes of it; with less the stiffness would rest on how well the
/// noise is known.
const SIGNAL: f64 = 5.0;

/// Joints of which nothing is known stay at the scene's own stiffness, pulled by this part of the least information there is.
const WEAK: f64 = 1e-8;

/// Passes of the weights, which depend on the stiffness.
const PASSES: usize = 3;

/// What can be said of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The data say it.
    Identified,
    /// The data say little; smoothness, knots, order or mean decide.
    PriorDriven,
    /// A bound decides.
    AtABound,
    /// The data know it only together with others.
    NotToldApart,
    /// Neither data nor anything else says anything.
    Unobservable,
}

impl Verdict {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Identified => "identified",
            Self::PriorDriven => "prior-driven",
            Self::AtABound => "at a bound",
            Self::NotToldApart => "not told apart",
            Self::Unobservable => "unobservable",
        }
    }
}

/// The answer for one joint.
#[derive(Debug, Clone, Serialize)]
pub struct Joint {
    /// Its node.
    pub node: usize,
    /// s/L.
    pub xi: f64,
    /// EI, N m².
    pub stiffness_n_m2: f64,
    /// Its standard deviation from the noise of the positions, N m².
    pub deviation_n_m2: f64,
    /// Σc² over what noise alone makes of it.
    pub signal_to_noise: f64,
    /// What can be said of it.
    pub verdict: Verdict,
}

/// What identification finds.
#[derive(Debug, Clone, Serialize)]
pub struct Identified {
    /// The joints.
    pub joints: Vec<Joint>,
    /// Strength of the actuation over the scene's, where it was asked for.
    pub actuation_gain: Option<f64>,
    /// Standard deviation of the positions, m, as asked for or as found.
    pub noise_m: f64,
    /// Samples to either side in the filter.
    pub window_samples: usize,
    /// Samples used.
    pub samples: usize,
    /// Root of the mean of squares of EI c − m over that of m: how well the balance holds.
    pub misfit: f64,
    /// Of a free rod: root mean squares of the sums of forces (N, x and y) and moments (N m) that must vanish, over those of
    /// their parts.
    pub balances: Option<[f64; 3]>,
    /// Constraints that bind, with their duals.
    pub active: Vec<(String, f64)>,
    /// Square roots of the eigenvalues of the data's part of the scaled Hessian, falling: how many numbers the data know, and how well (the
    /// inverse is a standard deviation over the reference stiffness).
    pub singular_values: Vec<f64>,
    /// Samples left out.
    pub missing: Vec<String>,
}

/// How a number moves with positions: index of the entry, and by its value, velocity and acceleration.
type Moves = Vec<(usize, [f64; 3])>;

/// Curvatures and moments of one joint over all samples.
pub(super) struct Series {
    /// Parts of c that do and do not move with the actuation: c = still − gain·driven.
    still: Vec<f64>,
    driven: Vec<f64>,
    /// m.
    pub(super) moment: Vec<f64>,
    /// What a position moves: index of the entry, and by value, velocity and acceleration; one list a sample. The first is for
    /// c, with unit stiffness, the second for −m.
    by: [Vec<Moves>; 2],
}

impl Series {
    pub(super) fn curvature(&self, gain: f64) -> Vec<f64> {
        self.still.iter().zip(&self.driven).map(|(still, driven)| still - gain * driven).collect()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// z × r.
fn turned(r: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-r.y, r.x)
}

/// Evaluates c and m of every joint, and the balances of a free rod.
pub(super) fn series(
    dynamics: &mut Dynamics,
    markers: &Markers,
    motion: &Motion,
) -> Result<(Vec<Series>, Option<[f64; 3]>)> {
    let nodes = dynamics.nodes();
    let joints = dynamics.model.rod.joints();
    let held = dynamics.model.head.is_some();
    let spacing = dynamics.model.rod.spacing;
    let mut state = State::zeros(2 * nodes);
    let naturals: Vec<Vec<f64>> = markers
        .times
        .iter()
        .map(|t| {
            dynamics.move_to(*t, &mut state);
            dynamics.natural.clone()
        })
        .collect();
    let mut all: Vec<Series> = joints
        .clone()
        .map(|_| Series { still: vec![], driven: vec![], moment: vec![], by: [vec![], vec![]] })
        .collect();
    let (mut sums, mut parts) = ([0.0; 3], [0.0; 3]);
    for sample in &motion.samples {
        let time = markers.times[sample.index];
        dynamics.move_to(time, &mut state);
        state.q.copy_from_slice(&sample.q);
        state.v.copy_from_slice(&sample.v);
        let bent = dynamics.shape(&state)?;
        let (dynamics, rod) = (bent.dynamics, &bent.dynamics.model.rod);
        let mut force: Vec<Vector2<f64>> =
            (0..nodes).map(|k| node(&sample.a, k) * rod.mass[k] - dynamics.load(k)).collect();
        let mut damping = vec![nalgebra::Matrix2::zeros(); nodes];
        let moving = bent.kinematics();
        let edges = 0..moving.edges.len();
        dynamics.model.forces.on_edges(&moving, Some(Direction::VELOCITIES), edges, |e, on| {
            for i in 0..2 {
                force[e + i] += on.force(i);
                damping[e + i] += nalgebra::Matrix2::from(on.own(i));
            }
        });
        dynamics.model.forces.on_tip(&moving, None).for_each(|tip| force[nodes - 1] += tip.force);
        let position = |k: usize| node(&state.q, k);
        for (i, k) in joints.clone().enumerate() {
            let kappa = bent.kappa()[k];
            let first = sample.index - motion.half;
            let natural: f64 =
                sample.weights.iter().zip(&naturals[first..]).map(|(w, natural)| w[0] * natural[k]).sum();
            let s = bend::curvature_per_turning(kappa);
            let scale = s / (dynamics.model.rod.joint_part(k) * spacing);
            let series = &mut all[i];
            series.still.push(kappa * scale);
            series.driven.push(natural * scale);
            // c moves with the turning between the edges at k.
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
            let mut by_m = Vec::with_capacity(2 * side.len() + 2);
            for j in side {
                let r = position(j) - position(k);
                moment -= sign * r.perp(&force[j]);
                total += force[j];
                let lever = turned(r) * sign;
                let (v, a) = (damping[j].transpose() * lever, lever * rod.mass[j]);
                let x = -turned(force[j]) * sign;
                by_m.push((2 * j, [x.x, v.x, a.x]));
                by_m.push((2 * j + 1, [x.y, v.y, a.y]));
            }
            let x = turned(total) * sign;
            by_m.push((2 * k, [x.x, 0.0, 0.0]));
            by_m.push((2 * k + 1, [x.y, 0.0, 0.0]));
            series.moment.push(moment);
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

/// Variance of Σ_i u_i e_i by noise of variance one in every position, where e moves by `by` of a sample.
fn variance(motion: &Motion, entries: usize, u: &[f64], by: impl Fn(usize, &mut dyn FnMut(usize, [f64; 3]))) -> f64 {
    // What every position of every sample counts in the sum.
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

/// What is known of a joint: Σc², its share of noise, Σcm, and the variance of Σc(EI c − m).
struct Known {
    square: f64,
    noise: f64,
    product: f64,
    variance: f64,
}

fn known(series: &Series, motion: &Motion, entries: usize, gain: f64, ei: f64, sigma: f64) -> Known {
    let c = series.curvature(gain);
    let of_c = |i: usize| {
        let gain = motion.samples[i].weights.iter().map(|w| w[0] * w[0]).sum::<f64>();
        // The middle node counts twice in the list, once an edge.
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
    Known {
        square: dot(&c, &c),
        noise,
        product: dot(&c, &series.moment),
        variance: sigma * sigma * variance(motion, entries, &c, by),
    }
}

/// The gain of the actuation that leaves the least of EI c − m where every joint takes its best stiffness.
fn best_gain(all: &[Series]) -> f64 {
    let misfit = |gain: f64| -> f64 {
        let of = |series: &Series| {
            let c = series.curvature(gain);
            let (cm, mm) = (dot(&c, &series.moment), dot(&series.moment, &series.moment));
            (1.0 - cm * cm / (dot(&c, &c) * mm)).max(0.0)
        };
        all.iter().map(of).sum()
    };
    // Golden section in the logarithm, after a look around for the right valley.
    let grid = |i: i32| (f64::from(i) * 0.1).exp();
    let middle = (-14..=14).min_by(|a, b| misfit(grid(*a)).total_cmp(&misfit(grid(*b)))).unwrap_or(0);
    let (mut low, mut high) = (f64::from(middle - 1) * 0.1, f64::from(middle + 1) * 0.1);
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    for _ in 0..60 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if misfit(a.exp()) < misfit(b.exp()) { high = b } else { low = a }
    }
    (0.5 * (low + high)).exp()
}

/// Bounds, order and mean of the stiffness over `reference`, as constraints of the unknowns.
pub fn constraints(table: &Table, basis: &Basis, equal_mean: bool) -> Vec<Constraint> {
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

/// The second differences D₂ of the joints' values, as rows of the unknowns.
pub fn second_differences(basis: &Basis) -> impl Iterator<Item = Vec<(usize, f64)>> {
    basis.rows.windows(3).map(|rows| {
        let parts = rows.iter().zip([1.0, -2.0, 1.0]);
        parts.flat_map(|(part, factor)| part.iter().map(move |(i, w)| (*i, factor * w))).collect()
    })
}

/// Adds λ‖D₂x‖² over the joints.
pub fn smooth(programme: &mut Quadratic, basis: &Basis, weight: f64) {
    for row in second_differences(basis).filter(|_| weight > 0.0) {
        programme.add_square(&row, 0.0, weight);
    }
}

/// Finds the stiffness with which `markers` moved in the scene of `dynamics`.
///
/// # Errors
/// [`Error::Design`] where data or demands allow no answer; those of [`Dynamics::shape`].
pub fn identify(dynamics: &mut Dynamics, markers: &Markers, table: &Table) -> Result<Identified> {
    let step = {
        let mut steps: Vec<f64> = markers.times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps[steps.len() / 2]
    };
    let motion = markers.smooth(table.window_s.map(|window| (0.5 * window / step).round() as usize))?;
    let (all, balances) = series(dynamics, markers, &motion)?;
    let rod = &dynamics.model.rod;
    let (entries, reference) = (2 * rod.nodes, rod.ei);
    let sigma = table.noise_m.unwrap_or(motion.noise);
    if table.actuation_gain && all.iter().all(|series| series.driven.iter().all(|x| *x == 0.0)) {
        return Err(Error::Design { reason: "actuation_gain is asked for where nothing is actuated".to_string() });
    }
    let gain = if table.actuation_gain { best_gain(&all) } else { 1.0 };
    let basis = table.basis(rod);
    let demands = constraints(table, &basis, true);
    let own: Vec<f64> = rod.joints().map(|k| rod.joint_stiffness(k)).collect();
    let mut stiffness = own.clone();
    let mut found = None;
    let mut data = Quadratic::new(0);
    for _ in 0..PASSES {
        let knowns: Vec<Known> = (all.iter().zip(&stiffness))
            .map(|(series, ei)| known(series, &motion, entries, gain, *ei, sigma))
            .collect();
        let mut programme = Quadratic::new(basis.unknowns);
        // Information (1/variance) of EI/reference.
        let informations: Vec<f64> = knowns
            .iter()
            .map(|known| {
                let square = known.square - known.noise;
                let speaks = square > SIGNAL * known.noise && square > 0.0;
                if speaks { (reference * square).powi(2) / known.variance.max(f64::MIN_POSITIVE) } else { 0.0 }
            })
            .collect();
        let least = informations.iter().copied().filter(|i| *i > 0.0).fold(f64::INFINITY, f64::min);
        data = Quadratic::new(basis.unknowns);
        let weak = WEAK * if least.is_finite() { least } else { 1.0 };
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
    let joints: Vec<Joint> = (rod.joints().zip(&stiffness).zip(&knowns))
        .map(|((k, ei), known)| {
            let square = known.square - known.noise;
            let signal = square / known.noise.max(f64::MIN_POSITIVE);
            let deviation = if square > 0.0 { known.variance.sqrt() / square } else { f64::INFINITY };
            let factor = ei / reference;
            let bound = table.bounds.iter().any(|bound| (factor / bound - 1.0).abs() < 1e-6);
            let verdict = if bound {
                Verdict::AtABound
            } else if signal > SIGNAL && deviation <= IDENTIFIED * ei {
                Verdict::Identified
            } else if prior {
                Verdict::PriorDriven
            } else {
                Verdict::Unobservable
            };
            let xi = rod.xi(k);
            Joint { node: k, xi, stiffness_n_m2: *ei, deviation_n_m2: deviation, signal_to_noise: signal, verdict }
        })
        .collect();
    let (mut left, mut size) = (0.0, 0.0);
    for (series, ei) in all.iter().zip(&stiffness) {
        for (c, m) in series.curvature(gain).iter().zip(&series.moment) {
            left += (ei * c - m).powi(2);
            size += m * m;
        }
    }
    Ok(Identified {
        joints,
        actuation_gain: table.actuation_gain.then_some(gain),
        noise_m: sigma,
        window_samples: motion.half,
        samples: motion.samples.len(),
        misfit: (left / size).sqrt(),
        balances,
        active,
        singular_values,
        missing: markers.missing.clone(),
    })
}
