//! Inputs that go on by themselves between a host's words: Taylor polynomials in the time since the last one.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::{Drive, Dynamics, Inputs, Model};
use crate::fluid::{Fluid, Layers};

/// The highest derivative that a host may set.
pub const HIGHEST_ORDER: usize = 3;

/// u(t) = Σ_k u_k (t − t₀)^k/k!, k ≤ [`HIGHEST_ORDER`], for every input u. The phase of the actuation follows the integral
/// of its frequency; viscosity and frequency stop at zero. A head goes its own way, see [`host`](crate::head::host).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Course {
    /// t₀, s.
    since: f64,
    /// u₀.
    values: Inputs,
    /// u₁, u₂, u₃ in the places of the inputs.
    rates: [Inputs; HIGHEST_ORDER],
    /// The first derivative at the time last asked for.
    rate: Inputs,
}

impl Course {
    /// Inputs that stay as they are.
    pub fn resting(model: &Model, values: &Inputs, since: f64) -> Self {
        let none = || Inputs::none(model);
        Self { since, values: values.clone(), rates: std::array::from_fn(|_| none()), rate: none() }
    }

    /// Shows `change` the derivatives of `order` 1 to [`HIGHEST_ORDER`] in the place of the inputs, which come back after.
    pub fn change_rates(&mut self, dynamics: &mut Dynamics, order: usize, change: impl FnOnce(&mut Dynamics)) {
        let rates = &mut self.rates[order - 1];
        std::mem::swap(&mut dynamics.inputs, rates);
        change(dynamics);
        std::mem::swap(&mut dynamics.inputs, rates);
    }

    /// Its values and derivatives.
    pub fn parts(&self) -> impl Iterator<Item = &Inputs> {
        [&self.values, &self.rate].into_iter().chain(&self.rates)
    }

    /// True where it has the flow.
    pub fn takes_flow(&self) -> bool {
        self.rates.iter().any(|rates| rates.flow_taken)
    }

    /// Sets `inputs` to what they are at time `t` (s).
    pub fn at(&mut self, t: f64, inputs: &mut Inputs) {
        let tau = t - self.since;
        let mut phase = self.values.cycle(t);
        for (rate, factor) in self.rates.iter().zip(factors(tau).skip(1)) {
            phase += TAU * rate.drive.frequency * factor;
        }
        let Self { values, rates, rate, .. } = self;
        taylor(std::iter::once(&*values).chain(&*rates), tau, inputs);
        taylor(rates.iter(), tau, rate);
        inputs.phase_origin = [t, phase];
        inputs.fluid.acceleration = rate.fluid.flow;
        inputs.drive.frequency = inputs.drive.frequency.max(0.0);
        inputs.fluid.clamp();
        inputs.layers.iter_mut().flat_map(Layers::iter_mut).for_each(|layer| layer.fluid.clamp());
    }

    /// The first derivative at the time last asked for, in the places of the inputs.
    pub fn rate(&self) -> &Inputs {
        &self.rate
    }

    /// Counts from time `t` (s) on, where the inputs are `now`.
    pub fn rebase(&mut self, t: f64, now: &Inputs) {
        let tau = t - self.since;
        let mut moved = self.rates.clone();
        for (k, moved) in moved.iter_mut().enumerate() {
            taylor(self.rates[k..].iter(), tau, moved);
        }
        (self.since, self.rates) = (t, moved);
        self.values.clone_from(now);
    }

    /// Takes over `now` as the values.
    pub fn set_values(&mut self, now: &Inputs) {
        self.values.clone_from(now);
    }
}

/// Sets all but phase and head of `sum` to Σ_k terms_k τ^k/k!.
fn taylor<'a>(mut terms: impl Iterator<Item = &'a Inputs>, tau: f64, sum: &mut Inputs) {
    if let Some(first) = terms.next() {
        sum.set_parts(first);
    }
    for (term, factor) in terms.zip(factors(tau)) {
        sum.add_parts(term, factor);
    }
}

/// τ, τ²/2, τ³/6, …
fn factors(tau: f64) -> impl Iterator<Item = f64> {
    (1..).scan(1.0, move |factor, k| {
        *factor *= tau / f64::from(k);
        Some(*factor)
    })
}

impl Inputs {
    /// No input at all: the derivative of inputs that rest.
    pub(crate) fn none(model: &Model) -> Self {
        let mut none = Self::of(model);
        none.clear();
        none
    }

    /// Makes every input zero, without allocating.
    pub(crate) fn clear(&mut self) {
        self.drive = Drive { amplitude: 0.0, frequency: 0.0 };
        (self.phase_offset, self.phase_origin) = (0.0, [0.0; 2]);
        (self.fluid, self.flow_taken) = (Fluid::NONE, false);
        self.layers = self.layers.as_ref().map(Layers::none);
        self.head = None;
        [&mut self.natural, &mut self.force].into_iter().flatten().for_each(|values| values.fill(0.0));
    }

    /// Copies all but phase and head from `other`, without allocating where there is room.
    fn set_parts(&mut self, other: &Self) {
        self.drive = other.drive;
        self.phase_offset = other.phase_offset;
        self.fluid = other.fluid;
        self.layers = other.layers;
        self.natural.clone_from(&other.natural);
        self.force.clone_from(&other.force);
    }

    /// Adds `factor` times all but phase and head of `other`.
    fn add_parts(&mut self, other: &Self, factor: f64) {
        self.drive.amplitude += factor * other.drive.amplitude;
        self.drive.frequency += factor * other.drive.frequency;
        self.phase_offset += factor * other.phase_offset;
        self.fluid.add(&other.fluid, factor);
        if let (Some(to), Some(from)) = (&mut self.layers, &other.layers) {
            to.add(from, factor);
        }
        for (to, from) in [(&mut self.natural, &other.natural), (&mut self.force, &other.force)] {
            let Some(from) = from else { continue };
            let to = to.get_or_insert_with(|| vec![0.0; from.len()]);
            to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
        }
    }
}
