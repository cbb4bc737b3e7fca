//! Getting and setting: a host's inputs wait here until they are needed.

use caudal::fmu::Target;
use caudal::model::Model;
use caudal::model::course::HIGHEST_ORDER;
use caudal::stepper::Change;
use caudal::variable::{Causality, Size, VARIABLES};
use serde::{Deserialize, Serialize};

use super::{Instance, Mode};
use crate::status::{Outcome, refuse};

/// The host's inputs, which wait here until they are needed: one flat array for each input, in nodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Inputs {
    /// Values and their derivatives; empty for what is no input, or no derivative yet.
    pub(super) values: Vec<[Vec<f64>; HIGHEST_ORDER + 1]>,
    /// Place and order of what was set since they were last handed over, in this order.
    pub(super) waiting: Vec<[usize; 2]>,
}

impl Inputs {
    /// True where some wait.
    pub(super) fn any(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Notes that the derivative of this order waits.
    fn wait(&mut self, place: usize, order: usize) {
        if let Err(at) = self.waiting.binary_search(&[place, order]) {
            self.waiting.insert(at, [place, order]);
        }
    }

    /// Everything that has a value waits.
    pub(super) fn all_wait(&mut self) {
        let orders = |(place, values): (usize, &[Vec<f64>; HIGHEST_ORDER + 1])| {
            (0..values.len()).filter(|order| !values[*order].is_empty()).map(|order| [place, order]).collect::<Vec<_>>()
        };
        self.waiting = self.values.iter().enumerate().flat_map(orders).collect();
    }
}

impl Instance {
    /// Reads a value; inputs were handed over before.
    #[inline]
    pub fn value(&self, target: Target) -> f64 {
        match (target, self.stepper.get()) {
            (Target::Parameter(place), _) => self.settings.parameters[place],
            (Target::Variable(place, node), Some(stepper)) => {
                let variable = &VARIABLES[place];
                let value = variable.at(&stepper.view(), node);
                if variable.causality == Causality::Independent { self.experiment.start + value } else { value }
            }
            (Target::Variable(..), None) => f64::NAN,
        }
    }

    /// Makes ready for reading.
    #[inline]
    pub fn settle(&mut self) -> Outcome {
        if self.inputs.any() || self.stale || self.untuned.is_some() {
            self.ready()?;
        }
        Ok(())
    }

    /// Reads all entries of a variable of FMI 3.0; the length has been checked.
    pub fn read(&self, target: Target, out: &mut [f64]) {
        match target {
            Target::Variable(place, _) if out.len() > 1 => {
                let nodes = self.entries(place);
                for (k, out) in out.iter_mut().enumerate() {
                    *out = if nodes.contains(&k) { self.value(Target::Variable(place, k)) } else { 0.0 };
                }
            }
            _ => out[0] = self.value(target),
        }
    }

    /// Refuses what cannot be set: entries of a variable from its node on, or a parameter.
    pub fn check(&self, target: Target, values: &[f64]) -> Outcome {
        let Target::Parameter(place) = target else { return self.check_input(target, 0, values) };
        let (parameter, value) = (&self.catalogue.parameters[place], values[0]);
        if self.mode == Mode::Intermediate || self.is_running() && !parameter.is_tunable() {
            return refuse(format!("{} is fixed: it can be set until initialisation ends", parameter.name()));
        }
        if value.is_finite() && parameter.range.contains(&value) {
            return Ok(());
        }
        refuse(format!("{}: found {value}; allowed: {:?}", parameter.name(), parameter.range))
    }

    /// The same, as a step of a set.
    pub fn check_mut(&mut self, target: Target, values: &[f64]) -> Outcome {
        self.check(target, values)
    }

    /// Sets what [`check`](Self::check) has let pass.
    pub fn set(&mut self, target: Target, values: &[f64]) -> Outcome {
        match target {
            Target::Parameter(place) => {
                let changed = self.settings.parameters[place] != values[0];
                if changed && self.is_running() && self.untuned.is_none() {
                    self.ready()?;
                    self.untuned = Some(self.settings.clone());
                }
                self.stale |= changed && !self.is_running();
                self.settings.parameters[place] = values[0];
                Ok(())
            }
            Target::Variable(place, node) => self.set_input(place, node, 0, values),
        }
    }

    /// Refuses a derivative of an input that cannot be set.
    pub fn check_derivative(&self, target: Target, order: i32, value: f64) -> Outcome {
        match (target, usize::try_from(order)) {
            (Target::Variable(..), Ok(order @ 1..=HIGHEST_ORDER)) => self.check_input(target, order, &[value]),
            (Target::Variable(..), _) => {
                refuse(format!("a derivative of order {order} cannot be set; allowed: 1 to {HIGHEST_ORDER}"))
            }
            (Target::Parameter(_), _) => refuse("a parameter has no derivative"),
        }
    }

    /// Sets what [`check_derivative`](Self::check_derivative) has let pass.
    pub fn set_derivative(&mut self, target: Target, order: i32, value: f64) -> Outcome {
        match target {
            Target::Variable(place, node) => self.set_input(place, node, order as usize, &[value]),
            Target::Parameter(_) => Ok(()),
        }
    }

    fn check_input(&self, target: Target, order: usize, values: &[f64]) -> Outcome {
        let Target::Variable(place, _) = target else { return Ok(()) };
        let variable = &VARIABLES[place];
        if !variable.is_input() {
            return refuse(format!("{} is not an input: it cannot be set", variable.name));
        }
        if order + variable.of_head().map_or(0, |[_, own]| own) > HIGHEST_ORDER {
            return refuse(format!("{} has no derivative of order {order}", variable.name));
        }
        let finite = values.iter().find(|value| !value.is_finite());
        match finite
            .map(|x| (*x, "a finite number"))
            .or_else(|| if order == 0 { variable.refused(values) } else { None })
        {
            Some((value, allowed)) => refuse(format!("{}: found {value}; allowed: {allowed}", variable.name)),
            None => Ok(()),
        }
    }

    fn set_input(&mut self, place: usize, node: usize, order: usize, values: &[f64]) -> Outcome {
        if order == 0 && self.inputs.waiting.binary_search(&[place, 0]).is_err() {
            // Entries that are not set now stay as they are, and after a new value nothing goes on by itself.
            if self.stale || self.stepper.get().is_none() {
                self.ready()?;
            }
            let mut now = std::mem::take(&mut self.inputs.values[place]);
            now[0].resize(self.lengths[place], 0.0);
            let kept = if values.len() < self.lengths[place] { self.entries(place) } else { 0..0 };
            for k in kept {
                now[0][k] = self.value(Target::Variable(place, k));
            }
            now[1..].iter_mut().for_each(Vec::clear);
            self.inputs.values[place] = now;
            self.inputs.waiting.retain(|[other, _]| *other != place);
        }
        self.inputs.wait(place, order);
        let entries = &mut self.inputs.values[place][order];
        entries.resize(self.lengths[place], 0.0);
        entries[node..node + values.len()].copy_from_slice(values);
        Ok(())
    }

    /// Gives the stepper the inputs that wait.
    pub(super) fn hand_over(&mut self) -> Outcome {
        let Some(stepper) = self.stepper.get_mut() else { return Ok(()) };
        let changes = changes(&self.inputs, stepper.model());
        let outcome = stepper.set_all(changes);
        // Whatever the answer, nothing waits: what was refused is gone.
        self.inputs.waiting.clear();
        if outcome.is_err() {
            self.inputs.values.iter_mut().flatten().for_each(Vec::clear);
        }
        Ok(outcome?)
    }
}

/// The changes that wait.
fn changes<'a>(inputs: &'a Inputs, model: &Model) -> impl Iterator<Item = Change<'a>> + Clone + use<'a> {
    let first = usize::from(model.head.is_none());
    let last = model.rod.nodes - 1;
    inputs.waiting.iter().map(move |[place, order]| {
        let (variable, values) = (&VARIABLES[*place], &inputs.values[*place][*order]);
        let values = if variable.size == Size::Joints { &values[first..last] } else { &values[..] };
        Change { variable, order: *order, values }
    })
}
