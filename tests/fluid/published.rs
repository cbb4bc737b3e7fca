//! What is published, scene by scene: every scene of `models/validation` with the number that it is there for, and the drag of
//! cylinders and the speeds of fishes over decades of the Reynolds number.
//! The table in docs/src/notes/fluid-validation.md lists them.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;
use std::f64::consts::{PI, TAU};

use caudal::fluid::laws::{DragLaw, LawInputs, cox, cross_flow, gray_hancock, lighthill, wall, weak_inertia};
use caudal::fluid::{Fluid, Forces};
use caudal::scene::Scene;
use caudal::stepper::Stepper;
use common::{largest, rod, run, run_with, scene, scene_files, scene_of};

/// A scene, what is measured of its run, what is published, and how far off it may be, as a part of that.
struct Case {
    scene: &'static str,
    found: fn(&Scene) -> f64,
    published: f64,
    tolerance: f64,
}

/// The mean over the last whole cycles of an output.
fn mean(scene: &Scene, name: &str) -> f64 {
    run(scene).get_scalar(name).unwrap()
}

/// The angle between fall and gravity, degrees.
fn drift(scene: &Scene) -> f64 {
    let stepper = run(scene);
    let v = stepper.state().v.as_chunks::<2>().0[4];
    (2.0_f64.sqrt().atan() - (v[1] / v[0]).atan()).to_degrees()
}

fn swing(scene: &Scene) -> f64 {
    let mut angles = Vec::new();
    run_with(scene, |stepper| angles.push(stepper.get_scalar("body_angle_rad").unwrap()));
    // It goes on beyond ±π/2 only by less than a turn.
    largest(angles)
}

fn tenth_period(scene: &Scene) -> f64 {
    let mut at = Vec::new();
    run_with(scene, |stepper: &mut Stepper| at.push(stepper.metrics().now.com));
    (at[999] - at[899]).norm()
}

/// How far the ends are above the middle, over the length.
fn bend(scene: &Scene) -> f64 {
    let stepper = run(scene);
    let y: Vec<f64> = stepper.state().q.chunks(2).map(|x| x[1]).collect();
    (0.5 * (y[0] + y[y.len() - 1]) - y[y.len() / 2]) / stepper.model().rod.length
}

static CASES: &[Case] = &[
    // asin ⅓. Measured: 7e-15 off.
    Case { scene: "oblique-fall", found: drift, published: 19.471_220_634_490_69, tolerance: 1e-9 },
    // Stokes. Measured: 7e-15 off.
    Case { scene: "sinking-sphere", found: |scene| -run(scene).state().v[0], published: 0.545, tolerance: 1e-9 },
    // Kirchhoff: π − 2ψ with tan ψ = (M + m⊥) 0.1/(M + m∥), the angle of the impulse. Measured: 1.4e-6 off.
    Case { scene: "kirchhoff-spheroid", found: swing, published: 2.839164, tolerance: 1e-3 },
    // An independent program's thrust over (ξ⊥ − ξ∥) ω L² θ₀². Measured: 7.8e-4 off.
    Case {
        scene: "yu-lauga-hosoi-tail",
        found: |scene| mean(scene, "cycle_thrust_n").abs() / 0.594_468,
        published: 0.05660,
        tolerance: 0.01,
    },
    Case { scene: "pyelastica-flagella", found: tenth_period, published: 0.01400, tolerance: 0.01 },
    // Three-dimensional simulation. Measured: 1.5e-2 off, by chance: the model's error is 30 %.
    Case {
        scene: "kern-koumoutsakos-eel",
        found: |scene| mean(scene, "cycle_forward_speed_m_s"),
        published: 0.40,
        tolerance: 0.3,
    },
    // An independent program, within 0.003. Measured: 1.8e-2 off.
    Case { scene: "falling-fibre", found: bend, published: 0.117, tolerance: 0.026 },
    // An experiment, whose height and kinematics are known roughly. Measured: 1.2e-2 off.
    Case {
        scene: "sznitman-worm",
        found: |scene| mean(scene, "cycle_forward_speed_m_s"),
        published: 0.35e-3,
        tolerance: 0.3,
    },
];

#[test]
fn every_validation_scene_gives_what_is_published() {
    let mut seen = Vec::new();
    for path in scene_files("models/validation") {
        let scene = Scene::load(&path).unwrap();
        let case = CASES.iter().find(|case| case.scene == scene.name);
        let Case { found, published, tolerance, .. } =
            case.unwrap_or_else(|| panic!("{} has nothing that it is compared with", scene.name));
        let found = found(&scene);
        println!("{}: {found:e} of {published:e}: {:+.2e}", scene.name, found / published - 1.0);
        assert!((found / published - 1.0).abs() < *tolerance, "{}: {found:e} of {published:e}", scene.name);
        seen.push(scene.name);
    }
    assert_eq!(seen.len(), CASES.len(), "a case has no scene");
}

/// C_D of a long cylinder across the flow by `law` at a Reynolds number of its diameter.
fn drag_coefficient(law: &DragLaw, reynolds: f64, slenderness: f64) -> f64 {
    let (a, density, speed) = (0.01, 1000.0, 0.1);
    let length = format!("rod.length_m={:e}", a * slenderness);
    let rod = rod(&scene(&[&length, "rod.outer_radius_m=0.01", "rod.inner_radius_m=0.0"]));
    let forces = Forces(vec![(law.build)(&LawInputs::plain(&rod))]);
    let fluid = Fluid { density, viscosity: density * speed * 2.0 * a / reynolds, ..Fluid::NONE };
    let [_, across] = forces.coefficients(&rod, fluid, speed).unwrap();
    across * speed / (0.5 * density * speed * speed * 2.0 * a)
}

/// Drag along and across, N s/m², of the cases below.
const COX: [f64; 2] = [1.654202295605, 2.618911933997];
const LIGHTHILL: [f64; 2] = [2.859600867380, 4.659000485147];
const GRAY_HANCOCK: [f64; 2] = [1.309455966999, 2.618911933997];
const NEAR: [f64; 2] = [6.528502605273, 13.057005210546];
const FARTHER: [f64; 2] = [1.654202295605, 3.069410351971];
/// Euler's constant.
const EULER: f64 = 0.577_215_664_901_532_9;

/// N s/m² along and across a rod of radius 0.01 m and length 1 m by `law`, in a fluid of unit viscosity.
fn resistance(law: &DragLaw, set: impl FnOnce(&mut LawInputs<'_>)) -> [f64; 2] {
    let rod = rod(&scene(&["rod.length_m=1.0", "rod.outer_radius_m=0.01", "rod.inner_radius_m=0.0"]));
    let mut law_inputs = LawInputs::plain(&rod);
    set(&mut law_inputs);
    let fluid = Fluid { density: 1000.0, viscosity: 1.0, ..Fluid::NONE };
    Forces(vec![(law.build)(&law_inputs)]).coefficients(&rod, fluid, 1e-9).unwrap()
}

#[test]
fn laws_of_creeping_flow_have_the_coefficients_of_their_sources() {
    // Worked out from the papers' formulas with an independent calculator; ℒ/a = 100, Λ/a = 50, h/a = 1.5 and 30.
    let slender = |length: f64| move |law_inputs: &mut LawInputs<'_>| law_inputs.slender_length = Some(length);
    let beside = |height: f64| move |law_inputs: &mut LawInputs<'_>| law_inputs.height = height;
    let cases: [(&str, [f64; 2], [f64; 2]); 6] = [
        ("cox", resistance(&cox::LAW, slender(1.0)), COX),
        ("lighthill", resistance(&lighthill::LAW, slender(0.5)), LIGHTHILL),
        ("gray-hancock", resistance(&gray_hancock::LAW, slender(1.0)), GRAY_HANCOCK),
        ("weak-inertia at rest", resistance(&weak_inertia::LAW, slender(1.0)), COX),
        ("wall, near", resistance(&wall::LAW, beside(0.015)), NEAR),
        ("wall, farther", resistance(&wall::LAW, beside(0.3)), FARTHER),
    ];
    for (name, found, published) in cases {
        for (found, published) in found.iter().zip(published) {
            // Measured: 2e-9 under weak-inertia, whose speed is not zero; 2e-15 else.
            assert!((found / published - 1.0).abs() < 1e-7, "{name}: {found} of {published}");
        }
    }
    // Lamb's cylinder is that of ℒ|V|/ν = 2 e^(1−γ) = 3.0524, to the last digit that is printed. Kaplun's factor is of second order.
    let (viscosity, density, speed, radius) = (1.0, 1000.0, 1e-6, 0.01);
    let rod = rod(&scene(&["rod.length_m=1e9", "rod.outer_radius_m=0.01", "rod.inner_radius_m=0.0"]));
    let forces =
        Forces(vec![(weak_inertia::LAW.build)(&LawInputs { slender_length: Some(1e30), ..LawInputs::plain(&rod) })]);
    let [along, across] = forces.coefficients(&rod, Fluid { density, viscosity, ..Fluid::NONE }, speed).unwrap();
    let whole = speed * 1.01_f64.sqrt(); // a tenth of it is along
    let reynolds = 2.0 * radius * whole * density / viscosity;
    let epsilon = 1.0 / (0.5 - EULER - (reynolds / 8.0).ln());
    let expected = 2.0 * TAU * viscosity * epsilon * (1.0 - 0.87 * epsilon * epsilon);
    assert!((across / expected - 1.0).abs() < 2e-6, "{across} of {expected}");
    // What moves along is carried off by the flow across as heat is: ln(4 e^−γ ν/(a|w|)).
    let expected = TAU * viscosity / (4.0 * viscosity / (density * radius * speed) / EULER.exp()).ln();
    assert!((along / expected - 1.0).abs() < 2e-6, "{along} of {expected}");
}

/// K₀ and K₁ of x e^(iπ/4) as real and imaginary parts, by Kₙ(z) = ∫₀^∞ e^(−z cosh t) cosh nt dt.
fn bessel(x: f64) -> [[f64; 2]; 2] {
    let (step, z) = (1e-3, x * 0.5_f64.sqrt());
    [0.0, 1.0].map(|order| {
        (0..20_000).map(|i| step * f64::from(i)).fold([0.0; 2], |sum, t| {
            let weight = if t == 0.0 { 0.5 } else { 1.0 } * step * (-z * t.cosh()).exp() * (order * t).cosh();
            let angle = -z * t.cosh();
            if weight == 0.0 { sum } else { [sum[0] + weight * angle.cos(), sum[1] + weight * angle.sin()] }
        })
    })
}

/// The drag in phase with the speed of a long cylinder that oscillates along itself, over 2πμ: Re λK₁(λ)/K₀(λ), λ² = iωa²/ν.
fn along_itself(swinging: f64) -> f64 {
    let (x, half) = (swinging.sqrt(), 0.5_f64.sqrt());
    let [[a, b], [c, d]] = bessel(x);
    let [re, im] = [a, b].map(|part| part / (a * a + b * b));
    let ratio = [c * re + d * im, d * re - c * im];
    x * half * (ratio[0] - ratio[1])
}

#[test]
fn a_cylinder_that_oscillates_along_or_across_itself_has_the_drag_of_stokes() {
    // Abramowitz & Stegun, table 9.12: ker 1 and kei 1; −kei₁ 1 and ker₁ 1.
    let published = [[0.286_706_208_7, -0.494_994_636_5], [0.241_995_966_4, -0.740_322_276_8]];
    for (found, published) in bessel(1.0).as_flattened().iter().zip(published.as_flattened()) {
        assert!((found - published).abs() < 1e-9, "{found} {published}");
    }
    let (a, density, viscosity): (f64, f64, f64) = (0.01, 1000.0, 1.0);
    let rod = rod(&scene(&["rod.length_m=1e9", "rod.outer_radius_m=0.01", "rod.inner_radius_m=0.0"]));
    for swinging in [1e-6, 1e-4, 1e-3, 1e-2, 0.05] {
        let frequency = Some(swinging * viscosity / density / (a * a) / TAU);
        let law_inputs = LawInputs { slender_length: Some(1e30), frequency, ..LawInputs::plain(&rod) };
        let forces = Forces(vec![(weak_inertia::LAW.build)(&law_inputs)]);
        let found = forces.coefficients(&rod, Fluid { density, viscosity, ..Fluid::NONE }, 1e-30).unwrap();
        let exact = TAU * viscosity * along_itself(swinging);
        let [along, across] = [found[0] / exact, found[1] / (2.0 * exact)];
        println!("ωa²/ν {swinging:e}: {along} along, {across} across");
        // Measured: 6e-8, 1e-5, 1.4e-4, 2.2e-3, 1.7e-2, both alike; one length for both directions was 88 % too high along at 0.01.
        assert!((along - 1.0).abs() < 0.02 && (across - 1.0).abs() < 0.02, "{swinging}: {along} {across}");
    }
}

#[test]
fn a_thin_rod_along_the_flow_has_the_drag_of_its_boundary_layer() {
    // Behind its front, what diffuses from the rod does so as from a line for the time s/U, by 2πμ/(ln √(4νt)/a − γ/2): the mean over
    // the length in the logarithm. Where the flow is slow, Oseen's 1 + F/(16πμνU)·U of any body (Brenner 1961).
    let (a, viscosity, density) = (1e-7, 1.0, 1.0);
    let rod = rod(&scene(&["rod.length_m=1.0", "rod.outer_radius_m=1e-7", "rod.inner_radius_m=0.0"]));
    let forces = Forces(vec![(weak_inertia::LAW.build)(&LawInputs::plain(&rod))]);
    let towing = |speed: f64| forces.towing(&rod, Fluid { density, viscosity, ..Fluid::NONE }, speed) / speed;
    let at_rest = towing(1e-12);
    let more = towing(0.05) / at_rest - 1.0;
    let expected = at_rest * 0.05 / (16.0 * PI);
    println!("slow: {more:e} of {expected:e}");
    // Measured: 4.1 % low.
    assert!((more / expected - 1.0).abs() < 0.05, "{more} of {expected}");
    for speed in [1e3, 1e4, 1e5] {
        let mean = (0..100_000)
            .map(|i| ((4.0 * (f64::from(i) + 0.5) * 1e-5 / speed).sqrt() / a).ln() - 0.5 * EULER)
            .sum::<f64>()
            / 1e5;
        let (found, expected) = (towing(speed), TAU * viscosity / mean);
        println!("U L/ν {speed:e}: {found} of {expected}");
        // Measured: 1.6e-4, 1.8e-5, 2.2e-6.
        assert!((found / expected - 1.0).abs() < 5e-4, "{speed}: {found} of {expected}");
    }
}

#[test]
fn a_cylinder_across_the_flow_has_the_drag_that_was_measured() {
    // Sucker & Brauer (1975), within a few percent of Tritton's and Wieselsberger's cylinders.
    for (reynolds, measured) in [(0.1, 58.0), (0.5, 17.0), (1.0, 10.3)] {
        let found = drag_coefficient(&weak_inertia::LAW, reynolds, 1e6);
        println!("weak-inertia Re {reynolds}: {found} of {measured}");
        // Measured: 4.0 %, 3.3 %, 4.5 % low.
        assert!((found / measured - 1.0).abs() < 0.06, "{reynolds}: {found}");
    }
    // Over six decades, as far as one law of viscous, boundary-layer and form drag goes; ℒ/a = 500 for a viscous part that knows
    // nothing of inertia.
    for (reynolds, published) in [(0.1, 60.0), (1.0, 9.9), (10.0, 2.67), (100.0, 1.45), (1e3, 0.96), (1e4, 1.09)] {
        let found = drag_coefficient(&cross_flow::LAW, reynolds, 500.0);
        println!("cross-flow Re {reynolds}: {found} of {published}");
        // Measured: −12 %, −9 %, 3 %, 6 %, 28 %, 5 %.
        assert!((found / published - 1.0).abs() < 0.3, "{reynolds}: {found}");
    }
}

#[test]
fn swimmers_of_all_sizes_are_as_fast_as_gazzola_argentina_and_mahadevan_found() {
    // Re of the lower of 0.03 Sw^1.31 and 0.4 Sw^1.02 (Nature Physics 10, 2014), Sw = ωAL/ν with the amplitude A from peak to peak.
    let text = include_str!("../../models/validation/kern-koumoutsakos-eel.toml");
    let points = [1.6e3, 1.2e4, 8e4, 5e5].map(|swimming: f64| {
        let viscosity = 1000.0 * TAU * 0.25 / swimming;
        let changes =
            [&format!("medium.viscosity_pa_s={viscosity:e}") as &str, "rod.nodes=17", "solver.duration_s=16.0"];
        let speed = mean(&scene_of(text, &changes), "cycle_forward_speed_m_s");
        let reynolds = speed * 1000.0 / viscosity;
        let fit = f64::min(0.03 * swimming.powf(1.31), 0.4 * swimming.powf(1.02));
        println!("Sw {swimming:e}: Re {reynolds:e}, fit {fit:e}, {:.3}", reynolds / fit);
        // Measured: 0.54 to 0.77.
        assert!((0.4..2.5).contains(&(reynolds / fit)), "{swimming}: {reynolds} {fit}");
        [swimming.ln(), reynolds.ln()]
    });
    // The slope falls from 1.31 towards 1.02. Measured: 1.24, 1.15, 1.09.
    let slopes: Vec<f64> = points.windows(2).map(|p| (p[1][1] - p[0][1]) / (p[1][0] - p[0][0])).collect();
    println!("{slopes:?}");
    assert!(slopes.windows(2).all(|pair| pair[1] < pair[0]), "{slopes:?}");
    assert!((slopes[0] - 1.31).abs() < 0.1 && (slopes[slopes.len() - 1] - 1.02).abs() < 0.1, "{slopes:?}");
}

#[test]
fn the_frequency_of_what_drives_a_scene_reaches_the_law_of_weak_inertia() {
    let drives = [
        "actuation={ kind = \"travelling-wave\", kappa_amp = 0.1, frequency_hz = 3.0, wavelength_m = 1.0 }",
        "head={ kind = \"driven\", angle_rad = { amplitude = 0.1, frequency_hz = 3.0 } }",
    ];
    for drive in drives {
        let scene = scene(&[
            "rod.outer_radius_m=0.001",
            "rod.inner_radius_m=0.0",
            "medium={ viscosity_pa_s = 1.0, density_kg_m3 = 1000.0 }",
            "drag={ law = \"weak-inertia\", slender_length_m = 1.0 }",
            drive,
        ]);
        let (model, rod) = (scene.model().unwrap(), rod(&scene));
        let fluid = Fluid { density: 1000.0, viscosity: 1.0, ..Fluid::NONE };
        let found = model.forces.coefficients(&rod, fluid, 1e-9).unwrap();
        let built = |frequency: Option<f64>| {
            let inputs = LawInputs { slender_length: Some(1.0), frequency, ..LawInputs::plain(&rod) };
            Forces(vec![(weak_inertia::LAW.build)(&inputs)]).coefficients(&rod, fluid, 1e-9).unwrap()
        };
        let (driven, steady) = (built(Some(3.0)), built(None));
        for i in [0, 1] {
            assert!((found[i] / driven[i] - 1.0).abs() < 1e-12, "{drive}: {found:?} {driven:?}");
            assert!(found[i] > 1.2 * steady[i], "{drive}: {found:?} {steady:?}"); // measured: 1.6
        }
    }
}
