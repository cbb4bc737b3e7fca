//! What a simpler law of the fluid changes of a motion, without running the scene: the scene's own rod and drive are followed under
//! each law, on a coarse mesh, with steps of a fixed size, over the first periods.
//!
//! Nothing of the scene is left out but mesh, steps and length: what drives, bends, carries or holds the rod acts as it does in the
//! run, so flows and heads that change in time are followed as they are.

use std::mem::swap;
use std::sync::Arc;

use nalgebra::Vector2;

use super::Mover;
use crate::cycle::{Cycles, KEPT, Means};
use crate::error::{Error, Result};
use crate::fluid::Fluid;
use crate::fluid::laws::DragLaw;
use crate::fluid::uncertainty::Uncertainty;
use crate::fluid::validity::TransverseMotion;
use crate::integrator::Method;
use crate::linear::SolverChoice as Linear;
use crate::metrics::{Meter, Reading};
use crate::model::{Dynamics, Model};
use crate::newton::Newton;
use crate::number_format::{percent, signed, two_digits};
use crate::regime::{self, MISALIGNED, MeanMotion, Regime};
use crate::rod::node;
use crate::spectrum::Spectrum;
use crate::system::{Form, State};

/// Periods that are followed after a ramp, steps of each, and steps where nothing repeats itself.
pub const PERIODS: f64 = 8.0;
const STEPS_A_PERIOD: f64 = 24.0;
const STEPS: f64 = 128.0;

/// Most steps, where what drives the rod has frequencies far apart: half a second of 17 nodes.
const MOST_STEPS: f64 = 2048.0;

/// Nodes on a wavelength or, of a longer one, on the rod; and the most of them.
const NODES_ON_A_WAVE: f64 = 16.0;
const MOST_NODES: u64 = 49;

/// Relative rounding of times.
const ROUNDING: f64 = 1e-9;

/// Last increment of Newton's method over the length, and how often steps that fail are halved.
const NEWTON: f64 = 1e-7;
const HALVINGS: u32 = 2;

/// The method: where drag stops a rod within a small part of a step, it leaves no oscillation of the velocity.
const METHOD: &str = "esdirk3";

/// Estimated errors are this many times the differences found.
pub const MARGIN: f64 = 1.5;
/// Smallest error that an estimate says.
pub const FLOOR: f64 = 0.005;

/// The nodes of a rod that is `waves` wavelengths long.
pub fn nodes(waves: f64) -> u64 {
    ((NODES_ON_A_WAVE * waves.max(1.0)).ceil() as u64 + 1).min(MOST_NODES)
}

/// The first part of a run, and its steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Its duration, s.
    pub duration: f64,
    /// Number of steps of one size.
    pub steps: u64,
    /// Longest period of what drives the rod, s; none where nothing repeats itself.
    pub period: Option<f64>,
}

impl Span {
    /// What is followed of a run of `duration` (s) with that drive: [`PERIODS`] of the slowest line after a ramp (s), or all of it
    /// where nothing repeats itself; in steps that follow the fastest. Of frequencies far apart fewer periods of the slowest are
    /// followed, and of a long run in which nothing repeats itself the first part: steps that do not follow the fastest say nothing.
    pub fn of(spectrum: &Spectrum, duration: f64, ramp: f64) -> Self {
        let Some((slowest, fastest)) = spectrum.slowest().zip(spectrum.fastest()) else {
            return Self { duration, steps: STEPS as u64, period: None };
        };
        let repeats = if spectrum.is_transient { duration } else { duration.min(ramp + PERIODS / slowest) };
        let rate = STEPS_A_PERIOD * fastest;
        let least = duration.min(ramp + PERIODS / fastest);
        let affordable = MOST_STEPS / rate;
        let duration = repeats.min(affordable.max(least));
        let steps = (rate * duration).ceil().clamp(STEPS_A_PERIOD, MOST_STEPS.max(rate * least));
        Self { duration, steps: steps as u64, period: (!spectrum.is_transient).then_some(1.0 / slowest) }
    }

    /// From when on (s) the motion is measured: over the last whole periods but the first, [`KEPT`] at most, or over all.
    fn measured_from(&self) -> f64 {
        let whole = |period: f64| ((self.duration / period * (1.0 + ROUNDING)).floor() - 1.0).min(KEPT as f64);
        let late = self.period.map(|period| whole(period) * period).filter(|late| *late > 0.0);
        late.map_or(0.0, |late| self.duration - late)
    }
}

/// What a motion that was followed comes to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Followed {
    /// Motion and power.
    pub means: Means,
    /// How the rod moves against the fluid.
    pub motion: MeanMotion,
}

/// Follows `model` over `span` from its start.
///
/// # Errors
/// Those of a step; [`Error::NotFinite`] where nothing has come out.
pub fn follow(model: &Arc<Model>, span: Span) -> Result<Followed> {
    let mut outcome = steps_of(model, span, span.steps);
    for halved in 1..=HALVINGS {
        match &outcome {
            Err(error) if error.is_cured_by_smaller_step() => {
                outcome = steps_of(model, span, span.steps << (2 * halved));
            }
            _ => break,
        }
    }
    outcome
}

fn steps_of(model: &Arc<Model>, span: Span, steps: u64) -> Result<Followed> {
    let duration = span.duration;
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
    let mut moments = Vec::with_capacity(steps as usize + 1);
    moments.push(Moment::of(&dynamics, &state));
    for step in 1..=steps {
        next.t = duration * step as f64 / steps as f64;
        let h = next.t - state.t;
        mover.step(&mut dynamics, &mut newton, &state, h, &mut next)?;
        reading.take(&mut dynamics, &next)?;
        let load = dynamics.load_work([state.t, next.t], &state.q, &next.q);
        meter.count(&mut reading, None, load, dynamics.head_mass())?;
        swap(&mut state, &mut next);
        cycles.follow(&dynamics, &state, &meter, None);
        moments.push(Moment::of(&dynamics, &state));
    }
    let means = Means::of(&cycles, &dynamics).ok_or_else(nothing)?;
    let from = moments.partition_point(|moment| moment.time <= span.measured_from() + ROUNDING * duration);
    Ok(Followed { means, motion: motion(&moments[from.saturating_sub(1)..], model.head.is_some()) })
}

/// How the rod moves against the fluid at one time: mean squares over its nodes.
struct Moment {
    time: f64,
    along: f64,
    across: f64,
    inertia: f64,
    body: f64,
    density: f64,
    viscosity: f64,
    tip: Vector2<f64>,
    /// Where the tip is seen from: a held head, or the centre of mass of a free rod, m.
    from: Vector2<f64>,
}

impl Moment {
    /// That of `state`, to which `dynamics` was moved last.
    fn of(dynamics: &Dynamics, State { t, q, v, .. }: &State) -> Self {
        let rod = &dynamics.model.rod;
        let last = rod.nodes - 1;
        let from = if dynamics.model.head.is_some() { node(q, 0) } else { rod.mean(q) };
        let mut moment = Self {
            time: *t,
            along: 0.0,
            across: 0.0,
            inertia: 0.0,
            body: 0.0,
            density: 0.0,
            viscosity: 0.0,
            tip: node(q, last),
            from,
        };
        if rod.body.is_some() {
            let Fluid { density, viscosity, flow, .. } = dynamics.fluid_at(node(q, 0));
            moment.body = (node(v, 0) - flow).norm_squared() * (density / viscosity).powi(2);
        }
        let part = 1.0 / (rod.nodes - rod.front) as f64;
        for k in rod.front..rod.nodes {
            let tangent = (node(q, (k + 1).min(last)) - node(q, k.saturating_sub(1).max(rod.front))).normalize();
            let Fluid { density, viscosity, flow, .. } = dynamics.fluid_at(node(q, k));
            let velocity = node(v, k) - flow;
            let along = tangent.dot(&velocity).powi(2);
            let across = tangent.perp(&velocity).powi(2) + MISALIGNED * MISALIGNED * along;
            moment.along += part * along;
            moment.across += part * across;
            moment.inertia += part * across * (density / viscosity).powi(2);
            moment.density += part * density;
            moment.viscosity += part * viscosity;
        }
        moment
    }
}

/// The motion from the first of equally spaced `moments`, which is the start of it, to the last.
fn motion(moments: &[Moment], held: bool) -> MeanMotion {
    let later = moments.get(1..).unwrap_or_default();
    let mean = |of: fn(&Moment) -> f64| later.iter().map(of).sum::<f64>() / later.len().max(1) as f64;
    let root = |of: fn(&Moment) -> f64| mean(of).sqrt();
    // What carries the head, or the centre of mass, on: all of a free rod's motion, of a held head its mean.
    let gone = |moment: &Moment| match (moments.first(), moments.last()) {
        (Some(first), Some(last)) if held && last.time > first.time => {
            (last.from - first.from) * ((moment.time - first.time) / (last.time - first.time))
        }
        _ if held => Vector2::zeros(),
        _ => moment.from,
    };
    let tips: Vec<_> = later.iter().map(|moment| moment.tip - gone(moment)).collect();
    MeanMotion {
        along: root(|moment| moment.along),
        across: TransverseMotion {
            speed: root(|moment| moment.across),
            per_depth: root(|moment| moment.inertia),
            body: root(|moment| moment.body),
            fluid: Fluid {
                density: mean(|moment| moment.density),
                viscosity: mean(|moment| moment.viscosity),
                ..Fluid::NONE
            },
        },
        tip: regime::half_width(&tips),
    }
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
    /// The flow around the rod under the first law that was followed, the highest of those that hold at any Reynolds number where it can
    /// be.
    pub regime: Regime,
}

impl FluidEstimates {
    /// The estimates from what the scene comes to under each law, the highest last.
    pub fn of(
        found: Vec<(&'static DragLaw, bool, Means)>,
        uncertainty: [f64; 2],
        held: bool,
        regime: Regime,
    ) -> Option<Self> {
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
            regime,
        })
    }

    /// Those of the laws that are `allowed`, against the highest of them; none where there is none.
    pub fn among(&self, allowed: impl Fn(&DragLaw, bool) -> bool) -> Option<Self> {
        let of = self.laws.iter().filter(|estimate| allowed(estimate.law, estimate.reactive));
        let found: Vec<_> = of.map(|estimate| (estimate.law, estimate.reactive, estimate.means)).collect();
        let (highest, reactive, _) = *found.last()?;
        // Of a law that the scene measures itself nothing is published.
        let known = highest.uncertainty(self.regime.reynolds, reactive);
        let uncertainty = known.map_or(self.uncertainty, |known: Uncertainty| known.measured(self.held));
        Self::of(found, uncertainty, self.held, self.regime)
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
    /// The cheapest law that is `allowed` and differs little from the highest of those, as seen beside that one's own uncertainty; with the
    /// water's inertia where that counts for the rod's stability, as a motion from rest may not show it.
    pub fn of(estimates: &FluidEstimates, allowed: impl Fn(&DragLaw, bool) -> bool) -> Option<Self> {
        let open = estimates.among(&allowed)?;
        let is_kept = estimates.regime.water_decides_stability() && open.laws.iter().any(|law| law.reactive);
        let left_out = is_kept && open.laws.iter().any(|law| !law.reactive);
        let estimates = if is_kept { open.among(|_, reactive| reactive)? } else { open };
        let limits = estimates.uncertainty.map(|uncertain| SHARE * uncertain);
        let highest = estimates.laws.last()?;
        let within = |law: &&FluidEstimate| law.errors.iter().zip(limits).all(|(error, limit)| *error <= limit);
        let excess =
            |law: &&FluidEstimate| law.errors.iter().zip(limits).map(|(e, limit)| e / limit).fold(0.0, f64::max);
        let taken = estimates.laws.iter().find(within).unwrap_or(highest);
        let mut reason = if taken == highest {
            let below = estimates.laws.iter().filter(|law| *law != highest);
            match below.min_by(|a, b| excess(a).total_cmp(&excess(b))) {
                Some(below) => format!(
                    "nothing simpler is near enough: {} errs by an estimated {}; a quarter of the uncertainty of {} is {}",
                    below.name(),
                    estimates.in_words(below.errors),
                    highest.name(),
                    estimates.in_words(limits)
                ),
                None => "there is no other law to compare it with".to_string(),
            }
        } else {
            format!(
                "against {} it errs by an estimated {}, within a quarter of what that is itself uncertain by ({})",
                highest.name(),
                estimates.in_words(taken.errors),
                estimates.in_words(estimates.uncertainty)
            )
        };
        if left_out {
            reason = format!(
                "with the water's inertia, which decides whether the rod is stable (¼πρD²U²L²/EI = {}, and a force along the tip makes a clamped rod flutter at {BECK}); {reason}",
                two_digits(estimates.regime.flow_velocity.powi(2)),
                BECK = regime::BECK
            );
        }
        let errors = (estimates.laws.len() > 1).then_some(taken.errors);
        Some(Self { law: Some(taken.law), reactive: taken.reactive, reason, errors })
    }

    /// Counts what `law`, which holds and is above all that it chose from, would change of motion and power.
    pub fn count(&mut self, law: &DragLaw, changes: [f64; 2], held: bool) {
        let [motion, power] = changes.map(|part| signed(100.0 * part, 1));
        let named = if held { "thrust" } else { "speed" };
        self.reason += &format!(
            "; {} holds here and is above these, but is not run: the motion would have {motion} % {named} and take {power} % power",
            law.name
        );
        let known = self.errors.unwrap_or_default();
        self.errors = Some([0, 1].map(|i| known[i].max(MARGIN * changes[i].abs()).max(FLOOR)));
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
