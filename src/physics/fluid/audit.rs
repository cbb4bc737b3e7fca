//! Checks of a force against finite differences, for tests of custom forces.

use nalgebra::Vector2;

use super::force::{Force, Kinematics, PowerKind, StateDerivatives, add_change, powers, visit_alone};
use super::medium::{DENSITY, Fluid, Key, VISCOSITY};
use crate::rod::{Edge, Rod, node};

/// Relative error above which a statement is reported. Differences are accurate to about 1e-9.
const TOLERANCE: f64 = 1e-6;

/// Number of random motions in which a force is checked.
const MOTIONS: usize = 8;

/// A statement of a force that its own values contradict.
#[derive(Debug, Clone, PartialEq)]
pub struct Contradiction {
    /// The statement: a method of [`Force`], and which part of it.
    pub statement: String,
    /// The error relative to the largest value; infinite if a value is not finite.
    pub error: f64,
}

impl std::fmt::Display for Contradiction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} is off by {:.1e} of the largest value", self.statement, self.error)
    }
}

/// Checks `force` on `rod` in random motions through `fluid`, and returns the statements that finite differences
/// contradict. It is empty for a correct force. Speeds are about one rod length per second, and nodes are off the
/// straight rod by up to a fifth of an edge each way. Checked are:
///
/// - the derivatives of [`evaluate`](Force::evaluate) with respect to positions, velocities, accelerations and flow;
/// - [`is_of_fluid`](Force::is_of_fluid), [`is_the_same_everywhere`](Force::is_the_same_everywhere) and
///   [`is_linear`](Force::is_linear);
/// - the derivatives of its [`energy`](Force::energy);
/// - that the energy of a force that dissipates nothing grows by its power, and that a force of [`PowerKind::Drag`]
///   supplies none;
/// - the derivatives with respect to viscosity and density.
///
/// For other parameters see [`audit_parameter`].
pub fn audit(force: &dyn Force, rod: &Rod, fluid: Fluid) -> Vec<Contradiction> {
    let mut found = Found::default();
    for seed in 0..MOTIONS {
        let motion = TrialMotion::random(rod, fluid, &mut Dice(1 + seed as u64));
        motion.slopes(force, seed, &mut found);
        motion.frames(force, &mut found);
        motion.energy(force, seed, &mut found);
        let medium = [(VISCOSITY, fluid.viscosity), (DENSITY, fluid.density)];
        for (key, value) in medium.into_iter().filter(|(key, _)| force.parameters().contains(key)) {
            let at = |by: f64| {
                let mut other = motion.clone();
                *if key == VISCOSITY { &mut other.fluid.viscosity } else { &mut other.fluid.density } += by;
                (other.force(force), other.stored(force))
            };
            motion.parameter(force, key, value, at, &mut found);
        }
    }
    found.0
}

/// The same for the parameter `key` of a custom force, which `build` creates from a value of that parameter.
pub fn audit_parameter<F: Force>(
    key: Key,
    value: f64,
    build: impl Fn(f64) -> F,
    rod: &Rod,
    fluid: Fluid,
) -> Vec<Contradiction> {
    let (mut found, force) = (Found::default(), build(value));
    if !force.parameters().contains(&key) {
        found.add(&format!("parameters() without {key}"), 1.0);
    }
    for seed in 0..MOTIONS {
        let motion = TrialMotion::random(rod, fluid, &mut Dice(1 + seed as u64));
        let at = |by: f64| {
            let other = build(value + by);
            (motion.force(&other), motion.stored(&other))
        };
        motion.parameter(&force, key, value, at, &mut found);
    }
    found.0
}

/// The largest error of each statement.
#[derive(Default)]
struct Found(Vec<Contradiction>);

impl Found {
    fn add(&mut self, statement: &str, error: f64) {
        let error = if error.is_finite() { error } else { f64::INFINITY };
        if error <= TOLERANCE {
            return;
        }
        match self.0.iter_mut().find(|known| known.statement == statement) {
            Some(known) => known.error = known.error.max(error),
            None => self.0.push(Contradiction { statement: statement.to_string(), error }),
        }
    }
}

/// Pseudorandom numbers (xorshift64*).
struct Dice(u64);

impl Dice {
    /// A number between −1 and 1.
    fn roll(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn many(&mut self, count: usize, size: f64) -> Vec<f64> {
        (0..count).map(|_| size * self.roll()).collect()
    }
}

/// A moving rod.
#[derive(Clone)]
struct TrialMotion {
    t: f64,
    /// Positions, velocities, accelerations.
    parts: [Vec<f64>; 3],
    fluid: Fluid,
    /// The sizes of changes of these parts.
    sizes: [f64; 3],
}

impl TrialMotion {
    fn random(rod: &Rod, fluid: Fluid, dice: &mut Dice) -> Self {
        let (count, length) = (2 * rod.nodes, rod.arc_length(rod.nodes - 1));
        let spacing = length / (rod.nodes - 1) as f64;
        for _ in 0..16 {
            dice.roll(); // the first numbers are similar
        }
        let mut q = dice.many(count, 0.2 * spacing);
        q.chunks_exact_mut(2).enumerate().for_each(|(k, at)| at[0] += rod.arc_length(k));
        let [flow, acceleration] = [0.3, 0.5].map(|size| Vector2::new(dice.roll(), dice.roll()) * (size * length));
        Self {
            t: dice.roll().abs(),
            parts: [q, dice.many(count, length), dice.many(count, length)],
            fluid: Fluid { flow, acceleration, ..fluid },
            sizes: [spacing, length, length],
        }
    }

    fn with<T>(&self, look: impl FnOnce(&Kinematics<'_>) -> T) -> T {
        let [q, v, a] = &self.parts;
        let edges: Vec<Edge> = (1..q.len() / 2).map(|k| Edge::new(node(q, k) - node(q, k - 1))).collect();
        look(&Kinematics { t: self.t, ..Kinematics::within(self.fluid, &edges, [q, v, a]) })
    }

    /// The opposing force on every node.
    fn force(&self, force: &dyn Force) -> Vec<f64> {
        let mut sum = vec![0.0; self.parts[0].len()];
        self.with(|rod| visit_alone(force, rod, |k, f| (0..2).for_each(|i| sum[2 * k + i] += f[i])));
        sum
    }

    fn stored(&self, force: &dyn Force) -> f64 {
        self.with(|rod| force.energy(rod, 0.0, None))
    }

    fn moved(&self, change: [&[f64]; 3], flow: Vector2<f64>, by: f64) -> Self {
        let mut moved = self.clone();
        for (part, change) in moved.parts.iter_mut().zip(change) {
            part.iter_mut().zip(change).for_each(|(x, d)| *x += by * d);
        }
        moved.fluid.flow += flow * by;
        moved
    }

    /// The same motion with `by` added to the positions (`part` 0) or velocities (`part` 1) of all nodes.
    fn shifted(&self, part: usize, by: Vector2<f64>) -> Self {
        let mut shifted = self.clone();
        shifted.parts[part].chunks_exact_mut(2).for_each(|x| (0..2).for_each(|i| x[i] += by[i]));
        shifted
    }

    /// Checks the derivatives of the force.
    fn slopes(&self, force: &dyn Force, seed: usize, found: &mut Found) {
        let (mut dice, count) = (Dice(1001 + seed as u64), self.parts[0].len());
        let (none, own) = (vec![0.0; count], largest(&self.force(force)));
        for (i, by) in ["positions", "velocities", "accelerations", "the flow"].into_iter().enumerate() {
            let (mut change, mut flow) = ([&none[..]; 3], Vector2::zeros());
            let some;
            if i < 3 {
                some = dice.many(count, self.sizes[i]);
                change[i] = &some;
            } else {
                flow = Vector2::new(dice.roll(), dice.roll()) * self.sizes[1];
            }
            let mut exact = vec![0.0; count];
            self.with(|rod| add_change(force, rod, change, flow, &mut exact));
            let differences = difference(|by| self.moved(change, flow, by).force(force));
            found.add(&format!("evaluate(): its slope by {by}"), relative_difference(&exact, &differences, own));
        }
    }

    /// Checks whether the force depends on position and on the frame of the fluid.
    fn frames(&self, force: &dyn Force, found: &mut Found) {
        let own = self.force(force);
        let by = Vector2::new(0.6, -0.8) * (3.0 * self.sizes[1]);
        if force.is_the_same_everywhere() {
            let elsewhere = self.shifted(0, by);
            found.add("is_the_same_everywhere()", relative_difference(&elsewhere.force(force), &own, largest(&own)));
        }
        if force.is_of_fluid() {
            let mut carried = self.shifted(1, by);
            carried.fluid.flow += by;
            found.add("is_of_fluid()", relative_difference(&carried.force(force), &own, largest(&own)));
        } else {
            let mut otherwise = self.clone();
            otherwise.fluid.flow += by;
            found.add("is_of_fluid() = false", relative_difference(&otherwise.force(force), &own, largest(&own)));
        }
        if force.is_linear() {
            let [one, two] = [1.0, 2.0].map(|times| self.shifted(1, by * times).force(force));
            let straight: Vec<f64> = own.iter().zip(&two).map(|(a, b)| 0.5 * (a + b)).collect();
            found.add("is_linear()", relative_difference(&one, &straight, largest(&two)));
        }
    }

    /// Checks the derivatives of the energy, and its balance with the power.
    fn energy(&self, force: &dyn Force, seed: usize, found: &mut Found) {
        let (mut dice, count) = (Dice(2001 + seed as u64), self.parts[0].len());
        let mut by = [(); 3].map(|()| vec![0.0; count]);
        let [q, v, a] = &mut by;
        let stored = self.with(|rod| force.energy(rod, 1.0, Some(StateDerivatives { q, v, a })));
        let change = self.sizes.map(|size| dice.many(count, size));
        let [dq, dv, da] = &change;
        let at = |h: f64| vec![self.moved([dq, dv, da], Vector2::zeros(), h).stored(force)];
        let exact: f64 = by.iter().zip(&change).map(|(by, d)| dot(by, d)).sum();
        found.add("energy(): its slopes", relative_difference(&[exact], &difference(at), stored.abs()));
        let (power, given) = self.with(|rod| (powers(force, rod).against_fluid, force.energy_by_time(rod, 0.0, None)));
        let scale = dot(&self.force(force).iter().map(|f| f.abs()).collect::<Vec<_>>(), &vec![self.sizes[1]; count]);
        match force.power_kind() {
            None | Some(PowerKind::Load) => {}
            // Drag is the default: if a force stores energy without declaring it, that would count as dissipated.
            Some(PowerKind::Drag) if power < 0.0 => {
                return found.add("power_kind() = Drag, that of a force that supplies no power", -power / scale);
            }
            Some(_) => return,
        }
        // The fluid's frame moves on too, because the energy of a force of the fluid is that of motion relative to it.
        let rate = difference(|h| {
            let mut later = self.moved([&self.parts[1], &self.parts[2], &vec![0.0; count]], Vector2::zeros(), h);
            later.t += h;
            later.fluid.flow += self.fluid.acceleration * h;
            vec![later.stored(force)]
        });
        found.add(
            "energy(): its rate, by the power and energy_by_time()",
            relative_difference(&[power + given], &rate, scale),
        );
    }

    /// Checks the derivatives with respect to a parameter with this `value`; `at` returns force and energy for a
    /// changed parameter.
    fn parameter(
        &self,
        force: &dyn Force,
        key: Key,
        value: f64,
        at: impl Fn(f64) -> (Vec<f64>, f64),
        found: &mut Found,
    ) {
        let size = if value == 0.0 { 1.0 } else { value.abs() };
        let mut exact = vec![0.0; self.parts[0].len()];
        let [energy, _] = self.with(|rod| force.add_by_parameter(key, rod, &mut exact));
        exact.iter_mut().for_each(|x| *x *= size);
        let differences = difference(|by| at(by * size).0);
        let statement = format!("add_by_parameter(): {key}");
        found.add(&statement, relative_difference(&exact, &differences, largest(&self.force(force))));
        let stored = difference(|by| vec![at(by * size).1]);
        found.add(
            &format!("{statement}, of the energy"),
            relative_difference(&[energy * size], &stored, self.stored(force).abs()),
        );
    }
}

/// The derivative of `f` at 0, by central differences with Richardson extrapolation.
fn difference(f: impl Fn(f64) -> Vec<f64>) -> Vec<f64> {
    let central = |h: f64| -> Vec<f64> { f(h).iter().zip(f(-h)).map(|(a, b)| (a - b) / (2.0 * h)).collect() };
    central(2e-4).iter().zip(central(1e-4)).map(|(coarse, fine)| (4.0 * fine - coarse) / 3.0).collect()
}

/// The largest difference between `a` and `b`, relative to the largest of `b` and `scale`.
fn relative_difference(a: &[f64], b: &[f64], scale: f64) -> f64 {
    let far = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let not_finite = a.iter().chain(b).any(|x| !x.is_finite());
    match (not_finite, largest(b).max(scale)) {
        (true, _) => f64::INFINITY,
        (_, 0.0) if far == 0.0 => 0.0,
        (_, scale) => far / scale,
    }
}

fn largest(a: &[f64]) -> f64 {
    a.iter().fold(0.0, |most, x| most.max(x.abs()))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
