//! What drives a body. A body that nothing drives only follows its head, its loads and the flow.

use crate::head::Signal;
use crate::model::Model;
use crate::tendons::{Pull, rest_length};

/// What drives a body by itself, without a host.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Drives {
    /// A wave of natural curvature or of active moments.
    pub actuation: bool,
    /// Tendons that are pulled.
    pub tendons: bool,
    /// The motor of a hinge gives a torque that the scene asks for.
    pub torque: bool,
}

impl Drives {
    /// What drives `model`.
    pub fn of(model: &Model) -> Self {
        Self {
            actuation: model.actuation.is_some(),
            tendons: model.tendons.iter().any(|tendon| match &tendon.pull {
                Pull::Tension(tension) => gives(tension),
                // Beside the straight rod a cable of that length is slack.
                Pull::Winch(winch) => winch.length.constant() != Some(rest_length(&model.rod, tendon.edges.clone())),
            }),
            torque: model.hinge.as_ref().is_some_and(|hinge| gives(&hinge.torque)),
        }
    }

    /// True where the body is bent from within.
    pub fn bend(self) -> bool {
        self.actuation || self.tendons
    }

    /// True where the start counts: a ramp lets the drive grow, and a jump releases the body into it.
    pub fn begin_with_start(self) -> bool {
        self.bend() || self.torque
    }
}

/// True for a signal that is not always zero.
pub(crate) fn gives(signal: &Signal) -> bool {
    signal.constant() != Some(0.0)
}
