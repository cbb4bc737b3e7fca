//! How far the cheaper models are from the whole one, without running it.
//!
//! The joint moments m_k that hold the rod in its natural curvature say how far a rod of finite stiffness would deviate
//! from it: δκ_k = m_k/(EI_k/ΔL), quasi-static and to first order. The rigid motion of the prescribed shape is followed as
//! it is, with κ̄ + δκ, and with both again without inertia (drag alone in force, moment and m_k): the differences of the
//! displacements are the errors that a model without elasticity, or without inertia, makes. Where δκ is not small it is
//! scaled down, and the difference up again.

use std::sync::Arc;

use nalgebra::Vector2;

use crate::error::Result;
use crate::model::{Dynamics, Model};
use crate::start::Start;
use crate::system::State;

use super::rigid::{Chain, RIGID, Rigid};
use super::runge_kutta::{ORDER, Step};
use super::shape::longest_step;

/// Estimated errors of the net displacement over a run, relative to the larger of its modulus and [`PATH`] of the path of
/// the centre of mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimates {
    /// Of the shape model.
    pub shape: f64,
    /// Of the overdamped model.
    pub overdamped: f64,
    /// Largest Σ|δκ_k|: by how much (rad) the rod would deviate from its natural curvature.
    pub deviation: f64,
    /// Time that the estimates cover, s: the run's, or less of a long one.
    pub time: f64,
}

/// Part of the centre of mass's path that displacements are measured against where they are smaller.
pub const PATH: f64 = 0.01;

/// Largest error of a step, over the length.
const TOLERANCE: f64 = 1e-7;

/// Most steps of one of the motions followed.
const MOST_STEPS: u32 = 5_000;

/// Total deviation (rad) up to which the displacement is linear in it.
const LINEAR: f64 = 0.1;

/// The estimates are this many times the differences found. Those are right to a few per cent where the deviation is small;
/// a rod that rings, as none of the motions followed does, is off by up to twice as much. Beyond [`BENT`] (rad) of deviation
/// they fall short by up to a factor of 12, for which the margin grows to [`MOST`] times as much (measured over moduli of
/// 1 MPa … 70 GPa and viscosities of 1 mPa s … 10 Pa s).
const MARGIN: f64 = 4.0;
const BENT: f64 = 0.25;
const MOST: f64 = 4.0;

/// Part of the longest step over which rates of moments are differences.
const DIFFERENCE: f64 = 1e-4;

/// What came of a motion of the prescribed shape and, beside it, of the same shape with part of its deviation.
#[derive(Debug, Clone, Copy, Default)]
struct Outcome {
    /// Net displacements of both, m.
    displacement: [f64; 2],
    path: f64,
    deviation: f64,
    time: f64,
}

impl Estimates {
    /// The estimates for a run of `duration` (s) of `model`.
    pub fn of(model: &Arc<Model>, duration: f64) -> Self {
        let unknown = f64::INFINITY;
        // A motion that cannot be followed says nothing about the errors.
        Self::found(model, duration).unwrap_or(Self {
            shape: unknown,
            overdamped: unknown,
            deviation: unknown,
            time: 0.0,
        })
    }

    fn found(model: &Arc<Model>, duration: f64) -> Result<Self> {
        let mut walk = Walk::new(model, duration);
        let plain = walk.follow(true, 0.0)?;
        let scale = (LINEAR / plain.deviation).min(1.0);
        let mut displacements = |inertia: bool| -> Result<[f64; 2]> {
            let [plain, bent] = walk.follow(inertia, scale)?.displacement;
            Ok([plain, (bent - plain) / scale])
        };
        let [with, by_elasticity] = displacements(true)?;
        let mut by_inertia = f64::INFINITY;
        if !model.forces.is_empty() {
            let [without, drift_by_elasticity] = displacements(false)?;
            by_inertia = (with - without).abs() + (by_elasticity - drift_by_elasticity).abs();
        }
        let size = plain.displacement[0].abs().max(PATH * plain.path);
        let margin = MARGIN * (1.0 + (plain.deviation / BENT).powi(2)).min(MOST);
        // A rod released into its natural curvature rings, which the motions followed know nothing of.
        let released = model.start == Start::Jump && walk.strained();
        let of = |error: f64| {
            let estimate = margin * error.abs() / size;
            if released || !estimate.is_finite() { f64::INFINITY } else { estimate }
        };
        Ok(Self { shape: of(by_elasticity), overdamped: of(by_inertia), deviation: plain.deviation, time: plain.time })
    }
}

/// A rod whose motions are followed.
struct Walk {
    dynamics: Dynamics,
    duration: f64,
    chain: Chain,
    state: State,
    acceleration: Vec<f64>,
    moments: [Vec<f64>; 3],
    curvature: [Vec<f64>; 2],
}

impl Walk {
    fn new(model: &Arc<Model>, duration: f64) -> Self {
        let nodes = model.rod.nodes;
        let zeros = || vec![0.0; nodes];
        Self {
            dynamics: Dynamics::new(Arc::clone(model)),
            duration,
            chain: Chain::new(&model.rod),
            state: State::zeros(2 * nodes),
            acceleration: zeros(),
            moments: [zeros(), zeros(), zeros()],
            curvature: [zeros(), zeros()],
        }
    }

    /// True where the natural curvature at the start is not the straight rod's.
    fn strained(&mut self) -> bool {
        self.dynamics.look_at(0.0);
        self.dynamics.natural.iter().any(|k| *k != 0.0)
    }

    /// The longest step, s.
    fn longest(&self) -> f64 {
        longest_step(&self.dynamics).min(self.duration / 20.0)
    }

    /// Follows the prescribed shape and, beside it, `scale` times its deviation on top, with inertia or without.
    fn follow(&mut self, inertia: bool, scale: f64) -> Result<Outcome> {
        let first = self.dynamics.first_state();
        let longest = self.longest();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let rigid = self.chain.fit(&self.dynamics.model.rod, natural, &first);
        let mut both = [0.0; 2 * RIGID];
        both.as_chunks_mut().0.fill(rigid);
        let mut outcome = Outcome::default();
        let mut rates = self.rates(inertia, scale, 0.0, &both)?;
        let start = self.com(inertia, scale, 0.0, &both)?;
        let mut com = start;
        let length = self.dynamics.model.rod.length;
        let (mut t, mut h) = (0.0, 0.05 * longest);
        for _ in 0..MOST_STEPS {
            if t >= self.duration {
                break;
            }
            h = h.min(longest).min(self.duration - t);
            let mut failure = None;
            let step = Step::new(t, both, rates, h, |t, both| {
                self.rates(inertia, scale, t, both).unwrap_or_else(|error| {
                    failure.get_or_insert(error);
                    [f64::NAN; 2 * RIGID]
                })
            });
            if let Some(failure) = failure {
                return Err(failure);
            }
            let error = |[x, y, turn, ..]: &Rigid| x.abs().max(y.abs()) + length * turn.abs();
            let error = step.error().as_chunks().0.iter().map(error).fold(0.0, f64::max) / (length * TOLERANCE);
            let factor = 0.9 * error.powf(-1.0 / f64::from(ORDER));
            if error > 1.0 {
                h *= factor.max(0.1);
                continue;
            }
            t = if t + h >= self.duration { self.duration } else { t + h };
            (both, rates) = (step.end, step.rate());
            h *= factor.clamp(0.2, 5.0);
            let here = self.com(inertia, scale, t, &both)?;
            outcome.path += (here[0] - com[0]).norm();
            com = here;
            if scale == 0.0 {
                self.moments(0, inertia, t, plain(&both))?;
                let rod = &self.dynamics.model.rod;
                let bend = rod.joints().map(|k| (self.moments[0][k] / rod.joint[k]).abs()).sum();
                outcome.deviation = outcome.deviation.max(bend);
            }
        }
        outcome.displacement = [0, 1].map(|i| com[i].x - start[i].x);
        outcome.time = t;
        Ok(outcome)
    }

    /// Writes the moments that hold the prescribed shape at time `t` to slot `i`.
    fn moments(&mut self, i: usize, inertia: bool, t: f64, rigid: &Rigid) -> Result<()> {
        let dynamics = &mut self.dynamics;
        dynamics.look_at(t);
        dynamics.natural_acceleration(t, &mut self.acceleration);
        let rod = &dynamics.model.rod;
        let natural = [&dynamics.natural[..], &dynamics.natural_rate, &self.acceleration];
        match &dynamics.held {
            Some(pose) => self.chain.hang(rod, natural, pose),
            None => {
                let shape = [natural[0], natural[1]];
                let rates = rates_of(&mut self.chain, dynamics, inertia, shape, rigid);
                let mut rigid = *rigid;
                (rigid[3], rigid[4]) = (rates[0], rates[1]);
                self.chain.place(rod, natural, &rigid, &rates);
            }
        }
        self.state.t = t;
        self.state.q.copy_from_slice(&self.chain.x);
        self.state.v.copy_from_slice(&self.chain.v);
        self.state.a.copy_from_slice(&self.chain.a);
        if !inertia {
            self.state.a.fill(0.0);
        }
        dynamics.shape(&self.state)?;
        dynamics.balance(&self.state, &mut self.moments[i]);
        Ok(())
    }

    /// Writes the natural curvatures at time `t` and their rates, with `scale` times the deviation that the motion `rigid`
    /// of the prescribed shape, with `rates`, makes. The rod starts without it, so it grows over the longest step.
    fn bend(&mut self, inertia: bool, scale: f64, t: f64, rigid: &Rigid, rates: &Rigid) -> Result<()> {
        let longest = self.longest();
        let d = DIFFERENCE * longest;
        let moved = |d: f64| std::array::from_fn(|j| rigid[j] + d * rates[j]);
        for (i, d) in [(0, 0.0), (1, -d), (2, d)] {
            self.moments(i, inertia, t + d, &moved(d))?;
        }
        self.dynamics.look_at(t);
        let [grown, growing] = Start::Ramp { duration: longest }.gain(t);
        let rod = &self.dynamics.model.rod;
        for k in rod.joints() {
            let flexibility = scale / rod.joint[k];
            let [here, before, after] = [0, 1, 2].map(|i| flexibility * self.moments[i][k]);
            self.curvature[0][k] = self.dynamics.natural[k] + grown * here;
            self.curvature[1][k] =
                self.dynamics.natural_rate[k] + grown * (after - before) / (2.0 * d) + growing * here;
        }
        Ok(())
    }

    /// The rates of both motions.
    fn rates(&mut self, inertia: bool, scale: f64, t: f64, both: &Both) -> Result<Both> {
        let mut rates = [0.0; 2 * RIGID];
        if self.dynamics.model.head.is_some() {
            return Ok(rates);
        }
        self.dynamics.look_at(t);
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let of_plain = rates_of(&mut self.chain, &self.dynamics, inertia, natural, plain(both));
        rates[..RIGID].copy_from_slice(&of_plain);
        if scale != 0.0 {
            self.bend(inertia, scale, t, plain(both), &of_plain)?;
            let bent = [&self.curvature[0][..], &self.curvature[1]];
            let rigid = both.last_chunk().unwrap_or(&[0.0; RIGID]);
            rates[RIGID..].copy_from_slice(&rates_of(&mut self.chain, &self.dynamics, inertia, bent, rigid));
        }
        Ok(rates)
    }

    /// The centres of mass of both at time `t`.
    fn com(&mut self, inertia: bool, scale: f64, t: f64, both: &Both) -> Result<[Vector2<f64>; 2]> {
        let Some(_) = self.dynamics.model.head else {
            return Ok([Vector2::new(both[0], both[1]), Vector2::new(both[RIGID], both[RIGID + 1])]);
        };
        let mut com = [Vector2::zeros(); 2];
        for (com, scale) in com.iter_mut().zip([0.0, scale]) {
            self.bend(inertia, scale, t, plain(both), &[0.0; RIGID])?;
            let rod = &self.dynamics.model.rod;
            let pose = self.dynamics.held.unwrap_or_default();
            self.chain.hang(rod, [&self.curvature[0], &self.curvature[1], &self.acceleration], &pose);
            *com = rod.mean(&self.chain.x);
        }
        Ok(com)
    }
}

/// The rigid motions of the prescribed shape and of the one that deviates from it.
type Both = [f64; 2 * RIGID];

fn plain(both: &Both) -> &Rigid {
    both.first_chunk().unwrap_or(&[0.0; RIGID])
}

fn rates_of(chain: &mut Chain, dynamics: &Dynamics, inertia: bool, shape: [&[f64]; 2], rigid: &Rigid) -> Rigid {
    if inertia { chain.rates(dynamics, shape, rigid) } else { chain.rates_without_inertia(dynamics, shape, rigid) }
}
