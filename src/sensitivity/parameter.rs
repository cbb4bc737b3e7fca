//! Parameters with respect to which a simulation can be differentiated, and their effect on the equations.

use std::f64::consts::TAU;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::output::{Gradient, OutputContext};
use crate::actuation::Wave;
use crate::error::{Error, Result, did_you_mean, nearest};
use crate::fluid::Key;
use crate::fluid::medium::by_key;
use crate::model::{ActiveMoments, Dynamics, Model};
use crate::rod::Rod;

/// A parameter of a simulation. Joints are identified by their nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parameter {
    /// Bending stiffness EI_k of the joint at node k, N m².
    Stiffness(usize),
    /// A constant natural curvature (1/m) added to that of the actuation at the joint at node k.
    NaturalCurvature(usize),
    /// A factor of the actuation's amplitude at the joint at node k only.
    WaveAmplitude(usize),
    /// A phase (rad) subtracted inside the actuation's sine at the joint at node k only.
    WavePhase(usize),
    /// Amplitude of the actuation: κ_amp, or that of its moment, N m.
    Amplitude,
    /// Frequency of the actuation, Hz.
    Frequency,
    /// Phase φ₀ (rad) subtracted inside the actuation's sine.
    Phase,
    /// A parameter of the forces, by its key.
    OfForces(Key),
    /// A number of the scene, by its index in [`Problem::finite_differences`](super::Problem::finite_differences).
    OfScene(usize),
    /// A direction in the parameters of joints, by its index in [`Problem::directions`](super::Problem::directions).
    Along(usize),
}

impl fmt::Display for Parameter {
    /// The name as in [`parameters`](super::simulation::parameters).
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stiffness(k) => write!(f, "joint_stiffness_n_m2 at node {k}"),
            Self::NaturalCurvature(k) => write!(f, "natural_curvature_1_m at node {k}"),
            Self::WaveAmplitude(k) => write!(f, "joint_amplitude_factor at node {k}"),
            Self::WavePhase(k) => write!(f, "joint_phase_rad at node {k}"),
            Self::Amplitude => f.write_str("the amplitude of the actuation"),
            Self::Frequency => f.write_str("actuation.frequency_hz"),
            Self::Phase => f.write_str("actuation_phase_rad"),
            Self::OfForces(key) => f.write_str(key),
            Self::OfScene(i) => write!(f, "finite difference {i} of the scene"),
            Self::Along(i) => write!(f, "direction {i} in the parameters of joints"),
        }
    }
}

/// A direction in the parameters of joints, for example of those that move with one knot: the derivative along it is the sum of
/// `weights` times the derivatives with respect to the parameters of the joints, at the cost of one.
#[derive(Debug, Clone)]
pub struct JointDirection {
    parameter: fn(usize) -> Parameter,
    joints: Range<usize>,
    /// A joint whose effect equals that of all joints, apart from their weights.
    whole: usize,
    weights: Arc<[f64]>,
}

impl JointDirection {
    /// The direction in the parameters that `parameter` returns for nodes, with the `weights` of the joints of `rod` from node
    /// `first` on.
    pub fn of(rod: &Rod, parameter: fn(usize) -> Parameter, first: usize, weights: &[f64]) -> Self {
        let joints = first..first + weights.len();
        let whole = joints.clone().find(|k| rod.joint_part(*k) == 1.0).unwrap_or(first);
        let weight = |(k, weight): (usize, &f64)| {
            let part = rod.joint_part(k) / rod.joint_part(whole);
            match parameter(k) {
                Parameter::Stiffness(_) => weight / part,
                Parameter::NaturalCurvature(_) => weight * part,
                _ => *weight,
            }
        };
        let weights = joints.clone().zip(weights).map(weight).collect();
        Self { parameter, joints, whole, weights }
    }

    /// The same direction with each weight multiplied by the `factor` of its node.
    pub fn scaled(&self, factor: impl Fn(usize) -> f64) -> Self {
        let weights = self.joints.clone().zip(&*self.weights).map(|(k, weight)| weight * factor(k)).collect();
        Self { weights, ..self.clone() }
    }

    /// True if it is a direction of stiffness.
    pub fn is_of_stiffness(&self) -> bool {
        matches!((self.parameter)(self.whole), Parameter::Stiffness(_))
    }

    fn effect(&self, rod: &Rod, shape: &ActuationShape) -> ParameterEffect {
        let of_joint = (self.parameter)(self.whole).effect(rod, shape, &[]);
        ParameterEffect { joints: self.joints.clone(), weights: Some(Arc::clone(&self.weights)), ..of_joint }
    }
}

/// The shape g of an actuation at a time, κ̄ = κ_amp r g(ψ) or M_amp r g(ψ), with its first two derivatives with respect to
/// phase.
#[derive(Debug, Clone, Default)]
pub(super) struct ActuationShape {
    wave: Option<Wave>,
    /// g, g' and g'', one entry per node.
    g: [Vec<f64>; 3],
    time: f64,
    /// For active moments: B_k, with κ̄_k = M_k/B_k and its rate; empty otherwise.
    active: Vec<(f64, [f64; 2])>,
    /// True if the wave is an active moment; g is then divided by B_k.
    moments: bool,
}

impl ActuationShape {
    pub(super) fn new(nodes: usize) -> Self {
        Self { g: std::array::from_fn(|_| vec![0.0; nodes]), ..Self::default() }
    }

    /// Evaluates the shape at time `t` (s).
    pub(super) fn take(&mut self, dynamics: &Dynamics, t: f64) {
        let rod = &dynamics.model.rod;
        let per = |k: usize| if rod.joints().contains(&k) { 1.0 / rod.joint[k] } else { 0.0 };
        self.active.clear();
        if let Some(ActiveMoments { moment, rate, .. }) = &dynamics.active {
            let active = |k: usize| (rod.joint[k], [moment[k] * per(k), rate[k] * per(k)]);
            self.active.extend((0..rod.nodes).map(active));
        }
        self.moments = dynamics.model.active_moments;
        let Some((actuation, _)) = &dynamics.model.actuation else { return };
        let wave = dynamics.inputs.wave(&dynamics.model.start, t, None);
        for (order, g) in self.g.iter_mut().enumerate() {
            let mut sizes = [0.0; 3];
            sizes[order] = 1.0;
            g.fill(0.0);
            actuation.add_derivatives(sizes, wave.phase, g);
            match self.moments {
                true => g.iter_mut().enumerate().for_each(|(k, g)| *g *= per(k)),
                false => rod.at_joints(g),
            }
        }
        (self.wave, self.time) = (Some(wave), t);
    }

    /// Σ `sizes` times g, g' and g'' at node `k`.
    #[inline]
    fn sum<const N: usize>(&self, sizes: &[f64; N], k: usize) -> f64 {
        sizes.iter().zip(&self.g).map(|(size, g)| size * g[k]).sum()
    }
}

/// The derivatives of the equations with respect to a parameter at a time. At each of `joints`, the derivative of B_k is
/// `stiffness`, that of κ̄_k is own + `natural`·(g, g'), and that of dκ̄_k/dt is `rate`·(g, g', g''), all times the joint's
/// weight. Where active moments bend the joint, the latter two are reduced by `stiffness`/B_k times the curvature that the
/// moments cause.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ParameterEffect {
    pub(super) joints: Range<usize>,
    /// The weight of each joint; 1 if `None`.
    weights: Option<Arc<[f64]>>,
    stiffness: f64,
    own: f64,
    natural: [f64; 2],
    rate: [f64; 3],
    /// The change of 2πf, rad/s.
    pub(super) angular_frequency: f64,
    pub(super) key: Option<Key>,
    /// Index of the finite difference, for a number of the scene.
    pub(super) scene_parameter: Option<usize>,
}

impl ParameterEffect {
    #[inline]
    fn weight(&self, k: usize) -> f64 {
        self.weights.as_ref().map_or(1.0, |weights| weights[k - self.joints.start])
    }

    /// dB_k.
    #[inline]
    pub(super) fn stiffness(&self, k: usize) -> f64 {
        self.weight(k) * self.stiffness
    }

    /// dκ̄_k.
    #[inline]
    pub(super) fn natural(&self, shape: &ActuationShape, k: usize) -> f64 {
        self.weight(k) * (self.own + shape.sum(&self.natural, k)) - self.softening(shape, k, 0)
    }

    /// d(dκ̄_k/dt), 1/s.
    #[inline]
    pub(super) fn rate(&self, shape: &ActuationShape, k: usize) -> f64 {
        self.weight(k) * shape.sum(&self.rate, k) - self.softening(shape, k, 1)
    }

    /// The reduction of the curvature caused by the active moment when the joint becomes stiffer, or of the rate of that
    /// curvature (`order` 1).
    #[inline]
    fn softening(&self, shape: &ActuationShape, k: usize, order: usize) -> f64 {
        shape
            .active
            .get(k)
            .filter(|_| self.stiffness != 0.0)
            .map_or(0.0, |(own, bent)| bent[order] * self.stiffness(k) / own)
    }

    /// dM_k, N m.
    #[inline]
    fn active(&self, shape: &ActuationShape, k: usize) -> f64 {
        let stiffness = shape.active.get(k).filter(|_| shape.moments).map_or(0.0, |(stiffness, _)| *stiffness);
        stiffness * self.weight(k) * shape.sum(&self.natural, k)
    }

    /// True if κ̄ depends on it.
    pub(super) fn bends(&self, shape: &ActuationShape) -> bool {
        let softens = self.stiffness != 0.0 && !shape.active.is_empty();
        softens || self.own != 0.0 || self.natural != [0.0; 2] || self.rate != [0.0; 3]
    }
}

impl Parameter {
    /// The parameter with an analytic derivative for the number `key` of a scene, if any.
    pub fn of_key(key: &str, model: &Model) -> Option<Self> {
        let driven = model.actuation.is_some() && !model.filters_drive();
        match key {
            "actuation.kappa_amp" | "actuation.moment_amp_n_m" => driven.then_some(Self::Amplitude),
            "actuation.frequency_hz" => driven.then_some(Self::Frequency),
            _ => {
                let keys = model.forces.iter().flat_map(|force| force.parameters().iter().copied());
                keys.into_iter().find(|own| *own == key).map(Self::OfForces)
            }
        }
    }

    /// Returns an error for a parameter that `model` does not have, for which derivatives would be zero; `count` is the number of
    /// finite differences.
    pub(super) fn check(self, model: &Model, count: usize, directions: &[JointDirection]) -> Result<()> {
        let refuse =
            |problem: String| Err(Error::Derivative { problem: format!("no derivative by {self}: {problem}") });
        let joints = model.rod.joints();
        match self {
            Self::Stiffness(k) | Self::NaturalCurvature(k) | Self::WaveAmplitude(k) | Self::WavePhase(k)
                if !joints.contains(&k) =>
            {
                refuse(format!("the rod has no joint at node {k}; allowed: {} to {}", joints.start, joints.end - 1))
            }
            Self::WaveAmplitude(_) | Self::WavePhase(_) | Self::Amplitude | Self::Frequency | Self::Phase
                if model.actuation.is_none() =>
            {
                refuse("the rod is not driven; allowed: with an actuation".to_string())
            }
            Self::NaturalCurvature(_)
            | Self::WaveAmplitude(_)
            | Self::WavePhase(_)
            | Self::Amplitude
            | Self::Frequency
            | Self::Phase
                if model.filters_drive() =>
            {
                refuse("the drive has a limit or a lag; allowed: without `actuation.lag_s`, `largest_1_m` and `largest_moment_n_m`".to_string())
            }
            Self::OfForces(key) => {
                let own = model.forces.iter().flat_map(|force| force.parameters().to_vec());
                // The parameters of every medium, whether or not a force depends on them.
                let media = by_key(&model.fluid, model.layers.as_ref()).map(|(key, _)| key);
                let mut keys: Vec<Key> = own.chain(media).collect();
                keys.sort_unstable();
                keys.dedup();
                if keys.contains(&key) {
                    return Ok(());
                }
                let near = did_you_mean(nearest(key, keys.iter().copied()));
                refuse(format!("no force has this parameter{near}; allowed: {}", keys.join(", ")))
            }
            Self::OfScene(i) if i >= count => refuse(format!(
                "Problem::finite_differences has {count} entries; allowed: an index into it (see sensitivity::scene_parameter)"
            )),
            Self::Along(i) => match directions.get(i) {
                Some(along) => along.joints.clone().try_for_each(|k| (along.parameter)(k).check(model, count, &[])),
                None => {
                    refuse(format!("Problem::directions has {} entries; allowed: an index into it", directions.len()))
                }
            },
            _ => Ok(()),
        }
    }

    /// The effect on the equations at the time of `shape`.
    pub(super) fn effect(self, rod: &Rod, shape: &ActuationShape, directions: &[JointDirection]) -> ParameterEffect {
        let none = ParameterEffect {
            joints: 0..0,
            weights: None,
            stiffness: 0.0,
            own: 0.0,
            natural: [0.0; 2],
            rate: [0.0; 3],
            angular_frequency: 0.0,
            key: None,
            scene_parameter: None,
        };
        let half = |k: usize| rod.joint_part(k);
        // A change of amplitude, of phase ψ and of the phase rate.
        let driven = |joints: Range<usize>, amplitude: f64, phase: f64, phase_rate: f64| {
            let Some(wave) = shape.wave else { return none.clone() };
            let Wave { amplitude: size, gain, gain_rate, phase_rate: omega, .. } = wave;
            ParameterEffect {
                joints,
                natural: [amplitude * gain, size * gain * phase],
                // κ̄' = S' g + S ω g', with S = κ_amp r.
                rate: [
                    amplitude * gain_rate,
                    amplitude * gain * omega + size * (gain_rate * phase + gain * phase_rate),
                    size * gain * omega * phase,
                ],
                angular_frequency: phase_rate,
                ..none.clone()
            }
        };
        let size = shape.wave.map_or(0.0, |wave| wave.amplitude);
        match self {
            Self::Stiffness(k) => {
                ParameterEffect { joints: k..k + 1, stiffness: 1.0 / (half(k) * rod.spacing), ..none }
            }
            Self::NaturalCurvature(k) => ParameterEffect { joints: k..k + 1, own: half(k) * rod.spacing, ..none },
            Self::WaveAmplitude(k) => driven(k..k + 1, size, 0.0, 0.0),
            Self::WavePhase(k) => driven(k..k + 1, 0.0, -1.0, 0.0),
            Self::Amplitude => driven(rod.joints(), 1.0, 0.0, 0.0),
            Self::Frequency => driven(rod.joints(), 0.0, TAU * shape.time, TAU),
            Self::Phase => driven(rod.joints(), 0.0, -1.0, 0.0),
            Self::OfForces(key) => ParameterEffect { key: Some(key), ..none },
            Self::OfScene(i) => ParameterEffect { scene_parameter: Some(i), ..none },
            Self::Along(i) => directions.get(i).map_or(none, |along| along.effect(rod, shape)),
        }
    }
}

/// The keys of the forces' parameters among `parameters`.
pub(super) fn keys(parameters: &[Parameter]) -> Vec<Key> {
    let key = |parameter: &Parameter| if let Parameter::OfForces(key) = parameter { Some(*key) } else { None };
    parameters.iter().filter_map(key).collect()
}

/// The direct derivative, at a fixed state; over a `step`, with the shapes at its ends.
pub(super) fn direct(
    gradient: &Gradient,
    effect: &ParameterEffect,
    shape: &ActuationShape,
    step: Option<([&ActuationShape; 2], Parameter, &OutputContext<'_>, &[JointDirection])>,
) -> f64 {
    let mut sum = effect.key.map_or(0.0, |key| gradient.by_key(key));
    let ends = step.filter(|_| effect.stiffness == 0.0 && !effect.joints.is_empty());
    let ends = ends.map(|(ends, parameter, at, directions)| {
        ends.map(|shape| (parameter.effect(&at.bent.dynamics.model.rod, shape, directions), shape))
    });
    for k in effect.joints.clone() {
        sum += gradient.stiffness[k] * effect.stiffness(k)
            + gradient.natural[k] * effect.natural(shape, k)
            + gradient.natural_rate[k] * effect.rate(shape, k)
            + gradient.active[k] * effect.active(shape, k);
        if let Some([from, to]) = &ends {
            if !shape.moments {
                let natural = |(effect, shape): &(ParameterEffect, &ActuationShape)| effect.natural(shape, k);
                sum += gradient.natural_step[k] * (natural(to) - natural(from));
            } else {
                // The natural curvature is set by a host, and does not depend on parameters within a step.
                let active = |(effect, shape): &(ParameterEffect, &ActuationShape)| effect.active(shape, k);
                sum += gradient.active_ends[k] * (active(from) + active(to));
            }
        }
    }
    sum
}
