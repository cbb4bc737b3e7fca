//! How far the cheaper models are from the whole one, without running it.
//!
//! The joint moments m_k that hold the rod in its natural curvature say how far a rod of finite stiffness would deviate
//! from it: δκ_k = m_k/(EI_k/ΔL), quasi-static and to first order. The rigid motion of the prescribed shape is followed as
//! it is, with κ̄ + δκ, and with both again without inertia (drag alone in force, moment and m_k): the differences of the
//! displacements are the errors that a model without elasticity, or without inertia, makes. Where δκ is not small it is
//! scaled down, and the difference up again.

use std::sync::Arc;

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

/// The estimates are this many times the differences found: these are right to a few per cent where the deviation is small,
/// and fall short by up to a factor of 12 beyond [`BENT`] (rad) of it, for which the margin grows to as many times more
/// (measured over moduli of 1 MPa … 70 GPa and viscosities of 1 mPa s … 10 Pa s).
const MARGIN: f64 = 2.0;
const BENT: f64 = 0.25;
const MOST: f64 = 8.0;

/// Part of the longest step over which rates of moments are differences.
const DIFFERENCE: f64 = 1e-4;

/// A motion that is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Kind {
    inertia: bool,
    /// Factor of δκ.
    deviation: f64,
}

/// What came of it.
#[derive(Debug, Clone, Copy, Default)]
struct Outcome {
    displacement: f64,
    path: f64,
    deviation: f64,
    time: f64,
}

impl Estimates {
    /// The estimates for a run of `duration` (s) of `model`.
    pub fn of(model: &Arc<Model>, duration: f64) -> Self {
        let unknown = f64::INFINITY;
        // A motion that cannot be followed says nothing about the errors.
        Self::found(model, duration).unwrap_or(Self { shape: unknown, overdamped: unknown, deviation: unknown, time: 0.0 })
    }

    fn found(model: &Arc<Model>, duration: f64) -> Result<Self> {
        let mut walk = Walk::new(model, duration);
        let plain = walk.follow(Kind { inertia: true, deviation: 0.0 })?;
        let scale = (LINEAR / plain.deviation).min(1.0);
        let bent = walk.follow(Kind { inertia: true, deviation: scale })?;
        let by_elasticity = (bent.displacement - plain.displacement) / scale;
        let mut by_inertia = f64::INFINITY;
        if model.drag.is_some() {
            let drift = walk.follow(Kind { inertia: false, deviation: 0.0 })?;
            let bent_drift = walk.follow(Kind { inertia: false, deviation: scale })?;
            let drift_by_elasticity = (bent_drift.displacement - drift.displacement) / scale;
            by_inertia = (plain.displacement - drift.displacement).abs() + (by_elasticity - drift_by_elasticity).abs();
        }
        let size = plain.displacement.abs().max(PATH * plain.path);
        let margin = MARGIN * (1.0 + (plain.deviation / BENT).powi(2)).min(MOST);
        let estimate = |error: f64| {
            let estimate = margin * error.abs() / size;
            if estimate.is_finite() { estimate } else { f64::INFINITY }
        };
        // A rod released into its natural curvature rings, which the prescribed shape knows nothing of.
        let released = model.start == Start::Jump && walk.strained();
        Ok(Self {
            shape: if released { f64::INFINITY } else { estimate(by_elasticity) },
            overdamped: estimate(by_inertia),
            deviation: plain.deviation,
            time: plain.time,
        })
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
            chain: Chain::new(nodes),
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

    fn follow(&mut self, kind: Kind) -> Result<Outcome> {
        let first = self.dynamics.first_state();
        let longest = longest_step(&self.dynamics).min(self.duration / 20.0);
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit(&self.dynamics.model.rod, natural, &first);
        let mut outcome = Outcome::default();
        let mut rates = self.rates(kind, 0.0, &rigid)?;
        let mut com = self.com(kind, 0.0, &rigid)?;
        let start = com;
        let length = self.dynamics.model.rod.length;
        let (mut t, mut h) = (0.0, 0.05 * longest);
        for _ in 0..MOST_STEPS {
            if t >= self.duration {
                break;
            }
            h = h.min(longest).min(self.duration - t);
            let mut failure = None;
            let step = Step::new(t, rigid, rates, h, |t, rigid| {
                self.rates(kind, t, rigid).unwrap_or_else(|error| {
                    failure.get_or_insert(error);
                    [f64::NAN; RIGID]
                })
            });
            let [x, y, turn, ..] = step.error().map(f64::abs);
            let error = (x.max(y) + length * turn) / (length * TOLERANCE);
            if let Some(failure) = failure {
                return Err(failure);
            }
            if error > 1.0 {
                h *= (0.9 * error.powf(-1.0 / f64::from(ORDER))).max(0.1);
                continue;
            }
            let last = t + h >= self.duration;
            t = if last { self.duration } else { t + h };
            (rigid, rates) = (step.end, step.rate());
            h *= (0.9 * error.powf(-1.0 / f64::from(ORDER))).clamp(0.2, 5.0);
            let here = self.com(kind, t, &rigid)?;
            outcome.path += (here[0] - com[0]).hypot(here[1] - com[1]);
            com = here;
            if kind.deviation == 0.0 {
                self.moments(0, kind, t, &rigid)?;
                let joint = &self.dynamics.model.rod.joint;
                let joints = self.dynamics.model.rod.joints();
                let bend: f64 = joints.map(|k| (self.moments[0][k] / joint[k]).abs()).sum();
                outcome.deviation = outcome.deviation.max(bend);
            }
        }
        outcome.displacement = com[0] - start[0];
        outcome.time = t;
        Ok(outcome)
    }

    /// Writes the moments that hold the prescribed shape at time `t` to slot `i`; leaves the motion in `state`.
    fn moments(&mut self, i: usize, kind: Kind, t: f64, rigid: &Rigid) -> Result<()> {
        let dynamics = &mut self.dynamics;
        dynamics.look_at(t);
        dynamics.natural_acceleration(t, &mut self.acceleration);
        let rod = &dynamics.model.rod;
        let natural = [&dynamics.natural[..], &dynamics.natural_rate, &self.acceleration];
        match &dynamics.held {
            Some(pose) => self.chain.hang(rod, natural, pose),
            None => {
                let shape = [natural[0], natural[1]];
                let mut rigid = *rigid;
                let rates = if kind.inertia {
                    self.chain.rates(dynamics, shape, &rigid)
                } else {
                    let rates = self.chain.rates_without_inertia(dynamics, shape, &rigid);
                    (rigid[3], rigid[4]) = (rates[0], rates[1]);
                    rates
                };
                self.chain.place(rod, natural, &rigid, &rates);
            }
        }
        self.state.t = t;
        self.state.q.copy_from_slice(&self.chain.x);
        self.state.v.copy_from_slice(&self.chain.v);
        self.state.a.copy_from_slice(&self.chain.a);
        if !kind.inertia {
            self.state.a.fill(0.0);
        }
        dynamics.shape(&self.state)?;
        dynamics.balance(&self.state, &mut self.moments[i]);
        Ok(())
    }

    /// Writes the curvatures of `kind` at time `t` and their rates.
    fn bend(&mut self, kind: Kind, t: f64, rigid: &Rigid) -> Result<()> {
        if kind.deviation != 0.0 {
            let d = DIFFERENCE * longest_step(&self.dynamics).min(self.duration / 20.0);
            self.moments(0, kind, t, rigid)?;
            let rates = self.plain_rates(kind, rigid);
            for (i, d) in [(1, -d), (2, d)] {
                let moved = std::array::from_fn(|j| rigid[j] + d * rates[j]);
                self.moments(i, kind, t + d, &moved)?;
            }
            self.dynamics.look_at(t);
            let rod = &self.dynamics.model.rod;
            for k in rod.joints() {
                let flexibility = kind.deviation / rod.joint[k];
                let [here, before, after] = [0, 1, 2].map(|i| self.moments[i][k]);
                self.curvature[0][k] = self.dynamics.natural[k] + flexibility * here;
                self.curvature[1][k] = self.dynamics.natural_rate[k] + flexibility * (after - before) / (2.0 * d);
            }
        } else {
            self.dynamics.look_at(t);
            self.curvature[0].copy_from_slice(&self.dynamics.natural);
            self.curvature[1].copy_from_slice(&self.dynamics.natural_rate);
        }
        Ok(())
    }

    fn plain_rates(&mut self, kind: Kind, rigid: &Rigid) -> Rigid {
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        if kind.inertia {
            self.chain.rates(&self.dynamics, natural, rigid)
        } else {
            self.chain.rates_without_inertia(&self.dynamics, natural, rigid)
        }
    }

    fn rates(&mut self, kind: Kind, t: f64, rigid: &Rigid) -> Result<Rigid> {
        if self.dynamics.model.head.is_some() {
            return Ok([0.0; RIGID]);
        }
        self.bend(kind, t, rigid)?;
        let shape = [&self.curvature[0][..], &self.curvature[1]];
        Ok(if kind.inertia {
            self.chain.rates(&self.dynamics, shape, rigid)
        } else {
            self.chain.rates_without_inertia(&self.dynamics, shape, rigid)
        })
    }

    /// The centre of mass at time `t`.
    fn com(&mut self, kind: Kind, t: f64, rigid: &Rigid) -> Result<[f64; 2]> {
        if self.dynamics.model.head.is_none() {
            return Ok([rigid[0], rigid[1]]);
        }
        self.bend(kind, t, rigid)?;
        let rod = &self.dynamics.model.rod;
        let pose = self.dynamics.held.unwrap_or_default();
        self.chain.hang(rod, [&self.curvature[0], &self.curvature[1], &self.acceleration], &pose);
        Ok(rod.mean(&self.chain.x).into())
    }
}
