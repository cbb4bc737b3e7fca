//! Limits that are no bounds are kept, their duals are what more room is worth, and two goals give a front.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use std::ops::ControlFlow;

use caudal::cycle::MEASURES;
use caudal::design::{Answer, Design, SearchResult};
use caudal::scene::{Document, Scene};
use caudal::sensitivity::{Output, Problem, Quantity};

fn document(wanted: &str) -> Document {
    let mut document = Document::read("models/eel.toml".as_ref()).unwrap();
    let wanted = format!("design={{ {wanted}, starts = 1 }}");
    for change in ["rod.nodes=9", "solver.time_step_s=0.01", "solver.duration_s=2.0", &wanted] {
        document.set(change).unwrap();
    }
    document
}

fn found(wanted: &str) -> SearchResult {
    let design =
        Design::of(&document(wanted), |_| ControlFlow::Continue(())).unwrap_or_else(|e| panic!("{wanted}: {e}"));
    let Answer::Search(found) = design.answer else { panic!("found") };
    *found
}

const FASTEST: &str = r#"goal = "cycle_forward_speed_m_s", variables = ["rod.outer_radius_m", "actuation.kappa_amp"], number_bounds = [0.8, 1.3]"#;

#[test]
fn limits_are_kept_and_their_duals_are_what_more_room_is_worth() {
    // Power has several peaks of nearly the same height here, each with a slope of its own. Measured, of 0.1 % more room: 0.006,
    // 0.005, 0.012 and 0.005; with one slope for all peaks of power 0.077.
    for (key, words, tolerance) in [
        ("largest_mass_kg", "total mass", 0.02),
        ("largest_moment_n_m", "moment", 0.02),
        ("largest_strain", "strain", 0.04),
        ("largest_power_w", "power", 0.02),
    ] {
        // What the fastest takes of it.
        let free = found(&format!("{FASTEST}, {key} = 1e3"));
        let value = 1e3 * free.limits[0].used;
        let limited = |factor: f64| found(&format!("{FASTEST}, {key} = {:e}", factor * value));
        let least = limited(0.92);
        let used = least.limits[0].used;
        let dual =
            least.active.iter().find(|(name, _)| name.contains(words)).unwrap_or_else(|| panic!("{key}: {least:?}")).1;
        let room = limited(0.92 * 1.001);
        let worth = (room.objective / least.objective - 1.0) / 0.001;
        println!(
            "{key}: {value:.4e} free, {used:.8} of the limit used, dual {dual:.4}, worth {worth:.4}, {} iterations",
            least.history.len()
        );
        assert!(least.converged && (used - 1.0).abs() <= 1e-6, "{key}: {used}");
        assert!(least.objective < free.objective, "{key}");
        assert!((worth / dual - 1.0).abs() <= tolerance, "{key}: {worth} {dual}");
    }
}

#[test]
fn a_limit_on_a_load_says_when_the_load_is_largest() {
    let fastest =
        r#"goal = "cycle_forward_speed_m_s", variables = ["actuation.kappa_amp"], number_bounds = [0.8, 1.3]"#;
    let found = found(&format!("{fastest}, largest_power_w = 1e3, least_speed_m_s = 1e-3"));
    let [power, speed] =
        ["power", "speed"].map(|of| found.limits.iter().find(|limit| limit.limit.contains(of)).unwrap());
    // Its own run, the start included.
    let mut designed = document(fastest);
    designed.set(&format!("actuation.kappa_amp={:e}", found.numbers[0].value)).unwrap();
    let mut problem = Problem::of(&designed.scene().unwrap()).unwrap();
    let motion = problem.forward(&[], &[Quantity::ActuationPower.into()], 1, |_| {}).unwrap();
    let largest = (0..motion.times.len()).max_by(|a, b| motion.value(*a, 0).total_cmp(&motion.value(*b, 0))).unwrap();
    println!("{power:?}, largest {:e} W at {} s", motion.value(largest, 0), motion.times[largest]);
    assert_eq!((power.at_s, speed.at_s), (Some(motion.times[largest]), None));
    assert!((1e3 * power.used / motion.value(largest, 0) - 1.0).abs() < 1e-6);
    // A limit that binds is told with that time.
    let tight = format!("{fastest}, largest_power_w = {:e}", 0.9 * motion.value(largest, 0));
    let design = Design::of(&document(&tight), |_| ControlFlow::Continue(())).unwrap();
    let line = design.lines.iter().find(|line| line.starts_with("binding: power")).unwrap();
    println!("{line}");
    assert!(
        line.contains(" W at t = ") && line.contains(" s (relaxing it by 1 % improves the objective by "),
        "{line}"
    );
}

#[test]
fn the_cheapest_that_is_fast_enough_is_as_fast_as_asked_and_its_dual_is_what_speed_costs() {
    let cheapest = r#"goal = "cycle_actuation_power_w", better = "smaller", variables = ["actuation.kappa_amp", "actuation.wavelength_m"], number_bounds = [0.5, 2.0]"#;
    let speed = found(&FASTEST.replace("[0.8, 1.3]", "[1.0, 1.0000001]")).objective;
    let limited = |factor: f64| found(&format!("{cheapest}, least_speed_m_s = {:e}", factor * speed));
    let [least, more] = [1.1, 1.1 * 1.002].map(limited);
    let (name, dual) = least.active.iter().find(|(name, _)| name.contains("speed")).unwrap();
    let worth = (more.objective / least.objective - 1.0) / 0.002;
    println!("{name}: {:.9} used, dual {dual:.4}, cost {worth:.4}, {:?}", least.limits[0].used, least.numbers);
    assert!(least.converged && more.converged && (least.limits[0].used - 1.0).abs() <= 1e-6, "{:?}", least.limits);
    assert!((worth / dual - 1.0).abs() <= 0.02, "{worth} {dual}");
    // Without it, the cheapest is what is moved the least.
    let free = found(cheapest);
    assert!(free.objective < 0.5 * least.objective && free.limits.is_empty());
}

#[test]
fn a_neutral_body_weighs_what_it_displaces_and_a_wall_stays_as_thick_as_asked() {
    let wanted = r#"goal = "cycle_forward_speed_m_s", variables = ["rod.density_kg_m3", "rod.outer_radius_m", "rod.inner_radius_m"], number_bounds = [0.5, 1.6], neutral_buoyancy = true, least_wall_m = 1.2e-3"#;
    let mut document = document(wanted);
    document.set("rod.inner_radius_m=[[0.0, 0.002], [0.1, 0.004], [1.0, 0.0008]]").unwrap();
    let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
    // Both sides of the equality bind, and count as one whose worth is what is left of them.
    let Answer::Search(found) = &design.answer else { panic!("searched") };
    let sides = found.active.iter().filter(|(name, _)| name.contains("than the fluid"));
    let sides: Vec<_> = sides.collect();
    println!("{sides:?} of {:?}", found.active);
    assert!(matches!(sides[..], [(_, worth)] if *worth > 0.0 && *worth < 10.0), "{:?}", found.active);
    let folder = tempfile::tempdir().unwrap();
    let files = design.write(folder.path()).unwrap().complete().unwrap();
    let path = files.iter().find(|path| path.ends_with("eel-designed.toml")).unwrap();
    let rod = Scene::load(path).unwrap().model().unwrap().rod;
    let displaced: f64 = rod.halves().flatten().map(|half| half.displaced * half.length).sum::<f64>() * 1000.0;
    println!("{:.9} of the displaced mass", rod.total_mass() / displaced);
    assert!((rod.total_mass() / displaced - 1.0).abs() <= 1e-6);
    for xi in [0.0, 0.1, 0.6, 1.0] {
        let section = rod.sections.at(xi);
        assert!(section.outer - section.inner >= 1.2e-3 * (1.0 - 1e-6), "{xi}: {section:?}");
    }
}

/// The eel starts by a ramp of one period and speeds up for several: over two cycles its speed still differs, over the last of twelve not.
#[test]
fn means_over_cycles_that_still_differ_are_said_to_be() {
    let lines = |duration: &str| {
        let mut document = document(&format!("{FASTEST}, iterations = 1"));
        document.set(&format!("solver.duration_s={duration}")).unwrap();
        Design::of(&document, |_| ControlFlow::Continue(())).unwrap().lines
    };
    let [one, short, long] = ["0.75", "2.0", "12.0"].map(lines);
    let said = |lines: &[String], words: &str| lines.iter().any(|line| line.contains(words));
    assert!(said(&short, "not periodic yet: the ") && !said(&long, "periodic"), "{short:#?}\n{long:#?}");
    assert!(said(&one, "over a single cycle"), "{one:#?}");
}

#[test]
fn two_goals_give_a_front_each_point_of_which_runs() {
    let wanted = r#"goal = "cycle_forward_speed_m_s", variables = ["actuation.kappa_amp", "actuation.wavelength_m"], number_bounds = [0.6, 1.5], front = { goal = "cycle_cost_of_transport", better = "smaller", points = 4 }"#;
    let design = Design::of(&document(wanted), |_| ControlFlow::Continue(())).unwrap();
    let numbers = design.numbers().unwrap();
    let front = numbers["front"].as_array().unwrap();
    assert_eq!(front.len(), 4);
    let of = |i: usize, key: &str| front[i][key].as_f64().unwrap();
    let folder = tempfile::tempdir().unwrap();
    design.write(folder.path()).unwrap().complete().unwrap();
    for (i, point) in front.iter().enumerate() {
        println!("{i} {:.6e} {:.6e} {}", of(i, "first"), of(i, "second"), point["converged"]);
        assert!(point["best"] == true && point["converged"] == true, "{point}");
        // Cheaper is slower.
        assert!(i == 0 || (of(i, "first") > of(i - 1, "first") && of(i, "second") > of(i - 1, "second")));
        let scene = Scene::load(folder.path().join(format!("eel-front-{}.toml", i + 1))).unwrap();
        for (key, value) in [("cycle_forward_speed_m_s", of(i, "first")), ("cycle_cost_of_transport", of(i, "second"))]
        {
            let measure = MEASURES.into_iter().find(|measure| measure.key == key).unwrap();
            let run = Problem::of(&scene).unwrap().cycle_mean(&measure, &[]).unwrap().unwrap().0;
            assert!((run / value - 1.0).abs() <= 1e-6, "{key}: {run} {value}");
        }
    }
    // Points are spread over both goals: each search has split the widest gap.
    let part = |key: &str, i: usize| (of(i + 1, key) - of(i, key)) / (of(3, key) - of(0, key));
    let gaps: Vec<f64> = (0..3).map(|i| part("first", i).hypot(part("second", i))).collect();
    println!("{gaps:?}");
    let [least, most] = [gaps.iter().copied().fold(f64::INFINITY, f64::min), gaps.iter().copied().fold(0.0, f64::max)];
    assert!(most <= 4.0 * least && most <= 0.9, "{gaps:?}");
    assert!(folder.path().join("front.svg").exists() && folder.path().join("front.csv").exists());
}

/// Slow eels pay for little speed with next to no power: there the front is steep, and has points all the same.
#[test]
fn points_of_a_front_are_spread_along_it_where_it_is_steep() {
    let wanted = r#"goal = "cycle_forward_speed_m_s", variables = ["actuation.kappa_amp", "actuation.wavelength_m"], number_bounds = [0.1, 1.5], front = { goal = "cycle_actuation_power_w", better = "smaller", points = 9 }"#;
    let design = Design::of(&document(wanted), |_| ControlFlow::Continue(())).unwrap();
    let numbers = design.numbers().unwrap();
    let front = numbers["front"].as_array().unwrap();
    let of = |i: usize, key: &str| front[i][key].as_f64().unwrap();
    for (i, point) in front.iter().enumerate() {
        println!("{i} {:.6e} {:.6e} {} {}", of(i, "first"), of(i, "second"), point["converged"], point["best"]);
        assert!(point["best"] == true && point["converged"] == true, "{point}");
        assert!(i == 0 || (of(i, "first") > of(i - 1, "first") && of(i, "second") > of(i - 1, "second")));
    }
    assert_eq!(front.len(), 9);
    let part = |key: &str, i: usize| (of(i + 1, key) - of(i, key)) / (of(8, key) - of(0, key));
    let gaps: Vec<f64> = (0..8).map(|i| part("first", i).hypot(part("second", i))).collect();
    let largest = gaps.iter().copied().fold(0.0, f64::max) / (gaps.iter().sum::<f64>() / 8.0);
    println!("largest gap over the mean gap: {largest:.3}, {gaps:.3?}");
    // Measured: 1.26. Where the second goal is held half way in all gaps it is 1.36, and with points even in the second goal 2.6.
    assert!(largest <= 1.3, "{gaps:?}");
}

#[test]
fn goals_that_do_not_conflict_have_one_best_design() {
    let wanted = r#"goal = "cycle_forward_speed_m_s", variables = ["actuation.kappa_amp"], number_bounds = [0.6, 1.1], front = { goal = "cycle_speed_m_s", points = 4 }"#;
    let design = Design::of(&document(wanted), |_| ControlFlow::Continue(())).unwrap();
    let front = design.numbers().unwrap()["front"].as_array().unwrap().len();
    let said = design.lines.iter().find(|line| line.contains("do not conflict")).unwrap();
    assert!(
        front == 2
            && said.starts_with("cycle_forward_speed_m_s (larger is better) and cycle_speed_m_s (larger is better)"),
        "{front} {said}"
    );
}

#[test]
fn limits_that_mean_nothing_are_refused() {
    for (wanted, words) in [
        (r#"goal = "distance", direction = "-x", largest_mass_kg = 1.0"#, "design.largest_mass_kg"),
        (r#"goal = "distance", direction = "-x", largest_strain = -1.0"#, "design.largest_strain"),
        (r#"goal = "distance", direction = "-x", least_speed_m_s = 0.0"#, "design.least_speed_m_s"),
        (r#"goal = "track-tip", data = "tip.csv", least_thrust_n = 1.0"#, "design.least_thrust_n"),
        (
            r#"goal = "distance", direction = "-x", front = { goal = "distance" }"#,
            "design.front.goal: found \"distance\"",
        ),
        (r#"goal = "cycle_speed_m_s", front = { goal = "distance" }"#, "design.front.goal"),
        (
            r#"goal = "cycle_speed_m_s", front = { goal = "cycle_slip", points = 2 }"#,
            "design.front.points: found 2; allowed: 3 to 100",
        ),
        (
            r#"goal = "cycle_speed_m_s", front = { goal = "cycle_slip", better = "less" }"#,
            "design.front.better: found \"less\"",
        ),
    ] {
        let error = Design::of(&document(wanted), |_| ControlFlow::Continue(())).unwrap_err();
        assert!(error.is_bad_input() && error.to_string().contains(words), "{wanted}: {error}");
    }
}

#[test]
fn a_mean_that_the_scene_has_not_is_no_limit() {
    let error = |changes: &[&str], wanted: &str| {
        let mut document = document(wanted);
        changes.iter().for_each(|change| document.set(change).unwrap());
        Design::of(&document, |_| ControlFlow::Continue(())).map(|_| ()).unwrap_err().to_string()
    };
    let thrust = error(&[], r#"goal = "distance", direction = "-x", least_thrust_n = 1e-3"#);
    assert!(thrust.contains("design.least_thrust_n: found with a free head"), "{thrust}");
    let held = "head.kind=clamped";
    let speed = error(&[held], r#"goal = "cycle_thrust_n", least_speed_m_s = 1e-3"#);
    assert!(speed.contains("design.least_speed_m_s: found with a held head"), "{speed}");
    let short = ["solver.duration_s=0.3"];
    let cycle = error(&short, r#"goal = "distance", direction = "-x", least_speed_m_s = 1e-3"#);
    assert!(cycle.contains("least_speed_m_s") && cycle.contains("shorter than one cycle"), "{cycle}");
}

/// The eel of five nodes whose largest moment is limited, and what a design with these further `keys` finds.
fn limited_eel(most: f64, keys: &str) -> (Document, Box<SearchResult>) {
    let eel = std::fs::read_to_string("models/design-silicone-eel.toml").unwrap();
    let mut document = Document::new("eel.toml", eel.split_once("[design]").unwrap().0);
    let wanted = format!(
        "design={{ goal = \"distance\", direction = \"-x\", knots = [0.1, 0.9], bounds = [0.2, 5.0], largest_moment_n_m = {most}, {keys} }}"
    );
    for change in ["rod.nodes=5", "solver.duration_s=3.0", &wanted] {
        document.set(change).unwrap();
    }
    let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
    let Answer::Search(found) = design.answer else { panic!("found") };
    (document, found)
}

/// Where the largest moment changes from one joint to another it has a kink, and least values beyond a limit that other designs keep.
#[test]
fn a_weaker_limit_is_kept_where_a_stronger_one_is() {
    for most in [0.19, 0.2, 0.205, 0.21, 0.22] {
        let (document, found) = limited_eel(most, "mean = 1.0, starts = 1");
        // The couples of the joints themselves.
        let rod = document.scene().unwrap().model().unwrap().rod;
        let mut problem = Problem::of(&document.scene().unwrap()).unwrap();
        problem.set_stiffness(&found.profile.stiffness_n_m2).unwrap();
        let couples: Vec<Output> = rod.joints().map(|k| Quantity::JointMoment(k).into()).collect();
        let values = problem.forward(&[], &couples, 1, |_| {}).unwrap().values;
        let used = values.iter().fold(0.0, |max: f64, x| max.max(x.abs())) / most;
        println!("{most}: {:.6e} m, {used:.6} of it, {} iterations", found.objective, found.history.len());
        assert!(found.converged && used <= 1.0 + 1e-6, "{most}: {used} {}", found.why);
        assert!((found.limits[0].used / used - 1.0).abs() <= 1e-9, "{most}: {:?} {used}", found.limits);
    }
}

/// Of 1600 profiles on a grid (40 by 40 stiffnesses at the knots) 435, 459 and 500 keep these limits, of which 1, 6 and 28 swim the right
/// way at all: the best of them goes 0.1702, 0.1712 and 0.1779 m. Measured: 0.1706, 0.1716 and 0.1803 m. From the even
/// profile alone −0.146, −0.028 and 0.1803 m are found.
#[test]
fn limits_that_few_designs_keep_are_met_by_one_of_the_best() {
    for (most, grid) in [(0.2, 0.1702), (0.205, 0.1712), (0.21, 0.1779)] {
        let found = limited_eel(most, "starts = 3").1;
        println!("{most}: {:.6e} m, starts {:?}", found.objective, found.starts);
        assert!(found.converged && found.kept && found.objective >= grid, "{most}: {:?} {}", found.starts, found.why);
    }
}

/// What no design keeps is no gain, and of a speed that is to be reached it is said how much of it is.
#[test]
fn a_design_that_breaks_its_limits_is_no_gain() {
    let most = 10.0;
    let wanted = format!("{FASTEST}, iterations = 5, least_speed_m_s = {most}");
    let design = Design::of(&document(&wanted), |_| ControlFlow::Continue(())).unwrap();
    let Answer::Search(found) = &design.answer else { panic!("found") };
    assert!(!found.kept && found.tolerances.is_empty());
    assert!(
        (found.limits[0].used * found.objective / most - 1.0).abs() < 1e-9,
        "{:?} {}",
        found.limits,
        found.objective
    );
    let said = |words: &str| design.lines.iter().any(|line| line.contains(words));
    assert!(said("no gain: the design violates its limits") && !said("is confirmed"), "{:#?}", design.lines);
}

#[test]
fn a_search_that_is_interrupted_before_it_has_a_start_is_interrupted() {
    let mut document = document("goal = \"distance\", direction = \"-x\", largest_power_w = 100.0");
    // The flow is too fast for the steps of any start.
    document.set("medium.flow_m_s=[0.0, 1e5]").unwrap();
    document.set("design.starts=3").unwrap();
    let mut told = 0;
    let error = Design::of(&document, |iteration| {
        assert!(iteration.is_none(), "{iteration:?}");
        told += 1;
        ControlFlow::Break(())
    });
    assert_eq!((error.unwrap_err(), told), (caudal::Error::Interrupted, 1));
}

#[test]
fn the_power_of_an_actuation_that_is_not_there_is_no_limit() {
    let mut document = Document::new("driven.toml", crate::common::driven(9));
    document.set("design={ goal = \"cycle_thrust_n\", largest_power_w = 1.0 }").unwrap();
    let error = Design::of(&document, |_| ControlFlow::Continue(())).unwrap_err();
    assert!(error.is_bad_input() && error.to_string().contains("found with a passive tail"), "{error}");
}

#[test]
fn what_is_to_be_reached_is_told_as_its_part() {
    // Twice as fast as the fastest.
    let free = found(FASTEST);
    let least = 2.0 * free.objective;
    let mut document = document(&format!("{FASTEST}, least_speed_m_s = {least:e}"));
    document.set("design.goal=cycle_actuation_power_w").unwrap();
    document.set("design.better=smaller").unwrap();
    let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
    let line = design.lines.iter().find(|line| line.contains("% of it is reached")).unwrap();
    println!("{line}");
    let words = line.split(" % of it is reached").next().unwrap();
    let part: f64 = words.rsplit(' ').next().unwrap().parse().unwrap();
    assert!((part - 50.0).abs() < 2.0, "{line}");
}
