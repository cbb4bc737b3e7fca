//! A frame of an animation: the rod at a time, with what acts on it.

use serde::{Deserialize, Serialize};

use crate::fluid::{Fluid, Layers};
use crate::rod::{Rod, Spheroid, bend, node};
use crate::variable::View;

/// The rod at a time, for the animation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Time, s.
    pub time: f64,
    /// Positions of some nodes, including head and tip, m.
    pub points: Vec<[f64; 2]>,
    /// Centre of mass, m.
    pub com: [f64; 2],
    /// Semi-axes (m) and angle (rad) of the body at the head, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<[f64; 3]>,
    /// The medium, if it has layers.
    #[serde(default)]
    pub medium: Option<(Fluid, Layers)>,
    /// What is drawn along the rod and around it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loads: Option<FrameLoads>,
}

/// Moments, powers and forces at the time of a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameLoads {
    /// Bending moment at the frame's points, N m; 0 where there is no joint.
    pub moment: Vec<f64>,
    /// Power that the actuation puts in per length of the rod at the frame's points, W/m; 0 where there is no joint.
    pub power: Vec<f64>,
    /// Force of the tail on a held head, N.
    pub head_force: Option<[f64; 2]>,
    /// Velocity of the flow before the first interface, or where a shear begins, m/s.
    pub flow: [f64; 2],
}

impl Frame {
    /// Approximate limit of the number of nodes.
    pub const POINTS: usize = 120;

    /// Semi-axes (m) and angle (rad) of the body at the head of `rod`, whose nodes are at `q`.
    pub fn body(rod: &Rod, q: &[f64]) -> Option<[f64; 3]> {
        rod.body.map(|body| Self::place_body(body, node(q, 0).into(), node(q, 1).into()))
    }

    /// Semi-axes (m) and angle (rad) of a `body` whose centre is the `head` and whose axis points to the `next` point.
    pub(super) fn place_body(body: Spheroid, head: [f64; 2], next: [f64; 2]) -> [f64; 3] {
        [body.along, body.across, (next[1] - head[1]).atan2(next[0] - head[0])]
    }

    /// The current frame.
    pub fn of(view: &View<'_>) -> Self {
        let nodes = view.state.q.len() / 2;
        let point = |k: usize| [view.state.q[2 * k], view.state.q[2 * k + 1]];
        let inputs = &view.dynamics.inputs;
        Self {
            time: view.state.t,
            points: Self::nodes(nodes).map(point).collect(),
            com: view.metrics.now.com.into(),
            body: Self::body(&view.dynamics.model.rod, &view.state.q),
            medium: inputs.layers.filter(|layers| layers.iter().len() > 0).map(|layers| (inputs.fluid, layers)),
            loads: None,
        }
    }

    /// The current frame with its loads.
    pub fn with_loads(view: &View<'_>) -> Self {
        let View { dynamics, state, metrics, .. } = view;
        let rod = &dynamics.model.rod;
        let joints = rod.joints();
        let at_joints = |value: &dyn Fn(usize) -> f64| {
            let at = |k: usize| if joints.contains(&k) { value(k) } else { 0.0 };
            Self::nodes(rod.nodes).map(at).collect()
        };
        let powers = metrics.now.actuation_powers(dynamics, state);
        let loads = FrameLoads {
            moment: at_joints(&|k| metrics.now.moment[k] * bend::curvature_per_turning(metrics.now.kappa[k])),
            power: at_joints(&|k| powers[k] / (rod.joint_part(k) * rod.spacing)),
            head_force: dynamics.model.head.is_some().then(|| metrics.now.head_force.into()),
            flow: dynamics.inputs.fluid.flow.into(),
        };
        Self { loads: Some(loads), ..Self::of(view) }
    }

    /// The nodes at which a frame has points, for a rod with this number of nodes.
    pub fn nodes(nodes: usize) -> impl Iterator<Item = usize> + Clone {
        let points = Self::POINTS.min(nodes);
        (0..points).map(move |i| i * (nodes - 1) / (points - 1).max(1))
    }
}
