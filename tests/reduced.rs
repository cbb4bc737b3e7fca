//! The cheaper models of a scene: the shape model's published numbers, the overdamped limit, balances, and error estimates
//! that keep what they promise.

mod common;

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use caudal::actuation::{Actuation, TravellingWave, Wave};
use caudal::fluid::force::{Force, OnTip, Tally, Validity};
use caudal::fluid::{Forces, Kinematics};
use caudal::integrator::Method;
use caudal::newton::Newton;
use caudal::reduced::{Choice, Estimates, RUNGS};
use caudal::report::chart::{Chart, Mark, Scale, Series};
use caudal::scene::Scene;
use caudal::stepper::Stepper;
use caudal::system::Direction;
use common::{SOFT, STUDY, distance, largest, order, scene_of};

const SMOOTH: &str = include_str!("../models/baseline-smooth.toml");
const DRIVEN: &str = include_str!("../models/driven-head.toml");

/// A thin swimmer in thick fluid: inertia is small.
const THIN: &str = r#"
[rod]
nodes = 17
length_m = 0.1
outer_radius_m = 5e-4
youngs_modulus_pa = 1e6
density_kg_m3 = 1100.0
[actuation]
kind = "travelling-wave"
kappa_amp = 30.0
frequency_hz = 1.0
wavelength_m = 0.1
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1260.0
[drag]
ratio = 2.0
[solver]
duration_s = 3.0
"#;

fn by(model: &str, text: &str, changes: &[&str]) -> Scene {
    scene_of(text, &[changes, &[&format!("solver.model={model}")]].concat())
}

fn whole(text: &str, changes: &[&str], tolerance: &str) -> Stepper {
    let tolerance = format!("solver.tolerance={tolerance}");
    common::run(&scene_of(text, &[changes, &["solver.integrator=esdirk3", &tolerance]].concat()))
}

#[test]
fn the_shape_of_the_study_tail_moves_as_an_independent_code_says() {
    let cases = [
        ("start={ kind = \"ramp\", ramp_s = 0.5 }", -3.311760e-4, None),
        ("start={ kind = \"shaped\" }", -4.487693e-4, Some(-2.6472e-5)),
    ];
    // Measured: 1.3e-7 of Δx (the reference has 7 digits), 1.2e-6 of y (5 digits).
    for pace in ["time_step_s=5e-3", "tolerance=1e-4", "tolerance=1e-7"] {
        for (start, dx, y) in cases {
            let run = common::run(&by("shape", STUDY, &[start, "solver.duration_s=2", &format!("solver.{pace}")]));
            let meter = run.meter();
            let error = meter.net_displacement() / dx - 1.0;
            println!("{pace} {start}: {:e} ({error:e}), {:e}", meter.net_displacement(), meter.now.com.y);
            assert!(error.abs() <= 1e-6, "{pace} {start}: {error:e}");
            assert!(y.is_none_or(|y| (meter.now.com.y / y - 1.0).abs() <= 1e-5), "{:e}", meter.now.com.y);
        }
    }
}

#[test]
fn the_shape_model_is_as_good_as_implicit_euler_without_a_matrix_in_a_thirtieth_of_the_evaluations() {
    // Six stages, the middle and two readings of a step: see `a_part_costs_what_it_is_asked`.
    const EVALUATIONS: u64 = 11;
    let truth = whole(SMOOTH, &[], "1e-6").meter().net_displacement();
    let error = |run: &Stepper| (run.meter().net_displacement() / truth - 1.0).abs();
    let shape = common::run(&by("shape", SMOOTH, &["solver.tolerance=1e-4"]));
    // A step of implicit Euler whose error is still the larger one.
    let euler = common::run(&scene_of(SMOOTH, &["solver.time_step_s=1.4e-4"]));
    let totals = shape.meter().totals;
    let (evaluations, iterations) = (EVALUATIONS * (totals.steps + totals.rejections), euler.work().newton_iterations);
    println!(
        "shape: {:e}, {evaluations} evaluations; implicit Euler: {:e}, {iterations}",
        error(&shape),
        error(&euler)
    );
    assert!(error(&shape) <= 1e-3); // measured: 1.6e-4
    assert!(error(&euler) >= error(&shape));
    assert_eq!(shape.work().factorisations, 0);
    assert!(iterations >= 30 * evaluations, "{}", iterations / evaluations); // measured: 40
}

#[test]
fn the_overdamped_model_swims_at_the_speed_of_gray_and_hancock() {
    // U/(ω/k) = ½(α−1)(kb)²/(1 + ½α(kb)²), times what a finite length leaves of it.
    const SWIMMER: &str = r#"
    [rod]
    nodes = 65
    length_m = 1.0
    outer_radius_m = 0.005
    youngs_modulus_pa = 1e11
    density_kg_m3 = 1000.0
    [actuation]
    kind = "travelling-wave"
    kappa_amp = 1.0
    frequency_hz = 1.0
    wavelength_m = 1.0
    [medium]
    viscosity_pa_s = 1.0
    density_kg_m3 = 1000.0
    [drag]
    ratio = 2.0
    [solver]
    model = "overdamped"
    tolerance = 1e-6
    duration_s = 1.0
    "#;
    let steep = 0.05; // k b
    for (waves, part) in [(1.0, 0.696), (2.0, 0.924), (4.0, 0.981)] {
        let k = std::f64::consts::TAU * waves;
        let (length, curvature) =
            (format!("actuation.wavelength_m={}", 1.0 / waves), format!("actuation.kappa_amp={}", k * steep));
        let nodes = format!("rod.nodes={}", 64 * waves as u32 + 1);
        let run = common::run(&scene_of(SWIMMER, &[&length, &curvature, &nodes]));
        let per_period = std::f64::consts::TAU / k * 0.5 * steep * steep / (1.0 + steep * steep);
        let ratio = -run.meter().net_displacement() / (part * per_period);
        println!("{waves} waves: {ratio}");
        assert!((ratio - 1.0).abs() <= 0.02, "{waves} waves: {ratio}"); // measured: 0.04 % … 0.08 %
    }
}

#[test]
fn the_whole_model_becomes_the_overdamped_one_as_mass_vanishes() {
    let overdamped = common::run(&by("overdamped", THIN, &["solver.tolerance=1e-7", "solver.duration_s=1"]));
    let distances: Vec<f64> = ["1000", "100", "10", "1"]
        .iter()
        .map(|density| {
            let changes = [&format!("rod.density_kg_m3={density}")[..], "solver.duration_s=1"];
            distance(&whole(THIN, &changes, "1e-8").state().q, &overdamped.state().q)
        })
        .collect();
    println!("{distances:?}");
    for pair in distances.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((8.0..12.0).contains(&ratio), "{distances:?}"); // first order in the mass
    }
    assert!(distances[3] <= 5e-6, "{distances:?}"); // measured: 2.4e-6, of a length of 0.1 m
}

#[test]
fn balance_recovers_the_moments_and_the_reaction_of_the_whole_model() {
    // A smooth start of a stiff rod, so that the whole one does not ring; what is left is its deviation.
    let driven = ["rod.youngs_modulus_pa=1e12", "start={ kind = \"ramp\", ramp_s = 0.5 }", "solver.duration_s=0.8"];
    let smooth = "head={ position_m = { amplitude = [0.0, 0.0], frequency_hz = 1.0 }, angle_rad = 0.0 }";
    let wave = "actuation={ kind = \"travelling-wave\", kappa_amp = 3.0, frequency_hz = 2.0, wavelength_m = 0.3 }";
    let held = [&driven[..], &[smooth, wave]].concat();
    let free = ["start={ kind = \"ramp\", ramp_s = 0.5 }", "solver.duration_s=0.8"];
    for (text, changes) in [(SMOOTH, &free[..]), (DRIVEN, &held[..])] {
        let shape = common::run(&by("shape", text, &[changes, &["solver.time_step_s=1e-3"]].concat()));
        let full = whole(text, changes, "1e-7");
        for name in ["joint_moment_n_m", "head_force_x_n", "head_force_y_n", "head_moment_n_m", "actuation_power_w"] {
            let (Ok(found), Ok(expected)) = (shape.get(name), full.get(name)) else { continue };
            let error = distance(&found, &expected) / largest(expected.iter().copied());
            println!("{name}: {error:e}");
            // Measured: 1.1e-2, of the power, and 6.4e-3, of the force along the rod.
            assert!(error <= 2e-2, "{name}: {found:?} {expected:?}");
        }
    }
}

#[test]
fn every_rung_closes_its_energy_balance() {
    let host_head = ["solver.duration_s=1"];
    let soft = ["solver.duration_s=1", "medium.flow_m_s=[0.1, -0.05]", "loads.gravity_m_s2=[0.02, 0.1]"];
    for rung in RUNGS {
        for (text, changes) in [(SOFT, &soft[..]), (DRIVEN, &host_head[..])] {
            let adaptive = [changes, &["solver.integrator=esdirk3", "solver.time_step_s=2.5e-4"]].concat();
            let run = common::run(&by(rung.name, text, &adaptive));
            let meter = run.meter();
            let work = meter.totals.work;
            let size = largest([work.actuation, work.viscous, work.load, work.head, work.flow]);
            let defect = meter.numerical_dissipation() / size;
            println!("{} : {defect:e} {work:?} {:?}", rung.name, meter.now.energy);
            assert!(defect.abs() <= 1e-5, "{}: {defect:e}", rung.name); // measured: 2.7e-6
        }
    }
}

#[test]
fn every_rung_is_driven_like_any_other() {
    for rung in RUNGS {
        for text in [SOFT, DRIVEN] {
            for pace in ["time_step_s=2e-3", "tolerance=1e-4"] {
                let scene = by(rung.name, text, &["solver.integrator=esdirk3", &format!("solver.{pace}")]);
                let mut tail = Stepper::of(&scene).unwrap();
                tail.do_step(0.1).unwrap();
                let joints = tail.get("curvature_1_m").unwrap().len();
                tail.set("natural_curvature_1_m", &vec![0.4; joints]).unwrap();
                tail.set("force_y_n", &vec![1e-3; tail.model().rod.nodes]).unwrap();
                tail.do_step(0.05).unwrap();
                let saved = tail.save();
                tail.do_step(0.1).unwrap();
                let (state, totals) = (tail.state().clone(), tail.meter().totals);
                tail.restore(&saved).unwrap();
                tail.do_step(0.1).unwrap();
                assert_eq!(*tail.state(), state, "{} {pace}", rung.name);
                assert_eq!(tail.meter().totals, totals, "{} {pace}", rung.name);
                let energy = tail.at(tail.time() - 1e-4, |view| view.meter.now.energy.total()).unwrap();
                assert!(energy.is_finite());
            }
        }
    }
}

#[test]
fn a_shape_that_changes_at_once_keeps_its_momentum_and_its_balance() {
    let scene = by("shape", SOFT, &["solver.time_step_s=1e-3"]);
    let mut tail = Stepper::of(&scene).unwrap();
    tail.do_step(0.2).unwrap();
    let mass = tail.model().rod.mass.clone();
    let momenta = |tail: &Stepper| {
        let (q, v) = (&tail.state().q, &tail.state().v);
        let sum = |of: &dyn Fn(usize) -> f64| -> f64 { mass.iter().enumerate().map(|(k, m)| m * of(k)).sum() };
        [sum(&|k| v[2 * k]), sum(&|k| v[2 * k + 1]), sum(&|k| q[2 * k] * v[2 * k + 1] - q[2 * k + 1] * v[2 * k])]
    };
    let (before, at) = (momenta(&tail), tail.get("x_com_m").unwrap());
    let joints = tail.get("curvature_1_m").unwrap().len();
    tail.set("natural_curvature_1_m", &vec![0.5; joints]).unwrap();
    tail.do_step(1e-9).unwrap();
    let difference = distance(&before, &momenta(&tail)) / largest(before);
    let moved = (tail.get("x_com_m").unwrap()[0] - at[0]).abs();
    println!("{difference:e}, {moved:e} m");
    assert!(difference <= 2e-8, "{difference:e}"); // measured: 4.2e-9
    assert!(moved <= 1e-10, "{moved:e}"); // measured: 2.1e-11
    tail.do_step(0.5).unwrap();
    let defect = tail.meter().numerical_dissipation() / tail.meter().totals.work.viscous;
    println!("{defect:e}");
    assert!(defect.abs() <= 1e-11, "{defect:e}"); // measured: 6.2e-13
}

#[test]
fn the_shape_is_known_between_its_steps() {
    let mut scene = by("shape", SMOOTH, &["solver.tolerance=1e-4", "solver.duration_s=1"]);
    let mut tail = Stepper::of(&scene).unwrap();
    tail.do_step(0.7).unwrap();
    let time = tail.time() - 0.01;
    let within = tail.at(time, |view| view.state.q.clone()).unwrap();
    scene.solver.tolerance = None;
    let mut exact = Stepper::of(&by("shape", SMOOTH, &["solver.time_step_s=1e-4"])).unwrap();
    exact.do_step(time).unwrap();
    let error = distance(&within, &exact.state().q);
    println!("{error:e}");
    assert!(error <= 1e-6, "{error:e}"); // measured: 1.6e-7, with steps of a sixteenth of a period
}

#[test]
fn shape_converges_with_its_order_and_halves_steps_that_are_too_long() {
    let run =
        |step: &str| common::run(&by("shape", SOFT, &["solver.duration_s=0.4", &format!("solver.time_step_s={step}")]));
    let [coarse, fine, finest, long] = ["1e-2", "5e-3", "5e-4", "0.2"].map(run);
    let distances = [&coarse, &fine, &long].map(|run| distance(&run.state().q, &finest.state().q));
    println!("{distances:?}, {} halvings", long.meter().totals.halvings);
    assert_eq!(coarse.meter().totals.halvings, 0);
    assert!((4.5..5.7).contains(&order(distances[0], distances[1])), "{distances:?}");
    assert!(long.meter().totals.halvings > 0 && distances[2] <= 3e-9, "{distances:?}"); // measured: 7.0e-10
}

/// A part of a model that counts how often it is asked.
#[derive(Debug, Clone)]
struct Counted<T>(T, Arc<AtomicU64>);

impl Force for Counted<Box<dyn Force>> {
    fn name(&self) -> &'static str {
        self.0.name()
    }

    fn validity(&self) -> Validity {
        self.0.validity()
    }

    fn evaluate(&self, rod: &Kinematics<'_>, along: Option<Direction>, edges: Range<usize>, sums: &mut Tally<'_>) {
        self.1.fetch_add(edges.len() as u64, Ordering::Relaxed);
        self.0.evaluate(rod, along, edges, sums);
    }

    fn tip(&self, rod: &Kinematics<'_>, along: Option<Direction>) -> Option<OnTip> {
        self.0.tip(rod, along)
    }
}

impl Actuation for Counted<TravellingWave> {
    fn add(&self, wave: Wave, natural: &mut [f64], rate: &mut [f64]) {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.add(wave, natural, rate);
    }

    fn add_derivatives(&self, sizes: [f64; 3], phase: f64, out: &mut [f64]) {
        self.0.add_derivatives(sizes, phase, out);
    }

    fn profiled(&self, factors: &[f64], phases: &[f64]) -> Box<dyn Actuation> {
        self.0.profiled(factors, phases)
    }
}

#[test]
fn a_part_costs_what_it_is_asked_and_nothing_where_it_is_absent() {
    const STEPS: u64 = 100;
    for rung in RUNGS {
        // Evaluations of drag and actuation, each beside the work of a run without the other.
        let counts = [true, false].map(|drag| {
            [true, false].map(|wave| {
                let mut model = scene_of(SOFT, &[]).model().unwrap();
                let (law, kind) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
                let rod = &model.rod;
                let travelling = TravellingWave::new(rod.nodes, rod.spacing, [1.0, 0.0], 1.0, 1.0);
                let edges = rod.nodes as u64 - 1;
                let counted = |force| Box::new(Counted(force, Arc::clone(&law))) as Box<dyn Force>;
                let forces = std::mem::take(&mut model.forces);
                model.forces = Forces(forces.0.into_iter().filter(|_| drag).map(counted).collect());
                let drive = model.actuation.take().unwrap().1;
                model.actuation =
                    wave.then(|| (Box::new(Counted(travelling, Arc::clone(&kind))) as Box<dyn Actuation>, drive));
                let newton = Newton::new(model.rod.nodes, 1e-10).unwrap();
                let euler = Method::named("implicit-euler").unwrap();
                if rung.needs_drag && !drag {
                    return [0; 3];
                }
                let mut tail =
                    Stepper::init(model, (rung.build)((euler.build)(&euler.defaults())), newton, 1e-3).unwrap();
                [&law, &kind].iter().for_each(|count| count.store(0, Ordering::Relaxed));
                tail.do_step(STEPS as f64 * 1e-3).unwrap();
                let count = |count: &AtomicU64| count.load(Ordering::Relaxed);
                [count(&law) / edges, count(&kind), tail.work().newton_iterations]
            })
        });
        println!("{}: [drag, actuation, iterations] {counts:?}", rung.name);
        let [[[law, kind, iterations], [_, passive, _]], [[dragless, ..], _]] = counts;
        assert_eq!([passive, dragless], [0, 0]);
        // Drag: each iteration, and the reading at the end; the shape's six stages, what its middle needs, two readings.
        assert!(law <= iterations + if rung.name == "shape" { 11 } else { 2 } * STEPS, "{}: {law}", rung.name);
        assert!(kind <= 12 * STEPS, "{}: {kind}", rung.name);
    }
}

#[test]
fn a_jump_start_is_not_left_to_the_shape() {
    let scene = scene_of(STUDY, &["solver.model=auto", "solver.accuracy=1", "solver.duration_s=0.1"]);
    let choice = scene.choice().unwrap();
    assert_eq!(choice.rung.name, "full", "{:?}", choice.reason);
    let scene = scene_of(SMOOTH, &["solver.model=auto", "solver.duration_s=2"]);
    let tail = Stepper::of(&scene).unwrap();
    let choice = tail.choice().unwrap();
    assert_eq!(choice.rung.name, "shape");
    assert!(choice.reason.as_ref().unwrap().contains("estimated error"), "{:?}", choice.reason);
}

#[test]
fn a_model_that_cannot_be_is_refused() {
    for (change, said) in
        [("solver.model=shapes", "allowed: shape, overdamped, full, auto"), ("solver.accuracy=0", "accuracy")]
    {
        let mut document = caudal::scene::Document::new("a.toml", SMOOTH);
        document.set(change).unwrap();
        let text = document.scene().unwrap_err().to_string();
        assert!(text.contains(said), "{text}");
    }
    let bare = SMOOTH.replace("[drag]", "[record]\n#").replace("law =", "#").replace("ratio =", "#");
    let bare = bare.replace("head_weight =", "#").replace("head_length_m =", "#");
    let mut document = caudal::scene::Document::new("a.toml", bare);
    document.set("solver.model=overdamped").unwrap();
    let text = document.scene().unwrap_err().to_string();
    assert!(text.contains("without [drag]"), "{text}");
}

/// A scene's estimates, and the true errors of the rungs in their order, all but the last.
struct Case {
    estimates: Estimates,
    truths: Vec<f64>,
}

fn cases(text: &str, moduli: [f64; 2], viscosities: [f64; 2], count: usize, changes: &[&str]) -> Vec<Case> {
    let grid = |[from, to]: [f64; 2], i: usize| from * (to / from).powf(i as f64 / (count - 1) as f64);
    let mut cases = Vec::new();
    for i in 0..count * count {
        let modulus = format!("rod.youngs_modulus_pa={:e}", grid(moduli, i / count));
        let viscosity = format!("medium.viscosity_pa_s={:e}", grid(viscosities, i % count));
        let changes = [changes, &[&modulus, &viscosity, "solver.integrator=esdirk3", "solver.tolerance=1e-5"]].concat();
        let run = |model: &str| {
            let run = common::run(&by(model, text, &changes));
            (run.meter().net_displacement(), run.meter().totals.path)
        };
        let (dx, path) = run("full");
        let truths = RUNGS[..RUNGS.len() - 1]
            .iter()
            .map(|rung| (run(rung.name).0 - dx).abs() / dx.abs().max(0.01 * path))
            .collect();
        cases.push(Case { estimates: scene_of(text, &changes).estimates().unwrap(), truths });
    }
    cases
}

#[test]
fn estimates_keep_what_they_promise() {
    // The sweep they were made on, and two more that they were not: parts of the scenes whose true error lies below the
    // estimate, and within a factor of 30 of it.
    let families = [
        ("tail", cases(SMOOTH, [70e9, 1e6], [1e-3, 10.0], 8, &["solver.duration_s=2"]), [0.95, 0.80]),
        ("thin swimmer", cases(THIN, [1e10, 1e5], [1e-2, 100.0], 6, &[]), [0.90, 0.60]),
        ("driven head", cases(DRIVEN, [1e10, 1e5], [1e-2, 10.0], 5, &["solver.duration_s=2.3"]), [0.95, 0.60]),
    ];
    let line =
        |name: &str, factor: f64| Series::new(name, vec![(1e-5, 1e-5 * factor), (1e2, 1e2 * factor)], Mark::Slope);
    let mut series = vec![line("1:1", 1.0), line("30:1", 30.0)];
    for (i, rung) in RUNGS[..RUNGS.len() - 1].iter().enumerate() {
        for (name, cases, promised) in &families {
            let pairs: Vec<_> = cases.iter().map(|case| (case.truths[i], (rung.error)(&case.estimates))).collect();
            let part = |ok: &dyn Fn(&(f64, f64)) -> bool| {
                pairs.iter().filter(|pair| ok(pair)).count() as f64 / pairs.len() as f64
            };
            let found = [part(&|(truth, estimate)| truth <= estimate), part(&|(truth, e)| *e <= 30.0 * truth)];
            println!("{name}, {}: {found:?} of {}", rung.name, pairs.len());
            assert!(found[0] >= promised[0] && found[1] >= promised[1], "{name}, {}: {found:?}", rung.name);
            series.push(Series::new(format!("{}: {name}", rung.name), pairs, Mark::Dots));
        }
    }
    let chart = Chart {
        title: "Estimated against true errors of the net displacement".into(),
        x: "true error".into(),
        y: "estimate".into(),
        scale: Scale::LogLog,
        series,
    };
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("estimates.svg"), chart.svg()).unwrap();
    let mut taken = [0; 3];
    for accuracy in [1e-4, 1e-3, 1e-2, 0.1] {
        for case in families.iter().flat_map(|(_, cases, _)| cases) {
            let choice = Choice::of(&case.estimates, accuracy, true);
            let rung = RUNGS.iter().position(|rung| rung.name == choice.rung.name).unwrap();
            taken[rung] += 1;
            let truth = case.truths.get(rung).copied().unwrap_or(0.0);
            assert!(truth <= 3.0 * accuracy, "{}: {truth:e} for {accuracy:e}", choice.rung.name);
        }
    }
    println!("taken: {taken:?}");
    assert!(taken.iter().all(|count| *count > 0), "{taken:?}");
}
