//! Checkpoints: the states of a simulation that are stored for its adjoint.

use super::controls::Controls;
use super::time_grid::TimeGrid;
use super::trajectory::Trajectory;
use crate::error::Result;
use crate::integrator::Integrator;
use crate::model::Dynamics;
use crate::newton::Newton;
use crate::system::State;

/// If the states of a simulation take more memory than this (bytes), only some of them are stored.
const MOST_KEPT: usize = 64 << 20;

/// All states of a simulation if they are few. Otherwise every k-th state, with k about the square root of their number; the
/// adjoint repeats the steps in between, one interval at a time (Griewank, Optim. Methods Softw. 1, 35, 1992, with one level).
/// Memory then grows with the square root of the number of steps, and each step is made twice.
#[derive(Debug)]
pub(crate) struct Checkpoints {
    /// The number of steps between stored states.
    every: usize,
    /// Number of states so far.
    count: usize,
    kept: Trajectory,
    /// The method's memory at the stored states, if it has one.
    memory: Vec<f64>,
}

impl Checkpoints {
    /// Creates empty checkpoints for states of that many `unknowns` at that many `times`.
    pub(crate) fn of(unknowns: usize, times: usize) -> Self {
        let few = 3 * size_of::<f64>() * unknowns * times <= MOST_KEPT;
        Self::at_multiples_of(if few { 1 } else { times.isqrt() })
    }

    pub(super) fn at_multiples_of(every: usize) -> Self {
        Self { every, count: 0, kept: Trajectory::default(), memory: Vec::new() }
    }

    /// Adds the next state.
    pub(crate) fn push(&mut self, state: &State) {
        if self.count.is_multiple_of(self.every) {
            self.kept.push(state);
            if self.every > 1 {
                self.memory.extend_from_slice(&state.memory);
            }
        }
        self.count += 1;
    }

    /// The states, for access in reverse order.
    pub(super) fn states(&self) -> ReverseStates<'_> {
        ReverseStates { every: self.every, kept: &self.kept, memory: &self.memory, interval: None }
    }
}

/// Solves the steps of a simulation.
#[derive(Debug)]
pub(super) struct StepSolver<'a> {
    pub(super) newton: Newton,
    pub(super) integrator: &'a mut dyn Integrator,
    pub(super) controls: &'a Controls,
    pub(super) grid: TimeGrid,
}

impl StepSolver<'_> {
    /// Advances `state` by the step to time `n`; `next` is a work array.
    pub(super) fn step(&mut self, dynamics: &mut Dynamics, n: usize, [state, next]: [&mut State; 2]) -> Result<()> {
        next.t = self.grid.time(n);
        self.controls.apply(dynamics, n);
        self.integrator.step(dynamics, &mut self.newton, state, self.grid.length(n), next)?;
        std::mem::swap(state, next);
        Ok(())
    }
}

/// The states of a simulation, read from the last to the first.
#[derive(Debug)]
pub(super) struct ReverseStates<'a> {
    every: usize,
    kept: &'a Trajectory,
    memory: &'a [f64],
    /// The index of a stored state, and the states from there to the next one.
    interval: Option<(usize, Trajectory)>,
}

impl<'a> ReverseStates<'a> {
    /// The states of a trajectory, which has all of them.
    pub(super) fn of(trajectory: &'a Trajectory) -> Self {
        Self { every: 1, kept: trajectory, memory: &[], interval: None }
    }

    /// Writes state `n`, without the method's memory. `dynamics` may be left at another time.
    pub(super) fn load(
        &mut self,
        n: usize,
        state: &mut State,
        dynamics: &mut Dynamics,
        steps: &mut StepSolver<'_>,
    ) -> Result<()> {
        if self.every == 1 {
            self.kept.load(n, state);
            return Ok(());
        }
        let has = |(first, states): &(usize, Trajectory)| (*first..first + states.times.len()).contains(&n);
        let (first, states) = match self.interval.take_if(|interval| has(interval)) {
            Some(interval) => interval,
            None => self.repeat(n.saturating_sub(1) / self.every, state, dynamics, steps)?,
        };
        states.load(n - first, state);
        self.interval = Some((first, states));
        Ok(())
    }

    /// Repeats the steps from stored state `i` to the next one. `state` is a work array.
    fn repeat(
        &self,
        i: usize,
        state: &mut State,
        dynamics: &mut Dynamics,
        steps: &mut StepSolver<'_>,
    ) -> Result<(usize, Trajectory)> {
        let first = i * self.every;
        self.kept.load(i, state);
        let width = self.memory.len() / self.kept.times.len();
        state.memory.clear();
        state.memory.extend_from_slice(&self.memory[i * width..(i + 1) * width]);
        let mut next = state.clone();
        let mut states = Trajectory::default();
        states.push(state);
        for n in first + 1..=(first + self.every).min(steps.grid.count()) {
            steps.step(dynamics, n, [&mut *state, &mut next])?;
            states.push(state);
        }
        Ok((first, states))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may panic")]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scene::Document;
    use crate::sensitivity::{Output, Parameter, Problem};
    use crate::variable::VARIABLES;

    #[test]
    fn steps_that_are_made_again_give_the_same_derivatives_to_the_bit() {
        let mut tried = 0;
        for file in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("models")).unwrap() {
            let path = file.unwrap().path();
            let Ok(mut document) = Document::read(&path) else { continue };
            let Ok(Ok(own)) = document.scene().map(|scene| Problem::of(&scene)) else { continue };
            let times = own.times();
            if own.model().rod.nodes > 100 || times.len() < 40 {
                continue;
            }
            document.set(&format!("solver.duration_s={:e}", 0.5 * (times[37] + times[38]))).unwrap();
            let Ok(scene) = document.scene() else { continue };
            let mut problem = Problem::of(&scene).unwrap();
            let recorded =
                VARIABLES.iter().filter(|v| v.recorded && v.name != "time_s" && v.exists_in(problem.model()));
            let outputs: Vec<Output> =
                recorded.map(|variable| Output::named(variable.name, problem.model()).unwrap()).collect();
            let parameters: Vec<Parameter> = problem.model().rod.joints().map(Parameter::Stiffness).collect();
            let weights: Vec<f64> =
                (0..outputs.len() * problem.times().len()).map(|i| (0.7 * i as f64).sin()).collect();
            let mut derivatives = |every: usize| {
                let mut checkpoints = Checkpoints::at_multiples_of(every);
                problem.forward(&[], &outputs, 1, |state| checkpoints.push(state)).unwrap();
                problem.adjoint_of(&parameters, &outputs, &weights, &checkpoints).unwrap()
            };
            let all = derivatives(1);
            // The last interval is partial, complete, or empty.
            for every in [6, 19, 38, 100] {
                assert_eq!(all, derivatives(every), "{}, every {every} steps", path.display());
            }
            tried += 1;
        }
        assert!(tried >= 10, "{tried} scenes");
    }

    #[test]
    fn few_states_are_all_kept_and_of_many_the_root_of_their_number() {
        assert_eq!(Checkpoints::of(66, 2000).every, 1);
        let many = Checkpoints::of(2000, 10_000);
        assert_eq!(many.every, 100);
    }
}
