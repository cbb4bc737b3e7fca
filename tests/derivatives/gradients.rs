//! In random scenes of every kind of part, the derivatives of every output and mean over cycles by everything that they are offered by
//! are those that differences of whole simulations show, none silently zero.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common;
use caudal::cycle::derivatives;
use caudal::jobs;
use caudal::scene::{Document, Scene};
use caudal::sensitivity::scene_parameter::{self, SceneParameter, SceneParameters};
use caudal::sensitivity::{Controls, Output, Parameter, Problem, Weights};
use caudal::variable::VARIABLES;
use common::{Dice, largest};

/// Scenes tried; CAUDAL_GRADIENTS tries more, from CAUDAL_SEED on.
const SCENES: u64 = 3;

/// Scenes in which 2000 found a wrong derivative once: means over cycles by the frequency beside a head that comes back to its place, at
/// rest, and between ends that slide, and the energy of a rod that is hardly stretched by its length.
const FOUND: [u64; 5] = [39, 125, 318, 345, 350];

/// Entries that are moved in a scene.
const MOVED: usize = 5;

/// A derivative may be off by this part of the largest that the output has over the sizes of all that is moved, or of itself.
const TOLERANCE: f64 = 1e-6;

/// An output that is smaller than this part of the largest of its unit is of that size: it is rounding.
const ROUNDED: f64 = 1e-6;

/// What changes by less than this, in SI units, in scenes of this size, does not change.
const NOTHING: f64 = 1e-10;

/// What Newton's tolerance of 1e-13 leaves in a position, over the length, and in a force, over EA: measured 5e-13 and 7e-13.
const UNSOLVED: f64 = 2e-12;

/// Largest step over the size of what is moved, and how many smaller ones are tried, each a fifth of the one before.
const STEP: f64 = 5e-4;
const STEPS: usize = 4;

const ROD: &str = "[rod]\nnodes = 7\nlength_m = 0.3\nouter_radius_m = 0.007\ndensity_kg_m3 = 1100.0\nyoungs_modulus_pa = 1e6\n\
    [solver]\nintegrator = \"newmark\"\ntime_step_s = 0.004\nduration_s = 0.5\nnewton_tolerance = 1e-13\n";

struct Chance(Dice);

impl Chance {
    fn of(&mut self, part: f64) -> bool {
        self.0.between(0.0, 1.0) < part
    }

    fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[(self.0.between(0.0, of.len() as f64) as usize).min(of.len() - 1)]
    }

    /// A number, or with this chance a profile.
    fn along(&mut self, part: f64, low: f64, high: f64) -> String {
        if !self.of(part) {
            return format!("{:e}", self.0.between(low, high));
        }
        let middle = self.0.between(0.1, 0.9);
        let mut point = |xi: f64| format!("[{xi:e},{:e}]", self.0.between(low, high));
        format!("[{},{},{}]", point(0.0), point(middle), point(1.0))
    }
}

/// A random scene.
fn random(seed: u64) -> Document {
    let mut dice = Chance(Dice(7919 * seed));
    let mut document = Document::new(format!("random-{seed}.toml"), ROD);
    let mut set = |text: String| document.set(&text).unwrap();
    let log = |dice: &mut Chance, low: f64, high: f64| dice.0.between(f64::ln(low), f64::ln(high)).exp();
    set(format!("rod.nodes={}", dice.one(&[5, 7, 9])));
    let modulus = log(&mut dice, 1e5, 1e7);
    set(format!("rod.youngs_modulus_pa={modulus:e}"));
    // Without a draw of chance.
    let moments = seed % 3 == 1;
    set(format!("rod.density_kg_m3={}", dice.along(0.25, 900.0, 1300.0)));
    set(format!("rod.outer_radius_m={}", dice.along(0.3, 0.004, 0.01)));
    if dice.of(0.3) {
        set(format!("rod.inner_radius_m={}", dice.along(0.4, 0.001, 0.003)));
    }
    if dice.of(0.4) {
        set(format!("rod.depth_m={}", dice.along(0.5, 0.01, 0.04)));
    }
    match dice.one(&[0, 1, 2, 2, 2]) {
        0 => set("rod.stiffness_gradient=0.7".into()),
        1 => set(format!("rod.stiffness_profile={}", dice.along(1.0, 0.5, 2.0))),
        _ => {}
    }
    if dice.of(0.3) {
        set(format!("rod.mass_lumping={}", dice.one(&["tributary", "uniform"])));
    }
    if dice.of(0.15) {
        set(format!("rod.mass_profile={}", dice.along(1.0, 0.5, 2.0)));
    }
    let frequency = dice.one(&[4.0, 6.0]);
    let has_wave = dice.of(0.75);
    if has_wave {
        let kind = dice.one(&["travelling-wave", "standing-wave", "sine-wave"]);
        let mut keys = format!("kind=\"{kind}\",frequency_hz={frequency:e}");
        if kind == "sine-wave" {
            keys += ",slope=0.3";
        } else if moments {
            // That which gives a round rod of 7 mm this curvature.
            keys += &format!(",moment_amp_n_m={:e}", dice.0.between(2.0, 6.0) * modulus * 1.89e-9);
        } else {
            keys += &format!(",kappa_amp={:e}", dice.0.between(2.0, 6.0));
        }
        if kind != "standing-wave" {
            keys += ",wavelength_m=0.31";
        }
        if kind != "sine-wave" && dice.of(0.3) && !moments {
            keys += ",kappa_reference_length_m=1.3";
        }
        if dice.of(0.6) {
            keys += ",envelope=[0.4,0.6]";
        }
        if kind != "sine-wave" && dice.of(0.3) {
            keys += ",harmonics=[0.1,-0.2]";
        }
        if dice.of(0.3) {
            keys += &format!(",amplitude_profile={}", dice.along(1.0, 0.5, 1.5));
        }
        if dice.of(0.3) {
            keys += &format!(",phase_profile_rad={}", dice.along(1.0, -0.5, 0.5));
        }
        set(format!("actuation={{{keys}}}"));
        let start = dice.one(&["kind=\"shaped\"", "kind=\"ramp\",ramp_s=0.1", "kind=\"jump\""]);
        set(format!("start={{{start}}}"));
    }
    let head = dice.one(&["free", "free", "clamped", "driven"]);
    let (layered, mut reactive) = (dice.of(0.3), dice.of(0.45));
    let sheared = dice.of(0.25);
    reactive &= !sheared;
    let oblique = dice.of(0.3);
    let normal = if oblique { "[0.6,0.8]" } else { "[0.0,1.0]" };
    let along = if oblique { [0.8, -0.6] } else { [1.0, 0.0] };
    let mut medium = format!("viscosity_pa_s={:e},density_kg_m3=1000.0", log(&mut dice, 1e-3, 1.0));
    if layered {
        medium += &format!(
            ",beyond={{normal={normal},offset_m={:e},thickness_m=0.08,viscosity_pa_s={:e},density_kg_m3={:e}",
            dice.0.between(-0.05, 0.05),
            log(&mut dice, 1e-2, 1.0),
            dice.one(&[700.0, 1300.0])
        );
        if dice.of(0.4) && !reactive {
            medium += &format!(",flow_m_s=[{:e},{:e}]", 0.16 * along[0], 0.16 * along[1]);
        }
        medium += "}";
    }
    if dice.of(0.6) {
        let [x, y] = [dice.0.between(-0.3, 0.3), dice.0.between(-0.3, 0.3)];
        medium += &match (layered || sheared, dice.of(0.25)) {
            (true, _) => format!(",flow_m_s=[{:e},{:e}]", x * along[0], x * along[1]),
            (false, true) => {
                format!(",flow_m_s=[{{amplitude=0.2,frequency_hz={frequency:e},offset={x:e}}},{y:e}]")
            }
            (false, false) => format!(",flow_m_s=[{x:e},{y:e}]"),
        };
    }
    if sheared {
        let normal = if layered { String::new() } else { format!(",normal={normal}") };
        medium += &format!(",shear={{rate_per_s=3.0{normal}}}");
    }
    set(format!("medium={{{medium}}}"));
    if dice.of(0.92) {
        let law = dice.one(&[
            "cox",
            "lighthill",
            "gray-hancock",
            "spheroid",
            "wall",
            "coefficients",
            "weak-inertia",
            "cross-flow",
            "cross-flow",
            "cross-flow",
            "stokes-like",
            "auto",
        ]);
        let mut keys = format!("law=\"{law}\"");
        match law {
            "wall" => keys += ",height_m=0.05",
            "coefficients" => {
                keys +=
                    &format!(",along_n_s_m2={},across_n_s_m2={}", dice.along(0.5, 0.1, 1.0), dice.along(0.5, 0.5, 3.0));
            }
            "stokes-like" => keys += ",ratio=3.0",
            "cox" if dice.of(0.4) => keys += ",slender_length_m=0.2",
            "cross-flow" => {
                for (part, key) in [
                    (0.4, "form_drag=0.9"),
                    (0.3, "thinning=0.5"),
                    (0.3, "skin_friction=1.2"),
                    (0.3, "turbulent_friction=0.004"),
                ] {
                    if dice.of(part) {
                        keys += ",";
                        keys += key;
                    }
                }
                if dice.of(0.3) {
                    keys += dice.one(&[
                        ",viscous=\"lighthill\"",
                        ",viscous=\"spheroid\"",
                        ",viscous=\"wall\",height_m=0.05",
                    ]);
                }
            }
            _ => {}
        }
        if dice.of(0.3) && law != "wall" {
            keys += ",head_weight=5.0,head_length_m=0.08";
        }
        set(format!("drag={{{keys}}}"));
    }
    if reactive {
        set(match dice.one(&[0, 1, 1]) {
            0 => "reactive=\"auto\"".to_string(),
            _ => format!("reactive={{shedding={:e}}}", dice.one(&[0.0, 0.5, 1.0])),
        });
    }
    if head == "free" && dice.of(0.35) && !layered && !sheared {
        let mut keys = "semi_axis_along_m=0.03,semi_axis_across_m=0.015".to_string();
        for (part, key) in [
            (0.5, "mass_kg=0.05"),
            (0.5, "form_drag_along=0.4"),
            (0.3, "form_drag_across=0.9"),
            (0.3, "moment_of_inertia_kg_m2=2e-5"),
        ] {
            if dice.of(part) {
                keys += ",";
                keys += key;
            }
        }
        set(format!("head_body={{{keys}}}"));
    }
    match head {
        "free" => {}
        "clamped" => set("head={kind=\"clamped\"}".into()),
        _ => set(format!(
            "head={{kind=\"driven\",position_m=[{{amplitude=0.02,frequency_hz={frequency:e},phase_rad=0.3}},0.01],\
             angle_rad={{amplitude=0.2,frequency_hz={frequency:e}}}}}"
        )),
    }
    if dice.of(0.35) {
        let gravity = if layered || sheared { "[0.0,-9.81]" } else { "[1.0,-9.0]" };
        if dice.of(0.7) {
            set(format!("loads.gravity_m_s2={gravity}"));
            if dice.of(0.5) {
                set("loads.buoyancy=true".into());
            }
        }
        if dice.of(0.4) {
            set("loads.point=[{node=-1,force_n=[0.01,0.02]}]".into());
        }
    }
    if dice.of(0.4) {
        // One frequency moves all that moves here.
        let moves = head == "driven" || has_wave;
        let material = dice.one(&[
            "0.004",
            "0.0",
            "{stretch=1e-4,bending=0.01}",
            "[[0.0,0.002],[0.6,0.0],[1.0,0.01]]",
            "loss",
            "loss",
        ]);
        match material {
            "loss" if moves => set(format!("rod.loss_factor={}", dice.along(0.4, 0.05, 0.4))),
            "loss" => {
                set("rod.loss_factor=0.2".into());
                set("rod.loss_frequency_hz=3.0".into());
            }
            time => set(format!("rod.damping_time_s={time}")),
        }
        if dice.of(0.4) && !moments {
            set("rod.damping_of=elastic".into());
        }
    }
    if dice.of(0.15) && head != "free" {
        set("loads.point=[{node=-1,force_n=[-0.02,0.01],follows=true},{node=2,force_n=[0.01,0.0]}]".into());
    }
    let method = dice.one(&["implicit-euler", "newmark", "generalized-alpha"]);
    set(format!("solver.integrator={method}"));
    if method == "newmark" && dice.of(0.3) {
        set("solver.beta=0.3025".into());
        set("solver.gamma=0.6".into());
    }
    // No end of a cycle is an end of a step, nor one of the run.
    let duration = if dice.of(0.6) { 2.4 / frequency + 0.0013 } else { 2.2 / frequency };
    set(format!("solver.duration_s={duration:e}"));
    // The first outline that its law takes, without a draw of chance.
    let deep = document.scene().is_ok_and(|scene| scene.rod.depth_m.is_some());
    let outlines = [["rectangle", "ellipse"], ["ellipse", "rectangle"], ["round", "ellipse"]][(seed % 3) as usize];
    for outline in outlines.into_iter().filter(|_| deep) {
        let mut other = document.clone();
        other.set(&format!("rod.section={outline}")).unwrap();
        if other.scene().is_ok() {
            return other;
        }
    }
    document
}

/// What a simulation is run with beside its scene.
#[derive(Clone)]
struct Values {
    numbers: Vec<f64>,
    stiffness: Option<Vec<f64>>,
    amplitude: Vec<f64>,
    phases: Vec<f64>,
    phase: f64,
    natural: Vec<f64>,
    force: Vec<f64>,
    start: Option<[Vec<f64>; 2]>,
}

/// One entry of it.
#[derive(Debug, Clone, Copy)]
enum Entry {
    Number(usize),
    Stiffness(usize),
    Amplitude(usize),
    PhaseProfile(usize),
    Phase,
    Natural(usize),
    Force(usize),
    Start(usize, usize),
}

impl Values {
    fn at(&mut self, entry: Entry) -> &mut f64 {
        match entry {
            Entry::Number(i) => &mut self.numbers[i],
            Entry::Stiffness(i) => &mut self.stiffness.as_mut().unwrap()[i],
            Entry::Amplitude(i) => &mut self.amplitude[i],
            Entry::PhaseProfile(i) => &mut self.phases[i],
            Entry::Phase => &mut self.phase,
            Entry::Natural(i) => &mut self.natural[i],
            Entry::Force(i) => &mut self.force[i],
            Entry::Start(part, i) => &mut self.start.as_mut().unwrap()[part][i],
        }
    }
}

struct Case {
    document: Document,
    own: Scene,
    numbers: Vec<SceneParameter>,
    controlled: bool,
}

impl Case {
    fn problem(&self, values: &Values) -> caudal::Result<Problem> {
        let mut document = self.document.clone();
        for (key, value) in scene_parameter::keys_with(&self.numbers, &values.numbers) {
            document.set_value("a difference", &key, &value);
        }
        let mut problem = Problem::of(&document.scene()?.with_fluid_of(&self.own))?;
        self.set(&mut problem, values)?;
        Ok(problem)
    }

    fn set(&self, problem: &mut Problem, values: &Values) -> caudal::Result<()> {
        if let Some(stiffness) = &values.stiffness {
            problem.set_stiffness(stiffness)?;
        }
        problem.set_phase(values.phase);
        problem.set_actuation(&values.amplitude, &values.phases)?;
        if self.controlled {
            problem
                .set_controls(Controls { natural: Some(values.natural.clone()), force: Some(values.force.clone()) })?;
        }
        if let Some([q, v]) = &values.start {
            problem.set_start(q.clone(), v.clone())?;
        }
        Ok(())
    }
}

/// What was compared, and what could be: those that differences know well enough.
#[derive(Default)]
struct Count {
    compared: usize,
    known: usize,
    scenes: usize,
    worst: f64,
}

impl Count {
    fn add(&mut self, other: &Self) {
        self.compared += other.compared;
        self.known += other.known;
        self.scenes += other.scenes;
        self.worst = self.worst.max(other.worst);
    }
}

/// Compares entries of chance in `document`, or all numbers of `keys`.
fn try_scene(document: Document, seed: u64, keys: &[&str], count: &mut Count, faults: &mut Vec<String>) {
    let Ok(own) = document.scene() else { return };
    let mut dice = Chance(Dice(104_729 * seed + 1));
    let Ok(mut problem) = Problem::of(&own) else { return };
    let model = own.model().unwrap();
    let known = SceneParameters::of(&own, &model);
    let mut numbers: Vec<SceneParameter> = known.keys().iter().flat_map(|key| known.of_key(key)).collect();
    scene_parameter::assign_indices(&mut numbers);
    let own_values: Vec<f64> = numbers.iter().map(|number| number.own).collect();
    let (joints, nodes, times) = (model.rod.joints().len(), model.rod.nodes, problem.times());
    let controlled = dice.of(0.5);
    let mut over_time = |width: usize, size: f64| -> Vec<f64> {
        let phases = dice.0.many(width, 0.0, 6.0);
        let row = |t: &f64| phases.iter().map(move |phase| size * (9.0 * t + phase).sin()).collect::<Vec<_>>();
        times.iter().flat_map(row).collect()
    };
    let (natural, force) = (over_time(joints, 0.3), over_time(2 * nodes, 0.003));
    let case = Case { document, own, numbers, controlled };
    let mut values = Values {
        numbers: own_values.clone(),
        stiffness: dice.of(0.4).then(|| problem.stiffness().iter().map(|ei| ei * 1.1).collect()),
        amplitude: vec![1.0; joints],
        phases: vec![0.0; joints],
        phase: 0.0,
        natural,
        force,
        start: None,
    };
    if dice.of(0.3) {
        let [mut q, mut v] = problem.first();
        let first = if model.head.is_some() { 2 } else { 0 };
        q.iter_mut().skip(first).for_each(|x| *x += dice.0.between(-1e-4, 1e-4));
        v.iter_mut().skip(first).for_each(|x| *x += dice.0.between(-1e-2, 1e-2));
        values.start = Some([q, v]);
    }
    if case.set(&mut problem, &values).is_err() {
        return;
    }
    // Everything that it is offered by.
    let mut parameters: Vec<Parameter> = case.numbers.iter().map(|number| number.by).collect();
    let mut entries: Vec<(Entry, usize)> = (0..parameters.len()).map(|i| (Entry::Number(i), i)).collect();
    for (i, k) in model.rod.joints().enumerate() {
        let driven = model.actuation.is_some();
        for (parameter, entry, there) in [
            (Parameter::Stiffness(k), Entry::Stiffness(i), values.stiffness.is_some()),
            (Parameter::WaveAmplitude(k), Entry::Amplitude(i), driven),
            (Parameter::WavePhase(k), Entry::PhaseProfile(i), driven),
            (Parameter::Phase, Entry::Phase, driven && i == 0),
        ] {
            if there {
                entries.push((entry, parameters.len()));
                parameters.push(parameter);
            }
        }
    }
    match scene_parameter::finite_differences(&case.document, &case.numbers, &own_values) {
        Ok(moved) => problem.finite_differences = moved,
        // Two motions of one frequency, of which one is moved, have no frequency of their own that a loss factor holds at.
        Err(error) if error.to_string().contains("rod.loss_frequency_hz") => return,
        Err(error) => return faults.push(format!("seed {seed}: {error}")),
    }
    case.set(&mut problem, &values).unwrap();
    let recorded = VARIABLES.iter().filter(|v| v.recorded && v.name != "time_s" && v.exists_in(&model));
    let names: Vec<&str> = recorded.map(|variable| variable.name).collect();
    let outputs: Vec<Output> = names.iter().map(|name| Output::named(name, problem.model()).unwrap()).collect();
    let Ok((trajectory, found)) = problem.simulate_with(&outputs) else { return };
    let count_of_times = times.len();
    let looks = [(0, 0.3), (count_of_times / 2, 0.7), (count_of_times - 1, 1.0)];
    let weighted = |values: &dyn Fn(usize, usize) -> f64, o: usize| -> f64 {
        looks.iter().map(|(n, weight)| weight * values(*n, o)).sum()
    };
    let sizes: Vec<f64> = (0..outputs.len()).map(|o| largest((0..count_of_times).map(|n| found.value(n, o)))).collect();
    let mut gradients: Vec<(String, f64, Vec<Option<f64>>)> = Vec::new();
    let measures: Vec<_> = derivatives::differentiable().collect();
    // Entries in order of the gradients' columns: parameters, then controls and start.
    let mut moved: Vec<(Entry, usize)> = Vec::new();
    for _ in 0..MOVED {
        moved.push(dice.one(&entries));
    }
    if !keys.is_empty() {
        moved = entries;
        moved.retain(|(entry, _)| matches!(entry, Entry::Number(i) if keys.contains(&&*case.numbers[*i].key)));
        assert!(keys.iter().all(|key| case.numbers.iter().any(|number| number.key == **key)), "{keys:?}");
    }
    let beyond = parameters.len();
    if controlled {
        moved.push((Entry::Natural((dice.0.between(0.0, 1.0) * (count_of_times * joints) as f64) as usize), beyond));
        let held = if model.head.is_some() { 2 } else { 0 };
        let entry = (dice.0.between(0.0, 1.0) * (count_of_times - 1) as f64) as usize * 2 * nodes;
        moved.push((Entry::Force(entry + held + dice.one(&[0, 1, 2, 3])), beyond + 1));
    }
    if values.start.is_some() {
        let first = if model.head.is_some() { 2 } else { 0 };
        let i = first + dice.one(&[0, 1, 2, 3, 4, 5]);
        moved.push((Entry::Start(0, i), beyond + 2));
        moved.push((Entry::Start(1, i), beyond + 2));
    }
    for (o, output) in outputs.iter().enumerate() {
        let mut weights = vec![0.0; count_of_times];
        looks.iter().for_each(|(n, weight)| weights[*n] += weight);
        let weights = Weights { outputs: &weights, ..Weights::default() };
        let by = problem.pull_back(&parameters, std::slice::from_ref(output), weights, &trajectory).unwrap();
        let rate = names[o] == "actuation_power_w"; // which needs the rate of what is given over time
        let column = |(entry, column): &(Entry, usize)| match entry {
            Entry::Natural(i) => (!rate).then(|| by.natural[*i]),
            Entry::Force(i) => Some(by.force[*i]),
            Entry::Start(part, i) => Some(by.start[*part][*i]),
            _ => Some(by.parameters[*column]),
        };
        gradients.push((names[o].to_string(), sizes[o], moved.iter().map(column).collect()));
    }
    let mut means = Vec::new();
    for measure in &measures {
        let Some((mean, by)) = problem.cycle_mean(measure, &parameters).unwrap() else {
            assert_eq!(problem.cycle_mean(measure, &[]).unwrap(), None, "seed {seed}: {}", measure.key);
            continue;
        };
        let column = |(_, column): &(Entry, usize)| by.get(*column).copied();
        gradients.push((measure.key.to_string(), mean.abs(), moved.iter().map(column).collect()));
        means.push(*measure);
    }
    let all = |values: &Values| -> Option<Vec<f64>> {
        let mut problem = case.problem(values).ok()?;
        let found = problem.forward(&[], &outputs, 1, |_| {}).ok()?;
        let mut all: Vec<f64> = (0..outputs.len()).map(|o| weighted(&|n, o| found.value(n, o), o)).collect();
        for measure in &means {
            all.push(problem.cycle_mean(measure, &[]).ok()??.0);
        }
        Some(all)
    };
    count.scenes += 1;
    for (j, (entry, _)) in moved.iter().enumerate() {
        let own = *values.at(*entry);
        let size = match entry {
            Entry::Number(i) if own == 0.0 => match &*case.numbers[*i].key {
                "rod.inner_radius_m" => continue, // differences have one side only
                "medium.flow_m_s" | "medium.beyond.offset_m" => 0.3,
                _ => 1.0,
            },
            Entry::Number(_) | Entry::Stiffness(_) => own.abs(),
            Entry::Natural(_) => 1.0,
            Entry::Force(_) | Entry::Start(..) => 0.01,
            _ => 1.0,
        };
        // A flow is moved along interfaces only.
        let mut partner: Option<(Entry, [f64; 2])> = None;
        if let (Entry::Number(i), Some(layers)) = (entry, &model.layers)
            && case.numbers[*i].key == "medium.flow_m_s"
        {
            let axis = case.numbers[*i].place[0];
            let other = case.numbers.iter().position(|n| n.key == "medium.flow_m_s" && n.place[0] != axis).unwrap();
            let (normal, across) = (layers.normal[axis], layers.normal[1 - axis]);
            partner = Some((Entry::Number(other), [1.0 - normal * normal, -normal * across]));
        }
        let at = |change: f64| {
            let mut moved = values.clone();
            let [own, other] = partner.map_or([1.0, 0.0], |(_, parts)| parts);
            *moved.at(*entry) += change * own;
            if let Some((partner, _)) = partner {
                *moved.at(partner) += change * other;
            }
            all(&moved)
        };
        let mut richardson: Vec<Vec<f64>> = Vec::new();
        let mut step = STEP * size;
        for _ in 0..STEPS {
            let sides = [-2.0, -1.0, 1.0, 2.0].map(|part| at(part * step));
            if let [Some(near), Some(less), Some(more), Some(far)] = sides {
                let of = |o: usize| (8.0 * (more[o] - less[o]) - (far[o] - near[o])) / (12.0 * step);
                richardson.push((0..more.len()).map(of).collect());
            }
            step *= 0.2;
        }
        let unit = |name: &str| name.rsplit_once('_').map_or("", |(_, unit)| unit).to_string();
        let rod = &model.rod;
        let unsolved = |name: &str| {
            UNSOLVED
                * match unit(name).as_str() {
                    "m" => rod.length,
                    "n" => rod.ea,
                    // The work that the residuals do.
                    _ if name == "numerical_dissipation_j" => rod.ea * rod.length,
                    _ => 0.0,
                }
        };
        let largest_by_unit = |o: usize| {
            let of_unit = gradients.iter().filter(|other| unit(&other.0) == unit(&gradients[o].0));
            largest(of_unit.map(|other| other.1))
        };
        for (o, (name, output_size, by)) in gradients.iter().enumerate() {
            let Some(exact) = by[j] else { continue };
            // Each two steps in turn, and how well they agree: of those that do, one must agree with the derivative, as larger steps
            // may cross a kink, and smaller ones are rounding.
            let pairs = richardson.windows(2).map(|pair| [pair[0][o], pair[1][o]]);
            let size_of_all = output_size.max(ROUNDED * largest_by_unit(o)); // what a held head does is rounding
            let scale = richardson.iter().fold((size_of_all / size).max(exact.abs()), |max, by| max.max(by[o].abs()));
            if scale * size <= NOTHING || richardson.len() < 2 {
                continue;
            }
            count.compared += 1;
            let noise = |[coarse, fine]: &[f64; 2]| (coarse - fine).abs();
            let beyond = |pair: &[f64; 2]| {
                let error = pair.iter().map(|by| (exact - by).abs()).fold(f64::INFINITY, f64::min);
                (error - 4.0 * noise(pair) - unsolved(name) / size).max(0.0) / scale
            };
            // Steps across a kink may agree with each other and not with smaller ones, which then need not agree as well.
            let from_known = pairs.skip_while(|pair| noise(pair) > 1e-5 * scale);
            let known = from_known.filter(|pair| noise(pair) <= 1e-4 * scale);
            let Some(pair) = known.min_by(|a, b| beyond(a).total_cmp(&beyond(b))) else { continue };
            let (error, coarse, noise) = (beyond(&pair), pair[0], noise(&pair));
            count.known += 1;
            count.worst = count.worst.max(error);
            if error > TOLERANCE || !exact.is_finite() {
                let what = match entry {
                    Entry::Number(i) => case.numbers[*i].label(),
                    other => format!("{other:?}"),
                };
                faults.push(format!(
                    "seed {seed}: d{name}/d{what} = {exact:e}, differences {coarse:e} (known to {noise:.1e}, scale {scale:.1e})"
                ));
            }
        }
    }
}

#[test]
fn gradients_in_random_scenes_are_those_of_differences() {
    let asked = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let scenes: u64 = asked("CAUDAL_GRADIENTS").unwrap_or(SCENES);
    let first: u64 = asked("CAUDAL_SEED").unwrap_or(1);
    let known = if first == 1 { &FOUND[..] } else { &[] };
    let seeds: Vec<u64> = known.iter().copied().chain(first..first + scenes).collect();
    let next = AtomicUsize::new(0);
    let (mut count, mut faults) = (Count::default(), Vec::new());
    std::thread::scope(|scope| {
        let work = || {
            let (mut count, mut faults) = (Count::default(), Vec::new());
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(seed) = seeds.get(i).copied() else { return (count, faults) };
                let before = faults.len();
                try_scene(random(seed), seed, &[], &mut count, &mut faults);
                faults[before..].iter().for_each(|fault| eprintln!("{fault}"));
                if (i + 1).is_multiple_of(100) {
                    eprintln!("{} scenes", i + 1);
                }
            }
        };
        let threads: Vec<_> = (0..jobs::cores()).map(|_| scope.spawn(work)).collect();
        for (own, wrong) in threads.into_iter().map(|thread| thread.join().unwrap()) {
            count.add(&own);
            faults.extend(wrong);
        }
    });
    let Count { compared, known, scenes: tried, worst } = count;
    println!("{tried} scenes, {compared} derivatives, {known} known to differences, worst {worst:e}");
    assert!(faults.is_empty(), "{} wrong:\n{}", faults.len(), faults.join("\n"));
    assert!(2 * tried as u64 >= scenes, "{tried} of {scenes} scenes ran");
    assert!(known as f64 >= 0.9 * compared as f64, "differences know {known} of {compared}");
}

/// How far roots of the speed of a rod whose rest is one but for rounding, some 1e-17 m/s, may bring a derivative off the viscous one.
const ROOTS: f64 = 1e-5; // measured: 1.6e-6

/// Drag by the root or the square of the speed has no derivative at rest, and the added mass feels no velocity: the flow, or its shear,
/// acts through the viscous law alone, in one fluid and across an interface.
#[test]
fn water_that_begins_to_flow_moves_a_rod_at_rest_by_its_viscous_law() {
    let rest = "[head]\nkind = \"clamped\"\n[drag]\nlaw = \"cox\"\n";
    let media = [
        "",
        "[medium.shear]\nrate_per_s = 0.0\nnormal = [0.0, 1.0]\n",
        "[medium.beyond]\nnormal = [0.0, 1.0]\noffset_m = 0.02\nthickness_m = 0.08\nviscosity_pa_s = 0.01\ndensity_kg_m3 = 700.0\n",
    ];
    let quadratic = "drag={law=\"cross-flow\",form_drag=1.1}";
    for medium in media {
        for (head, reactive) in [("clamped", false), ("free", false), ("free", true), ("clamped", true)] {
            let text = format!("{ROD}{rest}[medium]\nviscosity_pa_s = 0.001\ndensity_kg_m3 = 1000.0\n{medium}");
            let mut document = Document::new("rest.toml".to_string(), &text);
            document.set("solver.duration_s=0.1").unwrap();
            document.set(&format!("head.kind=\"{head}\"")).unwrap();
            if reactive && !medium.contains("shear") {
                document.set("reactive={shedding=1.0}").unwrap();
            }
            let viscous = by_flow(&document);
            document.set(quadratic).unwrap();
            let water = by_flow(&document);
            for ((name, own), (_, by)) in viscous.iter().zip(&water) {
                let reading = name.split(' ').next().unwrap();
                let scale = largest(viscous.iter().filter(|(other, _)| other.starts_with(reading)).map(|(_, by)| *by));
                assert!(
                    (own - by).abs() <= ROOTS * scale.max(NOTHING),
                    "{head} {reactive} {medium}: {name}: {by:e} for {own:e}"
                );
            }
            assert!(viscous.iter().any(|(name, by)| name.starts_with("tip_dx") && *by > 0.0));
        }
    }
}

/// The derivatives of the readings at the end by the flow's components and by shear, by their names.
fn by_flow(document: &Document) -> Vec<(String, f64)> {
    let own = document.scene().unwrap();
    let mut problem = Problem::of(&own).unwrap();
    let model = own.model().unwrap();
    let known = SceneParameters::of(&own, &model);
    let mut numbers: Vec<SceneParameter> =
        ["medium.flow_m_s", "medium.shear.rate_per_s"].iter().flat_map(|key| known.of_key(key)).collect();
    scene_parameter::assign_indices(&mut numbers);
    let values: Vec<f64> = numbers.iter().map(|number| number.own).collect();
    problem.finite_differences = scene_parameter::finite_differences(document, &numbers, &values).unwrap();
    let parameters: Vec<Parameter> = numbers.iter().map(|number| number.by).collect();
    let names = ["tip_dx_m", "tip_dy_m", "x_com_m", "y_com_m", "drag_force_x_n", "drag_force_y_n", "flow_work_j"];
    let outputs = names.map(|name| Output::named(name, problem.model()).unwrap());
    let found = problem.forward(&parameters, &outputs, usize::MAX, |_| {}).unwrap();
    let last = found.times.len() - 1;
    let row = |(o, name): (usize, &&str)| {
        let by = |(by, number): (&f64, &SceneParameter)| (format!("{name} by {}", number.label()), *by);
        found.row(last, o).iter().zip(&numbers).map(by).collect::<Vec<_>>()
    };
    names.iter().enumerate().flat_map(row).collect()
}

#[test]
fn gradients_by_thickness_hole_and_depth_are_those_of_differences_in_every_section() {
    const KEYS: [&str; 3] = ["rod.outer_radius_m", "rod.inner_radius_m", "rod.depth_m"];
    let (mut count, mut faults) = (Count::default(), Vec::new());
    for (seed, section) in ["round", "ellipse", "rectangle"].into_iter().enumerate() {
        let mut document = Document::new(format!("{section}.toml"), ROD);
        for change in [
            &format!("rod.section={section}"),
            "rod.depth_m=[[0,0.02],[1,0.04]]",
            "rod.outer_radius_m=0.006",
            "rod.inner_radius_m=0.002",
            "actuation={kind=\"travelling-wave\",kappa_amp=5,frequency_hz=4,wavelength_m=0.3}",
            "medium={viscosity_pa_s=1e-3,density_kg_m3=1000}",
            "drag={law=\"cross-flow\",turbulent_friction=0.004}",
            "reactive={shedding=1}",
            "loads={gravity_m_s2=[0.5,-2],buoyancy=true}",
        ] {
            document.set(change).unwrap();
        }
        try_scene(document, 100 + seed as u64, &KEYS, &mut count, &mut faults);
    }
    let Count { compared, known, scenes, worst } = count;
    println!("{scenes} scenes, {compared} derivatives, {known} known to differences, worst {worst:e}");
    assert!(faults.is_empty(), "{} wrong:\n{}", faults.len(), faults.join("\n"));
    assert_eq!(scenes, 3);
    assert!(known as f64 >= 0.9 * compared as f64, "differences know {known} of {compared}");
}
