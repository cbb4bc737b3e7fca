//! The answer in other simulations: with half the step, by another method, on a finer mesh, by a higher law of the fluid. Each of them,
//! of the design or of what was before, in each of the scenes that it is for, is a simulation of its own, wherever it is run.

use std::ops::ControlFlow;

use super::cases::Case;
use super::markers::Markers;
use super::memory::Memory;
use super::report::{Check, changed, gain_percent, simulations};
use super::search::Objective;
use super::table::Table;
use super::trust::higher_fluids;
use super::unknowns::Profile;
use crate::jobs;
use crate::scene::{Document, Scene};
use crate::sensitivity::Problem;

/// The simulations of a design of `table`.
pub(super) struct Checks<'a> {
    table: &'a Table,
    target: Option<&'a Markers>,
    /// Each in words, and what it changes.
    simulations: Vec<(String, Vec<String>)>,
    scenes: Vec<Checked>,
}

/// One of the scenes that a design is for.
struct Checked {
    document: Document,
    /// The design, and what was before.
    profiles: [Option<Profile>; 2],
}

impl<'a> Checks<'a> {
    /// Those of `profile`, designed for the scene of `document` or for `cases`, to come close to `target` where there is one.
    pub fn of(
        (document, cases): (&Document, &[Case]),
        scene: &Scene,
        table: &'a Table,
        target: Option<&'a Markers>,
        profile: &Profile,
    ) -> Self {
        let before = Problem::of(scene).ok().map(|problem| Profile::before(table, &problem.stiffness()));
        let allowed = |(_, changes): &(String, Vec<String>)| {
            changed(document, &table.numbers, changes, profile).is_ok_and(|scene| scene.model().is_ok())
        };
        let fluid = higher_fluids(scene).into_iter().filter(|_| before.is_some()).find(allowed);
        let simulations = simulations(scene).into_iter().chain(fluid).collect();
        let profiles = [Some(profile.clone()), before];
        let of = |case: &Case| Checked {
            document: case.document.clone(),
            profiles: [0, 1].map(|i| profiles[i].as_ref().map(|profile| case.profile(profile))),
        };
        let scenes = if cases.is_empty() {
            vec![Checked { document: document.clone(), profiles }]
        } else {
            cases.iter().map(of).collect()
        };
        Self { table, target, simulations, scenes }
    }

    /// Number of simulations.
    pub fn count(&self) -> usize {
        self.simulations.len() * 2 * self.scenes.len()
    }

    /// What simulation `index` changes, and in which scene it is of which profile.
    fn at(&self, index: usize) -> (&(String, Vec<String>), &Checked, Option<&Profile>) {
        let (rest, scene) = (index / self.scenes.len(), &self.scenes[index % self.scenes.len()]);
        (&self.simulations[rest / 2], scene, scene.profiles[rest % 2].as_ref())
    }

    /// Simulation `index` in words.
    pub fn describe(&self, index: usize) -> String {
        let ((name, _), ..) = self.at(index);
        let which = ["the design", "what was before"][index / self.scenes.len() % 2];
        match self.scenes.len() {
            1 => format!("{which}, {name}"),
            _ => format!("{which}, {name}, case {}", index % self.scenes.len()),
        }
    }

    /// What names its result.
    pub fn asked(&self, index: usize) -> String {
        let ((_, changes), _, profile) = self.at(index);
        format!("check {index}: {changes:?} of {profile:?}")
    }

    /// The objective in simulation `index`; none where it fails.
    pub fn measure(&self, index: usize) -> Option<f64> {
        let ((_, changes), Checked { document, .. }, profile) = self.at(index);
        let scene = changed(document, &self.table.numbers, changes, profile?).ok()?;
        let mut problem = Problem::without_derivatives(&scene, scene.model().ok()?).ok()?;
        let own = Profile::of(problem.stiffness());
        let objective = Objective::new(self.table, &problem, self.target).ok()?;
        objective.measure(&mut problem, &own).filter(|value| value.is_finite())
    }

    /// All of them, those that `memory` has not on all cores.
    pub fn make(&self, memory: &mut Memory) -> Vec<Check> {
        let mut found: Vec<Option<f64>> = vec![None; self.count()];
        let todo: Vec<usize> = (0..self.count()).filter(|index| !memory.has(&self.asked(*index))).collect();
        let keep = |index: usize, value| {
            found[index] = value;
            Ok(ControlFlow::Continue(()))
        };
        if jobs::run(&todo, jobs::cores(), |index| self.measure(index), keep).is_err() {
            todo.iter().for_each(|index| found[*index] = self.measure(*index)); // there are no threads
        }
        let mut values = found.into_iter().enumerate();
        let mut next = || {
            let (index, value) = values.next()?;
            memory.recall(|| self.asked(index), || value)
        };
        let mut measured = || {
            let values: Vec<Option<f64>> = self.scenes.iter().map(|_| next()).collect();
            match values[..] {
                [value] => value,
                _ => {
                    let values = values.into_iter().collect::<Option<Vec<f64>>>()?;
                    self.table.counted().of(&values, self.table.smaller_is_better())
                }
            }
        };
        let check = |(simulation, _): &(String, Vec<String>)| {
            let (designed, before) = (measured(), measured());
            let gain_percent = designed.zip(before).map(|(value, before)| gain_percent(self.table, value, before));
            Check { simulation: simulation.clone(), designed, before, gain_percent }
        };
        self.simulations.iter().map(check).collect()
    }
}
