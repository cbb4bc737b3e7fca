//! Fills the [`Summary`] of a run from its stepper.

use super::{Ending, Outcome};
use crate::cycle;
use crate::diagnostics::notes;
use crate::integrator::StepControl;
use crate::linear::SolverChoice;
use crate::metrics::Power;
use crate::model::Mechanics;
use crate::report::{FluidError, Summary, TendonMaxima};
use crate::scene::Scene;
use crate::stepper::Stepper;
use crate::system::Form;

impl Summary {
    /// The summary of a run of `scene`, given the `warnings` of its [`Assessment`](crate::assessment::Assessment).
    pub fn of(scene: &Scene, stepper: &Stepper, outcome: &Outcome, warnings: &[String]) -> Self {
        let (metrics, work) = (stepper.metrics(), stepper.work());
        let (now, model) = (&metrics.now, stepper.model());
        let elapsed = metrics.elapsed();
        let mean = |integral: f64| if elapsed > 0.0 { integral / elapsed } else { 0.0 };
        let Power { actuation, material, viscous, wake, spray, load, head, flow, other } = metrics.totals.work;
        let dynamics = stepper.view().dynamics;
        let whole = stepper.cycles().since_start();
        let of_run =
            |measure: &cycle::CycleMeasure| measure.mean(whole.as_slice(), dynamics).filter(|_| whole.is_some());
        // What gets nowhere in its cycles does not swim, however far its start has moved it.
        let of_swimmer = |measure: &cycle::CycleMeasure| {
            let cycles = stepper.cycles().whole(f64::INFINITY);
            of_run(measure).filter(|_| cycles.is_empty() || measure.mean(cycles, dynamics).is_some())
        };
        let cycles = stepper.cycles().averages(dynamics);
        let hinge = model.hinge.as_ref().map(|_| metrics.totals.hinge);
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
            net_displacement_m: metrics.net_displacement(),
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
            cost_of_transport: of_swimmer(&cycle::COST_OF_TRANSPORT),
            efficiency: of_swimmer(&cycle::EFFICIENCY),
            head_force_n: model.head.as_ref().map(|_| now.head_force.into()),
            head_moment_n_m: model.head.as_ref().map(|_| now.head_moment),
            mean_head_force_n: of_run(&cycle::HEAD_FORCE_X).zip(of_run(&cycle::HEAD_FORCE_Y)).map(|(x, y)| [x, y]),
            mean_thrust_n: of_run(&cycle::THRUST),
            mean_head_moment_n_m: of_run(&cycle::HEAD_MOMENT),
            max_head_force_n: model.head.as_ref().map(|_| metrics.totals.max_on_head[0]),
            max_head_moment_n_m: model.head.as_ref().map(|_| metrics.totals.max_on_head[1]),
            max_hinge_torque_n_m: hinge.map(|hinge| hinge.torque),
            max_hinge_power_w: hinge.map(|hinge| hinge.power),
            max_hinge_speed_rad_s: hinge.map(|hinge| hinge.speed),
            max_head_power_w: model.head.as_ref().map(|_| metrics.totals.max_power[1]),
            max_joint_moment_n_m: metrics.totals.max_couple,
            max_actuation_power_w: (model.actuation.is_some() || !model.tendons.is_empty())
                .then_some(metrics.totals.max_power[0]),
            tendons: TendonMaxima(metrics.totals.tendons[..model.tendons.len()].to_vec()),
            cycles,
            wall_s: outcome.wall.as_secs_f64(),
            verification: None,
            final_positions_m: stepper.state().q.chunks_exact(2).map(|p| [p[0], p[1]]).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use std::path::Path;
    use std::time::Duration;

    use super::*;
    use crate::report::{RunRecord, energy_balance};
    use crate::scene::Document;

    #[test]
    fn the_parts_of_a_drawn_energy_balance_add_up_to_zero_and_are_those_of_the_summary() {
        for (model, least) in [
            ("dipping-tail", 9),
            ("eel", 7),
            ("baseline", 5),
            ("driven-head", 5),
            ("glycerol", 5),
            ("flag", 6),
            ("snake", 4),
        ] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("models/{model}.toml"));
            let mut document = Document::read(&path).unwrap();
            document.set("solver.duration_s=0.5").unwrap();
            let scene = document.scene().unwrap();
            let mut stepper = Stepper::of(&scene).unwrap();
            let mut record = RunRecord::start(&scene, &stepper);
            for _ in 0..50 {
                stepper.do_step(0.01).unwrap();
                record.pass(&mut stepper).unwrap();
            }
            record.finish(&stepper.view());
            let parts = energy_balance(&record);
            assert!(parts.len() >= least, "{model}: {}", parts.len());
            for k in 0..parts[0].points.len() {
                let each = parts.iter().map(|part| part.points[k].1);
                let (sum, size) = (each.clone().sum::<f64>(), each.map(f64::abs).sum::<f64>());
                assert!(sum.abs() <= 1e-9 * size, "{model}: {sum} of {size}");
            }
            let outcome = Outcome { ending: Ending::Complete, wall: Duration::ZERO };
            let s = Summary::of(&scene, &stepper, &outcome, &[]);
            let put_in = s.actuation_work_j + s.load_work_j + s.head_work_j + s.flow_work_j + s.other_work_j;
            let stored = s.stretching_energy_j + s.bending_energy_j + s.kinetic_energy_j + s.fluid_energy_j;
            let taken =
                s.viscous_work_j + s.wake_work_j + s.spray_work_j + s.material_work_j + s.numerical_dissipation_j;
            let sources = ["actuation", "loads", "head", "flow", "other forces"];
            let sum = |of_sources: bool| -> f64 {
                let of = parts.iter().filter(|part| sources.contains(&part.label.as_str()) == of_sources);
                of.map(|part| part.points.last().unwrap().1).sum()
            };
            let size: f64 = parts.iter().map(|part| part.points.last().unwrap().1.abs()).sum();
            let initial = s.initial_energy_j;
            assert!((sum(true) - put_in).abs() <= 1e-9 * size, "{model}: {} for {put_in}", sum(true));
            assert!(
                (sum(false) + taken + stored - initial).abs() <= 1e-9 * size,
                "{model}: {} for {taken}",
                sum(false)
            );
        }
    }
}
