//! Saved states of an instance, in memory or serialised.

use caudal::scene::NODES;
use caudal::stepper::snapshot::{self, Snapshot};
use caudal::variable::{Size, VARIABLES};
use serde::{Deserialize, Serialize};

use super::values::SetInputs;
use super::{Experiment, Instance, InstanceMode, Settings};
use crate::status::{FmiResult, refuse};

/// A saved state of an instance: everything that changes during a run.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SavedState {
    mode: InstanceMode,
    experiment: Experiment,
    host_time: Option<f64>,
    /// The settings and the snapshot of the stepper.
    built: Settings,
    snapshot: Snapshot,
    /// The inputs that the host has set since.
    settings: Settings,
    stale: bool,
    inputs: SetInputs,
}

impl Instance {
    /// A copy of everything that changes during a run.
    pub fn save(&self) -> FmiResult<SavedState> {
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

    /// Restores a saved state. Nothing changes on error.
    pub fn restore(&mut self, state: &SavedState) -> FmiResult {
        match &mut self.stepper.own {
            Some(stepper) if self.built == state.built => stepper.restore(&state.snapshot)?,
            _ => {
                let (document, scene) = self.configured(&state.built)?;
                let mut stepper = document.stepper(&scene)?;
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

    /// Serialises a saved state, for any instance of this scene.
    pub fn serialize(&self, state: &SavedState) -> FmiResult<Vec<u8>> {
        Ok(snapshot::seal(self.scene.fingerprint(), state)?)
    }

    /// Deserialises a saved state.
    pub fn deserialize(&self, bytes: &[u8]) -> FmiResult<SavedState> {
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
        if same { Ok(state) } else { refuse("the saved state cannot be read: its sizes do not match this scene") }
    }
}
