//! What of a design can be trusted: whether its gain survives in other simulations, and how exactly it has to be made.

use serde::Serialize;

use super::report::Check;
use crate::fluid::laws::{CREEPING, Dependence, DragLaw, LAWS, cross_flow};
use crate::scene::Scene;

/// The loss of the objective that a tolerance allows.
pub const LOSS: f64 = 1e-2;

/// First change of an unknown: of the logarithm, or rad.
const STEP: f64 = 0.05;

/// A tolerance beyond this is as good as none.
pub const LOOSE: f64 = 0.693;

/// How far one unknown may be off, all others as designed, until 1 % of the objective is lost.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tolerance {
    /// The unknown in words.
    pub name: String,
    /// Largest change to the worse side, of the logarithm or in rad; none where a factor of two loses less.
    pub change: Option<f64>,
    /// The loss there, over the objective.
    pub loss: Option<f64>,
}

/// The tolerance of the unknown `name`; `loss` is what a change of it loses, over the objective, none where it fails.
pub(super) fn tolerance(name: String, mut loss: impl FnMut(f64) -> Option<f64>) -> Tolerance {
    // The parabola through what changes to both sides lose, then chords at the side that loses sooner.
    let sides = [STEP, -STEP].map(&mut loss);
    let [up, down] = sides.map(|loss| loss.unwrap_or(f64::INFINITY));
    let (slope, curvature) = (0.5 * (up - down) / STEP, (up + down) / (STEP * STEP));
    let side = if up >= down { 1.0 } else { -1.0 };
    let root = (slope * slope + 2.0 * curvature * LOSS).max(0.0).sqrt();
    let mut change = 2.0 * LOSS / (slope.abs() + root);
    if !change.is_finite() || change > LOOSE {
        change = LOOSE;
    }
    let mut found = None;
    let [mut inside, mut outside]: [Option<(f64, f64)>; 2] = [Some((0.0, 0.0)), None];
    for i in 0..10 {
        let lost = loss(side * change).filter(|lost| lost.is_finite()).unwrap_or(f64::INFINITY);
        if (lost / LOSS - 1.0).abs() < 0.02 {
            found = Some((change, lost));
            break;
        }
        if lost < LOSS {
            if change >= LOOSE {
                break;
            }
            inside = Some((change, lost));
        } else {
            outside = Some((change, lost));
        }
        change = match (inside, outside) {
            (Some((a, below)), Some((b, above))) if above.is_finite() => {
                // Loss is nearly a square, or nearly linear at a kink.
                let power = if i % 2 == 0 { 0.5 } else { 1.0 };
                let [below, above, at] = [below.max(0.0), above, LOSS].map(|loss| loss.powf(power));
                a + (b - a) * ((at - below) / (above - below)).clamp(0.05, 0.95)
            }
            (Some((a, _)), Some((b, _))) => 0.5 * (a + b),
            _ => (1.6 * change).min(LOOSE),
        };
    }
    let found = found.or(inside.filter(|_| outside.is_some()));
    Tolerance { name, change: found.map(|found| found.0), loss: found.map(|found| found.1) }
}

/// What a gain is once other simulations have been asked.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trust {
    /// As designed, %.
    pub gain_percent: Option<f64>,
    /// The least in any simulation, %; none where one fails.
    pub least_percent: Option<f64>,
    /// The simulation that has the least.
    pub least_in: String,
    /// True where the design is better in all of them.
    pub survives: bool,
}

impl Trust {
    /// Of the `checks`, the first of which is the simulation that it was designed in.
    pub(super) fn of(checks: &[Check]) -> Option<Self> {
        let (first, others) = checks.split_first()?;
        let gain = |check: &Check| check.gain_percent.filter(|gain| gain.is_finite());
        let size = |check: &Check| gain(check).unwrap_or(f64::NEG_INFINITY);
        let least = others.iter().min_by(|a, b| size(a).total_cmp(&size(b)))?;
        Some(Self {
            gain_percent: gain(first),
            least_percent: gain(least),
            least_in: least.simulation.clone(),
            survives: [first, least].into_iter().all(|check| size(check) > 0.0),
        })
    }

    /// It in a sentence.
    pub(super) fn words(&self) -> String {
        let gain = self.gain_percent.unwrap_or(f64::NAN);
        match (self.survives, self.least_percent) {
            (true, Some(least)) => {
                format!("the gain of {gain:.2} % survives: it is {least:.2} % at least, with {}", self.least_in)
            }
            (_, Some(_)) if gain <= 0.0 => "no gain: the design is no better than what was before".to_string(),
            (_, Some(least)) => {
                format!("no gain: of {gain:+.2} % as designed {least:+.2} % is left with {}", self.least_in)
            }
            (_, None) => format!("no gain: {gain:+.2} % as designed, but the simulation with {} fails", self.least_in),
        }
    }
}

/// Higher rungs of the fluid, in words and as changes of the scene; the first that the scene allows is its next. Above a law of
/// creeping flow drag for each edge by itself: where the flow does creep and the mesh is not too dear, drag of the whole rod, else
/// drag with the fluid's inertia. Above that the water that the rod accelerates. None above these, and above laws whose coefficients the
/// scene gives, or which a plane decides.
pub(super) fn higher_fluids(scene: &Scene) -> Vec<(String, Vec<String>)> {
    let rod = scene.model().map(|model| model.rod);
    let of = rod.iter().find_map(|rod| Some((scene.fluid_model(rod).0?, scene.regime().ok()?)));
    let Some((law, regime)) = of.filter(|_| scene.medium.is_some()) else { return Vec::new() };
    if law == &cross_flow::LAW {
        let water = ("the water that it accelerates".to_string(), vec!["reactive={}".to_string()]);
        return if scene.reactive.is_none() { vec![water] } else { Vec::new() };
    }
    if law.reynolds > CREEPING || !law.needs.is_empty() || law.is_whole() {
        return Vec::new();
    }
    let cheap = |law: &&DragLaw| match law.reach {
        Dependence::Rod { most_nodes, .. } => {
            regime.reynolds <= law.reynolds && 2 * scene.rod.nodes.get() <= most_nodes
        }
        Dependence::Edge => false,
    };
    let whole = LAWS
        .iter()
        .copied()
        .find(cheap)
        .map(|law| (format!("the law {}", law.name), vec![format!("drag.law={}", law.name)]));
    let name = cross_flow::LAW.name;
    let viscous = law.resistance.map(|_| format!("drag.viscous={}", law.name));
    let changes = std::iter::once(format!("drag.law={name}")).chain(viscous).collect();
    whole.into_iter().chain([(format!("the law {name}"), changes)]).collect()
}
