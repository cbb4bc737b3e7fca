//! A model that changes between steps: stiffness or drag are others from now on, the motion goes on.

use super::Stepper;
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::system::Form;

impl Stepper {
    /// Goes on as `scene`, whose tunable parameters alone differ from this one's
    /// ([`Parameter::is_tunable`](crate::scene::parameter::Parameter::is_tunable)): state, inputs and totals stay, accelerations
    /// follow with the next step. The energy that a stiffness gives or takes at once is no defect of the balance.
    ///
    /// # Errors
    /// Those of the scene; [`Error::Fmu`] in the chain form, whose state has moments, not curvatures; nothing is changed then.
    pub fn retune(&mut self, scene: &Scene) -> Result<()> {
        if self.form() == Form::Chain {
            let problem = "parameters are fixed in the chain form; allowed: with solver.form = \"positions\"";
            return Err(Error::Fmu(problem.to_string()));
        }
        let mut other = Self::of(scene)?;
        let mut now = self.save();
        now.scene = other.scene;
        other.restore(&now)?;
        other.reading.take(&mut other.dynamics, &other.state)?;
        let before = other.meter.now.energy.total();
        std::mem::swap(&mut other.meter.now, &mut other.reading);
        other.meter.first_energy += other.meter.now.energy.total() - before;
        other.kick.due = true;
        *self = other;
        Ok(())
    }
}
