//! What a step cannot follow is said: the largest strain and the largest rotation within a step are those of the run.

use crate::common;
use std::time::Duration;

use caudal::assessment::Assessment;
use caudal::report::Summary;
use caudal::rod::node;
use caudal::run::{Ending, Outcome};
use caudal::scene::Scene;
use caudal::sensitivity::Problem;
use caudal::stepper::Stepper;
use common::{SOFT, STUDY, run_with, scene_of};
use nalgebra::Vector2;

/// The summary of a run of `scene`, and the largest strain and rotation (rad) that its states show.
fn summary(scene: &Scene) -> (Summary, [f64; 2]) {
    let edges = |stepper: &Stepper| -> Vec<Vector2<f64>> {
        let q = &stepper.state().q;
        (1..q.len() / 2).map(|k| node(q, k) - node(q, k - 1)).collect()
    };
    let mut before = edges(&Stepper::of(scene).unwrap());
    let spacing = common::rod(scene).spacing;
    let [mut strain, mut rotation] = [0.0_f64; 2];
    let stepper = run_with(scene, |stepper| {
        let after = edges(stepper);
        for (old, new) in before.iter().zip(&after) {
            strain = strain.max((new.norm() / spacing - 1.0).abs());
            rotation = rotation.max(old.perp(new).atan2(old.dot(new)).abs());
        }
        before = after;
    });
    let outcome = Outcome { ending: Ending::Complete, wall: Duration::ZERO };
    (Summary::of(scene, &stepper, &outcome, &[]), [strain, rotation])
}

fn says(summary: &Summary, what: &str) -> bool {
    summary.notes.iter().any(|note| note.contains(what))
}

#[test]
fn the_summary_has_the_largest_strain_and_rotation_of_both_forms() {
    for form in ["positions", "chain"] {
        for head in ["free", "driven"] {
            let form = format!("solver.form={form}");
            let changes = [&form[..], &format!("head.kind={head}"), "solver.duration_s=0.2", "start.kind=jump"];
            let (summary, [strain, rotation]) = summary(&scene_of(SOFT, &changes));
            // Measured: at most 3e-15 apart.
            assert!(strain > 1e-4 && (summary.max_strain - strain).abs() < 1e-12, "{strain}");
            assert!(rotation > 1e-3 && (summary.max_rotation_per_step_rad - rotation).abs() < 1e-12, "{rotation}");
        }
    }
}

#[test]
fn an_edge_that_turns_by_more_than_45_degrees_in_a_step_is_worth_a_note() {
    // The study's release takes its shape within one step of 5 ms: by 45.7°; within one of 0.1 ms it turns by 7.1°.
    for (step, noted) in [(5e-3, true), (1e-4, false)] {
        let step = format!("solver.time_step_s={step}");
        let (summary, [_, rotation]) = summary(&scene_of(STUDY, &[&step, "solver.duration_s=0.02"]));
        println!("{step}: {:.1}°", rotation.to_degrees());
        assert_eq!(says(&summary, "within one step"), noted, "{:?}", summary.notes);
    }
}

#[test]
fn a_strain_of_more_than_5_percent_is_worth_a_note() {
    // The tip is pulled at once by EA/10 or EA/100: measured 20.3 % and 2.03 %.
    for (part, noted) in [(0.1, true), (0.01, false)] {
        let force = part * common::rod(&scene_of(SOFT, &[])).ea;
        let load = format!("loads.point=[{{ node = -1, force_n = [{force}, 0.0] }}]");
        let (summary, [strain, _]) = summary(&scene_of(SOFT, &[&load, "head.kind=clamped", "actuation.kappa_amp=0"]));
        println!("{part}: {strain}");
        assert_eq!(says(&summary, "stretched"), noted, "{:?}", summary.notes);
    }
}

#[test]
fn an_energy_balance_of_rounding_alone_is_no_note() {
    // A rod at rest at an angle, and one that hardly moves: measured 3e-27 J and 2e-25 J that come from rounding.
    let text = include_str!("../../models/cantilever.toml");
    let still = ["loads.gravity_m_s2=[0.0, 0.0]", "loads.point=[]", "start.kind=shaped", "solver.duration_s=0.5"];
    let still = [&still[..], &["head.kind=driven", "head.angle_rad=0.3"]].concat();
    let faint = ["start.kind=shaped", "actuation.kappa_amp=1e-12", "solver.duration_s=0.5"];
    for scene in [scene_of(text, &still), scene_of(STUDY, &faint)] {
        let (summary, _) = summary(&scene);
        println!("{:e} J", summary.numerical_dissipation_j);
        assert!(summary.notes.is_empty(), "{:?}", summary.notes);
    }
}

#[test]
fn adaptive_steps_are_not_advised_on_a_time_step_that_they_have_not() {
    // In five steps a period, and by a tolerance.
    let warnings = |steps: &str| {
        let scene = scene_of(STUDY, &["solver.integrator=esdirk3", "solver.duration_s=2.0", steps]);
        Assessment::of(&scene, &Stepper::of(&scene).unwrap()).unwrap().warnings
    };
    let (fixed, adaptive) = (warnings("solver.time_step_s=0.1"), warnings("solver.tolerance=1e-2"));
    let judged = |warnings: &[String]| warnings.iter().filter(|text| text.contains("time step")).count();
    assert_eq!((judged(&fixed), judged(&adaptive)), (2, 0), "{fixed:?} {adaptive:?}");
    assert!(
        adaptive.iter().any(|text| text.contains("excites vibrations") && text.contains("tolerance")),
        "{adaptive:?}"
    );
}

#[test]
fn a_mesh_that_positions_cannot_resolve_is_refused_wherever_it_is_solved_in_positions() {
    let scene = |changes: &[&str]| {
        let text = include_str!("../../models/spinning-bar.toml");
        scene_of(text, &[&["rod.nodes=100001", "solver.form=positions"], changes].concat())
    };
    let fine = scene(&[]);
    let refusals =
        [Stepper::of(&fine).map(drop), Problem::of(&fine).map(drop)].map(|refused| refused.unwrap_err().to_string());
    assert!(
        refusals[0].contains("rod.nodes: found 100001; the mesh is too fine to solve for positions"),
        "{refusals:?}"
    );
    assert_eq!(refusals[0], refusals[1]);
    Stepper::of(&scene(&["solver.form=auto"])).unwrap();
    // Its steps bend less.
    Stepper::of(&scene(&["solver.time_step_s=1e-5"])).unwrap();
}
