//! The unknowns of a search: stiffness, the actuation's amplitude, or its phase, at joints or knots; linear between knots.

use std::f64::consts::PI;

use nalgebra::DMatrix;
use serde::Serialize;

use super::identify::second_differences;
use super::qp::{Constraint, Quadratic};
use super::table::{Basis, Goal, Table, Variable};
use crate::rod::Rod;
use crate::sensitivity::Parameter;

/// What a search changes, joint by joint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Profile {
    /// EI, N m².
    pub stiffness_n_m2: Vec<f64>,
    /// Amplitude of the actuation over the scene's.
    pub amplitude: Vec<f64>,
    /// Phase subtracted inside the actuation's function of phase, beside the scene's, rad.
    pub phase_rad: Vec<f64>,
}

impl Profile {
    /// Of this stiffness (N m²), with the scene's actuation.
    pub fn of(stiffness: Vec<f64>) -> Self {
        Self { amplitude: vec![1.0; stiffness.len()], phase_rad: vec![0.0; stiffness.len()], stiffness_n_m2: stiffness }
    }

    fn values(&mut self, variable: Variable) -> &mut Vec<f64> {
        match variable {
            Variable::Stiffness => &mut self.stiffness_n_m2,
            Variable::Amplitude => &mut self.amplitude,
            Variable::Phase => &mut self.phase_rad,
        }
    }
}

/// How a value follows from its unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Map {
    /// Its logarithm.
    Logarithm,
    /// Its inverse: a tip moves nearly in proportion to the compliance 1/EI of a joint, as what bends it beyond its natural
    /// curvature is a moment that stiffness hardly changes.
    Inverse,
    /// Itself.
    Same,
}

/// The unknowns of one variable; values are over the reference.
#[derive(Debug, Clone)]
struct Block {
    variable: Variable,
    map: Map,
    bounds: [f64; 2],
    /// The largest mean.
    mean: Option<f64>,
}

impl Block {
    fn value(&self, x: f64) -> f64 {
        match self.map {
            Map::Logarithm => x.exp(),
            Map::Inverse => 1.0 / x,
            Map::Same => x,
        }
    }

    fn unknown(&self, value: f64) -> f64 {
        match self.map {
            Map::Logarithm => value.ln(),
            Map::Inverse => 1.0 / value,
            Map::Same => value,
        }
    }

    /// The derivative of a value by its unknown.
    fn slope(&self, value: f64) -> f64 {
        match self.map {
            Map::Logarithm => value,
            Map::Inverse => -value * value,
            Map::Same => 1.0,
        }
    }

    /// 1 where the value rises with its unknown, else -1.
    fn sense(&self) -> f64 {
        if self.map == Map::Inverse { -1.0 } else { 1.0 }
    }

    fn name(&self) -> &'static str {
        match self.variable {
            Variable::Stiffness => "",
            Variable::Amplitude => "amplitude at ",
            Variable::Phase => "phase at ",
        }
    }
}

/// The unknowns of a search, block after block.
#[derive(Debug, Clone)]
pub struct Unknowns {
    blocks: Vec<Block>,
    basis: Basis,
    /// Where each unknown of a block is, and its place in words.
    xi: Vec<f64>,
    places: Vec<String>,
    joints: Vec<usize>,
    reference: f64,
    own: Profile,
    monotone: bool,
}

impl Unknowns {
    /// Those that `table` names for `rod`, whose stiffness is kept where it is not among them.
    pub fn of(table: &Table, rod: &Rod, stiffness: Vec<f64>) -> Self {
        let compliance = if table.goal == Goal::TrackTip { Map::Inverse } else { Map::Logarithm };
        let block = |variable: &Variable| {
            let (map, bounds, mean) = match variable {
                Variable::Stiffness => (compliance, table.bounds, table.mean),
                Variable::Amplitude => {
                    (Map::Logarithm, table.amplitude_bounds.unwrap_or([0.5, 2.0]), table.amplitude_mean)
                }
                Variable::Phase => (Map::Same, table.phase_bounds_rad.unwrap_or([-PI, PI]), None),
            };
            Block { variable: *variable, map, bounds, mean }
        };
        let joints: Vec<usize> = rod.joints().collect();
        let (xi, places) = match &table.knots {
            Some(knots) => (knots.clone(), knots.iter().map(|xi| format!("knot xi = {xi}")).collect()),
            None => (
                joints.iter().map(|k| *k as f64 / (rod.nodes - 1) as f64).collect(),
                joints.iter().map(|k| format!("joint {k}")).collect(),
            ),
        };
        Self {
            blocks: table.variables.iter().map(block).collect(),
            basis: table.basis(rod),
            xi,
            places,
            joints,
            reference: rod.ei,
            own: Profile::of(stiffness),
            monotone: table.monotone,
        }
    }

    /// The joints they act on.
    pub fn joints(&self) -> usize {
        self.joints.len()
    }

    /// Their number.
    pub fn count(&self) -> usize {
        self.blocks.len() * self.basis.unknowns
    }

    fn parts<'a>(&'a self, x: &'a [f64]) -> impl Iterator<Item = (&'a Block, usize, &'a [f64])> {
        let n = self.basis.unknowns;
        self.blocks.iter().enumerate().map(move |(b, block)| (block, b * n, &x[b * n..(b + 1) * n]))
    }

    fn unit(&self, block: &Block) -> f64 {
        if block.variable == Variable::Stiffness { self.reference } else { 1.0 }
    }

    /// The profile of unknowns `x`.
    pub fn profile(&self, x: &[f64]) -> Profile {
        let mut profile = self.own.clone();
        for (block, _, x) in self.parts(x) {
            let unit = self.unit(block);
            *profile.values(block.variable) = self.basis.joints(x).iter().map(|x| unit * block.value(*x)).collect();
        }
        profile
    }

    /// What a simulation is differentiated by: a parameter a joint and variable.
    pub fn parameters(&self) -> Vec<Parameter> {
        let of = |block: &Block| match block.variable {
            Variable::Stiffness => Parameter::Stiffness,
            Variable::Amplitude => Parameter::WaveAmplitude,
            Variable::Phase => Parameter::WavePhase,
        };
        self.blocks.iter().flat_map(|block| self.joints.iter().map(move |k| of(block)(*k))).collect()
    }

    /// Derivatives by the unknowns of a number whose derivatives by the parameters are `by`.
    pub fn chain(&self, profile: &Profile, by: &[f64]) -> Vec<f64> {
        let joints = self.joints.len();
        let mut out = vec![0.0; self.count()];
        for (b, block) in self.blocks.iter().enumerate() {
            for (i, row) in self.basis.rows.iter().enumerate() {
                let size = match block.variable {
                    Variable::Stiffness => self.reference * block.slope(profile.stiffness_n_m2[i] / self.reference),
                    // The parameter is relative to what it is, as the unknown is.
                    Variable::Amplitude => 1.0,
                    Variable::Phase => block.slope(profile.phase_rad[i]),
                };
                row.iter().for_each(|(u, w)| out[b * self.basis.unknowns + u] += by[b * joints + i] * size * w);
            }
        }
        out
    }

    /// The means that are limited, over their limits, with their derivatives by all unknowns.
    pub fn means(&self, x: &[f64]) -> Vec<(f64, Vec<f64>)> {
        let count = self.basis.rows.len() as f64;
        let mut means = Vec::new();
        for (block, first, part) in self.parts(x) {
            let Some(most) = block.mean else { continue };
            let values: Vec<f64> = self.basis.joints(part).iter().map(|x| block.value(*x)).collect();
            let mut by = vec![0.0; x.len()];
            for (value, row) in values.iter().zip(&self.basis.rows) {
                row.iter().for_each(|(i, w)| by[first + i] += block.slope(*value) * w / count / most);
            }
            means.push((values.iter().sum::<f64>() / count / most, by));
        }
        means
    }

    fn is_ordered(&self, block: &Block) -> bool {
        self.monotone && block.variable == Variable::Stiffness
    }

    /// `x` inside its bounds and order, and values moved down block by block so that it keeps its means.
    pub fn kept(&self, mut x: Vec<f64>) -> Vec<f64> {
        let n = self.basis.unknowns;
        for _ in 0..50 {
            for (b, block) in self.blocks.iter().enumerate() {
                let ends = block.bounds.map(|bound| block.unknown(bound));
                let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
                let part = &mut x[b * n..(b + 1) * n];
                part.iter_mut().for_each(|x| *x = x.clamp(low, high));
                for i in (1..n).filter(|_| self.is_ordered(block)) {
                    part[i] = block.sense() * (block.sense() * part[i]).min(block.sense() * part[i - 1]);
                }
            }
            let means = self.means(&x);
            if means.iter().all(|(mean, _)| *mean <= 1.0 + 1e-12) {
                break;
            }
            for (mean, by) in means.into_iter().filter(|(mean, _)| *mean > 1.0) {
                let least = |i: usize| self.blocks[i / n].unknown(self.blocks[i / n].bounds[0]);
                let free: f64 = (0..x.len()).filter(|i| x[*i] != least(*i)).map(|i| by[i]).sum();
                if free != 0.0 {
                    x.iter_mut().zip(&by).filter(|(_, by)| **by != 0.0).for_each(|(x, _)| *x -= (mean - 1.0) / free);
                }
            }
        }
        x
    }

    /// Adds the constraints of a step from `x`: bounds, order, and the means last.
    pub fn constrain(&self, programme: &mut Quadratic, x: &[f64]) {
        let constraints = &mut programme.constraints;
        for (block, first, part) in self.parts(x) {
            let sense = block.sense();
            for ((i, x), place) in (first..).zip(part).zip(&self.places) {
                let place = format!("{}{place}", block.name());
                for (words, bound, sign) in [("at least", block.bounds[0], -sense), ("at most", block.bounds[1], sense)]
                {
                    let room = sign * (block.unknown(bound) - x);
                    constraints.push(Constraint::at_most(format!("{place} {words} {bound}"), vec![(i, sign)], room));
                }
            }
            for i in (1..part.len()).filter(|_| self.is_ordered(block)) {
                let name = format!("{} not above {}", self.places[i], self.places[i - 1]);
                let row = vec![(first + i, sense), (first + i - 1, -sense)];
                constraints.push(Constraint::at_most(name, row, sense * (part[i - 1] - part[i])));
            }
        }
        let limited = self.blocks.iter().filter_map(|block| block.mean.map(|most| (block, most)));
        for ((block, most), (mean, by)) in limited.zip(self.means(x)) {
            let what = if block.variable == Variable::Amplitude { "mean amplitude" } else { "mean" };
            let row = by.into_iter().enumerate().filter(|(_, by)| *by != 0.0).collect();
            constraints.push(Constraint::at_most(format!("{what} at most {most}"), row, (1.0 - mean).max(0.0)));
        }
    }

    /// The matrix of `weight`·Σ(D₂x)² over the joints, by rows.
    pub fn roughness(&self, weight: f64) -> Vec<f64> {
        let mut programme = Quadratic::new(self.count());
        for b in 0..self.blocks.len() {
            for row in second_differences(&self.basis) {
                let row: Vec<(usize, f64)> = row.iter().map(|(i, c)| (b * self.basis.unknowns + i, *c)).collect();
                programme.add_square(&row, 0.0, weight);
            }
        }
        programme.hessian
    }

    /// The standard deviation of each joint's stiffness over itself, where the unknowns have the covariance `noise`² V S⁻² Vᵀ;
    /// empty where stiffness is not among them.
    pub fn deviations(&self, x: &[f64], v_t: &DMatrix<f64>, singular: &[f64], noise: f64) -> Vec<f64> {
        let stiffness = self.parts(x).find(|(block, ..)| block.variable == Variable::Stiffness);
        let Some((block, first, part)) = stiffness else { return Vec::new() };
        let of = |(row, x): (&Vec<(usize, f64)>, f64)| {
            let along = |s: usize| row.iter().map(|(i, w)| w * v_t[(s, first + i)]).sum::<f64>() / singular[s];
            let value = block.value(x);
            noise
                * (0..singular.len()).map(|s| along(s).powi(2)).sum::<f64>().sqrt()
                * (block.slope(value) / value).abs()
        };
        self.basis.rows.iter().zip(self.basis.joints(part)).map(of).collect()
    }

    /// Starts: even, the study's gradient, its mirror image, then waves of random phase, in the first block; the scene's own
    /// in the others.
    pub fn first(&self, start: usize) -> Vec<f64> {
        let mut x = Vec::with_capacity(self.count());
        for (b, block) in self.blocks.iter().enumerate() {
            for xi in &self.xi {
                let factor = match start {
                    _ if b > 0 => 1.0,
                    0 => 1.0,
                    1 => (2.0 - xi) / 1.5,
                    2 => (1.0 + xi) / 1.5,
                    n => {
                        let phase = 2.399_963 * n as f64; // the golden angle
                        1.0 + 0.6 * (std::f64::consts::PI * (1.0 + (n % 3) as f64) * xi + phase).cos()
                    }
                };
                let even = if block.variable == Variable::Stiffness { block.mean.unwrap_or(1.0) } else { 1.0 };
                x.push(block.unknown(if block.variable == Variable::Phase { factor - 1.0 } else { even * factor }));
            }
        }
        self.kept(x)
    }
}
