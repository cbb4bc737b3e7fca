//! Diagnostics of a finished simulation: whether the balances of energy and momentum close, whether strain and rotation per step
//! stay in range, and whether the motion stays within the range of validity of the fluid's laws.

use crate::integrator::StepControl;
use crate::metrics::{HingeExtremes, Resultants, RunMetrics};
use crate::model::Model;
use crate::number_format::significant;
use crate::rod::Rod;
use crate::scene::Scene;

/// An error of the balance of energy or momentum above this fraction of the largest energy or work, or of the largest impulse, is
/// reported. Measured on the scenes of `models/` with adaptive steps: at most 0.7 % of either, except for oscillations after a
/// jump start, a free bar that turns many times without losing energy (8 %), and a column beyond its flutter limit that comes to
/// rest.
const MAX_BALANCE_DEFECT: f64 = 0.05;

/// Impulses along an axis are compared with at least this fraction of all impulses, because they may cancel along the axis.
const CANCELLATION_FLOOR: f64 = 0.03;

/// Number of rounding errors of a position, in units of the machine epsilon, that the energy balance may contain.
const POSITION_ROUNDINGS: f64 = 16.0;

/// A rod is at rest if its centre moves by less than the first fraction of its length and its edges stretch and turn by less than
/// the second. Its balances then only contain the tolerance of Newton's method, 1e-10 of the length.
const AT_REST: [f64; 2] = [1e-9, 1e-7];

/// Strain above which the linear elastic law of the rod does not hold. Measured on the scenes of `models/` and `tests/reference`,
/// 9–129 nodes, steps of 1e-5 … 2e-2 s: at most 0.7 %, reached in steps that create energy.
const MAX_LINEAR_STRAIN: f64 = 0.05;

/// Rotation (rad) of an edge within one step above which the step is reported as too large. Measured on the same scenes: at most
/// 20° after a smooth start, up to 70° in the single step in which a jump start takes its shape, 51–150° if steps create energy.
const MAX_ROTATION_PER_STEP: f64 = std::f64::consts::FRAC_PI_4;

/// The setting that a user reduces for finer steps.
fn finer(step_control: StepControl) -> &'static str {
    match step_control {
        StepControl::Fixed(_) => "step",
        StepControl::Adaptive(_) => "tolerance",
    }
}

/// The energy (J) of rounding errors: the energy of edges whose ends are rounded at their positions.
pub(crate) fn rounding_energy(rod: &Rod, positions: &[f64]) -> f64 {
    rod.ea * rod.length * rounding_strain(rod, positions).powi(2)
}

/// The strain of an edge whose ends are rounded at their positions.
fn rounding_strain(rod: &Rod, positions: &[f64]) -> f64 {
    let reach = positions.iter().fold(rod.length, |max, x| max.max(x.abs()));
    POSITION_ROUNDINGS * f64::EPSILON * reach / rod.spacing
}

/// A note on an energy balance that does not close to within `rounding` (J): a sign of too large steps, or of a wrong root of the
/// equations.
fn balance_note(metrics: &RunMetrics, rounding: f64, step_control: StepControl) -> Option<String> {
    let scale = metrics.totals.max_energy;
    let defect = metrics.numerical_dissipation();
    (defect.abs() > MAX_BALANCE_DEFECT * scale && defect.abs() > rounding).then(|| {
        let what = if defect < 0.0 { "were gained by numerical error" } else { "were dissipated by the integrator" };
        format!(
            "the energy balance does not close: {:.3e} J {what}, {:.0} % of the largest energy or work; check the result with a smaller {}",
            defect.abs(),
            100.0 * defect.abs() / scale,
            finer(step_control)
        )
    })
}

/// A note on a momentum balance that does not close: mean forces have an error of this size.
fn momentum_note(metrics: &RunMetrics, rod: &Rod, positions: &[f64], step_control: StepControl) -> Option<String> {
    let Resultants { drag, wake, spray, inertia: _, flow, load, head, other } = metrics.totals.impulse;
    let parts = [
        metrics.first_momentum,
        metrics.now.momentum.rod,
        metrics.now.momentum.fluid,
        drag,
        wake,
        spray,
        flow,
        load,
        head,
        other,
    ];
    // Reference impulses in case these cancel: that of the rod at its mean speed, and the largest work over the mean speed across.
    let motion = (2.0 * rod.total_mass() * metrics.totals.energy_time.kinetic / metrics.elapsed()).sqrt();
    let speed = metrics.across().map_or(0.0, |across| across.speed);
    let effort = if speed > 0.0 { metrics.totals.work.largest() / speed } else { 0.0 };
    let whole = parts.iter().fold(motion.max(effort), |max, impulse| max.max(impulse.norm()));
    let defects = metrics.momentum_defect();
    // The force of an edge whose ends are rounded at their positions.
    let rounding = rod.ea * rounding_strain(rod, positions) * metrics.elapsed();
    [0, 1].into_iter().find_map(|axis| {
        let largest = parts.iter().fold(0.0, |max: f64, impulse| max.max(impulse[axis].abs()));
        let (defect, scale) = (defects[axis].abs(), largest.max(CANCELLATION_FLOOR * whole));
        (defect > MAX_BALANCE_DEFECT * scale && defect > rounding).then(|| {
            format!(
                "the momentum balance along {} does not close: {defect:.3e} N s are missing, {:.0} % of the largest impulse, and mean forces have an error of {:.1e} N; check them with a smaller {}",
                ["x", "y"][axis],
                100.0 * defect / scale,
                defect / metrics.elapsed(),
                finer(step_control)
            )
        })
    })
}

/// Notes on edges that stretch or rotate more than the model or the step size allows.
fn motion_notes(metrics: &RunMetrics, step_control: StepControl) -> impl Iterator<Item = String> {
    let strained = (metrics.totals.max_strain > MAX_LINEAR_STRAIN).then(|| {
        format!(
            "an edge is stretched or compressed by {:.1} %: linear elasticity is valid for strains of up to {:.0} %",
            100.0 * metrics.totals.max_strain,
            100.0 * MAX_LINEAR_STRAIN
        )
    });
    let turned = (metrics.totals.max_rotation > MAX_ROTATION_PER_STEP).then(|| {
        format!(
            "an edge rotates by {:.0}° within one step, more than {:.0}°: the time step does not resolve the motion, and the result may be wrong; try a smaller {} or a smooth start",
            metrics.totals.max_rotation.to_degrees(),
            MAX_ROTATION_PER_STEP.to_degrees(),
            finer(step_control)
        )
    });
    strained.into_iter().chain(turned)
}

/// True if the rod did not move beyond the tolerance of Newton's method.
fn is_at_rest(metrics: &RunMetrics, rod: &Rod) -> bool {
    let [of_length, of_edges] = AT_REST;
    let totals = &metrics.totals;
    totals.path < of_length * rod.length && totals.max_strain.max(totals.max_rotation) < of_edges
}

/// A note on the motor of a hinge if more torque was commanded than it can supply.
fn motor_note(model: &Model, metrics: &RunMetrics) -> Option<String> {
    let largest = model.hinge.as_ref()?.largest_torque?;
    let HingeExtremes { asked, torque, .. } = metrics.totals.hinge;
    (asked > largest).then(|| {
        format!(
            "the motor of the hinge reaches its limit: the command is up to {} N m, the torque up to {} N m, head.largest_torque_n_m = {}",
            significant(asked, 3),
            significant(torque, 3),
            significant(largest, 3)
        )
    })
}

/// Notes on a simulation of `scene` with this `model` and `step_control`, measured by `metrics`, that ends at these `positions`:
/// the `warnings` given before the run, the balances of energy and momentum, strain, rotation per step, a motor at its limit, and
/// ranges of validity that the motion left.
pub(crate) fn notes(
    scene: &Scene,
    model: &Model,
    metrics: &RunMetrics,
    positions: &[f64],
    step_control: StepControl,
    warnings: &[String],
) -> Vec<String> {
    let left = metrics.across().map(|across| scene.range_notes(&model.forces, &model.rod, across));
    (warnings.iter().cloned())
        .chain(
            balance_note(metrics, rounding_energy(&model.rod, positions), step_control)
                .filter(|_| !is_at_rest(metrics, &model.rod)),
        )
        .chain(momentum_note(metrics, &model.rod, positions, step_control))
        .chain(motion_notes(metrics, step_control))
        .chain(motor_note(model, metrics))
        .chain(left.into_iter().flatten())
        .collect()
}
