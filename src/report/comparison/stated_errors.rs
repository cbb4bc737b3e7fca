//! The errors that a run states of its own results in its summary.
//!
//! `verification` (`caudal run --verify`) has the differences from the full model: of displacement and tip, of force and moment on a held
//! head. Without it, a cheaper model that was chosen by its estimated error states this in `model_reason`. `fluid_error` has the estimated
//! errors of a drag law that was chosen automatically, of speed or thrust and of power, relative to the most accurate law; that law's
//! published uncertainty, `fluid_uncertainty`, is common to runs under the same law. The tolerance of adaptive steps limits the error of
//! a step, not of a result, and is not included.

use toml::Value;

use super::super::recorded_run::RecordedRun;
use crate::reduced::comparison::{MIN_MEAN_FRACTION, MIN_PATH_FRACTION};
use crate::reduced::{ErrorMeasure, ModelChoice};

/// The relative errors that a run states.
#[derive(Debug, Clone, Default)]
pub struct StatedErrors {
    /// Errors of the model and its steps, by measure.
    measures: Vec<(ErrorMeasure, f64)>,
    /// True if these are differences from the full model, not an estimate.
    verified: bool,
    /// Errors of the drag law: of speed or thrust, and of power.
    fluid: Option<[f64; 2]>,
    /// Published uncertainty of the most accurate law.
    uncertainty: Option<[f64; 2]>,
    forces: Vec<String>,
    held: bool,
    /// The scale of errors of the displacement, m.
    displacement: Option<f64>,
    /// Largest force and moment on a held head.
    largest: [f64; 2],
}

impl StatedErrors {
    /// The stated errors of `run`.
    pub fn of(run: &RecordedRun) -> Self {
        let entry = |name: &str| run.summary.get(name);
        let pair = |name: &str| Some(["motion", "power"].map(|part| entry(name)?.get(part)?.as_f64()));
        let both = |name: &str| match pair(name) {
            Some([Some(motion), Some(power)]) => Some([motion, power]),
            _ => None,
        };
        let verification = entry("verification").filter(|value| value.is_object());
        let measures = match verification {
            Some(verification) => {
                let name = |measure: &ErrorMeasure| measure.meaning()[0];
                let noise = verification.get("noise").and_then(|noise| noise.as_array());
                let is_noise =
                    |measure: &ErrorMeasure| noise.is_some_and(|all| all.iter().any(|own| own == name(measure)));
                let error =
                    |measure: &ErrorMeasure| verification.get("relative_differences")?.get(name(measure))?.as_f64();
                let known = ErrorMeasure::ALL.into_iter().filter(|measure| !is_noise(measure));
                known.filter_map(|measure| Some((measure, error(&measure)?))).collect()
            }
            None => run.text("model_reason").and_then(ModelChoice::stated_error).into_iter().collect(),
        };
        let held = entry("head_force_n").is_some_and(|force| !force.is_null());
        let forces = entry("forces").and_then(|forces| forces.as_array());
        let forces = forces.into_iter().flatten().filter_map(|name| name.as_str().map(str::to_string)).collect();
        let largest = ["max_head_force_n", "max_head_moment_n_m"].map(|key| run.number(key).unwrap_or(0.0));
        Self {
            measures,
            verified: verification.is_some(),
            // Zero is that of the most accurate law itself, which is not without an error.
            fluid: both("fluid_error").filter(|errors| errors.iter().any(|error| *error > 0.0)),
            uncertainty: both("fluid_uncertainty"),
            displacement: displacement_scale(run, held),
            forces,
            held,
            largest,
        }
    }

    /// The forces that act on the rod.
    pub fn forces(&self) -> &[String] {
        &self.forces
    }

    /// The error of a number of the summary, in its unit; `None` if the run states none. The uncertainty of the law counts
    /// `with_uncertainty`.
    pub fn of_result(&self, key: &str, value: f64, with_uncertainty: bool) -> Option<f64> {
        // Errors are relative to the full model's value, which may be larger than this run's by as much.
        let of_own = |error: f64| if error < 1.0 { error / (1.0 - error) } else { f64::INFINITY };
        let measure = |wanted: ErrorMeasure| {
            self.measures.iter().find(|(measure, _)| *measure == wanted).map(|(_, error)| of_own(*error))
        };
        let of_load = |wanted: ErrorMeasure, largest: f64| {
            measure(wanted).map(|error| error * value.abs().max(MIN_MEAN_FRACTION * largest))
        };
        let uncertainty = self.uncertainty.filter(|_| with_uncertainty);
        let of_fluid = |parts: &[usize]| {
            let known = [self.fluid, uncertainty].into_iter().flatten();
            let sum = |errors: [f64; 2]| parts.iter().map(|part| errors[*part]).sum::<f64>();
            known.map(sum).reduce(|a, b| a + b).map(|error| error * value.abs())
        };
        let of_displacement =
            || measure(ErrorMeasure::Displacement).zip(self.displacement).map(|(error, size)| error * size);
        let [motion, power] = [0, 1];
        let (of_model, of_law) = match key {
            "x_com_m" | "y_com_m" | "max_lateral_excursion_m" => (of_displacement(), None),
            "net_displacement_m" => (of_displacement(), of_fluid(&[motion]).filter(|_| !self.held)),
            "cycle_speed_m_s" | "cycle_forward_speed_m_s" | "cycle_body_lengths" if !self.held => {
                (measure(ErrorMeasure::Displacement).map(|error| error * value.abs()), of_fluid(&[motion]))
            }
            "cycle_thrust_n" | "mean_thrust_n" => (of_load(ErrorMeasure::Force, self.largest[0]), of_fluid(&[motion])),
            "cycle_head_force_x_n" | "cycle_head_force_y_n" | "mean_head_force_n.x" | "mean_head_force_n.y" => {
                (of_load(ErrorMeasure::Force, self.largest[0]), None)
            }
            "cycle_head_moment_n_m" | "mean_head_moment_n_m" => (of_load(ErrorMeasure::Moment, self.largest[1]), None),
            "cycle_actuation_power_w"
            | "cycle_head_power_w"
            | "cycle_viscous_power_w"
            | "mean_actuation_power_w"
            | "mean_head_power_w"
            | "mean_viscous_power_w" => (None, of_fluid(&[power])),
            "cost_of_transport" | "cycle_cost_of_transport" => (None, of_fluid(&[motion, power])),
            _ => (None, None),
        };
        // A cheaper model states no error for other results, which does not mean that their error is zero.
        let of_law = of_law.filter(|_| of_model.is_some() || self.measures.is_empty());
        [of_model, of_law].into_iter().flatten().reduce(|a, b| a + b)
    }

    /// What the run states, for a sentence; `None` if that is nothing. The uncertainty of the law counts `with_uncertainty`.
    pub fn in_words(&self, with_uncertainty: bool) -> Option<String> {
        let source = if self.verified { "difference from the full model" } else { "estimated error of the model" };
        let named = |(measure, error): &(ErrorMeasure, f64)| format!("{} {error:.1e}", measure.meaning()[0]);
        let measures: Vec<String> = self.measures.iter().map(named).collect();
        let of_model = (!measures.is_empty()).then(|| format!("{source}: {}", measures.join(", ")));
        let motion = if self.held { "thrust" } else { "speed" };
        let two = |what: &str, [a, b]: [f64; 2]| format!("{what}: {motion} {a:.1e}, power {b:.1e}");
        let of_law = self.fluid.map(|errors| two("estimated error of the drag law", errors));
        let uncertainty = self.uncertainty.filter(|_| with_uncertainty);
        let published = uncertainty.map(|errors| two("published uncertainty of the drag law", errors));
        let all: Vec<String> = [of_model, of_law, published].into_iter().flatten().collect();
        (!all.is_empty()).then(|| all.join(", "))
    }
}

/// What errors of the displacement are relative to, m: the displacement through the fluid, but at least a part of the path. `None` if
/// the flow that carries a free rod is not constant or not known.
fn displacement_scale(run: &RecordedRun, held: bool) -> Option<f64> {
    let start = |name: &str| run.curves.curve("time_s", name).first().copied();
    let [(from, x), (_, y)] = [start("x_com_m")?, start("y_com_m")?];
    let span = run.number("end_time_s")? - from;
    let flow = if held { [0.0; 2] } else { constant_flow(run)? };
    let moved = [run.number("x_com_m")? - x - flow[0] * span, run.number("y_com_m")? - y - flow[1] * span];
    Some(moved[0].hypot(moved[1]).max(MIN_PATH_FRACTION * run.number("com_path_m")?))
}

fn constant_flow(run: &RecordedRun) -> Option<[f64; 2]> {
    let scene = run.scene.as_ref()?.read_as::<toml::Table>().ok()?;
    let number = |value: &Value| value.as_float().or_else(|| value.as_integer().map(|x| x as f64));
    match scene.get("medium").and_then(|medium| medium.get("flow_m_s")) {
        None => Some([0.0; 2]),
        Some(Value::Array(flow)) => Some([number(flow.first()?)?, number(flow.get(1)?)?]),
        Some(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_of_a_load_is_relative_to_its_mean_or_to_a_part_of_its_largest_value() {
        let errors = StatedErrors {
            measures: vec![(ErrorMeasure::Force, 0.1), (ErrorMeasure::Moment, 0.2)],
            held: true,
            largest: [50.0, 4.0],
            ..StatedErrors::default()
        };
        // Of the full model's value: 0.1/(1 − 0.1) and 0.2/(1 − 0.2).
        for (key, value, error) in [
            ("cycle_thrust_n", -9.0, 1.0),
            ("mean_head_force_n.x", 18.0, 2.0),
            ("cycle_thrust_n", 0.0, 50.0 * MIN_MEAN_FRACTION / 9.0),
            ("cycle_head_moment_n_m", 8.0, 2.0),
            ("mean_head_moment_n_m", 0.0, MIN_MEAN_FRACTION),
        ] {
            let found = errors.of_result(key, value, false).unwrap_or(f64::NAN);
            assert!((found - error).abs() < 1e-12, "{key} = {value}: {found} for {error}");
        }
    }
}
