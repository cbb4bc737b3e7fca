//! First-order lag of a drive: its output y follows the demand x by τ dy/dt = x − y.
//!
//! The equation is solved in closed form, so the output depends on time and inputs only, not on the steps. Since the
//! last change of the inputs, or the start or end of a ramp, the demand is a sum of terms S(t) e^{inφ}, with a
//! polynomial S in time and constant dφ/dt = ω. The output is the y at that moment, which decays as e^{−t/τ}, plus
//! e^{inφ} Z for each term, with
//!
//! Z = (1/τ) ∫ S(t − u) e^{−λu} du, λ = 1/τ + inω, over 0 < u < age.
//!
//! For large z = λ·age, this is the difference of Σ_j (−1)^j S^{(j)}/(τ λ^{j+1}) at the two ends. For small z that
//! would cancel, and Z is a sum over the moments ∫ x^j e^{−zx} dx.

use nalgebra::Complex;
use serde::{Deserialize, Serialize};

use super::Actuation;

/// Number of derivatives of S, from the value on: S is a ramp of degree 5 times an input of degree 3.
pub const ORDERS: usize = 9;

/// A polynomial in time, given by its value and derivatives at one time.
pub type Jet = [f64; ORDERS];

/// The product of two polynomials.
pub fn product(a: &Jet, b: &Jet) -> Jet {
    std::array::from_fn(|n| {
        let mut binomial = 1.0;
        let mut sum = 0.0;
        for k in 0..=n {
            sum += binomial * a[k] * b[n - k];
            binomial *= (n - k) as f64 / (k + 1) as f64;
        }
        sum
    })
}

/// The derivatives, from `order` on, of the polynomial `jet` at a time `later` (s).
fn shifted(jet: &Jet, order: usize, later: f64) -> Jet {
    std::array::from_fn(|j| {
        let terms = jet.get(j + order..).unwrap_or_default();
        terms.iter().enumerate().rev().fold(0.0, |sum, (m, derivative)| derivative + sum * later / (m + 1) as f64)
    })
}

/// An interval in which the demand is S e^{inφ}, with a polynomial S.
#[derive(Debug, Clone, Copy)]
pub struct Piece {
    /// S at the end of the interval.
    pub size: Jet,
    /// Duration, s; `None` for an interval without a beginning.
    pub age: Option<f64>,
}

impl Piece {
    /// Z at the end of the interval, and its first two time derivatives if the interval continues. Derivatives above
    /// `order` are zero.
    fn answer(&self, tau: f64, lambda: Complex<f64>, order: usize) -> [Complex<f64>; 3] {
        /// Above this |z|, the sum over moments would cancel.
        const LARGEST: f64 = 1.0;
        /// Number of further moments before the recursion reaches those needed: it reduces the error of its initial
        /// value by 20!.
        const BEYOND: usize = 20;
        let long = |size: &Jet| {
            let sum = |sum: Complex<f64>, derivative: &f64| (Complex::from(*derivative) - sum) / lambda;
            size.iter().rev().fold(Complex::default(), sum) / tau
        };
        let up_to =
            |of: &dyn Fn(usize) -> Complex<f64>| [0, 1, 2].map(|k| if k <= order { of(k) } else { Complex::default() });
        let Some(age) = self.age else { return up_to(&|k| long(&shifted(&self.size, k, 0.0))) };
        let z = lambda * age;
        let left = (-z).exp();
        let first = |order: usize| shifted(&self.size, order, -age);
        let since = |order: usize| {
            let size = shifted(&self.size, order, 0.0);
            if z.norm() > LARGEST {
                return long(&size) - left * long(&first(order));
            }
            let (mut sum, mut moment) = (Complex::default(), Complex::default());
            for j in (0..ORDERS + BEYOND).rev() {
                moment = (left + z * moment) / (j + 1) as f64;
                // Σ_j S^{(j)} (−age)^j/j! times the moment of order j.
                let term = size.get(j).copied().unwrap_or(0.0);
                sum = moment * term - sum * (age / (j + 1) as f64);
            }
            sum * (age / tau)
        };
        let begun = |order: usize| left * (first(order)[0] / tau);
        up_to(&|k| match k {
            0 => since(0),
            1 => since(1) + begun(0),
            _ => since(2) + begun(1) - lambda * begun(0),
        })
    }
}

/// The output of a drive for the demand S e^{inφ}.
#[derive(Debug, Clone, Copy)]
pub struct LaggedWave {
    /// τ, s.
    pub tau: f64,
    /// φ, rad.
    pub phase: f64,
    /// ω = dφ/dt, rad/s.
    pub turning: f64,
    /// S in the present interval.
    pub now: Piece,
    /// S in the interval before, with the same ω.
    pub before: Option<Piece>,
}

impl LaggedWave {
    /// The factor of e^{inφ} in the derivative of `order` 0, 1 or 2 of the output for the harmonic of order n.
    pub fn factor(&self, harmonic: f64, order: usize) -> Complex<f64> {
        let turning = harmonic * self.turning;
        let (along, lambda) = (Complex::new(0.0, turning), Complex::new(1.0 / self.tau, turning));
        let [now, rate, second] = self.now.answer(self.tau, lambda, order);
        let factor = match order {
            0 => now,
            1 => along * now + rate,
            _ => along * (along * now + rate * 2.0) + second,
        };
        let left = |(before, age): (Piece, f64)| before.answer(self.tau, lambda, 0)[0] * (-lambda * age).exp();
        factor + self.before.zip(self.now.age).map_or(Complex::default(), left) * fading(self.tau, order)
    }

    /// Adds the derivative of `order` 0, 1 or 2 of the output for `actuation` to `out`, one entry per node.
    pub fn add(&self, actuation: &dyn Actuation, order: usize, out: &mut [f64]) {
        actuation.add_filtered(&|harmonic| self.factor(harmonic, order), self.phase, out);
    }
}

/// The transfer function 1/(1 + inωτ) of a drive with lag `tau` (s) for the harmonic of order n of a steady wave with
/// phase rate `turning` ω (rad/s).
pub fn steady(tau: f64, turning: f64) -> impl Fn(f64) -> Complex<f64> {
    move |harmonic| Complex::new(1.0, harmonic * turning * tau).inv()
}

/// The derivative of `order` of e^{−t/τ} at t = 0.
fn fading(tau: f64, order: usize) -> f64 {
    (0..order).fold(1.0, |factor, _| -factor / tau)
}

/// The output of a drive at the last change of its inputs.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct LagState {
    /// Time of the change, s.
    pub since: f64,
    /// Output y, one entry per node.
    pub given: Vec<f64>,
}

impl Clone for LagState {
    fn clone(&self) -> Self {
        Self { since: self.since, given: self.given.clone() }
    }

    /// Does not allocate if there is room.
    fn clone_from(&mut self, other: &Self) {
        self.since = other.since;
        self.given.clone_from(&other.given);
    }
}

impl LagState {
    /// Adds the derivative of `order` of the decayed output at time `t` (s) to `out`.
    pub fn add(&self, tau: f64, t: f64, order: usize, out: &mut [f64]) {
        let left = ((self.since - t) / tau).exp() * fading(tau, order);
        out.iter_mut().zip(&self.given).for_each(|(out, given)| *out += left * given);
    }
}
