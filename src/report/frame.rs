//! A frame of an animation: the rod at a time, with what acts on it.

use serde::{Deserialize, Serialize};

use crate::fluid::{Fluid, Layers};
use crate::model::{Inputs, Model};
use crate::rod::bend;
use crate::variable::View;

/// The rod at a time, for the animation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Time, s.
    pub time: f64,
    /// Positions of the nodes that are drawn, m.
    pub points: Vec<[f64; 2]>,
    /// Centre of mass, m.
    pub com: [f64; 2],
    /// The medium; `None` if it is unknown, which is not the same as none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub medium: Option<Medium>,
    /// What is drawn along the rod.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loads: Option<FrameLoads>,
}

/// The fluid around the rod and its flow at a time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Medium {
    /// The fluid; with layers, the one before the first interface.
    pub fluid: Fluid,
    /// Interfaces with the fluids beyond them, and the shear of the flow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layers: Option<Layers>,
}

impl Medium {
    /// The medium of a model at time `t` (s), if no host changes it.
    pub fn at(model: &Model, t: f64) -> Self {
        let mut fluid = model.fluid;
        if let Some(signals) = &model.flow {
            fluid.flow = signals.each_ref().map(|signal| signal.at(t).value).into();
        }
        Self { fluid, layers: model.layers }
    }

    fn of(inputs: &Inputs) -> Self {
        Self { fluid: inputs.fluid, layers: inputs.layers }
    }

    /// The layers, if there is an interface.
    pub fn interfaces(&self) -> Option<&Layers> {
        self.layers.as_ref().filter(|layers| layers.iter().len() > 0)
    }

    /// True if fluid and flow are the same everywhere.
    pub fn is_uniform(&self) -> bool {
        self.layers.is_none_or(|layers| layers.iter().len() == 0 && layers.flow_together())
    }
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
}

impl Frame {
    /// The current frame, with these `nodes` as points.
    pub fn of(view: &View<'_>, nodes: &[usize]) -> Self {
        Self {
            time: view.state.t,
            points: nodes.iter().map(|k| [view.state.q[2 * k], view.state.q[2 * k + 1]]).collect(),
            com: view.metrics.now.com.into(),
            medium: Some(Medium::of(&view.dynamics.inputs)),
            loads: None,
        }
    }

    /// The current frame with its loads.
    pub fn with_loads(view: &View<'_>, nodes: &[usize]) -> Self {
        let View { dynamics, state, metrics, .. } = view;
        let rod = &dynamics.model.rod;
        let joints = rod.joints();
        let at_joints = |value: &dyn Fn(usize) -> f64| {
            nodes.iter().map(|k| if joints.contains(k) { value(*k) } else { 0.0 }).collect()
        };
        let powers = metrics.now.actuation_powers(dynamics, state);
        let loads = FrameLoads {
            moment: at_joints(&|k| metrics.now.moment[k] * bend::curvature_per_turning(metrics.now.kappa[k])),
            power: at_joints(&|k| powers[k] / (rod.joint_part(k) * rod.spacing)),
            head_force: dynamics.model.head.is_some().then(|| metrics.now.head_force.into()),
        };
        Self { loads: Some(loads), ..Self::of(view, nodes) }
    }
}
