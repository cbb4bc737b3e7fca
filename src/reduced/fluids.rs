//! What a simpler law of the fluid changes of a motion, without running the scene: the scene's own rod and drive are followed under
//! each law, on a coarse mesh, with steps of a fixed size, over the first periods.
//!
//! Nothing of the scene is left out but mesh, steps and length: what drives, bends, carries or holds the rod acts as it does in the
//! run, so flows and heads that change in time are followed as they are.

use std::mem::swap;
use std::sync::Arc;

use super::Mover;
use crate::cycle::{Cycles, Means};
use crate::error::{Error, Result};
use crate::fluid::laws::DragLaw;
use crate::integrator::Method;
use crate::linear::Choice as Linear;
use crate::metrics::{Meter, Reading};
use crate::model::{Dynamics, Model};
use crate::newton::Newton;
use crate::system::Form;
use crate::words::percent;

/// Periods that are followed after a ramp, steps of each, and steps where nothing repeats itself.
pub const PERIODS: f64 = 8.0;
const STEPS_A_PERIOD: f64 = 24.0;
const STEPS: f64 = 128.0;

/// Nodes on a wavelength or, of a longer one, on the rod; and the most of them.
const NODES_ON_A_WAVE: f64 = 16.0;
const MOST_NODES: u64 = 49;

/// Last increment of Newton's method over the length, and how often steps that fail are halved.
const NEWTON: f64 = 1e-7;
const HALVINGS: u32 = 2;

/// The method: where drag stops a rod within a small part of a step, it leaves no oscillation of the velocity.
const METHOD: &str = "esdirk3";

/// Estimated errors are this many times the differences found.
const MARGIN: f64 = 1.5;
/// Smallest error that an estimate says.
pub const FLOOR: f64 = 0.005;

/// The nodes of a rod that is `waves` wavelengths long.
pub fn nodes(waves: f64) -> u64 {
    ((NODES_ON_A_WAVE * waves.max(1.0)).ceil() as u64 + 1).min(MOST_NODES)
}

/// Follows `model` over `duration` (s) from its start, in steps that fit its drive's `frequency` (Hz).
///
/// # Errors
/// Those of a step; [`Error::NotFinite`] where nothing has come out.
pub fn follow(model: &Arc<Model>, duration: f64, frequency: Option<f64>) -> Result<Means> {
    let steps = frequency.map_or(STEPS, |frequency| (STEPS_A_PERIOD * frequency * duration).ceil().max(STEPS_A_PERIOD));
    let mut outcome = steps_of(model, duration, steps as u64);
    for halved in 1..=HALVINGS {
        match &outcome {
            Err(error) if error.is_cured_by_smaller_step() => {
                outcome = steps_of(model, duration, (steps as u64) << (2 * halved));
            }
            _ => break,
        }
    }
    outcome
}

fn steps_of(model: &Arc<Model>, duration: f64, steps: u64) -> Result<Means> {
    let nothing = || Error::NotFinite { time_s: duration, node: 0, what: "the motion" };
    let mut dynamics = Dynamics::new(Arc::clone(model));
    let mut newton = Newton::with(Form::Positions, Linear::Auto, model.rod.nodes, NEWTON)?;
    let method = Method::named(METHOD).ok_or_else(nothing)?;
    let mut mover: Box<dyn Mover> = (method.build)(&method.defaults()).into();
    let mut state = dynamics.first_state_in(Form::Positions);
    mover.begin(&mut dynamics, &mut newton, &mut state)?;
    let mut meter = Meter::start(&mut dynamics, &state)?;
    let mut cycles = Cycles::start(&dynamics, &state, &meter);
    let (mut next, mut reading) = (state.clone(), Reading::new(model.rod.nodes));
    for step in 1..=steps {
        next.t = duration * step as f64 / steps as f64;
        let h = next.t - state.t;
        mover.step(&mut dynamics, &mut newton, &state, h, &mut next)?;
        reading.take(&mut dynamics, &next)?;
        let load = dynamics.load_work([state.t, next.t], &state.q, &next.q);
        meter.count(&mut reading, None, load, dynamics.head_mass())?;
        swap(&mut state, &mut next);
        cycles.follow(&dynamics, &state, &meter, None);
    }
    Means::of(&cycles, &dynamics).ok_or_else(nothing)
}

/// A law of drag, with the water that the rod accelerates or without, and what the scene comes to under it.
#[derive(Debug, Clone, PartialEq)]
pub struct FluidEstimate {
    /// The law.
    pub law: &'static DragLaw,
    /// True with the water that the rod accelerates.
    pub reactive: bool,
    /// Motion and power, of a coarse and short run.
    pub means: Means,
    /// Estimated relative errors of motion and power against the highest law.
    pub errors: [f64; 2],
}

impl FluidEstimate {
    /// Its name.
    pub fn name(&self) -> String {
        self.law.with_reactive(self.reactive)
    }
}

/// What is estimated of the laws of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct FluidEstimates {
    /// The laws, the cheapest first; the last is the highest, which the errors are against.
    pub laws: Vec<FluidEstimate>,
    /// What the highest law is published to be uncertain by, in motion and power.
    pub uncertainty: [f64; 2],
    /// True where the motion is the thrust on a held head, else it is a speed.
    pub held: bool,
}

impl FluidEstimates {
    /// The estimates from what the scene comes to under each law, the highest last.
    pub fn of(found: Vec<(&'static DragLaw, bool, Means)>, uncertainty: [f64; 2], held: bool) -> Option<Self> {
        let highest = found.last()?.2;
        let error = |difference: f64| (MARGIN * difference.abs()).max(FLOOR);
        let count = found.len();
        let laws = found.into_iter().enumerate().map(|(i, (law, reactive, means))| FluidEstimate {
            law,
            reactive,
            means,
            errors: if i + 1 == count { [0.0; 2] } else { means.differences(&highest).map(error) },
        });
        let laws: Vec<_> = laws.collect();
        laws.iter().all(|law| law.errors.iter().all(|error| error.is_finite())).then_some(Self {
            laws,
            uncertainty,
            held,
        })
    }

    /// That of a law.
    pub fn get(&self, law: &DragLaw, reactive: bool) -> Option<&FluidEstimate> {
        self.laws.iter().find(|estimate| estimate.law == law && estimate.reactive == reactive)
    }

    /// Errors of motion and power in words.
    pub fn in_words(&self, [motion, power]: [f64; 2]) -> String {
        format!("{} in {}, {} in power", percent(motion), if self.held { "thrust" } else { "speed" }, percent(power))
    }
}

/// Which law of the fluid a scene takes that leaves it to the program, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct FluidChoice {
    /// The law of drag; none of a scene without drag.
    pub law: Option<&'static DragLaw>,
    /// True with the water that the rod accelerates.
    pub reactive: bool,
    /// Why.
    pub reason: String,
    /// Estimated relative errors of motion and power against the highest law, where they are known.
    pub errors: Option<[f64; 2]>,
}

/// The part of the highest law's own uncertainty that a simpler one may differ from it by.
const SHARE: f64 = 0.25;

impl FluidChoice {
    /// The cheapest law that is `allowed` and differs little from the highest, as seen beside that law's own uncertainty.
    pub fn of(estimates: &FluidEstimates, allowed: impl Fn(&DragLaw, bool) -> bool) -> Option<Self> {
        let limits = estimates.uncertainty.map(|uncertain| SHARE * uncertain);
        let highest = estimates.laws.last()?;
        let within = |law: &&FluidEstimate| law.errors.iter().zip(limits).all(|(error, limit)| *error <= limit);
        let excess =
            |law: &&FluidEstimate| law.errors.iter().zip(limits).map(|(e, limit)| e / limit).fold(0.0, f64::max);
        let candidates = || estimates.laws.iter().filter(|law| allowed(law.law, law.reactive));
        let nearest = || candidates().min_by(|a, b| excess(a).total_cmp(&excess(b)));
        let taken = candidates().find(within).or_else(nearest)?;
        let bound = |limits: [f64; 2]| estimates.in_words(limits);
        let reason = if taken == highest {
            let below = candidates().filter(|law| *law != highest).min_by(|a, b| excess(a).total_cmp(&excess(b)));
            match below {
                Some(below) => format!(
                    "nothing simpler is near enough: {} errs by an estimated {}; a quarter of the published uncertainty of {} is {}",
                    below.name(),
                    estimates.in_words(below.errors),
                    highest.name(),
                    bound(limits)
                ),
                None => "the scene leaves no other".to_string(),
            }
        } else if within(&taken) {
            format!(
                "against {} it errs by an estimated {}, within a quarter of what that is itself uncertain by ({})",
                highest.name(),
                estimates.in_words(taken.errors),
                bound(estimates.uncertainty)
            )
        } else {
            format!(
                "of what the scene leaves open it is nearest to {}, and errs by an estimated {}",
                highest.name(),
                estimates.in_words(taken.errors)
            )
        };
        Some(Self { law: Some(taken.law), reactive: taken.reactive, reason, errors: Some(taken.errors) })
    }

    /// What is taken, in words.
    pub fn name(&self) -> String {
        match (self.law, self.reactive) {
            (Some(law), reactive) => law.with_reactive(reactive),
            (None, true) => "reactive".to_string(),
            (None, false) => "no force".to_string(),
        }
    }
}

/// The time (s) that is followed of a run of `duration` (s).
pub fn followed(duration: f64, frequency: Option<f64>, ramp: f64) -> f64 {
    frequency.map_or(duration, |frequency| duration.min(ramp + PERIODS / frequency))
}
