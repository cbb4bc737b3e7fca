//! The steps before and after a state, for work that is summed over steps.

use super::controls::Controls;
use super::output::StepInterval;
use super::parameter::ActuationShape;
use super::time_grid::TimeGrid;
use crate::model::Dynamics;
use crate::system::{State, System};
use crate::tendons::MAX_TENDONS;

/// Controls and poses of the head over the steps before and after a state.
#[derive(Debug)]
pub(super) struct StepEnds {
    /// Shapes of the actuation at the previous, the current and the next time.
    pub(super) shapes: [ActuationShape; 3],
    natural: [Vec<f64>; 3],
    active: [Vec<f64>; 3],
    tensions: [[f64; MAX_TENDONS]; 3],
    force: [Vec<f64>; 3],
    /// The step that ends at this time, and the step that begins there.
    pub(super) intervals: [StepInterval; 2],
    scratch: State,
}

impl StepEnds {
    pub(super) fn new(nodes: usize) -> Self {
        Self {
            shapes: std::array::from_fn(|_| ActuationShape::new(nodes)),
            natural: std::array::from_fn(|_| vec![0.0; nodes]),
            active: std::array::from_fn(|_| vec![0.0; nodes]),
            tensions: Default::default(),
            force: std::array::from_fn(|_| vec![0.0; 2 * nodes]),
            intervals: std::array::from_fn(|_| StepInterval {
                natural: vec![0.0; nodes],
                active: vec![0.0; nodes],
                force: vec![0.0; 2 * nodes],
                ..StepInterval::default()
            }),
            scratch: State::zeros(2 * nodes),
        }
    }

    /// Evaluates the steps before and after time `n`. `dynamics` is left at that time.
    pub(super) fn look(&mut self, dynamics: &mut Dynamics, controls: &Controls, problem: TimeGrid, n: usize) {
        let mut poses = [None; 3];
        for (i, m) in [(0, n.saturating_sub(1)), (2, (n + 1).min(problem.count())), (1, n)] {
            let t = problem.time(m);
            controls.apply(dynamics, m);
            dynamics.move_to(t, &mut self.scratch);
            self.shapes[i].take(dynamics, t);
            match &dynamics.active {
                None => self.natural[i].copy_from_slice(&dynamics.natural),
                Some(active) => {
                    self.natural[i].copy_from_slice(&active.natural);
                    self.active[i].copy_from_slice(&active.moment);
                }
            }
            if let Some(force) = &dynamics.inputs.force {
                self.force[i].copy_from_slice(force);
            }
            self.tensions[i] = dynamics.tensions[0];
            poses[i] = dynamics.held;
        }
        for (i, span) in self.intervals.iter_mut().enumerate() {
            span.h = if i == 0 { problem.length(n) } else { problem.length(n + 1) };
            for (k, change) in span.natural.iter_mut().enumerate() {
                *change = self.natural[i + 1][k] - self.natural[i][k];
            }
            for (k, sum) in span.active.iter_mut().enumerate() {
                *sum = self.active[i + 1][k] + self.active[i][k];
            }
            for (k, sum) in span.tensions.iter_mut().enumerate() {
                *sum = self.tensions[i + 1][k] + self.tensions[i][k];
            }
            for (k, change) in span.force.iter_mut().enumerate() {
                *change = self.force[i + 1][k] - self.force[i][k];
            }
            span.poses = poses[i].zip(poses[i + 1]).map(|(from, to)| [from, to]);
        }
    }
}
