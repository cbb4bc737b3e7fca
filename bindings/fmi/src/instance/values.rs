//! Getting and setting values. Inputs that a host sets are stored until the stepper needs them.

use std::ops::Range;

use caudal::fmu::Target;
use caudal::model::Model;
use caudal::model::input_extrapolation::HIGHEST_ORDER;
use caudal::stepper::InputChange;
use caudal::variable::{Causality, Size, VARIABLES};
use serde::{Deserialize, Serialize};

use super::{Instance, InstanceMode};
use crate::status::{FmiResult, refuse};

/// Values of one input and of its derivatives by order, one entry per node: NaN if the host has not set the entry, empty if it
/// has set none of that order.
type Orders = [Vec<f64>; HIGHEST_ORDER + 1];

/// An input that the host has set.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct SetInput {
    place: usize,
    orders: Orders,
    /// True if it has not been passed to the stepper yet.
    pending: bool,
}

impl SetInput {
    fn set(&mut self, order: usize, node: usize, values: &[f64], len: usize) {
        self.pending = true;
        let entries = &mut self.orders[order];
        entries.resize(len, f64::NAN);
        entries[node..node + values.len()].copy_from_slice(values);
    }
}

/// The inputs that the host has set since the start of the last step, or before the first one. A value and the derivatives given
/// with it belong together, in either order.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct SetInputs(Vec<SetInput>);

impl SetInputs {
    /// True if some inputs have not been passed to the stepper.
    pub(super) fn is_pending(&self) -> bool {
        self.0.iter().any(|input| input.pending)
    }

    /// Marks all inputs as passed to the stepper.
    pub(super) fn mark_applied(&mut self) {
        self.0.iter_mut().for_each(|input| input.pending = false);
    }

    /// Discards all inputs, which belong to an earlier time.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Discards arrays, whose size changes.
    pub(super) fn forget_arrays(&mut self) {
        self.0.retain(|input| VARIABLES[input.place].size == Size::Scalar);
    }

    fn of(&mut self, place: usize) -> &mut SetInput {
        let at = self.0.binary_search_by_key(&place, |input| input.place).unwrap_or_else(|at| {
            self.0.insert(at, SetInput { place, orders: Orders::default(), pending: true });
            at
        });
        &mut self.0[at]
    }

    /// True if every array has the number of entries that `len` returns for its variable, and values that a host may set.
    pub(super) fn fits(&self, len: impl Fn(usize) -> Option<usize>) -> bool {
        let sound = |input: &SetInput| {
            let len = len(input.place);
            input.orders.iter().all(|values| {
                values.is_empty() || Some(values.len()) == len && !values.iter().any(|value| value.is_infinite())
            })
        };
        self.0.is_sorted_by(|a, b| a.place < b.place) && self.0.iter().all(sound)
    }

    /// The inputs as changes of `model`, in runs of consecutive entries: those not yet passed to the stepper, or `all`.
    pub(super) fn changes(&self, model: &Model, all: bool) -> Vec<(InputChange<'_>, usize)> {
        let mut changes = Vec::new();
        for input in self.0.iter().filter(|input| all || input.pending) {
            let variable = &VARIABLES[input.place];
            let nodes = variable.entries(model);
            for (order, values) in input.orders.iter().enumerate() {
                let Some(entries) = values.get(nodes.clone()) else { continue };
                for run in runs(entries) {
                    changes.push((InputChange { variable, order, values: &entries[run.clone()] }, run.start));
                }
            }
        }
        changes
    }
}

/// The ranges of `values` without NaN.
fn runs(values: &[f64]) -> impl Iterator<Item = Range<usize>> + '_ {
    let mut at = 0;
    std::iter::from_fn(move || {
        let start = at + values[at..].iter().position(|value| !value.is_nan())?;
        at = start + values[start..].iter().position(|value| value.is_nan()).unwrap_or(values.len() - start);
        Some(start..at)
    })
}

impl Instance {
    /// Reads a value. Inputs of the host must have been passed to the stepper before.
    #[inline]
    pub fn value(&self, target: Target) -> f64 {
        match (target, self.stepper.get()) {
            (Target::Parameter(place), _) => self.settings.parameters[place],
            (Target::Variable(place, node), Some(stepper)) => {
                let variable = &VARIABLES[place];
                if variable.causality == Causality::Independent {
                    return self.time();
                }
                variable.at(&stepper.view(), node).unwrap_or(0.0) // an entry at a node without a joint
            }
            (Target::Variable(..), None) => f64::NAN,
        }
    }

    /// Passes pending inputs to the stepper, before values are read.
    #[inline]
    pub fn apply_inputs(&mut self) -> FmiResult {
        if self.stale || self.inputs.is_pending() {
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

    /// Returns an error for values that cannot be set: entries of a variable from its node on, or a parameter.
    pub fn check(&self, target: Target, values: &[f64]) -> FmiResult {
        let Target::Parameter(place) = target else { return self.check_input(target, 0, values) };
        let (parameter, value) = (&self.catalogue.parameters[place], values[0]);
        let tunable = || self.stepper.get().is_some_and(|stepper| self.catalogue.is_tunable(place, stepper));
        if self.mode == InstanceMode::Intermediate || self.has_started() && !tunable() {
            return refuse(format!("{} is fixed: it can be set until initialisation ends", parameter.name()));
        }
        if value.is_finite() && parameter.range.contains(&value) {
            return Ok(());
        }
        refuse(format!("{}: found {value}; allowed: {:?}", parameter.name(), parameter.range))
    }

    /// The same with a mutable receiver, for use in place of [`set`](Self::set).
    pub fn check_mut(&mut self, target: Target, values: &[f64]) -> FmiResult {
        self.check(target, values)
    }

    /// Sets values that [`check`](Self::check) has accepted.
    pub fn set(&mut self, target: Target, values: &[f64]) -> FmiResult {
        match target {
            Target::Parameter(place) => {
                self.settings.parameters[place] = values[0];
                let differs = self.settings != self.built;
                self.stale = differs || self.stale && !self.has_started();
            }
            Target::Variable(place, node) => {
                self.inputs.of(place).set(0, node, values, self.lengths[place]);
            }
        }
        Ok(())
    }

    /// Returns an error for a derivative of an input that cannot be set.
    pub fn check_derivative(&self, target: Target, order: i32, value: f64) -> FmiResult {
        match (target, usize::try_from(order)) {
            (Target::Variable(..), Ok(order @ 1..=HIGHEST_ORDER)) => self.check_input(target, order, &[value]),
            (Target::Variable(..), _) => {
                refuse(format!("a derivative of order {order} cannot be set; allowed: 1 to {HIGHEST_ORDER}"))
            }
            (Target::Parameter(_), _) => refuse("a parameter has no derivative"),
        }
    }

    /// Sets a derivative that [`check_derivative`](Self::check_derivative) has accepted.
    pub fn set_derivative(&mut self, target: Target, order: i32, value: f64) -> FmiResult {
        if let Target::Variable(place, node) = target {
            self.inputs.of(place).set(order as usize, node, &[value], self.lengths[place]);
        }
        Ok(())
    }

    fn check_input(&self, target: Target, order: usize, values: &[f64]) -> FmiResult {
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

    /// Passes pending inputs to the stepper. If the stepper rejects them they stay pending, and the host may replace them.
    pub(super) fn pass_inputs(&mut self) -> FmiResult {
        let Some(stepper) = self.stepper.get_mut() else { return Ok(()) };
        let changes = self.inputs.changes(stepper.model(), false);
        stepper.set_entries(changes.iter().copied())?;
        self.inputs.mark_applied();
        Ok(())
    }
}
