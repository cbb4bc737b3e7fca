//! The unknowns of a search, in scaled variables: stiffness, amplitude or phase of the actuation at joints or knots, and numbers of
//! the scene; with their bounds, order and mean values as constraints.

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::DMatrix;

use super::basis::{Basis, second_differences};
use super::design_vector::DesignVector;
use super::qp::{Constraint, QuadraticProgram};
use super::table::{DesignTable, DesignVariable, Goal};
use crate::model::Model;
use crate::rod::Rod;
use crate::sensitivity::scene_parameter::SceneParameter;
use crate::sensitivity::{JointDirection, Parameter};

/// Name of the constraint of a fixed unknown, which is not reported.
pub const FIXED_UNKNOWN: &str = "fixed";

/// Singular values below this fraction of the largest are zero.
pub const RANK_TOLERANCE: f64 = 1e-12;

/// Sampled starting values differ from the scene's own by at most this factor, unless the bounds are narrower.
const SAMPLED_FACTOR: f64 = 5.0;

/// The transformation from a value to its unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Transform {
    /// The logarithm.
    Logarithm,
    /// The inverse: the tip moves nearly in proportion to the compliance 1/EI of a joint, since the moment that bends it beyond its
    /// natural curvature hardly depends on stiffness.
    Inverse,
    /// The value itself.
    Same,
}

/// The unknowns of one design variable; values are relative to a reference.
#[derive(Debug, Clone)]
struct VariableBlock {
    variable: DesignVariable,
    /// The reference, one for all values or one for each.
    units: Vec<f64>,
    map: Transform,
    bounds: [f64; 2],
    /// Upper bound of the mean.
    mean: Option<f64>,
    /// Index of its first unknown, and the basis functions.
    first: usize,
    basis: Basis,
    /// Initial values of the unknowns, if they are not those of a uniform profile.
    own: Option<Vec<f64>>,
    /// Position and description of each unknown.
    xi: Vec<f64>,
    places: Vec<String>,
    /// The parameters of the simulation: one per value, or directions along the unknowns.
    parameters: BlockParameters,
}

/// The parameters of the simulation for one design variable.
#[derive(Debug, Clone)]
enum BlockParameters {
    /// One for each value.
    OfValues(Vec<Parameter>),
    /// A direction for each unknown, in the parameters of the joints. With knots there are fewer unknowns than joints.
    AlongUnknowns(fn(usize) -> Parameter),
}

impl VariableBlock {
    fn unit(&self, i: usize) -> f64 {
        self.units.get(i).or(self.units.first()).copied().unwrap_or(1.0)
    }

    fn value(&self, x: f64) -> f64 {
        match self.map {
            Transform::Logarithm => x.exp(),
            Transform::Inverse => 1.0 / x,
            Transform::Same => x,
        }
    }

    fn unknown(&self, value: f64) -> f64 {
        match self.map {
            Transform::Logarithm => value.ln(),
            Transform::Inverse => 1.0 / value,
            Transform::Same => value,
        }
    }

    /// The derivative of a value with respect to its unknown.
    fn slope(&self, value: f64) -> f64 {
        match self.map {
            Transform::Logarithm => value,
            Transform::Inverse => -value * value,
            Transform::Same => 1.0,
        }
    }

    /// The derivative of each parameter of the simulation with respect to the value's unknown at `x`.
    fn slopes(&self, x: &[f64]) -> Vec<f64> {
        let slope = |(i, x): (usize, f64)| match self.variable {
            // The parameter is relative to the scene's value, like the unknown.
            DesignVariable::Amplitude => 1.0,
            _ => self.unit(i) * self.slope(self.value(x)),
        };
        self.basis.joints(x).into_iter().enumerate().map(slope).collect()
    }

    /// True if its bounds are equal.
    fn is_fixed(&self) -> bool {
        self.bounds[0] == self.bounds[1]
    }

    /// Upper bound of the mean, if it can be active.
    fn limited_mean(&self) -> Option<f64> {
        self.mean.filter(|_| !self.is_fixed())
    }

    /// 1 if the value rises with its unknown, else -1.
    fn sense(&self) -> f64 {
        if self.map == Transform::Inverse { -1.0 } else { 1.0 }
    }

    fn unknowns(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.basis.unknowns
    }

    /// A description of an unknown.
    fn place(&self, i: usize) -> String {
        match &self.variable {
            DesignVariable::Stiffness => self.places[i].clone(),
            DesignVariable::Amplitude => format!("amplitude at {}", self.places[i]),
            DesignVariable::Phase => format!("phase at {}", self.places[i]),
            DesignVariable::Number(_) => self.places[i].clone(),
        }
    }
}

/// The unknowns of a search, in blocks of one variable each.
#[derive(Debug, Clone)]
pub struct Unknowns {
    blocks: Vec<VariableBlock>,
    joints: usize,
    own: DesignVector,
    monotone: bool,
}

impl Unknowns {
    /// The unknowns that `table` names for `model`. Stiffness is fixed if it is not among them.
    pub fn of(table: &DesignTable, model: &Model, stiffness: Vec<f64>) -> Self {
        let rod = &model.rod;
        let stiffness_map = match table.goal {
            Goal::TrackTip => Transform::Inverse,
            Goal::Identify => Transform::Same, // linear between knots
            _ => Transform::Logarithm,
        };
        let joints: Vec<usize> = rod.joints().collect();
        let (xi, places): (Vec<f64>, Vec<String>) = match &table.knots {
            Some(knots) => (knots.clone(), knots.iter().map(|xi| format!("knot xi = {xi}")).collect()),
            None => {
                (joints.iter().map(|k| rod.xi(*k)).collect(), joints.iter().map(|k| format!("joint {k}")).collect())
            }
        };
        // Identification starts from the scene's own values.
        let points = joints.iter().zip(&stiffness).map(|(k, ei)| [rod.xi(*k), ei / rod.ei]).collect();
        let own_factors = crate::rod::Profile::through(points)
            .map(|profile| xi.iter().map(|xi| profile.at(*xi)).collect::<Vec<f64>>());
        let mut first = 0;
        let block = |variable: &DesignVariable| {
            let along = |unit: f64, map: Transform, bounds: [f64; 2], mean: Option<f64>, of: fn(usize) -> Parameter| {
                VariableBlock {
                    variable: variable.clone(),
                    units: vec![unit],
                    map,
                    bounds,
                    mean,
                    first,
                    basis: Basis::of(table, rod),
                    own: None,
                    xi: xi.clone(),
                    places: places.clone(),
                    parameters: match table.knots {
                        Some(_) => BlockParameters::AlongUnknowns(of),
                        None => BlockParameters::OfValues(joints.iter().map(|k| of(*k)).collect()),
                    },
                }
            };
            let block = match variable {
                DesignVariable::Stiffness => VariableBlock {
                    own: own_factors.clone().filter(|_| table.goal == Goal::Identify),
                    ..along(rod.ei, stiffness_map, table.bounds, table.mean, Parameter::Stiffness)
                },
                DesignVariable::Amplitude => {
                    let bounds = table.amplitude_bounds.unwrap_or([0.5, 2.0]);
                    along(1.0, Transform::Logarithm, bounds, table.amplitude_mean, Parameter::WaveAmplitude)
                }
                DesignVariable::Phase => {
                    let bounds = table.phase_bounds_rad.unwrap_or([-PI, PI]);
                    along(1.0, Transform::Same, bounds, None, Parameter::WavePhase)
                }
                DesignVariable::Number(key) => {
                    let numbers: Vec<&SceneParameter> =
                        table.numbers.iter().filter(|number| number.key == *key).collect();
                    VariableBlock {
                        variable: variable.clone(),
                        units: numbers.iter().map(|number| number.own).collect(),
                        map: Transform::Logarithm,
                        bounds: table.bounds_of(key),
                        mean: None,
                        first,
                        own: None,
                        basis: Basis {
                            unknowns: numbers.len(),
                            rows: (0..numbers.len()).map(|i| vec![(i, 1.0)]).collect(),
                        },
                        xi: numbers.iter().map(|number| number.xi.unwrap_or(0.0)).collect(),
                        places: numbers.iter().map(|number| number.label()).collect(),
                        parameters: BlockParameters::OfValues(numbers.iter().map(|number| number.by).collect()),
                    }
                }
            };
            first += block.basis.unknowns;
            block
        };
        let mut own = DesignVector::of(stiffness);
        if !table.numbers.is_empty() && !table.variables.contains(&DesignVariable::Stiffness) {
            own.stiffness_n_m2.clear();
        }
        Self {
            blocks: table.variables.iter().map(block).collect(),
            joints: joints.len(),
            own,
            monotone: table.monotone,
        }
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Number of unknowns.
    pub fn count(&self) -> usize {
        self.blocks.iter().map(|block| block.basis.unknowns).sum()
    }

    /// Descriptions of all unknowns.
    pub fn names(&self) -> Vec<String> {
        self.blocks.iter().flat_map(|block| (0..block.basis.unknowns).map(|i| block.place(i))).collect()
    }

    fn parts<'a>(&'a self, x: &'a [f64]) -> impl Iterator<Item = (&'a VariableBlock, usize, &'a [f64])> {
        self.blocks.iter().map(move |block| (block, block.first, &x[block.unknowns()]))
    }

    /// The design of the unknowns `x`.
    pub fn profile(&self, x: &[f64]) -> DesignVector {
        let mut profile = self.own.clone();
        for (block, _, x) in self.parts(x) {
            let values = block.basis.joints(x).into_iter().enumerate().map(|(i, x)| block.unit(i) * block.value(x));
            match &block.variable {
                DesignVariable::Stiffness => profile.stiffness_n_m2 = values.collect(),
                DesignVariable::Amplitude => profile.amplitude = values.collect(),
                DesignVariable::Phase => profile.phase_rad = values.collect(),
                DesignVariable::Number(_) => {
                    profile.numbers.extend(values.zip(&block.places).map(|(value, place)| (place.clone(), value)));
                }
            }
        }
        profile
    }

    /// The parameters of the simulation: one for each value, or each unknown, of each variable.
    pub fn parameters(&self) -> Vec<Parameter> {
        let mut directions = (0..).map(Parameter::Along);
        let of = |block: &VariableBlock| -> Vec<Parameter> {
            match &block.parameters {
                BlockParameters::OfValues(parameters) => parameters.clone(),
                BlockParameters::AlongUnknowns(_) => directions.by_ref().take(block.basis.unknowns).collect(),
            }
        };
        self.blocks.iter().flat_map(of).collect()
    }

    /// The directions, in the parameters of the joints of `rod`, in which these move along the unknowns at `x`.
    pub fn directions(&self, rod: &Rod, x: &[f64]) -> Arc<[JointDirection]> {
        let mut directions = Vec::new();
        for (block, _, x) in self.parts(x) {
            let BlockParameters::AlongUnknowns(parameter) = block.parameters else { continue };
            let slopes = block.slopes(x);
            let mut weights: Vec<(usize, Vec<f64>)> = vec![(0, Vec::new()); block.basis.unknowns];
            for (i, (row, slope)) in block.basis.rows.iter().zip(slopes).enumerate() {
                for (u, w) in row.iter().filter(|(_, w)| *w != 0.0) {
                    let (first, weights) = &mut weights[*u];
                    if weights.is_empty() {
                        *first = i;
                    }
                    weights.push(slope * w);
                }
            }
            let start = rod.joints().start;
            directions.extend(
                weights.iter().map(|(first, weights)| JointDirection::of(rod, parameter, start + first, weights)),
            );
        }
        directions.into()
    }

    /// Chain rule: derivatives with respect to the unknowns `x` from derivatives `by` with respect to the parameters.
    pub fn chain(&self, x: &[f64], by: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.count()];
        let mut by = by.iter();
        for (block, first, x) in self.parts(x) {
            if let BlockParameters::AlongUnknowns(_) = block.parameters {
                out[block.unknowns()].iter_mut().zip(&mut by).for_each(|(out, by)| *out = *by);
                continue;
            }
            for (row, slope) in block.basis.rows.iter().zip(block.slopes(x)) {
                let by = by.next().map_or(0.0, |by| by * slope);
                row.iter().for_each(|(u, w)| out[first + u] += by * w);
            }
        }
        out
    }

    /// Bounded means over their bounds, with derivatives with respect to all unknowns.
    pub fn means(&self, x: &[f64]) -> Vec<(f64, Vec<f64>)> {
        let mut means = Vec::new();
        for (block, first, part) in self.parts(x) {
            let Some(most) = block.limited_mean() else { continue };
            let count = block.basis.rows.len() as f64;
            let values: Vec<f64> = block.basis.joints(part).iter().map(|x| block.value(*x)).collect();
            let mut by = vec![0.0; x.len()];
            for (value, row) in values.iter().zip(&block.basis.rows) {
                row.iter().for_each(|(i, w)| by[first + i] += block.slope(*value) * w / count / most);
            }
            means.push((values.iter().sum::<f64>() / count / most, by));
        }
        means
    }

    fn is_ordered(&self, block: &VariableBlock) -> bool {
        self.monotone && block.variable == DesignVariable::Stiffness
    }

    /// `x` projected into bounds and order, and scaled down per block to satisfy the means.
    pub fn kept(&self, mut x: Vec<f64>) -> Vec<f64> {
        for _ in 0..50 {
            for block in &self.blocks {
                let ends = block.bounds.map(|bound| block.unknown(bound));
                let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
                let part = &mut x[block.unknowns()];
                part.iter_mut().for_each(|x| *x = x.clamp(low, high));
                for i in (1..part.len()).filter(|_| self.is_ordered(block)) {
                    part[i] = block.sense() * (block.sense() * part[i]).min(block.sense() * part[i - 1]);
                }
            }
            let means = self.means(&x);
            if means.iter().all(|(mean, _)| *mean <= 1.0 + 1e-12) {
                break;
            }
            for (mean, by) in means.into_iter().filter(|(mean, _)| *mean > 1.0) {
                let of = |i: usize| self.blocks.iter().find(|block| block.unknowns().contains(&i));
                let least = |i: usize| of(i).map_or(f64::NAN, |block| block.unknown(block.bounds[0]));
                let free: f64 = (0..x.len()).filter(|i| x[*i] != least(*i)).map(|i| by[i]).sum();
                if free != 0.0 {
                    x.iter_mut().zip(&by).filter(|(_, by)| **by != 0.0).for_each(|(x, _)| *x -= (mean - 1.0) / free);
                }
            }
        }
        x
    }

    /// Adds the constraints of a step from `x`: bounds, order, and the means last.
    pub fn constrain(&self, programme: &mut QuadraticProgram, x: &[f64]) {
        let constraints = &mut programme.constraints;
        for (block, first, part) in self.parts(x) {
            let sense = block.sense();
            for (i, x) in (first..).zip(part) {
                if block.is_fixed() {
                    // Two bounds at the same value would leave no interior.
                    let slack = block.unknown(block.bounds[0]) - x;
                    constraints.push(Constraint::equal(FIXED_UNKNOWN, vec![(i, 1.0)], slack));
                    continue;
                }
                let place = block.place(i - first);
                for (words, bound, sign) in [("at least", block.bounds[0], -sense), ("at most", block.bounds[1], sense)]
                {
                    let slack = sign * (block.unknown(bound) - x);
                    constraints.push(Constraint::at_most(format!("{place} {words} {bound}"), vec![(i, sign)], slack));
                }
            }
            for i in (1..part.len()).filter(|_| self.is_ordered(block) && !block.is_fixed()) {
                let name = format!("{} not above {}", block.places[i], block.places[i - 1]);
                let row = vec![(first + i, sense), (first + i - 1, -sense)];
                constraints.push(Constraint::at_most(name, row, sense * (part[i - 1] - part[i])));
            }
        }
        let limited = self.blocks.iter().filter_map(|block| block.limited_mean().map(|most| (block, most)));
        for ((block, most), (mean, by)) in limited.zip(self.means(x)) {
            let what = if block.variable == DesignVariable::Amplitude { "mean amplitude" } else { "mean" };
            let row = by.into_iter().enumerate().filter(|(_, by)| *by != 0.0).collect();
            constraints.push(Constraint::at_most(format!("{what} at most {most}"), row, (1.0 - mean).max(0.0)));
        }
    }

    /// The matrix of `weight`·Σ(D₂x)² over the joints, in row-major order.
    pub fn roughness(&self, weight: f64) -> Vec<f64> {
        let mut programme = QuadraticProgram::new(self.count());
        for block in &self.blocks {
            for row in second_differences(&block.basis) {
                let row: Vec<(usize, f64)> = row.iter().map(|(i, c)| (block.first + i, *c)).collect();
                programme.add_square(&row, 0.0, weight);
            }
        }
        programme.hessian
    }

    /// The relative standard deviation of each value of `variable`, for unknowns with the covariance `noise`² V S⁻² Vᵀ; empty if it
    /// is not an unknown.
    pub fn deviations(
        &self,
        variable: &DesignVariable,
        x: &[f64],
        v_t: &DMatrix<f64>,
        singular: &[f64],
        noise: f64,
    ) -> Vec<f64> {
        let Some((block, first, part)) = self.parts(x).find(|(block, ..)| block.variable == *variable) else {
            return Vec::new();
        };
        let least = RANK_TOLERANCE * singular.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let of = |(row, x): (&Vec<(usize, f64)>, f64)| {
            let along =
                |s: usize| row.iter().map(|(i, w)| w * v_t[(s, first + i)]).sum::<f64>() / singular[s].max(least);
            let value = block.value(x);
            noise
                * (0..singular.len()).map(|s| along(s).powi(2)).sum::<f64>().sqrt()
                * (block.slope(value) / value).abs()
        };
        block.basis.rows.iter().zip(block.basis.joints(part)).map(of).collect()
    }

    /// The unknowns whose bounds are equal.
    pub fn fixed(&self) -> impl Iterator<Item = usize> {
        self.blocks.iter().filter(|block| block.is_fixed()).flat_map(VariableBlock::unknowns)
    }

    /// The relative change of each value of `variable` with a change `by` of the unknowns `x`; empty if it is not an unknown.
    pub fn changes(&self, variable: &DesignVariable, x: &[f64], by: &[f64]) -> Vec<f64> {
        let Some((block, first, part)) = self.parts(x).find(|(block, ..)| block.variable == *variable) else {
            return Vec::new();
        };
        let of = |(row, x): (&Vec<(usize, f64)>, f64)| {
            let value = block.value(x);
            row.iter().map(|(i, w)| w * by[first + i]).sum::<f64>() * block.slope(value) / value
        };
        block.basis.rows.iter().zip(block.basis.joints(part)).map(of).collect()
    }

    /// Starts: in the first block a uniform profile, the source study's gradient, its mirror image, then waves of random phase; in
    /// the others the scene's own values.
    pub fn first(&self, start: usize) -> Vec<f64> {
        let mut x = Vec::with_capacity(self.count());
        for (b, block) in self.blocks.iter().enumerate() {
            for (i, xi) in block.xi.iter().enumerate() {
                let factor = match (start, &block.own) {
                    (0, Some(own)) => {
                        x.push(block.unknown(own[i]));
                        continue;
                    }
                    _ => match start {
                        0 => 1.0,
                        _ if b > 0 => 1.0,
                        n if matches!(block.variable, DesignVariable::Number(_)) => {
                            (0.3 * (2.399_963 * (n * (i + 1)) as f64).cos()).exp() // the golden angle
                        }
                        1 => (2.0 - xi) / 1.5,
                        2 => (1.0 + xi) / 1.5,
                        n => {
                            let phase = 2.399_963 * n as f64; // the golden angle
                            1.0 + 0.6 * (std::f64::consts::PI * (1.0 + (n % 3) as f64) * xi + phase).cos()
                        }
                    },
                };
                let even = if block.variable == DesignVariable::Stiffness { block.mean.unwrap_or(1.0) } else { 1.0 };
                x.push(block.unknown(if block.variable == DesignVariable::Phase {
                    factor - 1.0
                } else {
                    even * factor
                }));
            }
        }
        self.kept(x)
    }

    /// The `i`-th of a sequence of values that fill the range of the bounds, at most a factor of [`SAMPLED_FACTOR`] from the
    /// scene's own: each profile between one value at the head and one at the tip, each number separately. In the first four all
    /// profiles are at their bounds at either end, since limits are often kept only there. The others are drawn from the additive
    /// recurrence of the inverse powers of the root of x^(d+1) = x + 1, where d is the number of values, whose points are spread
    /// evenly (M. Roberts, 2018).
    pub fn sampled(&self, i: usize) -> Vec<f64> {
        let drawn = |block: &VariableBlock| match block.variable {
            DesignVariable::Number(_) => block.xi.len(),
            _ => 2,
        };
        let count: usize = self.blocks.iter().map(drawn).sum();
        let root = (0..60).fold(2.0_f64, |root, _| (1.0 + root).powf(1.0 / (count + 1) as f64));
        let mut part = 1.0;
        let mut draw = || {
            part /= root;
            (0.5 + (i + 1) as f64 * part).fract()
        };
        let mut x = Vec::with_capacity(self.count());
        for block in &self.blocks {
            let [low, high] = match block.map {
                Transform::Same => block.bounds,
                _ => [block.bounds[0].max(1.0 / SAMPLED_FACTOR), block.bounds[1].min(SAMPLED_FACTOR)],
            };
            let [low, high] = if low < high { [low, high] } else { block.bounds }.map(|bound| block.unknown(bound));
            if let DesignVariable::Number(_) = block.variable {
                x.extend(block.xi.iter().map(|_| low + draw() * (high - low)));
            } else {
                let drawn = [draw(), draw()];
                let [head, tip] = if i < 4 { [(i & 1) as f64, (i >> 1) as f64] } else { drawn };
                x.extend(block.xi.iter().map(|xi| low + (head + (tip - head) * xi) * (high - low)));
            }
        }
        self.kept(x)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::{DesignTable, Unknowns};
    use crate::scene::Document;

    #[test]
    #[allow(clippy::unwrap_used, reason = "a test may panic")]
    fn searches_start_at_an_even_profile_two_gradients_and_waves_of_other_phases() {
        let text = include_str!("../../../models/design-driven-head.toml");
        let scene = Document::new("design.toml", text).scene().unwrap();
        let model = scene.model().unwrap();
        let joints = || model.rod.joints();
        let stiffness: Vec<f64> = joints().map(|k| model.rod.joint[k]).collect();
        let unknowns = Unknowns::of(&DesignTable::of(&scene).unwrap(), &model, stiffness);
        let wave = |n: f64, half_waves: f64| {
            move |xi: f64| 1.0 + 0.6 * (half_waves * PI * xi + n * PI * (3.0 - 5.0_f64.sqrt())).cos()
        };
        let starts: [&dyn Fn(f64) -> f64; 6] =
            [&|_| 1.0, &|xi| 2.0 - xi, &|xi| 1.0 + xi, &wave(3.0, 1.0), &wave(4.0, 2.0), &wave(5.0, 3.0)];
        for (start, shape) in starts.into_iter().enumerate() {
            let profile = unknowns.profile(&unknowns.first(start)).stiffness_n_m2;
            // One factor for all joints keeps the mean.
            let factors: Vec<f64> = joints().zip(&profile).map(|(k, ei)| ei / shape(model.rod.xi(k))).collect();
            let apart = factors.iter().map(|factor| (factor / factors[0] - 1.0).abs()).fold(0.0, f64::max);
            assert!(apart < 5e-6, "start {start}: {profile:?}"); // measured: 1.3e-6, of the digits of the golden angle
        }
    }
}
