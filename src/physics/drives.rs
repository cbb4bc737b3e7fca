//! The drives of a body. A body without drives only follows its head, its loads and the flow.

use crate::head::Signal;
use crate::model::Model;
use crate::tendons::{Pull, rest_length};

/// The drives of a body, apart from the inputs of a host.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Drives {
    /// A wave of natural curvature or of active moments.
    pub actuation: bool,
    /// Tendons that are pulled.
    pub tendons: bool,
    /// A torque of a hinge's motor that the scene prescribes.
    pub torque: bool,
}

impl Drives {
    /// The drives of `model`.
    pub fn of(model: &Model) -> Self {
        Self {
            actuation: model.actuation.is_some(),
            tendons: model.tendons.iter().any(|tendon| match &tendon.pull {
                Pull::Tension(tension) => gives(tension),
                // A cable of this length is slack along the straight rod.
                Pull::Winch(winch) => winch.length.constant() != Some(rest_length(&model.rod, tendon.edges.clone())),
            }),
            torque: model.hinge.as_ref().is_some_and(|hinge| gives(&hinge.torque)),
        }
    }

    /// True if the body is bent from within.
    pub fn bend(self) -> bool {
        self.actuation || self.tendons
    }

    /// True if the kind of start matters: a ramp increases the drive gradually, a jump releases the body into it.
    pub fn begin_with_start(self) -> bool {
        self.bend() || self.torque
    }
}

/// True for a signal that is not constantly zero.
pub(crate) fn gives(signal: &Signal) -> bool {
    signal.constant() != Some(0.0)
}
