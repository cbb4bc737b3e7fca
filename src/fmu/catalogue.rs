//! The table of FMI variables: which variables and parameters a scene has, their value references, causality and variability.

use crate::integrator::StepControl;
use crate::scene::Scene;
use crate::scene::parameter::ScalarParameter;
use crate::stepper::Stepper;
use crate::variable::{Causality, VARIABLES, Variable};

/// A version of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standard {
    /// FMI 2.0: each array entry is a scalar variable.
    Fmi2,
    /// FMI 3.0: arrays, whose sizes are given by the structural parameter `nodes`.
    Fmi3,
}

/// The categories of log messages, with their descriptions.
pub const LOG_CATEGORIES: [(&str, &str); 4] = [
    ("logStatusWarning", "deviations from what was requested"),
    ("logStatusDiscard", "a step that failed; the state is as before the call"),
    ("logStatusError", "a call that the standard or the model does not allow"),
    ("logSteps", "every communication step: its internal steps and iterations"),
];

/// The name of the structural parameter for the number of nodes.
pub const NODES: &str = "nodes";

/// The name of the variable for the internal step.
pub(super) const TIME_STEP: &str = "time_step_s";

/// The variables and parameters of a scene with the value references of both versions.
///
/// FMI 3.0: the index in [`VARIABLES`], or [`PARAMETERS`](Self::PARAMETERS) plus the index among the parameters. FMI 2.0: the
/// same times 2²⁴, plus the node. Both are therefore looked up by arithmetic.
#[derive(Debug)]
pub struct Catalogue {
    /// The parameters of the scene.
    pub parameters: Vec<ScalarParameter>,
    exists: Vec<bool>,
}

/// What a value reference refers to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// A variable by its index in [`VARIABLES`], and a node.
    Variable(usize, usize),
    /// A parameter by its index.
    Parameter(usize),
}

/// Bits of the node in a value reference of FMI 2.0.
const NODE_BITS: u32 = 24;

impl Catalogue {
    /// Value reference of the first parameter. There are fewer variables than this, and an index with a node fits into 32 bits.
    pub const PARAMETERS: u32 = 200;

    /// The catalogue of a scene and its stepper.
    pub fn of(scene: &Scene, stepper: &Stepper) -> Self {
        let exists = VARIABLES.iter().map(|variable| variable.exists_in(stepper.model())).collect();
        Self { parameters: scene.parameters(), exists }
    }

    /// The variables of the scene, with their indices.
    pub fn variables(&self) -> impl Iterator<Item = (usize, &'static Variable)> + '_ {
        VARIABLES.iter().enumerate().filter(|(i, _)| self.exists[*i])
    }

    /// Causality and variability of a variable of `stepper`, as named by the standard.
    pub fn role(variable: &Variable, stepper: &Stepper) -> [&'static str; 2] {
        /// Counters, which change only at internal steps.
        const COUNTS: [&str; 4] = ["steps", "newton_iterations", "step_halvings", "cycles_used"];
        match variable.causality {
            Causality::Independent => ["independent", "continuous"],
            Causality::Input => ["input", "continuous"],
            Causality::Output if COUNTS.contains(&variable.name) => ["output", "discrete"],
            Causality::Output => ["output", "continuous"],
            Causality::Parameter
                if variable.name == TIME_STEP && matches!(stepper.step_control(), StepControl::Adaptive(_)) =>
            {
                ["output", "discrete"]
            }
            Causality::Parameter if stepper.can_change_parameters() && Self::follows_stiffness(variable, stepper) => {
                ["calculatedParameter", "tunable"]
            }
            Causality::Parameter => ["calculatedParameter", "fixed"],
        }
    }

    fn follows_stiffness(variable: &Variable, stepper: &Stepper) -> bool {
        variable.follows_parameter("rod.youngs_modulus_pa", stepper.view().dynamics, stepper.form())
    }

    /// Indices of the parameters on which `variable` depends directly between steps of `stepper`.
    pub fn followed_parameters(&self, variable: &Variable, stepper: &Stepper) -> impl Iterator<Item = usize> {
        let (dynamics, form) = (stepper.view().dynamics, stepper.form());
        let follows = |place: &usize| {
            self.is_tunable(*place, stepper) && variable.follows_parameter(&self.parameters[*place].key, dynamics, form)
        };
        (0..self.parameters.len()).filter(follows).collect::<Vec<_>>().into_iter()
    }

    /// True if the parameter with this index may change between steps of `stepper`.
    pub fn is_tunable(&self, place: usize, stepper: &Stepper) -> bool {
        self.parameters[place].is_tunable() && stepper.can_change_parameters()
    }

    /// The target of a value reference of FMI 3.0; its node is 0.
    #[inline]
    pub fn target(&self, reference: u32) -> Option<Target> {
        if (reference as usize) < VARIABLES.len() {
            return self.exists[reference as usize].then_some(Target::Variable(reference as usize, 0));
        }
        let place = reference.checked_sub(Self::PARAMETERS)? as usize;
        (place < self.parameters.len()).then_some(Target::Parameter(place))
    }

    /// The target of a value reference of FMI 2.0; the node is not checked.
    #[inline]
    pub fn scalar_target(&self, reference: u32) -> Option<Target> {
        let (place, node) = (reference >> NODE_BITS, (reference & ((1 << NODE_BITS) - 1)) as usize);
        match self.target(if place == Self::PARAMETERS { Self::PARAMETERS + node as u32 } else { place })? {
            Target::Variable(place, _) => Some(Target::Variable(place, node)),
            parameter => Some(parameter),
        }
    }

    /// The value reference of a target.
    pub fn reference(standard: Standard, target: Target) -> u32 {
        match (standard, target) {
            (Standard::Fmi3, Target::Variable(place, _)) => place as u32,
            (Standard::Fmi3, Target::Parameter(place)) => Self::PARAMETERS + place as u32,
            (Standard::Fmi2, Target::Variable(place, node)) => (place as u32) << NODE_BITS | node as u32,
            (Standard::Fmi2, Target::Parameter(place)) => Self::PARAMETERS << NODE_BITS | place as u32,
        }
    }
}

/// The instantiation token: it identifies the scene and the version of the program.
pub fn token(scene: &Scene) -> String {
    format!("{{{}}}", scene.fingerprint_text())
}
