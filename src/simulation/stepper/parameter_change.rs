//! Change of tunable parameters, such as stiffness or drag, between steps: the model changes and the motion continues.

use super::Stepper;
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::system::Form;

impl Stepper {
    /// True if [`change_parameters`](Self::change_parameters) is possible: for a scene's own model, except in the chain form,
    /// whose state has moments in place of curvatures.
    pub fn can_change_parameters(&self) -> bool {
        self.source_scene.is_some() && self.form() != Form::Chain
    }

    /// Continues as `scene`, which may differ from this scene in tunable parameters only
    /// ([`Parameter::is_tunable`](crate::scene::parameter::ScalarParameter::is_tunable)). State, inputs and totals stay;
    /// accelerations follow with the next step. The energy that a change of stiffness adds or removes at once does not count as
    /// an error of the energy balance.
    ///
    /// # Errors
    /// Errors of the scene; [`Error::Scene`] if anything else differs, and for a stepper of a model other than the scene's own;
    /// [`Error::Fmu`] in the chain form. On error nothing is changed.
    pub fn change_parameters(&mut self, scene: &Scene) -> Result<()> {
        let Some(own) = &self.source_scene else {
            let problem = "the stepper was made from a model without a scene; allowed: another stepper";
            return Err(scene.error("", problem.to_string()));
        };
        if !self.can_change_parameters() {
            let problem = "parameters are fixed in the chain form; allowed: with solver.form = \"positions\"";
            return Err(Error::Fmu(problem.to_string()));
        }
        if let Some(key) = own.differs_beyond_tuning(scene) {
            let problem = "differs from the stepper's scene; allowed between steps: other numbers for the stiffness and \
                 for rod.damping_time_s where it is one number, those of [drag] and reactive.shedding, if both scenes have them; otherwise create a new stepper of this scene";
            return Err(scene.error(&key, problem.to_string()));
        }
        let mut other = Self::in_form(scene, Some(self.form()))?;
        let mut now = self.save();
        now.scene = other.scene;
        other.restore(&now)?;
        other.measurements.measure(&mut other.dynamics, &other.now.state)?;
        let before = other.now.metrics.now.energy.total();
        std::mem::swap(&mut other.now.metrics.now, &mut other.measurements);
        other.now.metrics.first_energy += other.now.metrics.now.energy.total() - before;
        other.now.needs_reinitialisation = true;
        *self = other;
        Ok(())
    }
}
