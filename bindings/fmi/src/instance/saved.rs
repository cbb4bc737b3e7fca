//! States of an instance: copied, gone back to, and as bytes.

use caudal::scene::NODES;
use caudal::stepper::Stepper;
use caudal::stepper::snapshot::{self, Snapshot};
use caudal::variable::{Size, VARIABLES};
use serde::{Deserialize, Serialize};

use super::values::SetInputs;
use super::{Experiment, Instance, Mode, Settings};
use crate::status::{Outcome, refuse};

/// A saved state of an instance: all of it that changes.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SavedState {
    mode: Mode,
    experiment: Experiment,
    host_time: Option<f64>,
    /// What the stepper was built with, and where it was.
    built: Settings,
    snapshot: Snapshot,
    /// What the host has set since.
    settings: Settings,
    stale: bool,
    inputs: SetInputs,
}

impl Instance {
    /// A copy of everything that changes.
    pub fn save(&self) -> Outcome<SavedState> {
        let Some(stepper) = self.stepper.get() else { return refuse("there is no model") };
        Ok(SavedState {
            mode: self.mode,
            experiment: self.experiment,
            host_time: self.host_time,
            built: self.built.clone(),
            snapshot: stepper.save(),
            settings: self.settings.clone(),
            stale: self.stale,
            inputs: self.inputs.clone(),
        })
    }

    /// Goes back to a saved state, or changes nothing.
    pub fn restore(&mut self, state: &SavedState) -> Outcome {
        match &mut self.stepper.own {
            Some(stepper) if self.built == state.built => stepper.restore(&state.snapshot)?,
            _ => {
                let mut stepper = Stepper::of(&self.configured(&state.built)?)?;
                stepper.restore(&state.snapshot)?;
                self.stepper.own = Some(Box::new(stepper));
                self.built.clone_from(&state.built);
            }
        }
        self.settings.clone_from(&state.settings);
        self.inputs.clone_from(&state.inputs);
        (self.mode, self.experiment) = (state.mode, state.experiment);
        (self.host_time, self.stale) = (state.host_time, state.stale);
        self.size();
        Ok(())
    }

    /// A saved state as bytes, which any instance of this scene takes over.
    pub fn serialize(&self, state: &SavedState) -> Outcome<Vec<u8>> {
        Ok(snapshot::seal(self.scene.fingerprint(), state)?)
    }

    /// The saved state in `bytes`.
    pub fn deserialize(&self, bytes: &[u8]) -> Outcome<SavedState> {
        let state: SavedState = snapshot::open(self.scene.fingerprint(), bytes)?;
        let [least, most] = NODES.map(|nodes| nodes + self.scene.front() as u64);
        let of_scene = |settings: &Settings| {
            (least..=most).contains(&settings.nodes) && settings.parameters.len() == self.settings.parameters.len()
        };
        let len = |place: usize| {
            let variable = VARIABLES.get(place).filter(|variable| variable.is_input())?;
            Some(if variable.size == Size::Scalar { 1 } else { state.settings.nodes as usize })
        };
        let same = of_scene(&state.built) && of_scene(&state.settings) && state.inputs.fits(len);
        if same { Ok(state) } else { refuse("the saved state cannot be read: its sizes are not this scene's") }
    }
}
