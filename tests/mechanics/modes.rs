//! Natural modes: frequencies of the beam on any mesh, shapes that solve K φ = ω² M φ, and matrices others can read.

use crate::common;
use caudal::assessment::Assessment;
use caudal::modes::{HighestFrequencies, Matrices, ModeKind, Modes, first_frequency, lowest, lowest_of_model};
use common::{DRAG, GLYCEROL, rod, scene};

const UNIFORM: &str = "rod.stiffness_gradient=0.0";

#[test]
fn the_lowest_frequencies_are_those_of_all_frequencies_on_coarse_and_fine_meshes() {
    // Measured: equal; at 129 nodes, where the iteration takes over, 8.2e-10.
    for (nodes, digits) in [(9, 1e-11), (33, 1e-11), (65, 1e-11), (129, 2e-9)] {
        for head in ["head.kind=free", "head.kind=clamped"] {
            let rod = rod(&scene(&[&format!("rod.nodes={nodes}"), head]));
            let all = Modes::of(&rod).unwrap();
            let mut rising = [all.bending, all.stretching].concat();
            rising.sort_by(f64::total_cmp);
            for (mode, wanted) in lowest(&rod, 4).unwrap().iter().zip(rising) {
                assert!((mode.frequency / wanted - 1.0).abs() < digits, "{nodes} {head}: {} {wanted}", mode.frequency);
            }
        }
    }
}

#[test]
fn the_first_frequency_is_the_same_alone_among_a_few_and_among_all() {
    let (mut compared, mut largest) = (0, [0.0_f64; 2]);
    for path in common::all_scene_files() {
        let text = std::fs::read_to_string(&path).unwrap();
        let Ok(scene) = common::document_of(&path, &text, &["rod.nodes=67"]).scene() else { continue };
        let Ok(model) = scene.model() else { continue };
        let all = Modes::of_model(model).unwrap().lowest();
        let few = lowest_of_model(scene.model().unwrap(), 2).unwrap()[0].frequency;
        let alone = first_frequency(scene.model().unwrap()).unwrap();
        let off = [(few / all - 1.0).abs(), (alone / few - 1.0).abs()];
        // Measured: 9.4e-10 against all, where dense matrices are rounded, and 5.5e-11, of a servo-tail.
        assert!(off[0] < 2e-9 && off[1] < 1e-10, "{path:?}: {alone}, {few}, {all}");
        (compared, largest) = (compared + 1, [0, 1].map(|i| largest[i].max(off[i])));
    }
    println!("{compared} rods, at most {largest:?} off");
    assert!(compared > 30);
}

#[test]
fn bounds_enclose_the_highest_frequencies_of_all_scenes() {
    let (mut compared, mut loosest) = (0, 1.0_f64);
    for path in common::all_scene_files() {
        let text = std::fs::read_to_string(&path).unwrap();
        let Ok(scene) = common::document_of(&path, &text, &[]).scene() else { continue };
        if scene.rod.nodes.get() > 65 {
            continue;
        }
        let matrices = Matrices::of_natural_modes(scene.model().unwrap()).unwrap();
        let all = Modes::of_matrices(&matrices, 0.0).unwrap();
        let bounds = HighestFrequencies::bounds(&matrices, 0.0).unwrap_or_else(|| panic!("{path:?} has none"));
        for (bound, own) in bounds.frequencies.into_iter().zip([&all.bending, &all.stretching]) {
            // Measured: at most 1.315.
            let ratio = bound / own.last().unwrap();
            assert!((1.0 - 1e-12..1.5).contains(&ratio), "{path:?}: {ratio}");
            (compared, loosest) = (compared + 1, loosest.max(ratio));
        }
    }
    println!("{compared} axes, at most {loosest:.3} times");
    assert!(compared > 40);
}

#[test]
fn a_run_warns_of_fine_meshes_as_check_does() {
    for (model, changes) in [
        ("baseline", &["rod.nodes=129", "solver.integrator=symplectic-euler", "solver.time_step_s=1e-6"][..]),
        ("baseline", &["rod.nodes=129", "solver.integrator=symplectic-euler", "solver.time_step_s=1e-9"]),
        ("baseline", &["rod.nodes=129", "solver.time_step_s=1e-3", "start.kind=jump"]),
        ("baseline", &["rod.nodes=301", "solver.time_step_s=1e-3", "start.kind=jump"]),
        ("eel", &["rod.nodes=101"]),
        ("driven-head", &["rod.nodes=101"]),
    ] {
        let text = std::fs::read_to_string(format!("models/{model}.toml")).unwrap();
        let scene = common::scene_of(&text, changes);
        let stepper = caudal::stepper::Stepper::of(&scene).unwrap();
        let [run, check] = [Assessment::of_run(&scene, &stepper), Assessment::of(&scene, &stepper)].map(Result::unwrap);
        assert_eq!(run.warnings, check.warnings, "{model} {changes:?}");
        assert_eq!(run.first_frequency, check.first_frequency);
        println!("{model} {changes:?}: {:?}", run.warnings);
        let coarse = scene.with_nodes_up_to(201).model().unwrap();
        let all = Modes::of_model(coarse).unwrap();
        // Measured: 3e-9.
        assert!((run.first_frequency / all.lowest() - 1.0).abs() < 1e-7, "{model}: {}", run.first_frequency);
        let beyond = run.warnings.iter().any(|warning| warning.contains("stability limit"));
        assert_eq!(beyond, changes.contains(&"solver.time_step_s=1e-6"));
    }
}

#[test]
fn frequencies_converge_to_the_beam_s_up_to_a_hundred_thousand_nodes() {
    // βL of a free and of a clamped beam.
    for (head, wanted) in [
        ("head.kind=free", [4.730040744862704, 7.853204624095838]),
        ("head.kind=clamped", [1.875104068711961, 4.694091132974175]),
    ] {
        for (nodes, digits) in [(1001, 2e-5), (10_001, 2e-7), (100_001, 5e-9)] {
            let rod = rod(&scene(&[UNIFORM, head, &format!("rod.nodes={nodes}")]));
            let unit = (rod.ei / (rod.length.powi(3) * rod.total_mass())).sqrt();
            let found = lowest(&rod, 6).unwrap();
            let found: Vec<f64> = found
                .iter()
                .filter(|mode| mode.axis == ModeKind::Bending)
                .map(|mode| (mode.frequency / unit).sqrt())
                .collect();
            for (found, wanted) in found.iter().zip(wanted) {
                // Measured: 4.6e-6, 4.6e-8, 4.6e-10.
                assert!((found / wanted - 1.0).abs() < digits, "{head} {nodes}: {found} {wanted}");
            }
        }
    }
}

#[test]
fn shapes_solve_the_eigenproblem_and_drag_damps_them() {
    for head in ["head.kind=free", "head.kind=clamped"] {
        let scene = scene(&["rod.nodes=33", "rod.mass_lumping=uniform", head, GLYCEROL, "drag={ ratio = 5.0 }"]);
        let model = scene.model().unwrap();
        let [_, across] = model.forces.resistance(&model.rod, model.fluid).unwrap();
        let rod = model.rod.clone();
        let matrices = Matrices::of(model).unwrap();
        for mode in lowest(&rod, 8).unwrap() {
            let i = usize::from(mode.axis == ModeKind::Bending);
            let square = mode.frequency.powi(2);
            for k in matrices.free.first..33 {
                let force: f64 = (matrices.free.first..33)
                    .map(|j| matrices.stiffness.entry(2 * k + i, 2 * j + i) * mode.shape[j])
                    .sum();
                let scale = matrices.stiffness.entry(2 * k + i, 2 * k + i);
                let rest = force - square * matrices.mass[2 * k + i] * mode.shape[k];
                assert!(rest.abs() < 1e-13 * scale, "{head} {}: {rest:e} of {scale:e}", mode.frequency); // measured: 1.8e-15
            }
            assert!((mode.shape.iter().fold(0.0, |max: f64, x| max.max(x.abs())) - 1.0).abs() < 1e-15);
            let ratio = matrices.damping_ratio(&mode).unwrap();
            assert!(ratio > 0.0);
            if mode.axis == ModeKind::Bending && matrices.free.first == 0 {
                // All masses are ρAΔL and all drags ξΔL but those of the ends, ½ξΔL.
                let even = across * rod.spacing / (2.0 * mode.frequency * rod.mass[1]);
                // Measured: 0.89 to 0.95 of it.
                assert!(ratio < even && ratio > 0.85 * even, "{ratio} {even}");
            }
        }
    }
}

#[test]
fn the_matrices_read_back_from_matrix_market_text() {
    let model = scene(&["head.kind=clamped", GLYCEROL, DRAG]).model().unwrap();
    let matrices = Matrices::of(model).unwrap();
    let texts = matrices.matrix_market();
    assert_eq!(texts.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["mass.mtx", "stiffness.mtx", "damping.mtx"]);
    for (name, text) in &texts {
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some("%%MatrixMarket matrix coordinate real symmetric"));
        let mut lines = lines.skip_while(|line| line.starts_with('%'));
        let sizes: Vec<usize> = lines.next().unwrap().split(' ').map(|x| x.parse().unwrap()).collect();
        let entries: Vec<Vec<f64>> = lines.map(|line| line.split(' ').map(|x| x.parse().unwrap()).collect()).collect();
        assert_eq!(sizes, [16, 16, entries.len()], "{name}");
        for entry in entries {
            let (i, j) = (entry[0] as usize - 1, entry[1] as usize - 1);
            assert!(j <= i && i < 16, "{name}");
            let wanted = match *name {
                "mass.mtx" => matrices.mass[2 + i],
                "stiffness.mtx" => matrices.stiffness.entry(2 + i, 2 + j),
                _ => matrices.damping.as_ref().unwrap().entry(2 + i, 2 + j),
            };
            assert_eq!(entry[2], wanted, "{name} {i} {j}");
        }
    }
}
