//! FMUs: a scene as a component for co-simulation hosts, by the FMI standard, versions 2.0 and 3.0.
//!
//! An FMU is a zip file with the description of the variables (`modelDescription.xml`), the shared library of
//! `bindings/fmi`, the scene in `resources/`, and documentation. Library and description agree on the variables through
//! the [`Catalogue`].

#[cfg(feature = "fmu")]
mod description;
#[cfg(feature = "fmu")]
mod document;
#[cfg(feature = "fmu")]
mod package;
#[cfg(feature = "fmu")]
mod terminals;

use crate::integrator::StepControl;
use crate::scene::Scene;
use crate::scene::parameter::Parameter;
use crate::stepper::Stepper;
use crate::variable::{Causality, VARIABLES, Variable};
#[cfg(feature = "fmu")]
pub use package::{Choice, Fmu, library, library_name};

/// A version of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standard {
    /// FMI 2.0: every entry of an array is a variable of its own.
    Fmi2,
    /// FMI 3.0: arrays, whose sizes follow from the structural parameter `nodes`.
    Fmi3,
}

/// The categories of log messages, with what they say.
pub const LOG_CATEGORIES: [(&str, &str); 4] = [
    ("logStatusWarning", "what was done otherwise than asked for"),
    ("logStatusDiscard", "a step that could not be made; everything is as it was before the call"),
    ("logStatusError", "a call that the standard or the model does not allow"),
    ("logSteps", "every communication step: its internal steps and iterations"),
];

/// The name of the structural parameter.
pub const NODES: &str = "nodes";

/// The name of the internal step.
const TIME_STEP: &str = "time_step_s";

/// The variables and parameters of a scene with the value references of both versions.
///
/// FMI 3.0: the place in [`VARIABLES`], or [`PARAMETERS`](Self::PARAMETERS) plus the place among the parameters. FMI 2.0: the
/// same, times 2²⁴ plus the node; so both are looked up by arithmetic.
#[derive(Debug)]
pub struct Catalogue {
    /// The scene's own values.
    pub parameters: Vec<Parameter>,
    exists: Vec<bool>,
}

/// What a value reference stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// A variable by its place in [`VARIABLES`], and a node.
    Variable(usize, usize),
    /// A parameter by its place.
    Parameter(usize),
}

/// Bits of a node in a value reference of FMI 2.0.
const NODE_BITS: u32 = 24;

impl Catalogue {
    /// Where the parameters begin; there are fewer variables than that, and a place fits beside a node in 32 bits.
    pub const PARAMETERS: u32 = 200;

    /// The catalogue of a scene and its stepper.
    pub fn of(scene: &Scene, stepper: &Stepper) -> Self {
        let exists = VARIABLES.iter().map(|variable| variable.exists_in(stepper.model())).collect();
        Self { parameters: scene.parameters(), exists }
    }

    /// The variables that the scene has, with their places.
    pub fn variables(&self) -> impl Iterator<Item = (usize, &'static Variable)> + '_ {
        VARIABLES.iter().enumerate().filter(|(i, _)| self.exists[*i])
    }

    /// Causality and variability of a variable of `stepper`, in the standards' words.
    pub fn role(variable: &Variable, stepper: &Stepper) -> [&'static str; 2] {
        /// Outputs that count, and so change at internal steps alone.
        const COUNTS: [&str; 4] = ["steps", "newton_iterations", "step_halvings", "cycles_used"];
        match variable.causality {
            Causality::Independent => ["independent", "continuous"],
            Causality::Input => ["input", "continuous"],
            Causality::Output if COUNTS.contains(&variable.name) => ["output", "discrete"],
            Causality::Output => ["output", "continuous"],
            Causality::Parameter
                if variable.name == TIME_STEP && matches!(stepper.pace(), StepControl::Adaptive(_)) =>
            {
                ["output", "discrete"]
            }
            Causality::Parameter if stepper.can_be_retuned() && Self::follows_stiffness(variable, stepper) => {
                ["calculatedParameter", "tunable"]
            }
            Causality::Parameter => ["calculatedParameter", "fixed"],
        }
    }

    fn follows_stiffness(variable: &Variable, stepper: &Stepper) -> bool {
        variable.follows_parameter("rod.youngs_modulus_pa", stepper.view().dynamics, stepper.form())
    }

    /// The places of the parameters that `variable` follows at once between steps of `stepper`.
    pub fn followed_parameters(&self, variable: &Variable, stepper: &Stepper) -> impl Iterator<Item = usize> {
        let (dynamics, form) = (stepper.view().dynamics, stepper.form());
        let follows = |place: &usize| {
            self.is_tunable(*place, stepper) && variable.follows_parameter(&self.parameters[*place].key, dynamics, form)
        };
        (0..self.parameters.len()).filter(follows).collect::<Vec<_>>().into_iter()
    }

    /// True if the parameter at this place may change between steps of `stepper`.
    pub fn is_tunable(&self, place: usize, stepper: &Stepper) -> bool {
        self.parameters[place].is_tunable() && stepper.can_be_retuned()
    }

    /// What a reference of FMI 3.0 stands for; the node is 0.
    #[inline]
    pub fn target(&self, reference: u32) -> Option<Target> {
        if (reference as usize) < VARIABLES.len() {
            return self.exists[reference as usize].then_some(Target::Variable(reference as usize, 0));
        }
        let place = reference.checked_sub(Self::PARAMETERS)? as usize;
        (place < self.parameters.len()).then_some(Target::Parameter(place))
    }

    /// What a reference of FMI 2.0 stands for; whether the variable has that node is not looked at.
    #[inline]
    pub fn scalar_target(&self, reference: u32) -> Option<Target> {
        let (place, node) = (reference >> NODE_BITS, (reference & ((1 << NODE_BITS) - 1)) as usize);
        match self.target(if place == Self::PARAMETERS { Self::PARAMETERS + node as u32 } else { place })? {
            Target::Variable(place, _) => Some(Target::Variable(place, node)),
            parameter => Some(parameter),
        }
    }

    /// The reference of a target.
    pub fn reference(standard: Standard, target: Target) -> u32 {
        match (standard, target) {
            (Standard::Fmi3, Target::Variable(place, _)) => place as u32,
            (Standard::Fmi3, Target::Parameter(place)) => Self::PARAMETERS + place as u32,
            (Standard::Fmi2, Target::Variable(place, node)) => (place as u32) << NODE_BITS | node as u32,
            (Standard::Fmi2, Target::Parameter(place)) => Self::PARAMETERS << NODE_BITS | place as u32,
        }
    }
}

/// What a host must show to get an instance: it names the scene and the version of the program.
pub fn token(scene: &Scene) -> String {
    format!("{{{}}}", scene.fingerprint_text())
}
