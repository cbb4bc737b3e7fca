//! Derivatives of outputs with respect to time, and to inputs and parameters with direct feedthrough.

use caudal::fmu::{Catalogue, Standard, Target};
use caudal::head::HeadInput;
use caudal::variable::{Causality, VARIABLES, Variable};

use super::Instance;
use crate::status::{FmiResult, refuse};

impl Instance {
    /// The index of an output, or of a calculated parameter.
    fn output(&self, target: Target) -> FmiResult<usize> {
        match target {
            Target::Variable(place, _)
                if matches!(VARIABLES[place].causality, Causality::Output | Causality::Parameter) =>
            {
                Ok(place)
            }
            _ => refuse("only outputs have derivatives"),
        }
    }

    /// The variables of outputs with their nodes, or `None` if a variable has no entry at its node and is always zero.
    fn outputs(&self, unknowns: &[(Target, usize)]) -> FmiResult<Vec<Option<(&'static Variable, usize)>>> {
        let output = |(target, k): &(Target, usize)| {
            let place = self.output(*target)?;
            Ok(self.entries(place).contains(k).then_some((&VARIABLES[place], *k)))
        };
        unknowns.iter().map(output).collect()
    }

    /// Writes the first time derivatives of outputs at their nodes.
    pub fn rates(&mut self, unknowns: &[(Target, usize)], out: &mut [f64]) -> FmiResult {
        let outputs = self.outputs(unknowns)?;
        let rates = self.ready()?.rates()?;
        for (out, output) in out.iter_mut().zip(outputs) {
            *out = output.and_then(|(variable, k)| rates.of(variable, k)).unwrap_or(0.0);
        }
        Ok(())
    }

    /// Writes the change of `unknowns` (outputs at nodes) when `knowns` (inputs at nodes, tunable parameters, time) change by
    /// `seed`: for poses that are given for the end of a step, the change through the last step; for all others, direct
    /// feedthrough.
    pub fn directional(
        &mut self,
        unknowns: &[(Target, usize)],
        knowns: &[(Target, usize)],
        seed: &[f64],
        out: &mut [f64],
    ) -> FmiResult {
        let outputs = self.outputs(unknowns)?;
        self.seeds.resize(VARIABLES.len(), Vec::new());
        self.seeds.iter_mut().for_each(Vec::clear);
        let at_end = self.ready()?.model().head_input == HeadInput::AtEnd;
        let (mut time, mut parameters, mut through_step) = (0.0, Vec::new(), Vec::new());
        for ((target, k), seed) in knowns.iter().zip(seed) {
            match *target {
                Target::Variable(place, _) if at_end && VARIABLES[place].of_head().is_some() => {
                    through_step.push((&VARIABLES[place], *seed));
                }
                Target::Variable(place, _) if VARIABLES[place].is_input() => {
                    let seeds = &mut self.seeds[place];
                    seeds.resize(self.lengths[place], 0.0);
                    seeds[*k] += seed;
                }
                Target::Variable(place, _) if VARIABLES[place].causality == Causality::Independent => time += seed,
                Target::Parameter(place) => parameters.push((place, *seed)),
                Target::Variable(..) => return refuse("derivatives are by inputs, parameters and time"),
            }
        }
        let entries: Vec<_> = (0..VARIABLES.len()).map(|place| self.entries(place)).collect();
        let seeds = std::mem::take(&mut self.seeds);
        let change = self.ready()?.directional(|inputs| {
            for ((variable, seeds), nodes) in VARIABLES.iter().zip(&seeds).zip(&entries) {
                if !seeds.is_empty() {
                    inputs.set(variable, &seeds[nodes.clone()])?;
                }
            }
            Ok(())
        })?;
        for (out, output) in out.iter_mut().zip(&outputs) {
            *out = output.and_then(|(variable, k)| change.of(variable, k)).unwrap_or(0.0);
        }
        self.seeds = seeds;
        if time != 0.0 {
            let rates = self.ready()?.explicit_rates()?;
            for (out, output) in out.iter_mut().zip(&outputs) {
                *out += time * output.and_then(|(variable, k)| rates.of(variable, k)).unwrap_or(0.0);
            }
        }
        if !through_step.is_empty() {
            self.ready()?.add_through_last_step(&through_step, &outputs, out)?;
        }
        // Keeps the data of the last step, while other values of parameters are evaluated.
        let last = if parameters.is_empty() { None } else { Some(self.ready()?.take_last_step()) };
        let added =
            parameters.into_iter().try_for_each(|(place, seed)| self.add_by_parameter(place, seed, &outputs, out));
        if let (Some(last), Ok(stepper)) = (last, self.ready()) {
            stepper.put_last_step(last);
        }
        added?;
        Ok(())
    }

    /// Adds `seed` times the derivatives of outputs with respect to a parameter, by central differences between instances with
    /// different values of it.
    fn add_by_parameter(
        &mut self,
        place: usize,
        seed: f64,
        outputs: &[Option<(&'static Variable, usize)>],
        out: &mut [f64],
    ) -> FmiResult {
        /// Step of the difference relative to the value, or absolute if that is zero.
        const STEP: f64 = 1e-6;
        let state = self.save()?;
        let (target, value) = (Target::Parameter(place), self.settings.parameters[place]);
        let step = if value == 0.0 { STEP } else { STEP * value.abs() };
        let (mut read, mut ends) = (Vec::new(), Vec::new());
        for end in [value + step, value - step] {
            // At an end of its range the difference is one-sided.
            let end = if self.check(target, &[end]).is_ok() { end } else { value };
            let made = self.check(target, &[end]).and_then(|()| self.set(target, &[end]));
            let view = made.and_then(|()| self.ready()).map(|stepper| {
                let view = stepper.view();
                outputs
                    .iter()
                    .map(|output| output.and_then(|(variable, k)| variable.at(&view, k)).unwrap_or(0.0))
                    .collect::<Vec<_>>()
            });
            match view {
                Ok(values) => read.push(values),
                Err(refusal) => {
                    self.restore(&state)?;
                    return Err(refusal);
                }
            }
            ends.push(end);
        }
        self.restore(&state)?;
        for (out, (above, below)) in out.iter_mut().zip(read[0].iter().zip(&read[1])) {
            *out += seed * (above - below) / (ends[0] - ends[1]);
        }
        Ok(())
    }

    /// Writes the sum over `unknowns` of `seed` times their change with each of `knowns`: one direction for each of these.
    pub fn adjoint(
        &mut self,
        unknowns: &[(Target, usize)],
        knowns: &[(Target, usize)],
        seed: &[f64],
        out: &mut [f64],
    ) -> FmiResult {
        let mut changes = vec![0.0; unknowns.len()];
        for (known, out) in knowns.iter().zip(out) {
            self.directional(unknowns, std::slice::from_ref(known), &[1.0], &mut changes)?;
            *out = changes.iter().zip(seed).map(|(change, seed)| change * seed).sum();
        }
        Ok(())
    }

    /// The dependencies of a variable of FMI 3.0: the node of the dependent, and value reference and node of the variable on
    /// which it immediately depends. Calculated parameters depend on all parameters.
    pub fn dependencies(&mut self, target: Target) -> FmiResult<Vec<(usize, u32, usize)>> {
        let Ok(place) = self.output(target) else { return Ok(Vec::new()) };
        self.ready()?;
        let Some(stepper) = self.stepper.get() else { return refuse("there is no model") };
        let (variable, model) = (&VARIABLES[place], stepper.model());
        let (dynamics, form) = (stepper.view().dynamics, stepper.form());
        let reference = |target: Target| Catalogue::reference(Standard::Fmi3, target);
        let parameters: Vec<usize> = match variable.causality {
            Causality::Parameter => (0..self.catalogue.parameters.len()).collect(),
            _ => self.catalogue.followed_parameters(variable, stepper).collect(),
        };
        let time = VARIABLES.iter().position(|variable| variable.causality == Causality::Independent);
        let time = time.filter(|_| variable.follows_time(dynamics, form)).map(|place| Target::Variable(place, 0));
        let others: Vec<u32> =
            time.into_iter().chain(parameters.into_iter().map(Target::Parameter)).map(reference).collect();
        let inputs = || VARIABLES.iter().enumerate().filter(|(_, input)| input.is_input() && input.exists_in(model));
        let of = |node: usize| {
            let inputs = inputs().flat_map(move |(place, input)| {
                let reference = reference(Target::Variable(place, 0));
                variable.follows(node, input, dynamics, form).map(move |k| (node, reference, k))
            });
            inputs.chain(others.iter().map(move |reference| (node, *reference, 0)))
        };
        Ok(variable.entries(model).flat_map(of).collect())
    }
}
