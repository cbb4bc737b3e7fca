//! Diagnostics of a finished simulation: does the energy balance close, do strain and rotation per step stay in range, and does the
//! motion stay inside the validity of the fluid's laws?

use crate::integrator::StepControl;
use crate::metrics::{Power, RunMetrics};
use crate::model::Model;
use crate::rod::Rod;
use crate::scene::Scene;

/// A defect of the energy balance above this fraction of the largest energy or work is reported.
const MAX_BALANCE_DEFECT: f64 = 0.1;

/// Rounding errors of a position, in units of the machine epsilon, that the energy balance may contain.
const POSITION_ROUNDINGS: f64 = 16.0;

/// Strain above which the linear elastic law of the rod does not hold. Measured on the scenes of `models/` and
/// `tests/reference`, 9–129 nodes, steps of 1e-5 … 2e-2 s: at most 0.7 %, in steps whose energy comes from nowhere.
const MAX_LINEAR_STRAIN: f64 = 0.05;

/// Rotation (rad) of an edge within one step above which the step is reported as too large. Measured on the same: at most 20° after a
/// smooth start, up to 70° in the one step that takes a jump start to its shape, 51–150° where energy comes from nowhere.
const MAX_ROTATION_PER_STEP: f64 = std::f64::consts::FRAC_PI_4;

/// The setting that a user reduces for finer steps.
fn finer(pace: StepControl) -> &'static str {
    match pace {
        StepControl::Fixed(_) => "step",
        StepControl::Adaptive(_) => "tolerance",
    }
}

/// The energy (J) of rounding errors: that of edges whose ends are rounded at their positions.
pub(crate) fn rounding_energy(rod: &Rod, positions: &[f64]) -> f64 {
    let reach = positions.iter().fold(rod.length, |max, x| max.max(x.abs()));
    rod.ea * rod.length * (POSITION_ROUNDINGS * f64::EPSILON * reach / rod.spacing).powi(2)
}

/// A note on an energy balance that does not close beyond `rounding` (J): a sign of steps that are too large, or of a wrong root of
/// the equations.
fn balance_note(metrics: &RunMetrics, rounding: f64, pace: StepControl) -> Option<String> {
    let Power { actuation, material, viscous, wake, spray, load, head, flow, other } = metrics.totals.work;
    let scale = [
        metrics.first_energy,
        metrics.now.energy.total(),
        actuation,
        material,
        viscous,
        wake,
        spray,
        load,
        head,
        flow,
        other,
    ]
    .into_iter()
    .fold(0.0, |max: f64, x| max.max(x.abs()));
    let defect = metrics.numerical_dissipation();
    (defect.abs() > MAX_BALANCE_DEFECT * scale && defect.abs() > rounding).then(|| {
        let what = if defect < 0.0 { "came from nowhere" } else { "was taken by the method itself" };
        format!(
            "the energy balance does not close: {:.3e} J {what}, {:.0} % of the largest energy or work; a smaller {} shows whether the result stands",
            defect.abs(),
            100.0 * defect.abs() / scale,
            finer(pace)
        )
    })
}

/// Notes on edges that stretch or rotate further than the model or the step size allows.
fn motion_notes(metrics: &RunMetrics, pace: StepControl) -> impl Iterator<Item = String> {
    let strained = (metrics.totals.max_strain > MAX_LINEAR_STRAIN).then(|| {
        format!(
            "an edge is stretched or compressed by {:.1} %: the rod is linearly elastic, for strains of up to {:.0} %",
            100.0 * metrics.totals.max_strain,
            100.0 * MAX_LINEAR_STRAIN
        )
    });
    let turned = (metrics.totals.max_rotation > MAX_ROTATION_PER_STEP).then(|| {
        format!(
            "an edge turns by {:.0}° within one step, more than {:.0}°: the step does not follow the motion, which may have gone another way; a smaller {}, or a smooth start, shows whether the result stands",
            metrics.totals.max_rotation.to_degrees(),
            MAX_ROTATION_PER_STEP.to_degrees(),
            finer(pace)
        )
    });
    strained.into_iter().chain(turned)
}

/// Notes on a simulation of `scene` with this `model` and `pace`, measured by `metrics`, that ends at these `positions`: the
/// `warnings` given before it, energy balance, strain, rotation per step, and ranges of validity that the motion left.
pub(crate) fn notes(
    scene: &Scene,
    model: &Model,
    metrics: &RunMetrics,
    positions: &[f64],
    pace: StepControl,
    warnings: &[String],
) -> Vec<String> {
    let left = metrics.across().map(|across| scene.range_notes(&model.forces, &model.rod, across));
    (warnings.iter().cloned())
        .chain(balance_note(metrics, rounding_energy(&model.rod, positions), pace))
        .chain(motion_notes(metrics, pace))
        .chain(left.into_iter().flatten())
        .collect()
}
