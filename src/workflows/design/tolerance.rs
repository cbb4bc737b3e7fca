//! Manufacturing tolerances: the deviation of each unknown of a design that costs 1 % of the objective.

use serde::Serialize;

/// The relative loss of the objective that defines a tolerance.
pub const TOLERATED_LOSS: f64 = 1e-2;

/// First change of an unknown, of the logarithm or in rad.
const FIRST_CHANGE: f64 = 0.05;

/// Tolerances above a factor of two are not reported.
pub const MAX_REPORTED_TOLERANCE: f64 = 0.693;

/// The largest deviation of one unknown, with all others as designed, that costs at most 1 % of the objective.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tolerance {
    /// Description of the unknown.
    pub name: String,
    /// Largest change in the worse direction, of the logarithm or in rad; `None` if a factor of two loses less.
    pub change: Option<f64>,
    /// The relative loss there.
    pub loss: Option<f64>,
}

/// The tolerance of the unknown `name`; `loss` returns the relative loss for a change of the unknown, or `None` if the simulation fails.
pub(super) fn tolerance(name: String, mut loss: impl FnMut(f64) -> Option<f64>) -> Tolerance {
    // The parabola through the losses on both sides, then chords on the side with the larger loss.
    let sides = [FIRST_CHANGE, -FIRST_CHANGE].map(&mut loss);
    let [up, down] = sides.map(|loss| loss.unwrap_or(f64::INFINITY));
    let (slope, curvature) = (0.5 * (up - down) / FIRST_CHANGE, (up + down) / (FIRST_CHANGE * FIRST_CHANGE));
    let side = if up >= down { 1.0 } else { -1.0 };
    let root = (slope * slope + 2.0 * curvature * TOLERATED_LOSS).max(0.0).sqrt();
    let mut change = 2.0 * TOLERATED_LOSS / (slope.abs() + root);
    if !change.is_finite() || change > MAX_REPORTED_TOLERANCE {
        change = MAX_REPORTED_TOLERANCE;
    }
    let mut found = None;
    let [mut inside, mut outside]: [Option<(f64, f64)>; 2] = [Some((0.0, 0.0)), None];
    for i in 0..10 {
        let lost = loss(side * change).filter(|lost| lost.is_finite()).unwrap_or(f64::INFINITY);
        if (lost / TOLERATED_LOSS - 1.0).abs() < 0.02 {
            found = Some((change, lost));
            break;
        }
        if lost < TOLERATED_LOSS {
            if change >= MAX_REPORTED_TOLERANCE {
                break;
            }
            inside = Some((change, lost));
        } else {
            outside = Some((change, lost));
        }
        change = match (inside, outside) {
            (Some((a, below)), Some((b, above))) if above.is_finite() => {
                // The loss is nearly quadratic, or nearly linear at a kink.
                let power = if i % 2 == 0 { 0.5 } else { 1.0 };
                let [below, above, at] = [below.max(0.0), above, TOLERATED_LOSS].map(|loss| loss.powf(power));
                a + (b - a) * ((at - below) / (above - below)).clamp(0.05, 0.95)
            }
            (Some((a, _)), Some((b, _))) => 0.5 * (a + b),
            _ => (1.6 * change).min(MAX_REPORTED_TOLERANCE),
        };
    }
    let found = found.or(inside.filter(|_| outside.is_some()));
    Tolerance { name, change: found.map(|found| found.0), loss: found.map(|found| found.1) }
}
