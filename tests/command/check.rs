//! Every number that `check` prints, by hand from the scene.

use std::f64::consts::{PI, SQRT_2, TAU};
use std::process::Command;

/// A steel strip, so stiff that it moves as a whole, heaved in water.
const STRIP: &str = r#"
name = "strip"
[rod]
nodes = 65
length_m = 0.2
section = "rectangle"
outer_radius_m = 0.001
depth_m = 0.03
youngs_modulus_pa = 2e11
density_kg_m3 = 7800.0
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[drag]
law = "cross-flow"
[reactive]
[head]
kind = "driven"
position_m = [0.0, { amplitude = 0.01, frequency_hz = 0.5 }]
[solver]
integrator = "generalized-alpha"
time_step_s = 1e-2
duration_s = 8.0
"#;

/// A round rod behind a sphere that falls in a thick fluid.
const FALLING: &str = r#"
name = "falling"
[rod]
nodes = 33
length_m = 0.1
outer_radius_m = 0.001
youngs_modulus_pa = 1e9
density_kg_m3 = 1200.0
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1000.0
[drag]
law = "cox"
[head_body]
semi_axis_along_m = 0.002
semi_axis_across_m = 0.002
mass_kg = 4e-5
[loads]
gravity_m_s2 = [0.0, -9.81]
buoyancy = true
[solver]
time_step_s = 1e-2
duration_s = 2.0
"#;

/// What `check --json` says of a scene: its facts by name, those of one name one after the other, and all of its answer.
fn checked(text: &str) -> (impl Fn(&str) -> String + use<>, serde_json::Value) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), text).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .args(["check", "scene.toml", "--json"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let answer: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let facts = answer["facts"].clone();
    let fact = move |name: &str| {
        let of = facts.as_array().unwrap().iter().filter(|fact| fact["name"] == name);
        let texts: Vec<&str> = of.map(|fact| fact["text"].as_str().unwrap()).collect();
        assert!(!texts.is_empty(), "no fact {name}");
        texts.join("\n")
    };
    (fact, answer)
}

/// The number that follows `before` in `text`.
fn after(text: &str, before: &str) -> f64 {
    let rest = text.split_once(before).unwrap_or_else(|| panic!("no {before:?} in {text:?}")).1.trim_start();
    let number: String = rest.chars().take_while(|c| c.is_ascii_digit() || "+-.e".contains(*c)).collect();
    number.trim_end_matches(['.', '-', 'e', '+']).parse().unwrap_or_else(|_| panic!("{number:?} after {before:?}"))
}

#[track_caller]
fn near(found: f64, wanted: f64, part: f64, what: &str) {
    assert!((found - wanted).abs() <= part * wanted.abs(), "{what}: found {found:e}, by hand {wanted:e}");
}

#[test]
fn the_numbers_of_a_strip_that_heaves_in_water_are_those_of_its_formulas() {
    let (length, thickness, depth, density, modulus) = (0.2, 2e-3, 0.03, 7800.0, 2e11);
    let (water, viscosity, amplitude, frequency) = (1000.0, 1e-3, 0.01, 0.5);
    let omega = TAU * frequency;
    let (fact, answer) = checked(STRIP);
    let digits = 6e-5; // printed in five
    let mass = density * thickness * depth * length;
    let stiffness = modulus * depth * f64::powi(thickness, 3) / 12.0;
    assert_eq!(after(&fact("rod"), ""), 65.0);
    assert_eq!(after(&fact("rod"), "nodes, "), 130.0);
    near(after(&fact("rod"), "spacing "), length / 64.0, digits, "spacing");
    near(after(&fact("rod"), " m, "), mass, digits, "mass");
    for place in ["EI = ", "at the head, ", "in the middle, "] {
        near(after(&fact("stiffness"), place), stiffness, digits, place);
    }
    near(after(&fact("stiffness"), "EA = "), modulus * thickness * depth, digits, "EA");
    near(after(&fact("mass over displaced mass"), ""), density / water, digits, "mass over displaced mass");
    near(after(&fact("section"), "rectangle, "), thickness, digits, "thickness");
    near(after(&fact("section"), "motion, "), depth, digits, "depth");
    assert_eq!(after(&fact("solver"), "generalized-alpha, "), 800.0);
    assert_eq!(after(&fact("output"), "about "), 801.0);
    // Kinetic energy: the strip at its largest speed, as a whole.
    let speed = amplitude * omega;
    near(after(&fact("energy at the start"), "kinetic "), 0.5 * mass * speed * speed, 1e-3, "kinetic energy"); // measured: 1e-4
    // The water that a strip accelerates is π/4 ρD² and a little for its thickness (t/D = 1/15): between 1 and 1.05 of that.
    let ratio = after(&fact("oscillation"), "rod's mass ");
    let thin = 0.25 * PI * water * depth * depth * length / mass;
    assert!((1.0..1.12).contains(&(ratio / thin)), "{ratio}, of a thin plate {thin}"); // measured: 1.107
    near(
        after(&fact("energy at the start"), "fluid "),
        ratio * 0.5 * mass * speed * speed,
        1e-3,
        "energy of the water",
    );
    // Root mean square of the speed of the heave.
    let root = speed / SQRT_2;
    let flow = fact("flow around the rod");
    near(after(&flow, "depth of "), depth, digits, "depth of the flow");
    near(after(&flow, " m and "), root, 3e-3, "speed across"); // measured: 1.6e-3, the strip bends a little
    near(after(&flow, "Re_d = "), water * root * depth / viscosity, 3e-3, "Reynolds number");
    near(answer["reynolds_number"].as_f64().unwrap(), water * root * depth / viscosity, 3e-3, "Reynolds number");
    near(after(&fact("oscillation"), "β = fD²/ν = "), frequency * depth * depth * water / viscosity, 6e-4, "β");
    near(after(&fact("oscillation"), "KC = "), TAU * amplitude / depth, 3e-3, "KC");
    near(answer["tip_amplitude_m"].as_f64().unwrap(), amplitude, 2e-3, "tip amplitude"); // measured: 6e-4
    // A clamped beam, 1.8751²/L² √(EI/m), with the water's mass; the mesh is of second order.
    let first = 1.875_104_f64.powi(2) * (stiffness / (mass / length * (1.0 + ratio))).sqrt() / (length * length);
    near(answer["first_frequency_rad_s"].as_f64().unwrap(), first, 2e-2, "first frequency"); // measured: 1.0e-2
    near(answer["frequency_ratio"].as_f64().unwrap(), omega / first, 2e-2, "frequency ratio");
    near(after(&fact("first natural frequency"), ""), first / TAU, 2e-2, "first natural frequency");
    let water_side = fact("reactive force");
    near(
        after(&water_side, "frequencies by "),
        100.0 * (1.0 - (1.0 + ratio).powf(-0.5)),
        2e-3,
        "fall of the frequencies",
    );
    near(after(&water_side, "depth over length "), depth / length, 1e-9, "depth over length");
    let drag = fact("drag per length and speed");
    let (along, across) = (after(&drag, ""), after(&drag, "along, "));
    assert!(0.0 < along && along < 0.1 * across, "{drag}");
    // Sperm number and inertia by the drag across at rest.
    let per_length = mass / length * (1.0 + ratio);
    let resting = omega * per_length / answer["inertia_ratio"].as_f64().unwrap();
    let sperm = length * (resting * omega / stiffness).powf(0.25);
    near(answer["sperm_number"].as_f64().unwrap(), sperm, 1e-3, "sperm number");
    near(after(&fact("sperm number"), ""), sperm, 1e-3, "sperm number");
}

#[test]
fn the_numbers_of_what_falls_in_a_thick_fluid_are_those_of_stokes() {
    let (length, radius, ball, viscosity, fluid, gravity) = (0.1, 1e-3, 2e-3, 1.0, 1000.0, 9.81);
    let (fact, answer) = checked(FALLING);
    let rod = 1200.0 * PI * radius * radius * length;
    near(after(&fact("rod"), " m, "), rod + 4e-5, 6e-5, "mass with the ball");
    let body = fact("head body");
    near(after(&body, "semi-axes "), ball, 6e-5, "semi-axis");
    near(after(&body, "Stokes drag "), 6.0 * PI * viscosity * ball, 6e-5, "drag of the ball along");
    near(after(&body, "along, "), 6.0 * PI * viscosity * ball, 6e-5, "drag of the ball across");
    near(after(&body, "across, "), 4e-5, 6e-5, "mass of the ball");
    near(after(&body, "N s/m across, "), 8.0 * PI * viscosity * f64::powi(ball, 3), 6e-5, "drag of its spin");
    let volume = PI * radius * radius * length + 4.0 / 3.0 * PI * f64::powi(ball, 3);
    near(
        after(&fact("mass over displaced mass"), ""),
        (rod + 4e-5) / (fluid * volume),
        5e-4,
        "mass over displaced mass",
    );
    // It falls as its weight in the fluid and its drag across say.
    let across = after(&fact("drag per length and speed"), "along, ");
    let weight = (rod + 4e-5 - fluid * volume) * gravity;
    let speed = weight / (across * length + 6.0 * PI * viscosity * ball);
    let flow = fact("flow around the rod");
    near(after(&flow, " m and "), speed, 2e-2, "speed of the fall"); // measured: 1.3e-2, since the lighter ball turns the rod
    near(
        answer["reynolds_number"].as_f64().unwrap(),
        fluid * after(&flow, " m and ") * 2.0 * radius / viscosity,
        1e-3,
        "Re",
    );
    // The ball is lighter than the rod: on it the rod falls a little slower than as a whole, and faster than the ball alone would.
    let alone = (4e-5 - fluid * 4.0 / 3.0 * PI * f64::powi(ball, 3)) * gravity / (6.0 * PI * viscosity * ball);
    let own = after(&body, "Re = ") * viscosity / (fluid * 2.0 * ball);
    assert!(alone < own && own < speed && own > 0.9 * speed, "{alone} {own} {speed}"); // measured: 1.70e-3, 2.10e-3, 2.27e-3
    assert_eq!(after(&flow, "radius "), 100.0);
}

#[test]
fn the_numbers_of_an_interface_are_those_of_its_fluids() {
    let text = STRIP.replace("[reactive]\n", "").replace("section = \"rectangle\"", "section = \"ellipse\"");
    let layers = "[medium.beyond]\nnormal = [0.0, 1.0]\noffset_m = 0.05\nthickness_m = 0.01\nviscosity_pa_s = 2e-5\n\
        density_kg_m3 = 800.0\n[loads]\ngravity_m_s2 = [0.0, -9.81]\n[drag]";
    let (fact, _) = checked(&text.replace("[drag]", layers));
    let interface = fact("interface");
    near(after(&interface, "1 at "), 0.05, 1e-9, "place");
    near(after(&interface, "thick: "), 0.01 / 1e-3, 1e-9, "thickness in radii");
    near(after(&interface, "radii, "), 0.01 / (0.2 / 64.0), 1e-9, "thickness in spacings");
    for (before, wanted) in [("from ", 1000.0), ("kg/m^3, ", 1e-3), ("Pa s to ", 800.0), ("Pa s to 8.0000e2, ", 2e-5)] {
        near(after(&interface, before), wanted, 6e-5, before);
    }
    let speed = after(&fact("flow around the rod"), " m and ");
    near(speed, 0.01 * PI / SQRT_2, 3e-3, "speed across");
    near(after(&interface, "(Re_d "), 800.0 * speed * 0.03 / 2e-5, 1e-3, "Reynolds number beyond");
    let crossing = fact("crossing");
    let reduced = 9.81 * 200.0 / 1000.0;
    near(after(&crossing, "gΔρ/ρ = "), reduced, 6e-4, "reduced gravity");
    near(after(&crossing, "√(g′D) = "), speed / (reduced * 0.03).sqrt(), 1e-3, "Froude number");
    // Water against air at 25 °C: 0.072 N/m.
    near(after(&crossing, "ρw²D/σ = "), 1000.0 * speed * speed * 0.03 / 0.072, 2e-3, "Weber number");
}

#[test]
fn the_size_of_the_tables_is_about_what_check_says() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), STRIP).unwrap();
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_caudal")).args(arguments).current_dir(folder.path()).output().unwrap()
    };
    let said = String::from_utf8(run(&["check", "scene.toml"]).stdout).unwrap();
    let line = said.lines().find(|line| line.starts_with("output")).unwrap();
    let told = after(line, "rows, ") * 1e6;
    assert!(line.contains(" MB"), "{line}");
    assert!(run(&["run", "scene.toml", "--quiet"]).status.success());
    let size = |file: &str| std::fs::metadata(folder.path().join("out/strip").join(file)).unwrap().len() as f64;
    let written = size("trajectory.csv") + size("nodes.csv");
    assert!((0.9..1.1).contains(&(told / written)), "check says {told:e} bytes, {written:e} were written"); // measured: 0.986
}

#[test]
fn the_added_mass_of_a_ball_at_the_head_is_half_of_the_water_that_it_displaces() {
    let (fact, _) = checked(&FALLING.replace("law = \"cox\"", "law = \"cox\"\n[reactive]"));
    let body = fact("head body");
    let half = 2.0 / 3.0 * PI * f64::powi(2e-3, 3) * 1000.0;
    near(after(&body, "added mass "), half, 6e-5, "along");
    near(after(&body, "kg along, "), half, 6e-5, "across");
    assert!(after(&body, "moment of inertia ").abs() < 1e-20, "{body}");
}

/// A clamped rod that a standing wave bends, far below its first mode.
const BENT: &str = r#"name = "bent"
[rod]
nodes = 9
length_m = 0.2
outer_radius_m = 0.01
youngs_modulus_pa = 1e6
density_kg_m3 = 1000.0
damping_time_s = 0.3
[actuation]
kind = "standing-wave"
kappa_amp = 1.0
frequency_hz = 0.5
[head]
kind = "clamped"
[solver]
time_step_s = 1e-3
duration_s = 8.0
"#;

#[test]
fn what_damping_does_to_the_answer_of_a_drive_is_what_runs_show() {
    let tip = |changes: &[&str]| {
        let scene = crate::common::scene_of(BENT, changes);
        let mut stepper = caudal::stepper::Stepper::of(&scene).unwrap();
        stepper.do_step(6.0).unwrap();
        let swing = (0..200).map(|_| {
            stepper.do_step(0.01).unwrap();
            stepper.get_scalar("tip_dy_m").unwrap()
        });
        let [least, most] = swing.fold([f64::INFINITY, -f64::INFINITY], |[a, b], tip| [a.min(tip), b.max(tip)]);
        0.5 * (most - least)
    };
    let undamped = tip(&["rod.damping_time_s=2e-3"]); // which ends the ringing of the start and little else
    for rate in ["whole", "elastic"] {
        let text = BENT.replace("damping_time_s = 0.3", &format!("damping_time_s = 0.3\ndamping_of = \"{rate}\""));
        let (fact, _) = checked(&text);
        let said = fact("damping of the material");
        let shown = undamped / tip(&[&format!("rod.damping_of={rate}")]);
        match said.split_once("would respond ") {
            Some((_, rest)) => near(after(rest, ""), shown, 0.06, rate),
            None => assert!(shown < 1.05, "{rate}: {said} {shown}"),
        }
        assert_eq!(said.contains("would respond"), rate == "whole", "{said}");
        assert_eq!(fact("frequency ratio ω/ω₁").contains("reduced and delayed"), rate == "whole");
    }
}

#[test]
fn of_a_profile_of_damping_times_no_single_one_is_said() {
    let text = BENT.replace("damping_time_s = 0.3", "damping_time_s = [[0.0, 0.1], [0.5, 0.0], [1.0, 0.1]]");
    let (fact, _) = checked(&text);
    let said = fact("damping of the material");
    assert!(
        said.starts_with("τ = 0 to 0.100 s in bending along the rod")
            && !said.contains("damping ratios of the first modes"),
        "{said}"
    );
}

#[test]
fn what_cannot_move_is_told_before_a_run() {
    let warned = |text: &str, word: &str| {
        let (_, answer) = checked(text);
        answer["warnings"].as_array().unwrap().iter().any(|warning| warning.as_str().unwrap().contains(word))
    };
    let still = STRIP.replace("position_m = [0.0, { amplitude = 0.01, frequency_hz = 0.5 }]", "");
    let (moves, hosted) =
        ("the head stands still", still.replace("kind = \"driven\"", "kind = \"driven\"\ninput = \"at-end\""));
    assert!(warned(&still, moves) && !warned(STRIP, moves) && !warned(&hosted, moves));
    // Amplitudes of 0.
    let heave = "head.position_m.1 has an amplitude of 0";
    assert!(warned(&STRIP.replace("amplitude = 0.01", "amplitude = 0.0"), heave) && !warned(STRIP, heave));
    let both = "position_m = { amplitude = [0.0, 0.01], frequency_hz = 0.5 }";
    assert!(!warned(
        &STRIP.replace("position_m = [0.0, { amplitude = 0.01, frequency_hz = 0.5 }]", both),
        "amplitude of 0"
    ));
    let wave = |amplitude: &str, more: &str| {
        format!("{STRIP}[actuation]\nkind = \"standing-wave\"\nkappa_amp = {amplitude}\nfrequency_hz = 0.5\n{more}")
    };
    let nothing = "actuation.kappa_amp = 0: the actuation does nothing";
    assert!(warned(&wave("0.0", ""), nothing) && !warned(&wave("3.0", ""), nothing));
    assert!(warned(&wave("3.0", "envelope = [0.0, 0.0]\n"), "is 0 along the whole rod"));
    // A standing wave of frequency 0 stays at its phase: at a zero, or at its crest.
    let wave = "[actuation]\nkind = \"standing-wave\"\nkappa_amp = 3.0\nfrequency_hz = 0.0\n";
    let bent = format!(
        "{}{wave}",
        STRIP.replace(
            "kind = \"driven\"\nposition_m = [0.0, { amplitude = 0.01, frequency_hz = 0.5 }]",
            "kind = \"clamped\""
        )
    );
    let crest = format!("{bent}phase_profile_rad = [[0.0, -1.5707963267948966], [1.0, -1.5707963267948966]]\n");
    // A bend that rings faster than the steps.
    let swings = "which the time step does not resolve";
    let released = STRIP.replace(
        "kind = \"driven\"\nposition_m = [0.0, { amplitude = 0.01, frequency_hz = 0.5 }]",
        "kind = \"clamped\"\n[start]\ncurvature_1_m = 1.0",
    );
    assert!(
        warned(&released, swings)
            && !warned(&released.replace("= 1.0", "= 0.0"), swings)
            && !warned(&released, "shaped")
    );
    let word = "actuation.frequency_hz = 0";
    assert!(warned(&bent, word) && !warned(&crest, word));
    for text in [&bent, &crest] {
        let tip = checked(text).1["tip_amplitude_m"].as_f64();
        assert!(tip.is_none_or(|tip| tip < 1e-15), "{tip:?}");
    }
}

#[test]
fn the_loads_of_the_first_cycles_are_those_of_a_run_of_them() {
    let models = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("models");
    for (model, ends) in [("servo-tail", "in the first 1.50 s"), ("tendon-fish", "in the first 1.50 s")] {
        let text = std::fs::read_to_string(models.join(format!("{model}.toml"))).unwrap();
        let said = checked(&text).0("loads");
        let scene = crate::common::scene_of(&text, &[]);
        let mut stepper = caudal::stepper::Stepper::of(&scene).unwrap();
        while stepper.time() < 1.5 {
            stepper.do_step(scene.typical_step()).unwrap();
        }
        let joint = stepper.metrics().totals.max_couple;
        assert!(said.ends_with(ends) && said.contains(&format!("joint {joint:.4e} N m")), "{said}, {joint:e}");
    }
}
