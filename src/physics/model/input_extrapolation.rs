//! Extrapolation of inputs between communication points: Taylor polynomials in the time since the input was set.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::{Drive, Dynamics, Inputs, Model};
use crate::fluid::{Fluid, Layers};
use crate::head::MotorCommand;
use crate::tendons::MAX_TENDONS;

/// The highest derivative that a host may set.
pub const HIGHEST_ORDER: usize = 3;

/// u(t) = Σ_k u_k (t − t₀)^k/k!, k ≤ [`HIGHEST_ORDER`], for every input u. The phase of the actuation is the integral
/// of its frequency. Viscosity, density and frequency are zero, with zero rates, where their polynomials are negative.
/// The pose of a driven head is extrapolated separately, see [`pose_extrapolation`](crate::head::pose_extrapolation).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InputExtrapolation {
    /// t₀, s.
    since: f64,
    /// u₀, u₁, u₂, u₃.
    jet: [Inputs; HIGHEST_ORDER + 1],
    /// The first derivative at the time of the last evaluation.
    rate: Inputs,
}

impl InputExtrapolation {
    /// Constant inputs.
    pub fn resting(model: &Model, values: &Inputs, since: f64) -> Self {
        let none = || Inputs::none(model);
        let jet = std::array::from_fn(|k| if k == 0 { values.clone() } else { none() });
        Self { since, jet, rate: none() }
    }

    /// Calls `change` with the derivatives of `order` 0 (the values) to [`HIGHEST_ORDER`] in place of the inputs of
    /// `dynamics`, which are restored afterwards.
    pub fn change(&mut self, dynamics: &mut Dynamics, order: usize, change: impl FnOnce(&mut Dynamics)) {
        let derivatives = &mut self.jet[order];
        std::mem::swap(&mut dynamics.inputs, derivatives);
        change(dynamics);
        std::mem::swap(&mut dynamics.inputs, derivatives);
    }

    /// All values and derivatives.
    pub fn parts(&self) -> impl Iterator<Item = &Inputs> {
        self.jet.iter().chain([&self.rate])
    }

    /// True if derivatives of the flow are set.
    pub fn takes_flow(&self) -> bool {
        self.jet[1..].iter().any(|rates| rates.flow_taken)
    }

    /// Sets `inputs` to their values at time `t` (s).
    pub fn at(&mut self, t: f64, inputs: &mut Inputs) {
        let tau = t - self.since;
        taylor(self.jet.iter(), tau, inputs);
        taylor(self.jet[1..].iter(), tau, &mut self.rate);
        inputs.phase_origin = [t, self.cycle(t)];
        inputs.fluid.acceleration = self.rate.fluid.flow;
        let rate = &mut self.rate;
        stop_at_zero(&mut inputs.drive.frequency, &mut rate.drive.frequency);
        stop_fluid_at_zero(&mut inputs.fluid, &mut rate.fluid);
        let layers = inputs.layers.iter_mut().flat_map(Layers::iter_mut);
        for (layer, rate) in layers.zip(rate.layers.iter_mut().flat_map(Layers::iter_mut)) {
            stop_fluid_at_zero(&mut layer.fluid, &mut rate.fluid);
        }
    }

    /// The first derivative at the time of the last evaluation.
    pub fn rate(&self) -> &Inputs {
        &self.rate
    }

    /// The derivative of `order` of a scalar input at time `t` (s).
    pub fn derivative(&self, order: usize, t: f64, of: impl Fn(&Inputs) -> f64) -> f64 {
        let tau = t - self.since;
        let terms = self.jet[order..].iter().map(of);
        terms.zip(std::iter::once(1.0).chain(factors(tau))).map(|(term, factor)| term * factor).sum()
    }

    /// Adds `factor` times the derivative of `order` of an array input `of` at time `t` (s) to `out`.
    pub fn add_derivative(
        &self,
        order: usize,
        t: f64,
        of: fn(&Inputs) -> Option<&[f64]>,
        factor: f64,
        out: &mut [f64],
    ) {
        let factors = std::iter::once(1.0).chain(factors(t - self.since));
        for (part, own) in self.jet.iter().skip(order).zip(factors) {
            let own = own * factor;
            out.iter_mut().zip(of(part).into_iter().flatten()).for_each(|(out, given)| *out += own * given);
        }
    }

    /// The layers at time `t` (s), or `None` if no interface moves.
    pub fn layers(&self, t: f64) -> Option<Layers> {
        let mut terms = self.jet.iter().map(|inputs| inputs.layers);
        let mut layers = terms.next()??;
        let moves = self.jet[1..].iter().flat_map(|inputs| &inputs.layers).flat_map(Layers::iter);
        if moves.into_iter().all(|layer| layer.offset == 0.0) {
            return None;
        }
        for (term, factor) in terms.zip(factors(t - self.since)) {
            layers.add(&term?, factor);
        }
        Some(layers)
    }

    /// Phase 2π∫f dt of the drive before the offset at time `t` (s), rad; f is zero where its polynomial is negative.
    fn cycle(&self, t: f64) -> f64 {
        let tau = t - self.since;
        let f: [f64; HIGHEST_ORDER + 1] = std::array::from_fn(|k| self.jet[k].drive.frequency);
        if stays_positive(&f, tau) {
            let mut phase = self.jet[0].cycle(t);
            for (rate, factor) in f[1..].iter().zip(factors(tau).skip(1)) {
                phase += TAU * rate * factor;
            }
            return phase;
        }
        self.jet[0].cycle(self.since) + TAU * integral_above_zero(&f, tau)
    }

    /// Moves the origin of time to `t` (s), where the inputs are `now`.
    pub fn rebase(&mut self, t: f64, now: &Inputs) {
        let phase = self.cycle(t);
        let tau = t - self.since;
        for k in 0..self.jet.len() {
            // Derivatives of higher order are still those at t₀.
            let [first, higher @ ..] = &mut self.jet[k..] else { continue };
            for (term, factor) in higher.iter().zip(factors(tau)) {
                first.add_parts(term, factor);
            }
        }
        self.jet[0].phase_origin = [t, phase];
        if !now.flow_taken {
            self.jet[0].fluid.flow = now.fluid.flow; // the scene's, until a host takes it over
        }
        self.since = t;
    }
}

/// Clamps `value` to zero from below, with zero `rate` while it would be negative.
fn stop_at_zero(value: &mut f64, rate: &mut f64) {
    if *value < 0.0 || *value == 0.0 && *rate < 0.0 {
        (*value, *rate) = (0.0, 0.0);
    }
}

fn stop_fluid_at_zero(fluid: &mut Fluid, rate: &mut Fluid) {
    stop_at_zero(&mut fluid.viscosity, &mut rate.viscosity);
    stop_at_zero(&mut fluid.density, &mut rate.density);
}

/// f₀ + f₁τ + f₂τ²/2 + f₃τ³/6 at `tau`.
fn polynomial([f0, f1, f2, f3]: &[f64; 4], tau: f64) -> f64 {
    f0 + tau * (f1 + 0.5 * tau * (f2 + tau * f3 / 3.0))
}

/// The extrema of that polynomial between 0 and `tau` (0 for a missing one), with both ends, in order.
fn turns([_, f1, f2, f3]: &[f64; 4], tau: f64) -> [f64; 4] {
    // f₁ + f₂τ + f₃τ²/2 = 0, without cancellation.
    let q = -0.5 * (f2 + (f2 * f2 - 2.0 * f1 * f3).sqrt().copysign(*f2));
    let inside = |x: f64| if x > 0.0 && x < tau { x } else { 0.0 };
    let roots = [inside(f1 / q), inside(2.0 * q / f3)]; // never NaN
    [0.0, roots[0].min(roots[1]), roots[0].max(roots[1]), tau]
}

/// True if that polynomial is nowhere negative between 0 and `tau`.
fn stays_positive(f: &[f64; 4], tau: f64) -> bool {
    tau <= 0.0 || f.iter().all(|x| *x >= 0.0) || turns(f, tau).iter().all(|x| polynomial(f, *x) >= 0.0)
}

/// ∫₀^`tau` of the positive part of that polynomial.
fn integral_above_zero(f: &[f64; 4], tau: f64) -> f64 {
    let [f0, f1, f2, f3] = *f;
    let integral = |x: f64| x * (f0 + x * (f1 / 2.0 + x * (f2 / 6.0 + x * f3 / 24.0)));
    let mut sum = 0.0;
    for part in turns(f, tau).windows(2) {
        let [from, to] = [part[0], part[1]];
        let signs = [from, to].map(|x| polynomial(f, x) > 0.0);
        if signs[0] == signs[1] {
            sum += if polynomial(f, 0.5 * (from + to)) > 0.0 { integral(to) - integral(from) } else { 0.0 };
            continue;
        }
        let (mut low, mut high) = (from, to);
        loop {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if (polynomial(f, middle) > 0.0) == signs[0] { low = middle } else { high = middle }
        }
        sum += if signs[0] { integral(low) - integral(from) } else { integral(to) - integral(low) };
    }
    sum
}

/// Sets `sum`, except for phase and head, to Σ_k terms_k τ^k/k!.
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
    /// Zero inputs: the derivative of constant inputs.
    pub(crate) fn none(model: &Model) -> Self {
        let mut none = Self::of(model);
        none.clear();
        none
    }

    /// Sets every input to zero, without allocating.
    pub(crate) fn clear(&mut self) {
        self.drive = Drive { amplitude: 0.0, frequency: 0.0 };
        (self.phase_offset, self.phase_origin) = (0.0, [0.0; 2]);
        (self.fluid, self.flow_taken) = (Fluid::NONE, false);
        self.layers = self.layers.as_ref().map(Layers::none);
        (self.head, self.redundant_head_inputs) = (None, Default::default());
        (self.tension, self.winch) = ([0.0; MAX_TENDONS], [0.0; MAX_TENDONS]);
        self.hinge = MotorCommand::default();
        self.lagging = None;
        let arrays = [&mut self.natural, &mut self.moment, &mut self.force];
        arrays.into_iter().flatten().for_each(|values| values.fill(0.0));
    }

    /// Copies everything except phase and head from `other`; does not allocate if there is room.
    fn set_parts(&mut self, other: &Self) {
        self.drive = other.drive;
        self.phase_offset = other.phase_offset;
        self.fluid = other.fluid;
        self.layers = other.layers;
        self.natural.clone_from(&other.natural);
        self.moment.clone_from(&other.moment);
        (self.tension, self.winch) = (other.tension, other.winch);
        self.hinge = other.hinge;
        self.force.clone_from(&other.force);
    }

    /// Adds `factor` times everything except phase and head of `other`.
    fn add_parts(&mut self, other: &Self, factor: f64) {
        self.drive.amplitude += factor * other.drive.amplitude;
        self.drive.frequency += factor * other.drive.frequency;
        self.phase_offset += factor * other.phase_offset;
        self.fluid.add(&other.fluid, factor);
        self.hinge.torque += factor * other.hinge.torque;
        self.hinge.angle += factor * other.hinge.angle;
        let tendons = [(&mut self.tension, &other.tension), (&mut self.winch, &other.winch)];
        for (to, from) in tendons {
            to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
        }
        if let (Some(to), Some(from)) = (&mut self.layers, &other.layers) {
            to.add(from, factor);
        }
        let arrays =
            [(&mut self.natural, &other.natural), (&mut self.moment, &other.moment), (&mut self.force, &other.force)];
        for (to, from) in arrays {
            let Some(from) = from else { continue };
            let to = to.get_or_insert_with(|| vec![0.0; from.len()]);
            to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{integral_above_zero, stays_positive, turns};

    #[test]
    fn a_cubic_turns_where_its_slope_is_zero() {
        // Its slope is k (τ − a)(τ − b).
        for (k, a, b) in [(6.0, 1.0, 3.0), (-6.0, 1.0, 3.0), (0.3, 0.2, 0.25), (6.0, -1.0, 2.0), (-2.0, -3.0, 1.5)] {
            let cubic = [1.0, k * a * b, -k * (a + b), 2.0 * k];
            let inside: Vec<_> = [a, b].into_iter().filter(|root| *root > 0.0).collect();
            let found: Vec<_> = turns(&cubic, 4.0)[1..3].iter().copied().filter(|root| *root > 0.0).collect();
            let apart = found.iter().zip(&inside).map(|(found, root)| (found - root).abs()).fold(0.0, f64::max);
            assert!(found.len() == inside.len() && apart <= 1e-14, "{found:?} for {inside:?}");
        }
    }

    #[test]
    fn a_cubic_that_dips_below_zero_counts_above_it_only() {
        // (τ − 1)(τ − 2)(τ − 3) + 0.1 is negative at 0, positive at 4, and negative again in between.
        let cubic = [-5.9, 11.0, -12.0, 6.0];
        let at = |t: f64| (t - 1.0) * (t - 2.0) * (t - 3.0) + 0.1;
        assert!(!stays_positive(&[5.9, -11.0, 12.0, -6.0], 4.0) && !stays_positive(&cubic, 4.0));
        assert!(stays_positive(&[6.1, -11.0, 12.0, 0.0], 4.0));
        let parts = 400_000;
        let step = 4.0 / f64::from(parts);
        let sum: f64 = (0..parts).map(|i| at((f64::from(i) + 0.5) * step).max(0.0) * step).sum();
        let found = integral_above_zero(&cubic, 4.0);
        assert!((found - sum).abs() < 1e-8, "{found} for {sum}"); // the sum's own error is 1e-10
    }
}
