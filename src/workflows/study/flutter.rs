//! `caudal study stability --vary flow`: flutter and divergence of a held tail in a flow, over the flow speed and the mass of the
//! tail. They follow from the eigenvalues of small motions about the equilibrium, and are compared with beam theory.

use std::f64::consts::TAU;

use serde_json::json;

use super::beam::{Beam, BeamInFlow};
use super::rest_map::{
    MAX_NODES, RestMap, RestPoint, RestStability, Scan, Scanned, calm_again_in_words, even, left_out,
};
use super::runner::{StudyOutcome, StudyRunner};
use super::stability::{StabilityOptions, geometric_sequence};
use crate::error::{Error, Result};
use crate::jobs;
use crate::linear_stability::{NoSteadyState, SteadyState};
use crate::report::Findings;
use crate::scene::{HeadKind, Scene};

/// Range of the mass ratio β, the share of the water in the inertia.
const MASS_RATIO_RANGE: [f64; 2] = [0.05, 0.95];

/// Default range of the flow speed, in units of √(EI/m_a)/L.
const DEFAULT_SPEED_RANGE: [f64; 2] = [1.0, 20.0];

/// Up to this relative deviation an equilibrium counts as straight, a load along it as zero (over EI/L²), and edges as equally long.
const MAX_DEVIATION: f64 = 1e-2;

/// Speeds of the tracked modes per speed of the map.
const TRACKING_REFINEMENT: usize = 4;

/// Properties of the tail, and the scales of the theory.
struct HeldTail {
    /// Direction of the flow.
    direction: [f64; 2],
    /// True if the flow comes from the free end.
    is_reversed: bool,
    /// Mass of the rod and added mass across it, kg.
    masses: [f64; 2],
    /// Length, m.
    length: f64,
    /// √(EI/m_a)/L, m/s.
    unit: f64,
    /// Share χ of the wake and damping time τ of the material (s), if the theory covers this rod; otherwise the reason why not.
    theory: std::result::Result<[f64; 2], &'static str>,
}

impl HeldTail {
    fn share(&self) -> f64 {
        self.masses[1] / (self.masses[0] + self.masses[1])
    }

    /// The factor on the rod's density that gives the mass ratio β.
    fn factor(&self, share: f64) -> f64 {
        self.masses[1] * (1.0 - share) / (share * self.masses[0])
    }
}

/// The properties of the tail of `scene` at its equilibrium.
fn tail(scene: &Scene, steady: &mut SteadyState) -> std::result::Result<HeldTail, NoSteadyState> {
    let refuse = |key: &'static str, problem: &str| NoSteadyState { key, problem: problem.to_string() };
    let Some(reactive) = scene.reactive_on().cloned() else {
        return Err(refuse("reactive", "missing; without added mass a flow cannot make a tail flutter or diverge"));
    };
    let added = steady.added_mass().map_err(|error| refuse("reactive", &error.to_string()))?;
    let bend = steady.bend();
    let model = steady.model();
    let rod = &model.rod;
    let pitch = model.head.as_ref().map_or(0.0, |head| head[2].at(0.0).value);
    let along = [pitch.cos(), pitch.sin()];
    let speed = model.fluid.flow.norm();
    let direction = if speed > 0.0 { (model.fluid.flow / speed).into() } else { along };
    let masses = [rod.total_mass(), added.iter().sum()];
    let unit = (rod.ei / (masses[1] / rod.length)).sqrt() / rod.length;
    let alike = |values: &[f64]| values.iter().all(|value| (value / values[0] - 1.0).abs() < MAX_DEVIATION);
    let inner = 1..rod.nodes - 1;
    let time = rod.damping.as_ref().map_or(Some(0.0), |damping| damping.uniform(rod));
    let uniform = alike(&rod.joint[inner.clone()]) && alike(&rod.mass[inner.clone()]) && alike(&added[inner]);
    let is_reversed = direction[0] * along[0] + direction[1] * along[1] < 0.0;
    let aligned = (direction[0] - along[0]).hypot(direction[1] - along[1]) < 1e-9;
    let load: f64 = (0..rod.nodes).map(|k| steady.load(k).dot(&nalgebra::Vector2::from(along)).abs()).sum();
    let pushed = load * rod.length * rod.length > MAX_DEVIATION * rod.ei || scene.has_followers();
    let tensioned = pushed || bend > MAX_DEVIATION * rod.length;
    let theory = match (time.filter(|_| uniform), aligned, tensioned) {
        _ if model.hinge.is_some() => Err("it is for a head whose angle is held"),
        (None, ..) => Err("it is for a rod that is the same all along"),
        (_, false, _) => Err("it is for a flow along the rod, from its head"),
        (.., true) => Err("it is for a straight rod without loads along it"),
        (Some(time), ..) => Ok([reactive.shedding.get(), time]),
    };
    Ok(HeldTail { direction, is_reversed, masses, length: rod.length, unit, theory })
}

/// Maps flutter and divergence of the tail of `scene`.
pub(super) fn flutter(scene: &Scene, asked: &StabilityOptions, runner: StudyRunner<'_>) -> Result<StudyOutcome> {
    let refused = |NoSteadyState { key, problem }: NoSteadyState| Error::Scene {
        place: scene.name.clone(),
        key: key.to_string(),
        problem,
    };
    if scene.head.kind == HeadKind::Free {
        let problem = "the head is free, and the rod drifts with the flow; allowed: a held head".to_string();
        return Err(refused(NoSteadyState { key: "head.kind", problem }));
    }
    // The study asks which speed makes the water matter: with `reactive = "auto"` the scene has the reactive force at all speeds.
    let left = scene.reactive.as_ref().is_some_and(|reactive| reactive.auto);
    let own = if left { scene.with_reactive(true) } else { scene.clone() };
    let nodes = scene.rod.nodes.get();
    let coarse = if nodes > MAX_NODES { own.with_nodes(MAX_NODES as u64) } else { own };
    let model = coarse.model()?;
    let own_speed = model.fluid.flow.norm();
    let mut steady = SteadyState::of(model).map_err(refused)?;
    let tail = tail(&coarse, &mut steady).map_err(refused)?;
    let range = asked.range.unwrap_or(DEFAULT_SPEED_RANGE.map(|speed| speed * tail.unit));
    let speeds = geometric_sequence(range, asked.points);
    let finer = even(range, TRACKING_REFINEMENT * asked.points).collect();
    let mut scans = vec![Scan { place: tail.share(), values: finer }];
    scans.extend(even(MASS_RATIO_RANGE, asked.points).map(|share| Scan { place: share, values: speeds.clone() }));
    let at = |factor: f64, speed: f64, near: Option<&[f64]>| {
        RestPoint::of(&coarse.with_rod_density(factor).with_flow(tail.direction.map(|x| x * speed)), near)
    };
    let run = |scan: &Scan| Some(scan.run(|speed, near| at(tail.factor(scan.place), speed, near)));
    let found = match runner.run_all("flutter", scene, &scans, jobs::cores(), run)? {
        Ok(found) => found,
        Err(interrupted) => return Ok(interrupted),
    };
    let own = (own_speed > 0.0).then(|| (own_speed, at(1.0, own_speed, None).0));
    let report = FlutterReport { scene, tail: &tail, own, nodes: coarse.rod.nodes.get(), scans: &scans, found: &found };
    Ok(StudyOutcome::Complete(report.findings()))
}

struct FlutterReport<'a> {
    scene: &'a Scene,
    tail: &'a HeldTail,
    /// The scene's own flow speed (m/s), and the result there.
    own: Option<(f64, RestPoint)>,
    nodes: usize,
    scans: &'a [Scan],
    found: &'a [Scanned],
}

impl FlutterReport<'_> {
    fn findings(&self) -> Findings {
        let mut findings = Findings { subject: "stability in flow", ..Findings::default() };
        let Self { scene, tail, scans, found, .. } = self;
        let columns: Vec<(&Scan, &Scanned)> = scans.iter().zip(*found).collect();
        let Some((own, map)) = columns.split_first() else { return findings };
        let beam = tail.theory.ok().map(|of| (Beam::new(), of));
        let highest = own.0.values.last().copied().unwrap_or(0.0);
        let theory = |share: f64| {
            let (beam, [shedding, time]) = beam.as_ref()?;
            let damping = time * tail.unit / tail.length * share.sqrt();
            let flow = BeamInFlow { mass_ratio: share, shedding: *shedding, damping };
            Some(beam.critical(&flow, highest / tail.unit)? * tail.unit)
        };
        let (share, own_theory, critical) = (own.0.place, theory(own.0.place), own.1.critical);
        let calm_again = own.1.calm_again(&own.0.values);
        let again = calm_again_in_words(&calm_again, " m/s");
        findings.answers.push(match critical {
            Some(critical) if critical.value == 0.0 => format!(
                "With the mass ratio m_a/(m + m_a) = {share:.4} the tail is unstable at rest even in still fluid: {} of small motions.{again}",
                critical.outcome.category().label
            ),
            Some(critical) => format!(
                "With the mass ratio m_a/(m + m_a) = {share:.4} the tail is stable at rest in flows of up to {:.4} m/s (u = {:.4}); {}.{again}",
                critical.value,
                critical.value / tail.unit,
                critical.in_words()
            ),
            None => format!(
                "With the mass ratio m_a/(m + m_a) = {share:.4} the tail is stable at rest at all speeds examined, up to {highest:.4} m/s."
            ),
        });
        findings.answers.push(match (&tail.theory, own_theory) {
            (Ok(_), Some(speed)) => {
                format!("Beam theory without drag predicts {speed:.4} m/s (u = {:.4}).", speed / tail.unit)
            }
            (Ok(_), None) => {
                format!("Beam theory without drag predicts stability at all speeds up to {highest:.4} m/s.")
            }
            (Err(why), _) => format!("The line of beam theory is left out: {why}."),
        });
        if let Some((flow, point)) = &self.own {
            let omega = point.leading[1];
            let says = match point.outcome {
                RestStability::Stable => "small motions about the equilibrium decay".to_string(),
                RestStability::Flutter => {
                    format!(
                        "small motions about the equilibrium grow as flutter, at {:.4} Hz: the run will leave it",
                        omega / TAU
                    )
                }
                RestStability::Divergence => {
                    "small motions about the equilibrium diverge: the run will leave it".to_string()
                }
                RestStability::NoRest => "no equilibrium is found".to_string(),
            };
            findings.answers.push(format!("In the scene's own flow of {flow:.4} m/s, {says}."));
        }
        if tail.is_reversed {
            findings.answers.push(
                "The flow comes from the free end: a tail that leaves this equilibrium may fold back and reach another one, which small motions do not show."
                    .into(),
            );
        }
        left_out(scene, self.nodes, &mut findings);
        findings.numbers.insert("mass_ratio".into(), json!(share));
        findings.numbers.insert("unit_speed_m_s".into(), json!(tail.unit));
        findings.numbers.insert("critical_speed_m_s".into(), json!(critical.map(|critical| critical.value)));
        findings.numbers.insert("calm_again_m_s".into(), json!(calm_again));
        let frequency = critical.map(|critical| critical.frequency / TAU);
        findings.numbers.insert("critical_frequency_hz".into(), json!(frequency));
        findings.numbers.insert("critical_speed_by_theory_m_s".into(), json!(own_theory));
        let lines: Vec<(f64, Option<f64>)> = map.iter().map(|(scan, _)| (scan.place, theory(scan.place))).collect();
        let theory_at = |share: f64, _: f64| json!(lines.iter().find(|line| line.0 == share).and_then(|line| line.1));
        let reduced = |_: f64, speed: f64| json!(speed / tail.unit);
        let factor = |share: f64, _: f64| json!(tail.factor(share));
        RestMap {
            name: &scene.name,
            cause: "flow",
            place: ("mass ratio m_a/(m + m_a)", "mass_ratio", true),
            value: ("flow speed (m/s)", "flow_m_s"),
            columns: map.to_vec(),
            own: *own,
            here: self.own.as_ref().map(|(speed, _)| (share, *speed)),
            line: (
                "theory, without drag",
                lines.iter().filter_map(|(share, speed)| Some((*share, (*speed)?))).collect(),
            ),
        }
        .add(
            &mut findings,
            [
                &[("reduced_speed", &reduced)],
                &[("reduced_speed", &reduced), ("density_factor", &factor), ("theory_flow_m_s", &theory_at)],
            ],
        );
        findings
    }
}
