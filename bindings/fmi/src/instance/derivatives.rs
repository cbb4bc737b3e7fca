//! Derivatives of outputs: by time, and by the inputs that they follow at once.

use caudal::fmu::Target;
use caudal::variable::{Causality, VARIABLES, Variable};

use super::Instance;
use crate::status::{Outcome, refuse};

impl Instance {
    /// The place of an output.
    fn output(&self, target: Target) -> Outcome<usize> {
        match target {
            Target::Variable(place, _) if VARIABLES[place].causality == Causality::Output => Ok(place),
            _ => refuse("only outputs have derivatives"),
        }
    }

    /// The variables of outputs with their nodes; none where a variable has no entry at its node, and so is always zero.
    fn outputs(&self, unknowns: &[(Target, usize)]) -> Outcome<Vec<Option<(&'static Variable, usize)>>> {
        let output = |(target, k): &(Target, usize)| {
            let place = self.output(*target)?;
            Ok(self.entries(place).contains(k).then_some((&VARIABLES[place], *k)))
        };
        unknowns.iter().map(output).collect()
    }

    /// The place of an input.
    fn input(&self, target: Target) -> Outcome<usize> {
        match target {
            Target::Variable(place, _) if VARIABLES[place].is_input() => Ok(place),
            _ => refuse("derivatives are by inputs only"),
        }
    }

    /// Writes the first derivatives by time of outputs at their nodes.
    pub fn rates(&mut self, unknowns: &[(Target, usize)], out: &mut [f64]) -> Outcome {
        let outputs = self.outputs(unknowns)?;
        let rates = self.ready()?.rates()?;
        for (out, output) in out.iter_mut().zip(outputs) {
            *out = output.map_or(0.0, |(variable, k)| rates.of(variable, k));
        }
        Ok(())
    }

    /// Writes the change of `unknowns` (outputs at nodes) when `knowns` (inputs at nodes) change by `seed`.
    pub fn directional(
        &mut self,
        unknowns: &[(Target, usize)],
        knowns: &[(Target, usize)],
        seed: &[f64],
        out: &mut [f64],
    ) -> Outcome {
        let outputs = self.outputs(unknowns)?;
        self.seeds.resize(VARIABLES.len(), Vec::new());
        self.seeds.iter_mut().for_each(Vec::clear);
        for ((target, k), seed) in knowns.iter().zip(seed) {
            let place = self.input(*target)?;
            let seeds = &mut self.seeds[place];
            seeds.resize(self.lengths[place], 0.0);
            seeds[*k] += seed;
        }
        let entries: Vec<_> = (0..VARIABLES.len()).map(|place| self.entries(place)).collect();
        let seeds = std::mem::take(&mut self.seeds);
        let change = self.ready()?.directional(|inputs| {
            for ((variable, seeds), nodes) in VARIABLES.iter().zip(&seeds).zip(&entries) {
                if !seeds.is_empty() {
                    inputs.set(variable, &seeds[nodes.clone()]);
                }
            }
        })?;
        for (out, output) in out.iter_mut().zip(outputs) {
            *out = output.map_or(0.0, |(variable, k)| change.of(variable, k));
        }
        self.seeds = seeds;
        Ok(())
    }

    /// Writes the sum over `unknowns` of `seed` times their change by each of `knowns`: one direction for each of these.
    pub fn adjoint(
        &mut self,
        unknowns: &[(Target, usize)],
        knowns: &[(Target, usize)],
        seed: &[f64],
        out: &mut [f64],
    ) -> Outcome {
        let mut changes = vec![0.0; unknowns.len()];
        for (known, out) in knowns.iter().zip(out) {
            self.directional(unknowns, std::slice::from_ref(known), &[1.0], &mut changes)?;
            *out = changes.iter().zip(seed).map(|(change, seed)| change * seed).sum();
        }
        Ok(())
    }

    /// The dependencies of a variable of FMI 3.0: node of the dependent, place and node of the input.
    pub fn dependencies(&mut self, target: Target) -> Outcome<Vec<(usize, usize, usize)>> {
        let variable = &VARIABLES[self.output(target)?];
        let stepper = self.ready()?;
        let (model, form) = (stepper.model(), stepper.form());
        let inputs = || VARIABLES.iter().enumerate().filter(|(_, input)| input.is_input() && input.exists_in(model));
        let of = |node: usize| {
            inputs().flat_map(move |(place, input)| {
                variable.follows(node, input, model, form).map(move |k| (node, place, k))
            })
        };
        Ok(variable.entries(model).flat_map(of).collect())
    }
}
