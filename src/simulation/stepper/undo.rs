//! Undo of a failed step: the stepper is then as it was before the call.

use super::Stepper;
use super::run_state::SavedRun;

/// The saved state before the current step. It is saved only if the step may fail halfway: before the first of several internal steps,
/// before a halved one, or before inputs jump.
#[derive(Debug, Default)]
pub(super) struct Undo {
    /// True if `saved` holds the state before this step.
    kept: bool,
    /// Allocated by the first step that needs it.
    saved: Option<Box<SavedRun>>,
}

impl Undo {
    /// Begins a step.
    pub(super) fn begin(&mut self) {
        self.kept = false;
    }

    /// Returns the state before the last step, if it was saved, to be [returned](Self::give_back) later.
    pub(super) fn saved_in_step(&mut self) -> Option<Box<SavedRun>> {
        self.saved.take_if(|_| self.kept)
    }

    /// Restores `saved` as the saved state.
    pub(super) fn give_back(&mut self, saved: Box<SavedRun>) {
        self.saved = Some(saved);
    }
}

impl Stepper {
    /// Saves the current state, unless this step has already saved one.
    pub(super) fn save_for_undo(&mut self) {
        if self.undo.kept {
            return;
        }
        self.undo.kept = true;
        match self.undo.saved.take() {
            Some(mut saved) => {
                self.copy_to(&mut saved);
                self.undo.saved = Some(saved);
            }
            None => self.undo.saved = Some(Box::new(self.saved())),
        }
    }

    /// Restores the state saved in this step. If none was saved, the step has changed nothing but counts.
    pub(super) fn undo_step(&mut self) {
        match self.undo.saved.take() {
            Some(saved) if self.undo.kept => {
                self.restore_saved(&saved);
                self.undo.saved = Some(saved);
            }
            saved => {
                self.undo.saved = saved;
                self.discard_step();
            }
        }
    }
}
