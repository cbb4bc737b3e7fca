//! States of an instance: copied, gone back to, and as bytes.

use caudal::model::course::HIGHEST_ORDER;
use caudal::scene::NODES;
use caudal::stepper::snapshot::{self, Snapshot};
use caudal::variable::{Size, VARIABLES, Variable};
use serde::{Deserialize, Serialize};

use super::values::Inputs;
use super::{Experiment, Instance, Mode, Settings};
use crate::status::{Outcome, refuse};

/// A saved state of an instance.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SavedState {
    mode: Mode,
    settings: Settings,
    experiment: Experiment,
    inputs: Inputs,
    snapshot: Snapshot,
}

impl Instance {
    /// A copy of everything that changes.
    pub fn save(&mut self) -> Outcome<SavedState> {
        let snapshot = self.ready()?.save();
        let (settings, experiment, inputs) = (self.settings.clone(), self.experiment, self.inputs.clone());
        Ok(SavedState { mode: self.mode, settings, experiment, inputs, snapshot })
    }

    /// Goes back to a saved state.
    pub fn restore(&mut self, state: &SavedState) -> Outcome {
        let before = (self.settings.clone(), self.stepper.own.take(), self.stale);
        if self.settings == state.settings && !self.stale {
            self.stepper.own = before.1;
        } else {
            self.settings = state.settings.clone();
            match self.build() {
                Ok(stepper) => self.stepper.own = Some(Box::new(stepper)),
                Err(error) => {
                    (self.settings, self.stepper.own, self.stale) = before;
                    return Err(error.into());
                }
            }
        }
        self.size();
        (self.stale, self.untuned) = (false, None);
        if let Some(stepper) = &mut self.stepper.own {
            stepper.restore(&state.snapshot)?;
        }
        self.inputs.clone_from(&state.inputs);
        (self.mode, self.experiment) = (state.mode, state.experiment);
        Ok(())
    }

    /// A saved state as bytes, which any instance of this scene takes over.
    pub fn serialize(&self, state: &SavedState) -> Outcome<Vec<u8>> {
        Ok(snapshot::seal(self.scene.fingerprint(), state)?)
    }

    /// The saved state in `bytes`.
    pub fn deserialize(&self, bytes: &[u8]) -> Outcome<SavedState> {
        let state: SavedState = snapshot::open(self.scene.fingerprint(), bytes)?;
        let Inputs { values, waiting } = &state.inputs;
        let nodes = state.settings.nodes as usize;
        let fits = |(values, variable): (&[Vec<f64>; HIGHEST_ORDER + 1], &Variable)| {
            let len = if variable.size == Size::Scalar { 1 } else { nodes };
            values.iter().all(|values| values.is_empty() || values.len() == len)
        };
        let of_value = |[place, order]: &[usize; 2]| {
            values.get(*place).and_then(|values| values.get(*order)).is_some_and(|values| !values.is_empty())
        };
        let [least, most] = NODES.map(|nodes| nodes + self.scene.front() as u64);
        let same = (least..=most).contains(&state.settings.nodes)
            && state.settings.parameters.len() == self.settings.parameters.len()
            && values.len() == VARIABLES.len()
            && values.iter().zip(VARIABLES).all(fits)
            && waiting.iter().all(of_value);
        if same { Ok(state) } else { refuse("the saved state cannot be read: its sizes are not this scene's") }
    }
}
