//! Fills the [`Summary`] of a run from its stepper.

use super::{Ending, Outcome};
use crate::cycle::{self, GRAVITY};
use crate::diagnostics::notes;
use crate::integrator::StepControl;
use crate::linear::SolverChoice;
use crate::metrics::Power;
use crate::model::Mechanics;
use crate::report::{FluidError, Summary};
use crate::scene::Scene;
use crate::stepper::Stepper;
use crate::system::Form;

/// A net displacement below this fraction of the length counts as zero: cost of transport and efficiency are undefined then.
const MIN_DISPLACEMENT: f64 = 1e-9;

impl Summary {
    /// The summary of a run of `scene`, given the `warnings` of its [`Assessment`](crate::assessment::Assessment).
    pub fn of(scene: &Scene, stepper: &Stepper, outcome: &Outcome, warnings: &[String]) -> Self {
        let (metrics, work) = (stepper.metrics(), stepper.work());
        let (now, model) = (&metrics.now, stepper.model());
        let elapsed = metrics.elapsed();
        let mean = |integral: f64| if elapsed > 0.0 { integral / elapsed } else { 0.0 };
        let Power { actuation, material, viscous, wake, spray, load, head, flow, other } = metrics.totals.work;
        let displacement = metrics.net_displacement();
        let pulled = cycle::is_pulled(actuation, load, other);
        let swims = actuation > 0.0 && !pulled && displacement.abs() >= MIN_DISPLACEMENT * model.rod.length;
        let dynamics = stepper.view().dynamics;
        let speed = mean(displacement.abs());
        let whole = stepper.cycles().since_start();
        let held = |measure: &cycle::CycleMeasure| measure.mean(whole.as_slice(), dynamics).filter(|_| whole.is_some());
        let cycles = stepper.cycles().averages(dynamics);
        Self {
            name: scene.name.clone(),
            scene_file: scene.file(),
            scene_fingerprint: scene.fingerprint_text(),
            caudal_version: env!("CARGO_PKG_VERSION"),
            complete: outcome.ending == Ending::Complete,
            ending: match &outcome.ending {
                Ending::Complete => "complete".to_string(),
                Ending::Interrupted => "interrupted".to_string(),
                Ending::Failed(error) => error.to_string(),
            },
            end_time_s: stepper.time(),
            nodes: model.rod.nodes,
            model: stepper.choice().map_or("full", |choice| choice.kind.name),
            model_reason: stepper.choice().and_then(|choice| choice.reason.clone()),
            forces: model.forces.iter().map(|force| force.name()).collect(),
            fluid_reason: scene.fluid_choice().map(|choice| choice.reason.clone()),
            fluid_error: scene.fluid_choice().and_then(|choice| choice.errors).map(FluidError::from),
            fluid_uncertainty: scene.fluid_choice().and_then(|choice| choice.uncertainty).map(FluidError::from),
            integrator: stepper.method(scene).to_string(),
            form: stepper.form(),
            time_step_s: match stepper.step_control() {
                StepControl::Fixed(step) => step,
                StepControl::Adaptive(_) => elapsed / metrics.totals.steps.max(1) as f64,
            },
            tolerance: match stepper.step_control() {
                StepControl::Fixed(_) => None,
                StepControl::Adaptive(tolerance) => Some(tolerance),
            },
            steps: metrics.totals.steps,
            rejected_steps: metrics.totals.rejections,
            newton_iterations: work.newton_iterations,
            factorisations: work.factorisations,
            linear_solver: match (stepper.form(), scene.solver.linear) {
                _ if stepper.view().dynamics.mechanics == Mechanics::Shape => "none",
                (Form::Chain, _) => "riccati",
                #[cfg(feature = "faer")]
                (Form::Positions, SolverChoice::FaerLu) => "faer-lu",
                (Form::Positions, SolverChoice::Auto | SolverChoice::BlockBand) => "block-band",
            },
            linear_fallbacks: work.linear_fallbacks,
            step_halvings: metrics.totals.halvings,
            newton_floor_stops: work.floor_stops,
            max_strain: metrics.totals.max_strain,
            max_rotation_per_step_rad: metrics.totals.max_rotation,
            x_com_m: now.com.x,
            y_com_m: now.com.y,
            net_displacement_m: displacement,
            max_lateral_excursion_m: metrics.totals.max_lateral,
            com_path_m: metrics.totals.path,
            initial_energy_j: metrics.first_energy,
            stretching_energy_j: now.energy.stretching,
            bending_energy_j: now.energy.bending,
            kinetic_energy_j: now.energy.kinetic,
            fluid_energy_j: now.energy.fluid,
            mean_stretching_energy_j: mean(metrics.totals.energy_time.stretching),
            mean_bending_energy_j: mean(metrics.totals.energy_time.bending),
            mean_kinetic_energy_j: mean(metrics.totals.energy_time.kinetic),
            actuation_work_j: actuation,
            material_work_j: material,
            viscous_work_j: viscous,
            wake_work_j: wake,
            spray_work_j: spray,
            other_work_j: other,
            load_work_j: load,
            head_work_j: head,
            flow_work_j: flow,
            mean_actuation_power_w: mean(actuation),
            mean_material_power_w: mean(material),
            mean_viscous_power_w: mean(viscous),
            mean_wake_power_w: mean(wake),
            mean_spray_power_w: mean(spray),
            mean_load_power_w: mean(load),
            mean_head_power_w: mean(head),
            mean_flow_power_w: mean(flow),
            mean_other_power_w: mean(other),
            numerical_dissipation_j: metrics.numerical_dissipation(),
            rod_momentum_n_s: now.momentum.rod.into(),
            fluid_momentum_n_s: now.momentum.fluid.into(),
            drag_impulse_n_s: metrics.totals.impulse.drag.into(),
            wake_impulse_n_s: metrics.totals.impulse.wake.into(),
            flow_impulse_n_s: metrics.totals.impulse.flow.into(),
            load_impulse_n_s: metrics.totals.impulse.load.into(),
            head_impulse_n_s: metrics.totals.impulse.head.into(),
            spray_impulse_n_s: metrics.totals.impulse.spray.into(),
            other_impulse_n_s: metrics.totals.impulse.other.into(),
            momentum_defect_n_s: metrics.momentum_defect().into(),
            notes: notes(scene, model, metrics, &stepper.state().q, stepper.step_control(), warnings),
            cost_of_transport: swims.then(|| actuation / (model.rod.total_mass() * GRAVITY * displacement.abs())),
            efficiency: match &model.head {
                Some(_) => held(&cycle::EFFICIENCY),
                None => dynamics.towing_force(speed).filter(|_| swims).map(|drag| drag * speed * elapsed / actuation),
            },
            head_force_n: model.head.as_ref().map(|_| now.head_force.into()),
            head_moment_n_m: model.head.as_ref().map(|_| now.head_moment),
            mean_head_force_n: held(&cycle::HEAD_FORCE_X).zip(held(&cycle::HEAD_FORCE_Y)).map(|(x, y)| [x, y]),
            mean_thrust_n: held(&cycle::THRUST),
            mean_head_moment_n_m: held(&cycle::HEAD_MOMENT),
            max_head_force_n: model.head.as_ref().map(|_| metrics.totals.max_on_head[0]),
            max_head_moment_n_m: model.head.as_ref().map(|_| metrics.totals.max_on_head[1]),
            max_hinge_torque_n_m: model.hinge.as_ref().map(|_| metrics.totals.max_hinge_torque),
            max_head_power_w: model.head.as_ref().map(|_| metrics.totals.max_power[1]),
            max_joint_moment_n_m: metrics.totals.max_couple,
            max_actuation_power_w: model.actuation.as_ref().map(|_| metrics.totals.max_power[0]),
            cycles,
            wall_s: outcome.wall.as_secs_f64(),
            verification: None,
            final_positions_m: stepper.state().q.chunks_exact(2).map(|p| [p[0], p[1]]).collect(),
        }
    }
}
