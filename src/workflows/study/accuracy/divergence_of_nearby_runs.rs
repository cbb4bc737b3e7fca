//! Chaos: if no reference solution exists, measures how fast two runs with nearly equal initial states diverge.

use serde_json::json;

use super::quantities::{describe_errors, quantities};
use super::reference::{Reference, SAMPLES};
use crate::error::Result;
use crate::number_format::in_sentence;
use crate::report::Findings;
use crate::report::chart::{Chart, Mark, Scale, Series};
use crate::scene::Scene;
use crate::study::study_run::StudyRun;
use crate::wording::Phrase;

/// Initial distance of two nearby runs, over the length.
pub const INITIAL_PERTURBATION: f64 = 1e-9;

/// A motion is chaotic if two nearby runs diverge by this factor.
const CHAOTIC_GROWTH: f64 = 1e4;

/// The growth is fitted up to this fraction of the length. Runs cover these fractions of the duration; the longest one with this
/// many samples below this distance is used.
const SATURATION: f64 = 1e-3;

pub const WINDOWS: [f64; 4] = [1.0, 0.1, 0.01, 0.001];

const MIN_SAMPLES: usize = 100;

/// The findings if the two references disagree.
pub fn without_reference(
    scene: &Scene,
    nodes: u64,
    step: f64,
    four: &[StudyRun],
    reference: Option<&Reference>,
    pairs: &[StudyRun],
) -> Result<Findings> {
    let mut findings = Findings { subject: "speed against accuracy", ..Findings::default() };
    let why = match reference {
        Some(Reference { errors, .. }) => {
            let errors = describe_errors(quantities(scene), errors.map(|e| format!("{:.1} %", 100.0 * e)));
            format!(
                "two independent references, extrapolated ESDIRK3 and generalized-α with steps of {step:e} s and less, differ by {errors}"
            )
        }
        None => {
            let failures: Vec<_> = four
                .iter()
                .filter_map(|run| run.failure.as_ref())
                .map(|(_, t, reason)| format!("at t = {t:.4} s: {reason}"))
                .collect();
            format!("a reference run failed {}", failures.first().map_or("", String::as_str))
        }
    };
    findings.answers.push(format!("No trajectory reference exists on {nodes} nodes: {why}."));
    findings.numbers.insert("reference_exists".into(), json!(false));
    let (duration, length) = (scene.solver.duration_s.get(), scene.rod.length_m.get());
    let distances = |(pair, part): (&[StudyRun], f64)| -> Vec<(f64, f64)> {
        let apart = pair[0].tip.iter().zip(&pair[1].tip).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
        apart.enumerate().map(|(i, d)| (part * duration * i as f64 / SAMPLES as f64, d)).skip(1).collect()
    };
    let windows: Vec<_> = pairs.chunks(2).zip(WINDOWS).map(distances).collect();
    let widest = windows.iter().flatten().map(|p| p.1).fold(0.0, f64::max);
    // The longest run in which the growth can be followed.
    let followed =
        |apart: &&Vec<(f64, f64)>| apart.iter().take_while(|p| p.1 < SATURATION * length).count() >= MIN_SAMPLES;
    let apart = windows.iter().find(followed).or(windows.last()).cloned().unwrap_or_default();
    if let Some((rate, end)) = growth(&apart, length) {
        findings.numbers.insert("separation_growth_rate_1_s".into(), json!(rate));
        let common = format!(
            "Two runs with an initial distance of {INITIAL_PERTURBATION:e} of the length diverge as e^({} t/s) until t = {end:.4} s, and reach a distance of {:.1e} of the length",
            in_sentence(rate, 3),
            widest / length
        );
        let apart = widest > CHAOTIC_GROWTH * INITIAL_PERTURBATION * length;
        findings.answers.push(if apart && is_chaotic(rate, end) {
            format!("{common}: the motion is chaotic, so no method or step computes its trajectory accurately. Means over many runs or long times may still be meaningful.")
        } else if apart {
            format!("{common}, but not exponentially. The steps do not resolve the motion, and nothing indicates that it is chaotic. Smaller {} may give a reference; the notes of a run of this scene may name the cause.", Phrase::Steps)
        } else {
            format!("{common}: the motion is not chaotic, but the steps do not resolve it; smaller {} may give a reference.", Phrase::Steps)
        });
    }
    findings.answers.push("No errors are given, because there is no reference.".to_string());
    let over = |(apart, part): (&Vec<(f64, f64)>, f64)| {
        let since_start = |p: &(f64, f64)| (p.0, p.1 / length);
        Series::new(format!("over {} s", part * duration), apart.iter().map(since_start).collect(), Mark::Line)
    };
    let series = windows.iter().zip(WINDOWS).map(over).collect();
    let chart = Chart {
        title: format!("{}: two runs with an initial distance of {INITIAL_PERTURBATION:e} of the length", scene.name),
        x: "time (s)".into(),
        y: "distance of their tips over the length".into(),
        scale: Scale::LogLog,
        series,
    };
    let caption = "Distance between two runs that start almost together. If it keeps growing, no run is accurate.";
    findings.figures.extend(chart.figure("separation.svg", caption));
    Ok(findings)
}

/// True if a distance that grows at this rate (1/s) until this time (s) indicates chaos, and not a jump.
fn is_chaotic(rate: f64, until: f64) -> bool {
    rate * until > CHAOTIC_GROWTH.ln()
}

/// Growth rate (1/s) of a distance by a least-squares fit of its logarithm, until it reaches a thousandth of `length` or the end.
/// Also returns the time (s) of the end of the fit.
fn growth(apart: &[(f64, f64)], length: f64) -> Option<(f64, f64)> {
    let until = apart.iter().position(|p| p.1 > SATURATION * length).unwrap_or(apart.len()).max(3).min(apart.len());
    let logs: Vec<_> = apart[..until].iter().filter(|p| p.1 > 0.0).map(|p| (p.0, p.1.ln())).collect();
    let count = logs.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / count;
    let (t, y) = (mean(|p| p.0), mean(|p| p.1));
    let along: f64 = logs.iter().map(|p| (p.0 - t).powi(2)).sum();
    let rate = logs.iter().map(|p| (p.0 - t) * (p.1 - y)).sum::<f64>() / along;
    rate.is_finite().then(|| (rate, logs[logs.len() - 1].0))
}

#[cfg(test)]
mod tests {
    use super::is_chaotic;

    #[test]
    fn runs_that_part_at_once_and_then_keep_their_distance_are_not_chaotic() {
        assert!(is_chaotic(15.0, 1.0) && !is_chaotic(5.0, 1.0) && !is_chaotic(-0.000_36, 1.0));
    }
}
