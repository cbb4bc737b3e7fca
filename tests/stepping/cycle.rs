//! What swimmers are measured by: averages over the last whole cycles are right at any step, and say when they are not there.

use crate::common;
use std::f64::consts::TAU;

use caudal::cycle::{self, CycleDifference, CycleMeasure, MAX_CYCLES, MEASURES};
use caudal::rod::node;
use caudal::scene::Scene;
use caudal::stepper::Stepper;
use common::{SOFT, largest, order, run, scene_of, stepper_of};

/// A stiff rod held at its head in a thick fluid, which moves as a whole.
const HELD: &str = r#"
[rod]
nodes = 9
length_m = 0.5
outer_radius_m = 0.02
inner_radius_m = 0.0
youngs_modulus_pa = 1e12
density_kg_m3 = 1000.0
[medium]
viscosity_pa_s = 0.5
density_kg_m3 = 1000.0
[drag]
ratio = 2.0
[head]
kind = "driven"
position_m = [0.0, { amplitude = 0.02, frequency_hz = 1.25 }]
angle_rad = 0.0
[solver]
integrator = "generalized-alpha"
time_step_s = 1e-3
duration_s = 4.0
"#;

/// What makes of the soft swimmer, which is driven beyond its natural frequency and swims tail first, one that follows its drive.
const STIFF: [&str; 10] = [
    "solver.integrator=newmark",
    "actuation.kappa_amp=4.8",
    "rod.nodes=17",
    "rod.outer_radius_m=0.012",
    "rod.youngs_modulus_pa=5e7",
    "rod.stiffness_gradient=1.0",
    "actuation.wavelength_m=1.0",
    "medium.viscosity_pa_s=0.8",
    "drag.head_length_m=0.0625",
    "solver.duration_s=4.0",
];

/// Mean and spread of a measure over the last whole cycles.
fn of(stepper: &Stepper, measure: &CycleMeasure) -> Option<[f64; 2]> {
    let (cycles, dynamics) = (stepper.cycles().whole(stepper.time()), stepper.view().dynamics);
    Some([measure.mean(cycles, dynamics)?, measure.spread(cycles, dynamics)?])
}

fn mean(stepper: &Stepper, measure: &CycleMeasure) -> f64 {
    of(stepper, measure).unwrap_or_else(|| panic!("{} is not there", measure.key))[0]
}

/// The soft swimmer's run.
fn swimmer(changes: &[&str]) -> Stepper {
    run(&scene_of(SOFT, &[&["solver.duration_s=4.0", "solver.newton_tolerance=1e-12"], changes].concat()))
}

/// The same by steps that their estimated errors choose.
fn adaptive(tolerance: f64, changes: &[&str]) -> Stepper {
    let text = SOFT.replace("time_step_s = 2e-3\n", &format!("tolerance = {tolerance:e}\n"));
    let changes = [&["solver.duration_s=4.0", "solver.integrator=esdirk3"], changes].concat();
    run(&scene_of(&text, &changes))
}

#[test]
fn every_measure_is_what_its_formula_makes_of_a_cycle() {
    // Steps that divide the period, looked at where the last cycle begins and ends.
    let scene = scene_of(SOFT, &["solver.integrator=newmark", "actuation.frequency_hz=2.0"]);
    let (mut tail, period) = (Stepper::of(&scene).unwrap(), 0.5);
    let start = tail.metrics().now.com;
    tail.do_step(0.5).unwrap();
    let (before, work, energy) =
        (tail.metrics().now.com, tail.metrics().totals.work, tail.metrics().now.energy.total());
    let first = tail.cycles().whole(0.5)[0].excursion;
    assert!(first > 0.0);
    let (mut axis, mut tips) = (nalgebra::Vector2::zeros(), Vec::new());
    for _ in 0..250 {
        let edge = (node(&tail.state().q, 0) - node(&tail.state().q, 1)).normalize();
        tail.do_step(2e-3).unwrap();
        let next = (node(&tail.state().q, 0) - node(&tail.state().q, 1)).normalize();
        axis += (edge + next) * 1e-3;
        tips.push(node(&tail.state().q, 8));
    }
    let dynamics = tail.view().dynamics;
    let cycle = &tail.cycles().whole(1.0)[1..2];
    let found = |measure: &CycleMeasure| measure.mean(cycle, dynamics).unwrap();
    let velocity = (tail.metrics().now.com - before) / period;
    let (speed, axis) = (velocity.norm(), axis.normalize());
    let rod = &tail.model().rod;
    let now = tail.metrics().totals.work;
    let power = (now.actuation - work.actuation) / period;
    let stored = tail.metrics().now.energy.total() - energy;
    let towed = tail.model().forces.towing(rod, tail.model().fluid, speed);
    // The path is that of the cycle before, and the tip goes on between the steps: measured 2e-3.
    let path = (before - start) / period;
    let across = nalgebra::Vector2::new(-path.y, path.x).normalize();
    let sides = tips.iter().zip(1..).map(|(tip, i)| (tip - path * (f64::from(i) * 2e-3)).dot(&across));
    let excursion = sides.clone().fold(f64::NEG_INFINITY, f64::max) - sides.fold(f64::INFINITY, f64::min);
    assert!((cycle[0].excursion / excursion - 1.0).abs() < 2e-2, "{} {excursion}", cycle[0].excursion);
    let expected = [
        (cycle::PERIOD, period),
        (cycle::SPEED, speed),
        (cycle::BODY_LENGTHS, speed * period / rod.length),
        (cycle::TIP_EXCURSION, cycle[0].excursion),
        (cycle::STROUHAL, cycle[0].excursion / period / speed),
        (cycle::ACTUATION_POWER, power),
        (cycle::VISCOUS_POWER, (now.viscous - work.viscous) / period),
        (cycle::LOAD_POWER, 0.0),
        (cycle::HEAD_POWER, 0.0),
        (cycle::FLOW_POWER, 0.0),
        (cycle::COST_OF_TRANSPORT, power / (rod.total_mass() * 9.80665 * speed)),
        (cycle::EFFICIENCY, towed * speed / power),
    ];
    for (measure, expected) in expected {
        // Measured: at most 4e-15.
        assert!(
            (found(&measure) - expected).abs() <= 1e-12 * expected.abs(),
            "{}: {} {expected}",
            measure.key,
            found(&measure)
        );
    }
    // Sums by parabola and by trapezoid differ: measured 2e-6.
    let ahead = velocity.dot(&axis);
    for (measure, expected) in
        [(cycle::FORWARD_SPEED, ahead), (cycle::DIRECTION, (ahead / speed).acos()), (cycle::SLIP, ahead * period / 0.8)]
    {
        assert!(
            (found(&measure) - expected).abs() <= 1e-4 * expected.abs(),
            "{}: {} {expected}",
            measure.key,
            found(&measure)
        );
    }
    for measure in [cycle::THRUST, cycle::HEAD_FORCE_X, cycle::HEAD_FORCE_Y, cycle::HEAD_MOMENT] {
        assert_eq!(measure.mean(cycle, dynamics), None, "{}", measure.key);
    }
    assert!(stored.abs() > 0.0);
}

#[test]
fn a_rod_that_is_swung_and_washed_as_a_whole_has_the_thrust_power_and_strouhal_number_of_theory() {
    // m y'' + c y' at the head, y = a sin ωt; the flow u pushes along the rod with ξ∥ L u.
    let scene = scene_of(HELD, &["medium.flow_m_s=[0.3, 0.0]"]);
    let tail = run(&scene);
    let [along, across] = tail.model().forces.resistance(&tail.model().rod, tail.model().fluid).unwrap();
    let (length, a, f, u) = (0.5, 0.02, 1.25, 0.3);
    let expected = [
        (cycle::PERIOD, 0.8),
        (cycle::SPEED, u),
        (cycle::FORWARD_SPEED, u), // the head faces −x, the water comes from there
        (cycle::STROUHAL, f * 2.0 * a / u),
        (cycle::THRUST, -along * length * u),
        (cycle::HEAD_FORCE_X, along * length * u),
        (cycle::HEAD_POWER, 0.5 * across * length * (TAU * f * a).powi(2)),
        (cycle::BODY_LENGTHS, u * 0.8 / length),
        (cycle::TIP_EXCURSION, 2.0 * a),
        (cycle::EFFICIENCY, -along * u * u / (0.5 * across * (TAU * f * a).powi(2))), // it brakes
    ];
    for (measure, expected) in expected {
        let [mean, spread] = of(&tail, &measure).unwrap();
        println!("{}: {:e}, spread {:e}", measure.key, mean / expected - 1.0, spread / expected);
        // Measured: at most 6e-6, of the head's power, by steps of 1 ms and a rod that bends by 1e-6.
        assert!((mean / expected - 1.0).abs() < 1e-4, "{}: {mean}, not {expected}", measure.key);
    }
    assert!(CycleDifference::largest(tail.cycles().whole(4.0), tail.model().rod.length).unwrap().is_periodic());
    assert_eq!(tail.cycles().whole(4.0).len(), MAX_CYCLES);
    for measure in [cycle::SLIP, cycle::COST_OF_TRANSPORT] {
        assert_eq!(of(&tail, &measure), None, "{}", measure.key);
    }
}

#[test]
fn the_excursion_of_the_tip_is_that_between_steps_too() {
    // Eleven steps and a half in a period: the largest of them alone would be up to 3.7 % short.
    let scene = scene_of(HELD, &["medium.flow_m_s=[0.3, 0.0]", "solver.time_step_s=0.07"]);
    let expected = 1.25 * 2.0 * 0.02 / 0.3;
    let [mean, spread] = of(&run(&scene), &cycle::STROUHAL).unwrap();
    println!("{:e}, spread {:e}", mean / expected - 1.0, spread / expected);
    assert!((mean / expected - 1.0).abs() < 1e-3 && spread < 1e-3 * expected, "{mean} {spread}, not {expected}");
}

#[test]
fn averages_converge_with_steps_that_do_not_divide_the_period_and_adaptive_ones_agree() {
    // The period is 2/3 s.
    let shown = [cycle::SPEED, cycle::FORWARD_SPEED, cycle::STROUHAL, cycle::ACTUATION_POWER, cycle::EFFICIENCY];
    let held = [cycle::THRUST, cycle::HEAD_FORCE_Y, cycle::HEAD_MOMENT, cycle::ACTUATION_POWER];
    for (head, measures) in [("free", &shown[..]), ("clamped", &held[..])] {
        let head = format!("head.kind={head}");
        let by = |step: &str| {
            let tail = swimmer(&["solver.integrator=generalized-alpha", &format!("solver.time_step_s={step}"), &head]);
            measures.iter().map(|measure| mean(&tail, measure)).collect::<Vec<_>>()
        };
        let mut failed = false;
        let [fine, middle, coarse] = ["1.5151e-4", "1.05e-3", "2.1e-3"].map(by);
        let adaptive = adaptive(1e-4, &[&head]);
        for (i, measure) in measures.iter().enumerate() {
            let error = |x: f64| (x / fine[i] - 1.0).abs();
            println!(
                "{head} {}: {:.1e} {:.1e}, adaptive {:.1e}",
                measure.key,
                error(coarse[i]),
                error(middle[i]),
                error(mean(&adaptive, measure))
            );
            // Measured: order 1.9 to 3.4, adaptive at most 1.4e-3.
            failed |= order(error(coarse[i]), error(middle[i])) < 1.7 || error(mean(&adaptive, measure)) > 2e-3;
        }
        assert!(!failed, "{head}");
    }
}

#[test]
fn a_cycle_is_one_of_the_phase_whatever_frequencies_a_host_sets() {
    let mut tail = stepper_of(SOFT, &["solver.integrator=newmark", "solver.time_step_s=1.7e-3"]);
    tail.do_step(0.5).unwrap(); // three quarters of a cycle at 1.5 Hz
    tail.set("actuation_frequency_hz", &[0.5]).unwrap();
    tail.do_step(1.0).unwrap(); // a quarter in 0.5 s, another in the next 0.5 s
    tail.set("actuation_frequency_hz", &[2.0]).unwrap();
    tail.do_step(1.0).unwrap(); // three quarters in 0.375 s, then one in 0.5 s
    let ends: Vec<f64> = tail.cycles().whole(tail.time()).iter().map(|cycle| cycle.until).collect();
    assert_eq!(ends.len(), 3);
    // Measured: at most 4e-16.
    assert!(largest(ends.iter().zip([1.0, 1.875, 2.375]).map(|(end, expected)| end - expected)) < 1e-12, "{ends:?}");
    let periods: Vec<f64> = tail.cycles().whole(tail.time()).iter().map(|cycle| cycle.period()).collect();
    assert!(
        largest(periods.iter().zip([1.0, 0.875, 0.5]).map(|(end, expected)| end - expected)) < 1e-12,
        "{periods:?}"
    );
    // Within a step only the cycles that are over by then are there.
    tail.do_step(0.5).unwrap();
    assert_eq!(tail.get_scalar("cycles_used").unwrap(), 4.0);
    let mut steps = Vec::new();
    let mut tail = stepper_of(SOFT, &["solver.integrator=newmark", "solver.time_step_s=0.03"]);
    tail.do_step_with(0.69, |tail| {
        for part in [0.1, 0.5, 1.0] {
            let t = tail.time() - 0.03 * (1.0 - part);
            let used = tail.find("cycles_used").unwrap();
            steps.push((t, tail.at(t, |view| used.first(view)).unwrap()));
        }
        std::ops::ControlFlow::Continue(())
    })
    .unwrap();
    assert!(steps.iter().all(|(t, used)| *used == f64::from(u8::from(*t >= 2.0 / 3.0))), "{steps:?}");
    assert!(steps.last().unwrap().1 == 1.0);
}

#[test]
fn a_snapshot_goes_on_with_the_cycles_that_it_was_saved_with() {
    let scene = scene_of(SOFT, &["solver.integrator=newmark", "solver.time_step_s=1.7e-3"]);
    let mut tail = Stepper::of(&scene).unwrap();
    tail.do_step(1.0).unwrap();
    let snapshot = tail.save();
    let bytes = snapshot.serialize().unwrap();
    tail.do_step(1.0).unwrap();
    let mut other = Stepper::of(&scene).unwrap();
    other.restore(&other.deserialize(&bytes).unwrap()).unwrap();
    other.do_step(1.0).unwrap();
    assert_eq!(other.cycles(), tail.cycles());
    tail.restore(&snapshot).unwrap();
    assert_eq!(tail.cycles().whole(9.0).len(), 1);
    tail.do_step(1.0).unwrap();
    assert_eq!(other.cycles(), tail.cycles());
}

#[test]
fn numbers_without_a_unit_are_the_same_from_a_micrometre_to_ten_metres() {
    // Lengths times s at the same times, stresses and viscosities at the same density times s²: the same motion.
    let measures = [cycle::BODY_LENGTHS, cycle::STROUHAL, cycle::SLIP, cycle::DIRECTION, cycle::EFFICIENCY];
    let at = |s: f64| {
        let changes = [
            format!("rod.length_m={s:e}"),
            format!("rod.outer_radius_m={:e}", 0.08 * s),
            format!("rod.youngs_modulus_pa={:e}", 1e5 * s * s),
            format!("actuation.kappa_amp={:e}", 4.0 / s),
            format!("actuation.wavelength_m={:e}", 0.8 * s),
            format!("medium.viscosity_pa_s={:e}", 5.0 * s),
            format!("drag.head_length_m={:e}", 0.2 * s),
            "solver.integrator=newmark".to_string(),
        ];
        let tail = swimmer(&changes.iter().map(String::as_str).collect::<Vec<_>>());
        measures.map(|measure| mean(&tail, &measure))
    };
    let metre = at(1.0);
    for s in [1e-6, 10.0] {
        for ((measure, x), expected) in measures.iter().zip(at(s)).zip(metre) {
            println!("{s:e} m, {}: {:.1e}", measure.key, x / expected - 1.0);
            assert!((x / expected - 1.0).abs() < 1e-7, "{s:e} m, {}: {x}, not {expected}", measure.key);
        }
    }
}

#[test]
fn where_there_is_no_whole_cycle_it_is_said_why() {
    let wave = "actuation.frequency_hz";
    let free = |changes: &[&str]| scene_of(SOFT, changes);
    let held = |changes: &[&str]| scene_of(HELD, changes);
    let mixed = "head.position_m=[{amplitude=0.01,frequency_hz=2.0},{amplitude=0.01,frequency_hz=3.0}]";
    let still = "head.position_m=[0.0,0.0]";
    let cases: [(Scene, &str); 5] = [
        (free(&["solver.duration_s=0.6"]), "shorter than one cycle of 0.6667 s"),
        (free(&[&format!("{wave}=0.0")]), "the actuation's frequency is 0"),
        (held(&[mixed]), "is a multiple of all others"),
        (held(&[still]), "nothing drives"),
        (held(&["solver.duration_s=0.7"]), "shorter than one cycle of 0.8000 s"),
    ];
    for (scene, reason) in cases {
        let tail = run(&scene);
        let averages = tail.cycles().averages(tail.view().dynamics);
        assert!(averages.reason.as_ref().is_some_and(|found| found.contains(reason)), "{averages:?}, not {reason}");
        assert!(averages.to_string().contains(reason));
        let written = serde_json::to_value(&averages).unwrap();
        assert_eq!((&written["cycles_used"], &written["cycles_periodic"]), (&0.into(), &serde_json::Value::Null));
        for measure in MEASURES {
            assert!(written[measure.key].is_null() && written[measure.spread].is_null(), "{}", measure.key);
        }
    }
    // Sinusoids with a common period repeat with the slowest; a host's head has none.
    let common = "head.position_m=[{amplitude=0.01,frequency_hz=2.5},{amplitude=0.01,frequency_hz=1.25}]";
    let mut tail = Stepper::of(&held(&[common])).unwrap();
    tail.do_step(1.0).unwrap();
    assert_eq!(tail.cycles().whole(1.0).len(), 1);
    tail.set("head_y_m", &[0.02]).unwrap(); // at this time the scene's own would be 0.01
    tail.do_step(2.0).unwrap();
    assert_eq!(tail.cycles().whole(3.0).len(), 1);
}

#[test]
fn every_measure_is_in_the_summary_and_in_the_table_of_variables_and_tail_first_is_said() {
    for (scene, swims) in [
        (scene_of(SOFT, &["solver.duration_s=2.0"]), Some("tail first")),
        (scene_of(SOFT, &STIFF), Some("head first")),
        (scene_of(HELD, &[]), None),
    ] {
        let mut tail = Stepper::of(&scene).unwrap();
        let outcome = caudal::run::run(&scene, &mut tail, |_| Ok(std::ops::ControlFlow::Continue(())));
        let summary = serde_json::to_value(caudal::report::Summary::of(&scene, &tail, &outcome, &[])).unwrap();
        assert_eq!(summary["swims"].as_str(), swims);
        for measure in MEASURES {
            let (mean, spread) = (&summary[measure.key], &summary[measure.spread]);
            assert!(measure.key.ends_with(measure.spread.rsplit_once("spread").unwrap().1));
            assert_eq!(mean.is_number(), spread.is_number(), "{}", measure.key);
            match tail.get_scalar(measure.key) {
                Ok(value) => assert_eq!(value, mean.as_f64().unwrap_or(0.0), "{}", measure.key),
                Err(_) => assert!(mean.is_null(), "{}", measure.key),
            }
        }
        assert_eq!(summary["cycles_used"].as_f64(), Some(tail.get_scalar("cycles_used").unwrap()));
        assert_eq!(summary["mean_thrust_n"].is_number(), swims.is_none());
    }
}

#[test]
fn the_mean_is_that_of_the_cycles_and_the_spread_their_standard_deviation() {
    let stepper = swimmer(&["solver.duration_s=2.1"]); // not settled: cycles differ
    let (cycles, dynamics) = (stepper.cycles().whole(stepper.time()), stepper.view().dynamics);
    assert_eq!(cycles.len(), 3);
    let mut tried = 0;
    for measure in &MEASURES {
        let Some([mean, spread]) = of(&stepper, measure) else { continue };
        let each: Vec<f64> = cycles.chunks(1).map(|one| measure.mean(one, dynamics).unwrap()).collect();
        let expected = each.iter().sum::<f64>() / 3.0;
        let deviation = (each.iter().map(|x| (x - expected).powi(2)).sum::<f64>() / 2.0).sqrt();
        assert!((mean - expected).abs() <= 1e-12 * largest(each.iter().copied()), "{}: {mean} {expected}", measure.key);
        assert!(
            (spread - deviation).abs() <= 1e-9 * deviation.max(1e-9 * mean.abs()),
            "{}: {spread} {deviation}",
            measure.key
        );
        tried += usize::from(deviation > 1e-6 * mean.abs());
    }
    assert!(tried >= 6, "{tried}");
}

#[test]
fn the_fluid_takes_what_drag_wake_and_spray_take() {
    let scene = Scene::load("models/dipping-tail.toml").unwrap();
    let mut stepper = Stepper::of(&scene).unwrap();
    let works = |stepper: &Stepper| {
        ["viscous_work_j", "wake_work_j", "spray_work_j"].map(|name| stepper.get_scalar(name).unwrap())
    };
    stepper.do_step(2.0).unwrap();
    let before = works(&stepper);
    stepper.do_step(1.0).unwrap();
    let after = works(&stepper);
    let each: Vec<f64> = before.iter().zip(after).map(|(before, after)| after - before).collect();
    let cycles = stepper.cycles().whole(stepper.time());
    let found = cycles[cycles.len() - 1].mean_power_into_fluid();
    assert!(each.iter().all(|work| *work > 1e-4), "{each:?}");
    assert!((found - each.iter().sum::<f64>()).abs() < 1e-9, "{found} {each:?}");
}

#[test]
fn a_swimmer_within_sixty_degrees_of_its_axis_swims_head_first() {
    // A stiff rod that gravity pulls obliquely swims there as it lies.
    for (degrees, said) in [(50.0_f64, "head first"), (70.0, "sideways"), (110.0, "sideways"), (130.0, "tail first")] {
        // The head's axis is from the rod to the head, along −x.
        let (y, x) = (std::f64::consts::PI - degrees.to_radians()).sin_cos();
        let gravity = format!("loads={{ gravity_m_s2 = [{}, {}] }}", 0.05 * x, 0.05 * y);
        let changes = [
            "drag={ ratio = 1.0 }",
            "rod.youngs_modulus_pa=1e9",
            "actuation.kappa_amp=1e-9",
            &gravity,
            "solver.duration_s=4.0",
        ];
        let text = SOFT.replace("[drag]\nratio = 5.0\nhead_weight = 10.0\nhead_length_m = 0.2\n", "");
        let stepper = run(&scene_of(&text, &changes));
        let averages = stepper.cycles().averages(stepper.view().dynamics);
        assert_eq!(averages.swims(), Some(said), "{degrees}: {:?}", averages.mean(&cycle::DIRECTION));
    }
}

/// Lateral force and moment of a symmetric beat vanish in the mean: what is left of them is compared with their size, not with itself.
/// Of a beat that begins, the message names what differs.
#[test]
fn a_symmetric_beat_is_periodic_and_one_that_begins_names_what_differs() {
    let beat = |duration: f64, changes: &[&str]| {
        let text = HELD.replace("time_step_s = 1e-3\n", "").replace("integrator = \"generalized-alpha\"\n", "");
        let duration = format!("solver.duration_s={duration}");
        run(&scene_of(&text, &[&[&*duration], changes].concat()))
    };
    let difference =
        |tail: &Stepper| CycleDifference::largest(tail.cycles().whole(tail.time()), tail.model().rod.length).unwrap();
    let (soft, long) = (&["rod.youngs_modulus_pa=3e5", "medium.viscosity_pa_s=10.0"], 20.0);
    let swung = beat(long, soft);
    let [moment, _] = of(&swung, &cycle::HEAD_MOMENT).unwrap();
    let size = swung.metrics().totals.max_on_head[1];
    println!("{} moment {moment:e} of {size:e}", difference(&swung));
    assert!(difference(&swung).is_periodic() && moment.abs() < 1e-3 * size, "{}", difference(&swung));
    // Driven along itself it turns about nothing: its moment is rounding.
    for angle in [0.0_f64, 0.5, 2.0] {
        let (y, x) = angle.sin_cos();
        let motion = |part: f64| format!("{{ amplitude = {}, frequency_hz = 1.25 }}", 0.02 * part);
        let surge = format!("head.position_m=[{}, {}]", motion(x), motion(y));
        let along = beat(long, &[soft[0], soft[1], &surge, &format!("head.angle_rad={angle}")]);
        println!("{}", difference(&along));
        assert!(difference(&along).is_periodic(), "{angle}: {}", difference(&along));
    }
    let vacuum = HELD.split("[medium]").next().unwrap().to_string() + HELD.split("ratio = 2.0\n").nth(1).unwrap();
    let dry = run(&scene_of(&vacuum, &[]));
    let reason = dry.cycles().averages(dry.view().dynamics).efficiency_reason.unwrap();
    assert_eq!(reason, "there is no fluid to push against");
    let begun = beat(1.6, soft);
    println!("{}", difference(&begun));
    assert!(!difference(&begun).is_periodic());
    let said = begun.cycles().averages(begun.view().dynamics).to_string();
    assert!(said.contains("not periodic yet: the ") && said.ends_with("from cycle to cycle"), "{said}");
}

#[test]
fn a_held_head_that_comes_back_has_no_path_whatever_the_steps() {
    const HEAVED: &str = r#"
[rod]
nodes = 17
length_m = 0.3
outer_radius_m = 0.004
youngs_modulus_pa = 2e6
density_kg_m3 = 1100.0
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1000.0
[drag]
law = "cross-flow"
[head]
kind = "driven"
position_m = [{amplitude=0.03, frequency_hz=1.0}, {amplitude=0.03, frequency_hz=1.0, phase_rad=1.0}]
[solver]
integrator = "newmark"
time_step_s = 0.01
duration_s = 6.3
"#;
    let excursion = |step: f64| {
        let stepper = run(&scene_of(HEAVED, &[&format!("solver.time_step_s={step}")]));
        assert_eq!(of(&stepper, &cycle::STROUHAL), None, "{step}");
        mean(&stepper, &cycle::TIP_EXCURSION)
    };
    let [fine, coarse, coarser] = [0.01, 0.0487, 0.0613].map(excursion);
    println!("{fine} {coarse} {coarser}");
    // Across a path that is none: three times as much.
    assert!((coarse / fine - 1.0).abs() < 0.02 && (coarser / fine - 1.0).abs() < 0.02, "{fine} {coarse} {coarser}");
}
