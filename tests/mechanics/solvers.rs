//! Every scene ends at the same place whichever solver its linear systems are given to.

use crate::common;
use caudal::linear::SolverChoice;
use caudal::scene::{Document, Scene};
use common::largest;

/// Largest difference allowed between final positions, over the length. Measured: at most 1.7e-14 (glycerol_jump_n9).
const TOLERANCE: f64 = 1e-9;

/// Durations are cut to this, s.
const SHORT: f64 = 0.2;

/// Up to this many nodes the fast solver needs no help on these scenes.
const ALONE_UP_TO: usize = 201;

/// Beyond this many nodes a scene runs in the chain form, which has its own solver.
const POSITIONS_UP_TO: usize = 1001;

/// Rings after a jump without any damping: what differs by a rounding differs by more at every step.
const CHAOTIC: &str = "newmark-compare-newmark";

/// The scenes of `models/` and `tests/reference/`, shortened.
fn scenes() -> Vec<(String, Document)> {
    let mut scenes = Vec::new();
    for folder in ["models", "tests/reference"] {
        for path in common::scene_files(folder) {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            if name == CHAOTIC {
                continue;
            }
            let mut document = Document::read(&path).unwrap();
            if document.scene().unwrap().rod.nodes.get() > POSITIONS_UP_TO {
                continue;
            }
            document.set("solver.newton_tolerance=1e-12").unwrap();
            if Scene::load(&path).unwrap().solver.duration_s.get() > SHORT {
                document.set(&format!("solver.duration_s={SHORT}")).unwrap();
            }
            scenes.push((name, document));
        }
    }
    scenes
}

#[test]
fn every_scene_ends_at_the_same_place_with_each_linear_solver() {
    let scenes = scenes();
    assert_eq!(scenes.len(), 37);
    for (name, document) in scenes {
        let mut scene = document.scene().unwrap();
        assert_eq!(scene.solver.linear, SolverChoice::Auto);
        let [auto, lu, band] = [SolverChoice::Auto, SolverChoice::FaerLu, SolverChoice::BlockBand].map(|choice| {
            scene.solver.linear = choice;
            common::run(&scene)
        });
        let length = auto.model().rod.length;
        let difference = largest(auto.state().q.iter().zip(&lu.state().q).map(|(a, b)| (a - b) / length));
        println!("{name}: {difference:e}, {:?} {:?}", auto.work(), lu.work());
        assert!(difference <= TOLERANCE, "{name}: {difference:e}");
        if scene.rod.nodes.get() <= ALONE_UP_TO {
            assert_eq!(auto.state(), band.state(), "{name}");
            assert_eq!([auto, lu, band].map(|stepper| stepper.work().linear_fallbacks), [0; 3], "{name}");
        }
    }
}

#[test]
fn a_scene_chooses_its_linear_solver_by_name() {
    for (name, choice) in
        [("auto", SolverChoice::Auto), ("faer-lu", SolverChoice::FaerLu), ("block-band", SolverChoice::BlockBand)]
    {
        let scene = common::scene(&[&format!("solver.linear={name}")]);
        assert_eq!(scene.solver.linear, choice);
        assert_eq!(serde_json::to_value(choice).unwrap(), name);
    }
}

#[test]
fn where_the_fast_solver_fails_the_other_goes_on_and_a_restored_run_goes_on_equal_to_the_bit() {
    // So fine a mesh that after the jump Newton's first iterates go astray, to matrices that need pivoting.
    let mut stepper = common::stepper_of(common::STUDY, &["rod.nodes=2001", "solver.form=positions"]);
    let before = stepper.save();
    let [first, second] = [0, 1].map(|_| {
        stepper.restore(&before).unwrap();
        for _ in 0..5 {
            stepper.do_step(5e-3).unwrap();
        }
        (stepper.state().clone(), stepper.work())
    });
    assert_eq!(first, second);
    println!("{:?}", first.1);
    assert!(first.1.linear_fallbacks > 0);
    // An iterate that the model refuses is counted as an iteration, and not factored.
    assert!(first.1.factorisations <= first.1.newton_iterations + first.1.linear_fallbacks);
}
