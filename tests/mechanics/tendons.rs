//! Tendons: their length is that of a cable, their pull is its derivative, and what they do is booked.

use std::f64::consts::TAU;

use caudal::assessment::Assessment;
use caudal::rod::node;
use caudal::scene::Document;
use caudal::sensitivity::value_and_grad;
use caudal::stepper::Stepper;
use caudal::variable::VARIABLES;
use nalgebra::Vector2;

use crate::common::{document_of, largest, stepper_of};

/// A soft rod of 0.2 m with a tendon on either side.
const PAIR: &str = r#"
[rod]
nodes = 11
length_m = 0.2
outer_radius_m = 0.005
inner_radius_m = 0.0
youngs_modulus_pa = 5e5
density_kg_m3 = 1100.0
damping_time_s = 0.01
[[tendons]]
offset_m = 0.004
tension_n = { offset = 0.3, amplitude = 0.3, frequency_hz = 2.0 }
[[tendons]]
offset_m = -0.004
from_xi = 0.2
to_xi = 0.8
tension_n = 0.2
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[drag]
law = "coefficients"
along_n_s_m2 = 0.01
across_n_s_m2 = 0.03
[solver]
integrator = "newmark"
time_step_s = 1e-3
duration_s = 1.0
newton_tolerance = 1e-13
"#;

fn pair(changes: &[&str]) -> Stepper {
    stepper_of(PAIR, changes)
}

/// The rod of `text`, 0.2 m long at scale 1, with a clamped head and so much damping that it rests after 1000 s in steps of 0.05 s.
pub fn resting(text: &str, scale: f64, changes: &[&str]) -> Stepper {
    let sizes = [format!("rod.length_m={:e}", 0.2 * scale), format!("rod.outer_radius_m={:e}", 0.005 * scale)];
    let settings = [
        "head.kind=clamped",
        "start={kind=\"ramp\",ramp_s=0.1}",
        "drag={law=\"coefficients\",along_n_s_m2=30.0,across_n_s_m2=30.0}",
        "solver.integrator=generalized-alpha",
        "solver.time_step_s=0.05",
        "solver.duration_s=1000.0",
        "rod.damping_time_s=1.0",
    ];
    stepper_of(text, &[&sizes.each_ref().map(String::as_str)[..], changes, &settings].concat())
}

fn document(changes: &[&str]) -> Document {
    document_of("pair.toml", PAIR, changes)
}

fn get(stepper: &mut Stepper, name: &str) -> f64 {
    stepper.get(name).unwrap()[0]
}

/// The length of the cable at the distance `offset` to the left of the polygon through `nodes`, whose edges meet on the bisectors of the
/// joints; `before` is the direction that it comes from at the first node, where it passes a joint there too.
fn cable(nodes: &[Vector2<f64>], offset: f64, before: Option<Vector2<f64>>) -> f64 {
    let tangent = |e: usize| (nodes[e + 1] - nodes[e]).normalize();
    let left = |t: Vector2<f64>| Vector2::new(-t.y, t.x);
    let last = nodes.len() - 1;
    // The corner of two parallels at the distance `offset`: along the sum of the normals.
    let corner = |k: usize, e: Vector2<f64>, f: Vector2<f64>| {
        let sum = left(e) + left(f);
        nodes[k] + sum * (2.0 * offset / sum.norm_squared())
    };
    let ends = |k: usize| match (k, before) {
        (0, Some(before)) => corner(0, before, tangent(0)),
        (0, None) => nodes[0] + left(tangent(0)) * offset,
        (k, _) if k == last => nodes[k] + left(tangent(k - 1)) * offset,
        (k, _) => corner(k, tangent(k - 1), tangent(k)),
    };
    // Along its edge each part counts with its sign: a corner inside a sharp bend takes length away.
    let parts = (0..last).map(|e| (ends(e + 1) - ends(e)).dot(&tangent(e)));
    // What the corner lies ahead of the fixed point in the holder.
    let held = before.map_or(0.0, |before| (ends(0) - nodes[0]).dot(&before));
    parts.sum::<f64>() + held
}

#[test]
fn the_length_is_that_of_a_cable_beside_the_bent_and_stretched_rod() {
    let mut worst = 0.0_f64;
    for head in ["head.kind=free", "head.kind=clamped"] {
        for form in ["solver.form=positions", "solver.form=chain"] {
            let mut stepper =
                pair(&[head, form, "start.kind=jump", "rod.damping_time_s=0.0", "tendons.0.tension_n.amplitude=0.25"]);
            for _ in 0..20 {
                stepper.do_step(0.013).unwrap();
                let nodes: Vec<Vector2<f64>> = (0..11).map(|k| node(&stepper.state().q, k)).collect();
                let before = (head == "head.kind=clamped").then(Vector2::x);
                let [whole, part] = [cable(&nodes, 0.004, before), cable(&nodes[2..=8], -0.004, None)];
                worst = worst.max((get(&mut stepper, "tendon_1_length_m") / whole - 1.0).abs());
                worst = worst.max((get(&mut stepper, "tendon_2_length_m") / part - 1.0).abs());
            }
            let bent = largest(stepper.get("curvature_1_m").unwrap());
            assert!(bent > 2.0, "{bent}"); // it does bend
        }
    }
    println!("lengths differ by {worst:e}");
    assert!(worst < 1e-13, "{worst:e}"); // measured: 2e-15
}

#[test]
fn a_constant_tension_bends_a_rod_to_an_arc_and_shortens_it_at_any_size() {
    // B κ = T d and EA ε = −T, whatever the size: exact on every mesh, for the cable follows the rod.
    for scale in [1e-5, 1.0, 50.0] {
        let length = 0.2 * scale;
        // EI/L² and EA as strong against T at any size.
        let tension = 0.1 * scale * scale;
        let tendon = format!("tendons=[{{offset_m={:e},to_xi=0.6,tension_n={tension:e}}}]", 0.004 * scale);
        let mut stepper = resting(PAIR, scale, &[&tendon]);
        stepper.do_step(1000.0).unwrap();
        let (ei, ea) = (get(&mut stepper, "bending_stiffness_n_m2"), get(&mut stepper, "stretching_stiffness_n"));
        let curvature = stepper.get("curvature_1_m").unwrap();
        let arc = tension * 0.004 * scale / ei;
        let q = stepper.state().q.clone();
        for (k, curvature) in curvature.into_iter().enumerate().take(10) {
            let (bent, strain) = (if k < 6 { arc } else { 0.0 }, if k < 6 { -tension / ea } else { 0.0 });
            let stretched = (node(&q, k + 1) - node(&q, k)).norm() / (0.1 * length) - 1.0;
            let [off, apart] = [(curvature - bent).abs() / arc, (stretched - strain).abs() / (tension / ea)];
            println!("{scale:e}, joint {k}: curvature {off:e}, strain {apart:e}");
            assert!(off < 1e-7 && apart < 1e-6, "{scale:e}, joint {k}: {off:e} {apart:e}");
        }
        assert!(arc * length > 0.1);
    }
}

#[test]
fn what_tendons_put_in_is_the_actuation_s_and_closes_the_balance() {
    for head in
        ["head.kind=free", "head.kind=clamped", "head={kind=\"driven\",angle_rad={amplitude=0.1,frequency_hz=2.0}}"]
    {
        for form in ["positions", "chain"] {
            let run = |step: f64| {
                let steps = format!("solver.time_step_s={step:e}");
                let mut stepper =
                    pair(&[head, "start={kind=\"ramp\",ramp_s=0.2}", &steps, &format!("solver.form={form}")]);
                let mut by_length = [0.0; 2];
                let mut by_power = [0.0; 2];
                let read = |stepper: &mut Stepper| {
                    [1, 2].map(|i| {
                        ["tension_n", "length_m", "power_w"].map(|what| get(stepper, &format!("tendon_{i}_{what}")))
                    })
                };
                let mut last = read(&mut stepper);
                while stepper.time() < 0.999_999 {
                    stepper.do_step(step).unwrap();
                    let now = read(&mut stepper);
                    for i in 0..2 {
                        by_length[i] -= 0.5 * (now[i][0] + last[i][0]) * (now[i][1] - last[i][1]);
                        by_power[i] += 0.5 * step * (now[i][2] + last[i][2]);
                    }
                    last = now;
                }
                let work = get(&mut stepper, "actuation_work_j");
                let told =
                    last.iter().map(|tendon| tendon[2]).sum::<f64>() / get(&mut stepper, "actuation_power_w") - 1.0;
                let defect = get(&mut stepper, "numerical_dissipation_j") / work;
                let parts = [by_length, by_power].map(|parts| parts.iter().sum::<f64>() / work - 1.0);
                (parts, told.abs(), defect.abs())
            };
            let ([coarse_length, coarse_power], told, coarse) = run(2e-3);
            let ([fine_length, fine_power], _, fine) = run(1e-3);
            println!(
                "{head} {form}: {coarse_length:e} {fine_length:e}, {coarse_power:e} {fine_power:e}, {told:e}, {coarse:e} {fine:e}"
            );
            // The work of a step is that of the mean tension over the change of the length, to the last digit.
            assert!(coarse_length.abs().max(fine_length.abs()) < 1e-10 && told < 1e-9, "{head} {form}");
            // The other ways of the second order: measured 2.6 to 4.3 times smaller.
            assert!(fine_power.abs() < 0.5 * coarse_power.abs() && fine_power.abs() < 1e-2, "{head} {form}");
            assert!(fine < 0.5 * coarse && fine < 1e-2, "{head} {form}");
        }
    }
}

#[test]
fn an_antagonistic_pair_turned_over_mirrors_the_motion() {
    let run = |changes: &[&str]| {
        let mut stepper = pair(&[&["head.kind=clamped", "start={kind=\"ramp\",ramp_s=0.2}"], changes].concat());
        stepper.do_step(0.7).unwrap();
        stepper.state().q.clone()
    };
    let there = run(&[]);
    let mirrored = run(&["tendons.0.offset_m=-0.004", "tendons.1.offset_m=0.004"]);
    let apart = largest(there.chunks(2).zip(mirrored.chunks(2)).map(|(a, b)| (a[0] - b[0]).hypot(a[1] + b[1])));
    assert!(apart < 1e-13, "{apart:e}"); // measured: 0
}

#[test]
fn a_host_that_adds_the_scene_s_tension_moves_the_rod_as_the_scene_does() {
    let own = |changes: &[&str]| pair(&[&["head.kind=clamped", "start.kind=jump"], changes].concat());
    let mut scene = own(&["tendons.0.tension_n=0.25"]);
    let mut hosted = own(&["tendons.0.tension_n=0.0"]);
    hosted.set("tendon_1_added_tension_n", &[0.25]).unwrap();
    scene.do_step(0.4).unwrap();
    hosted.do_step(0.4).unwrap();
    let apart = largest(scene.state().q.iter().zip(&hosted.state().q).map(|(a, b)| a - b));
    assert!(apart < 1e-13, "{apart:e}"); // measured: 0
    // A sinusoid by its value and three rates at each host step of T/50 is off by the next term, (2π/50)⁴/24 of its amplitude.
    let mut scene = own(&["tendons.0.tension_n={offset=0.3,amplitude=0.2,frequency_hz=2.0}"]);
    let mut hosted = own(&["tendons.0.tension_n=0.0"]);
    for n in 0..100 {
        let (t, omega) = (0.01 * f64::from(n), TAU * 2.0);
        let (sin, cos) = (omega * t).sin_cos();
        hosted.set("tendon_1_added_tension_n", &[0.3 + 0.2 * sin]).unwrap();
        for (order, rate) in
            [0.2 * omega * cos, -0.2 * omega.powi(2) * sin, -0.2 * omega.powi(3) * cos].into_iter().enumerate()
        {
            hosted.set_derivative("tendon_1_added_tension_n", order + 1, &[rate]).unwrap();
        }
        scene.do_step(0.01).unwrap();
        hosted.do_step(0.01).unwrap();
    }
    let [a, b] = [&mut scene, &mut hosted].map(|stepper| get(stepper, "tendon_1_tension_n"));
    let apart = largest(scene.state().q.iter().zip(&hosted.state().q).map(|(a, b)| a - b));
    println!("{apart:e} m, {:e} N", a - b);
    assert!(apart < 2e-6 && (a - b).abs() < 1e-5, "{apart:e} {:e}", a - b);
}

#[test]
fn a_tendon_never_pushes() {
    let mut stepper = pair(&["head.kind=clamped", "tendons.0.tension_n=0.1"]);
    stepper.set("tendon_1_added_tension_n", &[-0.3]).unwrap();
    stepper.do_step(0.05).unwrap();
    assert_eq!(get(&mut stepper, "tendon_1_tension_n"), 0.0);
    assert_eq!(get(&mut stepper, "tendon_1_power_w"), 0.0);
    stepper.set("tendon_1_added_tension_n", &[0.3]).unwrap();
    assert_eq!(get(&mut stepper, "tendon_1_tension_n"), 0.4);
}

#[test]
fn a_snapshot_keeps_what_a_host_adds() {
    let mut stepper = pair(&["head.kind=clamped"]);
    stepper.set("tendon_2_added_tension_n", &[0.1]).unwrap();
    stepper.do_step(0.1).unwrap();
    let saved = stepper.save();
    stepper.do_step(0.1).unwrap();
    let there = stepper.state().clone();
    stepper.set("tendon_2_added_tension_n", &[0.0]).unwrap();
    stepper.do_step(0.1).unwrap();
    stepper.restore(&saved).unwrap();
    stepper.do_step(0.1).unwrap();
    assert_eq!(stepper.state(), &there);
}

#[test]
fn readings_of_tendons_between_steps_follow_the_state_there() {
    let mut stepper = pair(&["head.kind=clamped", "start={kind=\"ramp\",ramp_s=0.2}"]);
    stepper.do_step(0.3).unwrap();
    let mut last = get(&mut stepper, "tendon_1_length_m");
    let mut worst = 0.0_f64;
    // A reading in the middle of an internal step is that of both ends but for the curve between, a host's step being shorter than the scene's.
    for _ in 0..40 {
        stepper.do_step(5e-4).unwrap();
        let (now, rate) = (
            get(&mut stepper, "tendon_1_length_m"),
            stepper.get("tendon_1_power_w").unwrap()[0] / -get(&mut stepper, "tendon_1_tension_n"),
        );
        worst = worst.max((now - last - 5e-4 * rate).abs());
        last = now;
    }
    assert!(worst < 2e-6, "{worst:e}");
}

#[test]
fn tendons_that_cannot_be_are_refused_by_name() {
    for (change, told) in [
        ("tendons.0.tension_n=-1.0", "does not push"),
        ("tendons.0.tension_n.amplitude=0.4", "does not push"),
        ("tendons.0.to_xi=0.0", "beyond from_xi"),
        ("tendons.1.to_xi=0.24", "passes a joint"),
        ("tendons.0.from_xi=1.5", "from 0 to 1"),
        ("tendons=[{offset_m=0.0},{offset_m=0.0},{offset_m=0.0},{offset_m=0.0},{offset_m=0.0}]", "at most 4"),
        ("tendons=3", "[[tendons]]"),
        ("rod.damping_of=elastic", "with [[tendons]]"),
        ("solver.model=shape", "[[tendons]], which only the full model supports"),
        ("tendons.0.tension_n={table=\"absent.csv\"}", "absent.csv"),
    ] {
        let mut document = document(&[]);
        let message = document
            .set(change)
            .and_then(|()| document.scene())
            .and_then(|scene| scene.model().map(|_| ()))
            .unwrap_err()
            .to_string();
        println!("{change}: {message}");
        assert!(message.contains(told), "{change}: {message}");
    }
}

#[test]
fn scenes_without_tendons_say_what_their_variables_need() {
    let stepper = pair(&["tendons=[]"]);
    let names: Vec<&str> =
        VARIABLES.iter().map(|variable| variable.name).filter(|name| name.starts_with("tendon_")).collect();
    assert_eq!(names.len(), 20);
    for name in names {
        let message = stepper.get(name).unwrap_err().to_string();
        assert!(message.contains("[[tendons]]"), "{message}");
    }
}

#[test]
fn a_jump_releases_the_rod_into_its_tendons_and_a_tail_with_tendons_is_not_passive() {
    let scene = |changes: &[&str]| {
        document_of("pair.toml", &PAIR.replace("integrator = \"newmark\"\n", ""), changes).scene().unwrap()
    };
    // As a jump start of an actuation, that of tendons has a method that damps the ringing.
    assert_eq!(scene(&["start.kind=jump"]).integrator_name(), "implicit-euler");
    assert_eq!(scene(&[]).integrator_name(), "generalized-alpha");
    let slack = ["start.kind=jump", "tendons.0.tension_n=0.0", "tendons.1.tension_n=0.0"];
    assert_eq!(scene(&slack).integrator_name(), "generalized-alpha");
    let warnings = |changes: &[&str]| {
        let scene = scene(changes);
        Assessment::of(&scene, &Stepper::of(&scene).unwrap()).unwrap().warnings
    };
    let coarse = ["rod.nodes=5", "head.kind=driven", "head.angle_rad={amplitude=0.1,frequency_hz=20.0}"];
    assert!(!warnings(&coarse).iter().any(|warning| warning.contains("passive")));
    assert!(warnings(&[&coarse[..], &slack[1..]].concat()).iter().any(|warning| warning.contains("passive tail")));
    let jump = warnings(&["start.kind=jump", "solver.time_step_s=0.02"]);
    assert!(
        jump.iter()
            .any(|warning| warning.contains("the jump start excites vibrations") && warning.contains("\"ramp\"")),
        "{jump:?}"
    );
    let outside = warnings(&["tendons.1.offset_m=-0.008"]);
    assert!(outside.iter().any(|warning| warning.contains("tendon 2 runs outside of the body")), "{outside:?}");
    assert!(!warnings(&[]).iter().any(|warning| warning.contains("outside")));
}

#[test]
fn a_rod_that_its_tendons_fold_at_the_start_blames_the_stronger_one() {
    for strong in [0, 1] {
        let tension = format!("tendons.{strong}.tension_n=1e12");
        let scene = document(&[&tension, "head.kind=clamped"]).scene().unwrap();
        let error = Stepper::of(&scene).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(&format!("tendons.{strong}.tension_n: the rod folds over")), "{error}");
    }
}

#[test]
fn what_a_winch_is_bought_by_is_that_of_its_steps() {
    let mut stepper = pair(&[]);
    let mut most = [0.0_f64; 3];
    let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
    for _ in 0..=500 {
        let [tension, power, length] =
            ["tendon_1_tension_n", "tendon_1_power_w", "tendon_1_length_m"].map(|name| get(&mut stepper, name));
        most.iter_mut().zip([tension, power, (power / tension).abs()]).for_each(|(most, own)| *most = most.max(own));
        ends = [ends[0].min(length), ends[1].max(length)];
        stepper.do_step(1e-3).unwrap();
    }
    stepper = pair(&[]);
    stepper.do_step(0.5).unwrap();
    let found = stepper.metrics().totals.tendons[0];
    assert_eq!([found.tension, found.power], [most[0], most[1]]);
    assert!((found.speed / most[2] - 1.0).abs() < 1e-9, "{found:?} {most:?}");
    assert_eq!(found.travel(), ends[1] - ends[0]);
}

#[test]
fn a_tension_that_changes_has_derivatives_by_its_numbers_but_its_frequency() {
    let scene = document(&[]).scene().unwrap();
    let reason = scene.not_a_number("tendons.0.tension_n.frequency_hz").unwrap();
    assert!(
        reason.contains("tendons.0.tension_n changes in time") && reason.contains("amplitude, phase_rad"),
        "{reason}"
    );
    assert_eq!([scene.not_a_number("tendons.1.tension_n"), scene.not_a_number("tendons.0.offset_m")], [None, None]);
    let keys = ["amplitude", "phase_rad", "offset"].map(|part| format!("tendons.0.tension_n.{part}"));
    let by = |changes: &[&str]| {
        let names = keys.each_ref().map(String::as_str);
        let (tip, gradient) = value_and_grad(&document(changes), "tip_y_m", &names).unwrap();
        (tip, gradient.iter().map(|by| by.values[0]).collect::<Vec<f64>>())
    };
    // Above zero at all times, where a cable that does not push has a kink.
    let above = "tendons.0.tension_n.offset=0.4";
    let (_, exact) = by(&[above]);
    for (i, key) in keys.iter().enumerate() {
        let own = [0.3, 0.0, 0.4][i];
        let tip = |change: f64| by(&[above, &format!("{key}={:e}", own + change)]).0;
        let h = 1e-3;
        let found = (8.0 * (tip(h) - tip(-h)) - (tip(2.0 * h) - tip(-2.0 * h))) / (12.0 * h);
        let error = (exact[i] / found - 1.0).abs();
        println!("{key}: {:e}, differences {found:e}", exact[i]);
        assert!(found.abs() > 1e-3 && error < 1e-6, "{key}: {:e} {found:e}", exact[i]);
    }
}
