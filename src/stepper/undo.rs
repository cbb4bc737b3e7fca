//! Taking back a step that failed: everything is then as it was before the call.

use super::Stepper;
use super::run_state::SavedState;

/// What there was before the step that is under way. It is kept only once a step can fail halfway: before the first of several
/// internal steps, of a halved one, or before inputs act.
#[derive(Debug, Default)]
pub(super) struct Undo {
    /// What there was is in `room`.
    kept: bool,
    /// Room after the first step that needed it.
    room: Option<Box<SavedState>>,
}

impl Undo {
    /// A step begins.
    pub(super) fn begin(&mut self) {
        self.kept = false;
    }
}

impl Stepper {
    /// Keeps what there is, unless it was kept before in this step.
    pub(super) fn save_for_undo(&mut self) {
        if self.undo.kept {
            return;
        }
        self.undo.kept = true;
        match self.undo.room.take() {
            Some(mut room) => {
                self.copy_to(&mut room);
                self.undo.room = Some(room);
            }
            None => self.undo.room = Some(Box::new(self.saved())),
        }
    }

    /// Goes back to what was kept of this step; where nothing was, the step has changed nothing but the counts of its attempt.
    pub(super) fn undo_step(&mut self) {
        match self.undo.room.take() {
            Some(room) if self.undo.kept => {
                self.restore_saved(&room);
                self.undo.room = Some(room);
            }
            room => {
                self.undo.room = room;
                self.discard_step();
            }
        }
    }
}
