//! What `auto` decides the law of the fluid by: estimated errors of simpler laws against true ones, on random scenes from creeping flow to
//! Reynolds numbers of 10⁵. `CAUDAL_FLUIDS=500 CAUDAL_OUT=out/estimates cargo test --release --test fluid estimates:: -- --nocapture`
//! makes the table and the figure.

use crate::common;
use std::cell::RefCell;
use std::fmt::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::choices::speeds;
use caudal::fluid::laws::DragLaw;
use caudal::reduced::MotionAndPower;
use caudal::reduced::fluid_estimates::{FluidEstimate, MIN_ERROR, ShortRun};
use caudal::report::chart::{Chart, Mark, Scale, Series};
use caudal::scene::Scene;
use caudal::stepper::Stepper;
use common::{Dice, scene_of};

const FACTOR: f64 = 3.0;

/// A random scene: rods that swim, that a held head drives, or that are held in a flow; stiff and soft; of every size; in flows that
/// stand still, go on, or change in time.
fn random(seed: u64) -> (String, f64) {
    let dice = RefCell::new(Dice(1000 * seed));
    let between = |low: f64, high: f64| dice.borrow_mut().between(low, high);
    let log = |low: f64, high: f64| between(low.ln(), high.ln()).exp();
    let reynolds = log(1e-3, 1e5);
    let (length, frequency) = (log(1e-4, 1.0), log(0.3, 30.0));
    let radius = length * log(0.004, 0.03);
    let depth = 2.0 * radius * log(1.0, 3.0);
    let (density, heavy) = (log(500.0, 2000.0), log(0.7, 3.0));
    let (waves, turn) = (log(0.5, 1.6), log(0.3, 1.2));
    let (softness, periods) = (log(0.3, 40.0), log(4.0, 14.0));
    let (nodes, envelope) = (log(13.0, 40.0) as u32, between(0.0, 1.0));
    let (kind, flowing) = (between(0.0, 1.0), between(0.0, 1.0));
    let body = between(0.0, 1.0) < 0.15;
    let omega = std::f64::consts::TAU * frequency;
    // A wave of that turning (rad) moves about so far across; a driven head as far.
    let reach = 0.3 * turn * length / waves;
    let speed = omega * reach / 2f64.sqrt() * if kind < 0.8 { 0.5 } else { 0.6 };
    let viscosity = density * speed * depth / reynolds;
    // Across the rod: Stokes' drag, form drag, inertia of rod and water, against which softness says how stiff it is.
    let added = density * std::f64::consts::FRAC_PI_4 * depth * depth;
    let mass = density * heavy * std::f64::consts::PI * radius * radius;
    let drag = 4.0 * viscosity * std::f64::consts::PI / ((length / radius).ln() + 0.2) + density * depth * speed;
    let stiffness = (drag * omega + (mass + added) * omega * omega) * length.powi(4) / softness;
    let modulus = stiffness / (std::f64::consts::FRAC_PI_4 * radius.powi(4));
    let curvature = turn * std::f64::consts::TAU * waves / length;
    let wave_speed = frequency * length / waves;
    let mut text = format!(
        "[rod]\nnodes = {nodes}\nlength_m = {length:e}\nouter_radius_m = {radius:e}\ninner_radius_m = 0.0\ndepth_m = {depth:e}\nyoungs_modulus_pa = {modulus:e}\ndensity_kg_m3 = {}\n",
        density * heavy
    );
    if kind < 0.8 {
        let _ = write!(
            text,
            "[actuation]\nkind = \"travelling-wave\"\nkappa_amp = {curvature:e}\nfrequency_hz = {frequency:e}\nwavelength_m = {:e}\nenvelope = [{envelope:e}, {:e}]\n",
            length / waves,
            1.0 - envelope
        );
    }
    let ahead = flowing * wave_speed * if kind < 0.6 { 0.3 } else { 1.0 };
    let flow = match flowing {
        ..0.4 => "[0.0, 0.0]".to_string(),
        ..0.8 => format!("[{ahead:e}, 0.0]"),
        _ => format!(
            "[{{ offset = {:e}, amplitude = {:e}, frequency_hz = {frequency:e} }}, 0.0]",
            0.5 * ahead,
            0.3 * ahead
        ),
    };
    let _ = write!(
        text,
        "[medium]\nviscosity_pa_s = {viscosity:e}\ndensity_kg_m3 = {density:e}\nflow_m_s = {flow}\n[drag]\nlaw = \"cross-flow\"\n[reactive]\n"
    );
    match kind {
        ..0.6 => {}
        ..0.8 => text.push_str("[head]\nkind = \"clamped\"\n"),
        _ => {
            let _ = write!(
                text,
                "[start]\nkind = \"ramp\"\nramp_s = {:e}\n[head]\nkind = \"driven\"\nposition_m = [0.0, {{ amplitude = {:e}, frequency_hz = {frequency:e} }}]\nangle_rad = 0.0\n",
                1.0 / frequency,
                reach
            );
        }
    }
    if body && kind < 0.6 {
        let _ = write!(
            text,
            "[head_body]\nsemi_axis_along_m = {:e}\nsemi_axis_across_m = {:e}\n",
            3.0 * radius,
            1.5 * radius
        );
    }
    let _ = write!(text, "[solver]\nduration_s = {:e}\ntolerance = 1e-4\n", (periods / frequency * 1e6).round() / 1e6);
    (text, reynolds)
}

/// What the whole run of `scene` comes to under a law.
fn truth(scene: &Scene, law: &'static DragLaw, reactive: bool) -> Result<MotionAndPower, String> {
    let (scene, _) = scene.with_fluid(law, reactive)?;
    let mut stepper = Stepper::of(&scene).map_err(|error| error.to_string())?;
    for span in scene.spans() {
        stepper.do_step(span).map_err(|error| error.to_string())?;
    }
    MotionAndPower::of(stepper.cycles(), stepper.view().dynamics).ok_or("nothing came out".to_string())
}

/// A simpler law of a scene: estimated and true errors of motion and power, at a Reynolds number.
struct Row {
    seed: u64,
    reynolds: f64,
    law: String,
    estimated: [f64; 2],
    found: [f64; 2],
}

/// The random scene with the viscosity that makes its Reynolds number the one that it is to have.
fn scene_at(seed: u64) -> Scene {
    let (text, wanted) = random(seed);
    let rough = scene_of(&text, &[]);
    let found = rough.regime().unwrap().reynolds;
    let viscosity = rough.medium.as_ref().unwrap().viscosity_pa_s.get() * found / wanted;
    scene_of(&text, &[&format!("medium.viscosity_pa_s={viscosity:e}")])
}

fn rows_of(seed: u64) -> Result<Vec<Row>, String> {
    let scene = scene_at(seed);
    let estimates = scene.fluid_estimates()?;
    let reynolds = estimates.regime.reynolds;
    let highest = estimates.laws.last().unwrap();
    let wanted = truth(&scene, highest.law, highest.reactive).map_err(|reason| format!("whole: {reason}"))?;
    let row = |estimate: &FluidEstimate| {
        let found = truth(&scene, estimate.law, estimate.reactive).ok()?.differences(&wanted).map(f64::abs);
        Some(Row { seed, reynolds, law: estimate.name(), estimated: estimate.errors, found })
    };
    Ok(estimates.laws[..estimates.laws.len() - 1].iter().filter_map(row).collect())
}

/// How many random scenes to try: what the environment asks for, or `default`.
fn count(variable: &str, default: u64) -> u64 {
    std::env::var(variable).ok().and_then(|count| count.parse().ok()).unwrap_or(default)
}

/// Tries the seeds below `wanted` on all processors.
fn for_each_seed(wanted: u64, work: impl Fn(u64) + Sync) {
    let next = AtomicU64::new(0);
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let seed = next.fetch_add(1, Ordering::Relaxed)
                    && seed < wanted
                {
                    work(seed);
                }
            });
        }
    });
}

#[test]
#[ignore = "looks at one scene"]
fn one() {
    let seed = std::env::var("CAUDAL_SEED").unwrap().parse().unwrap();
    println!("{}", random(seed).0);
    let scene = scene_at(seed);
    let estimates = scene.fluid_estimates().unwrap();
    for law in &estimates.laws {
        println!("{} {:?} whole {:?}", law.name(), law.means, truth(&scene, law.law, law.reactive));
    }
}

#[test]
fn estimates_are_honest_on_random_scenes_and_never_far_off() {
    let wanted = count("CAUDAL_FLUIDS", 24);
    let all = Mutex::new((Vec::new(), Vec::new()));
    for_each_seed(wanted, |seed| {
        let found = rows_of(seed);
        let mut all = all.lock().unwrap();
        match found {
            Ok(rows) => all.0.extend(rows),
            Err(reason) => all.1.push((seed, reason)),
        }
    });
    let (mut rows, without) = all.into_inner().unwrap();
    rows.sort_by(|a, b| a.seed.cmp(&b.seed).then(a.law.cmp(&b.law)));
    let scenes = wanted as usize - without.len();
    let mut scenes_honest: std::collections::BTreeMap<u64, bool> = std::collections::BTreeMap::new();
    let (mut pairs, mut honest, mut far) = (0, 0, Vec::new());
    let mut table = String::from("seed,reynolds,law,estimated_motion,true_motion,estimated_power,true_power\n");
    let mut dots: [Vec<(f64, f64)>; 4] = Default::default();
    for row in &rows {
        let [estimated, found] = [row.estimated, row.found];
        let _ = writeln!(
            table,
            "{},{:e},{},{:e},{:e},{:e},{:e}",
            row.seed, row.reynolds, row.law, estimated[0], found[0], estimated[1], found[1]
        );
        for i in 0..2 {
            pairs += 1;
            let is_honest = estimated[i] >= found[i];
            honest += usize::from(is_honest);
            *scenes_honest.entry(row.seed).or_insert(true) &= is_honest;
            let ratio = estimated[i] / found[i].max(MIN_ERROR);
            if !(1.0 / FACTOR..=FACTOR).contains(&ratio) {
                far.push((row.seed, row.reynolds, row.law.clone(), i, estimated[i], found[i]));
            }
            let class = [1.0, 1e2, 1e4].iter().filter(|limit| row.reynolds > **limit).count();
            dots[class].push((found[i].max(MIN_ERROR), estimated[i]));
        }
    }
    let all_honest = scenes_honest.values().filter(|honest| **honest).count();
    println!("{scenes} scenes, {} without estimates or truth: {without:?}", without.len());
    println!(
        "{honest} of {pairs} estimates honest, all of {all_honest} of {} scenes; {} off by more than {FACTOR}:",
        scenes_honest.len(),
        far.len()
    );
    for (seed, reynolds, law, i, estimated, found) in &far {
        println!(
            "  {seed} Re {reynolds:.2e} {law} {} estimated {estimated:.4} true {found:.4}",
            ["motion", "power"][*i]
        );
    }
    if let Ok(folder) = std::env::var("CAUDAL_OUT") {
        let line = |factor: f64| vec![(MIN_ERROR, factor * MIN_ERROR), (10.0, factor * 10.0)];
        let names = ["Re_d up to 1", "up to 100", "up to 1e4", "up to 1e5"];
        let mut series: Vec<Series> =
            names.iter().zip(dots).map(|(name, dots)| Series::new(*name, dots, Mark::Dots)).collect();
        series.push(Series::new("", line(1.0), Mark::Line));
        series.extend([1.0 / FACTOR, FACTOR].map(|factor| Series::new("", line(factor), Mark::Ghost)));
        let chart = Chart::new(
            format!("Estimated errors of simpler laws, {scenes} random scenes"),
            "true error",
            "estimated error",
            Scale::LogLog,
            series,
        );
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(format!("{folder}/estimates.csv"), &table).unwrap();
        std::fs::write(format!("{folder}/estimates.svg"), chart.svg()).unwrap();
    }
    assert!(without.len() as u64 * 50 <= wanted, "{without:?}");
    assert!(honest * 100 >= 95 * pairs, "{honest} of {pairs}");
    // Measured on 300 scenes: 1110 of 1116 honest, one off by a factor of 3.7.
    let beyond = far.iter().find(|(.., estimated, found)| !(0.2..=5.0).contains(&(estimated / found.max(MIN_ERROR))));
    assert!(far.len() * 100 <= pairs && beyond.is_none(), "{far:?}");
}

#[test]
fn the_regime_of_random_scenes_is_that_of_their_runs() {
    let wanted = count("CAUDAL_REGIMES", 12);
    let all = Mutex::new(Vec::new());
    for_each_seed(wanted, |seed| {
        let scene = scene_at(seed);
        let ([across, along], regime) = (speeds(&scene), scene.regime().unwrap());
        let counted = regime.counted_speed() / across.max(0.1 * along) - 1.0;
        all.lock().unwrap().push(([counted, regime.across.speed / across - 1.0], seed));
    });
    let all = all.into_inner().unwrap();
    // What Reynolds numbers and laws go by, and the velocity across the rod alone. Of 500 scenes one is off by 27 %: a heavy swimmer that
    // is still gaining speed after the cycles of the estimate. The next are off by 13 % and 21 %.
    for (i, most) in [0.2, 0.25].into_iter().enumerate() {
        let mut parts: Vec<(f64, u64)> = all.iter().map(|(parts, seed)| (parts[i].abs(), *seed)).collect();
        parts.sort_by(|a, b| b.0.total_cmp(&a.0));
        println!("{} scenes, the worst: {:?}", parts.len(), &parts[..parts.len().min(8)]);
        let far: Vec<_> = parts.iter().filter(|(part, _)| part.is_nan() || *part > most).collect();
        assert!(far.len() * 500 <= all.len() && parts[0].0 < 0.3, "{far:?}");
    }
}

const EEL: &str = include_str!("../../models/eel.toml");

#[test]
fn a_short_run_takes_eight_periods_after_the_ramp_in_steps_of_a_twenty_fourth_of_one() {
    let spectrum = scene_of(EEL, &[]).spectrum();
    assert_eq!([spectrum.slowest(), spectrum.fastest()], [Some(2.0); 2]);
    for (duration, ramp, taken, steps) in [
        (1.0, 0.0, 1.0, 48),
        (60.0, 0.0, 4.0, 192),
        (60.0, 1.0, 5.0, 240),
        // After a long ramp steps stay as short.
        (200.0, 100.0, 104.0, 24 * 2 * 104),
    ] {
        let run = ShortRun::of(&spectrum, duration, ramp);
        assert_eq!((run.duration, run.steps, run.period), (taken, steps, Some(0.5)), "{duration} s, ramp of {ramp} s");
    }
}

#[test]
fn a_stream_along_a_straight_rod_is_its_speed_along_and_one_across_its_speed_across() {
    let still = ["actuation.kappa_amp=0.0", "head={ kind = \"clamped\" }", "solver.duration_s=1.0"];
    let [along, across] = [[0.3, 0.0], [0.0, 1e-6]].map(|[x, y]| {
        let flow = format!("medium.flow_m_s=[{x:e},{y:e}]");
        scene_of(EEL, &[&still[..], &[&flow]].concat()).regime().unwrap()
    });
    assert!((along.along / 0.3 - 1.0).abs() < 1e-7 && along.across.speed < 1e-9, "{along:?}"); // measured: 1e-8
    assert!((across.across.speed / 1e-6 - 1.0).abs() < 1e-2 && across.along < 1e-9, "{across:?}");
}
