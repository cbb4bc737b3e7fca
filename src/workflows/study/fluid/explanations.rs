//! The answers of the study in sentences and numbers: which fluid model the scene needs.

use serde_json::{Value, json};

use super::fluid_models::{FluidModel, FluidModels};
use super::model_run::FluidModelRun;
use crate::fluid::laws::Dependence;
use crate::number_format::{percent, two_digits};
use crate::reduced::MotionAndPower;
use crate::reduced::fluid_estimates::UNCERTAINTY_FRACTION;
use crate::report::{Findings, Table};
use crate::scene::Scene;
use crate::study::study_run::StudyRun;

/// The results of all runs.
pub struct FluidReport<'a> {
    pub scene: &'a Scene,
    pub models: &'a FluidModels,
    pub swims: &'a [FluidModelRun],
    /// Index of the reference model.
    pub reference: Option<usize>,
    pub held: bool,
}

/// A model with its run.
#[derive(Clone, Copy)]
pub struct FluidModelRow<'a> {
    pub model: &'a FluidModel,
    pub swim: &'a FluidModelRun,
    /// Relative differences of motion and power from the reference.
    pub differences: Option<[f64; 2]>,
    pub is_reference: bool,
}

fn signed(part: f64) -> String {
    if part < 0.0 { format!("−{}", percent(-part)) } else { format!("+{}", percent(part)) }
}

impl<'a> FluidReport<'a> {
    /// The quantity that is compared along with the power.
    pub fn motion(&self) -> &'static str {
        if self.held { "thrust" } else { "speed" }
    }

    pub fn rows(&self) -> Vec<FluidModelRow<'a>> {
        let truth = self.reference.and_then(|i| self.swims[i].means);
        let against = |means: MotionAndPower| truth.map(|truth| means.differences(&truth));
        let models = self.models.models.iter().zip(self.swims).enumerate();
        models
            .map(|(i, (model, swim))| FluidModelRow {
                model,
                swim,
                differences: swim.means.and_then(against),
                is_reference: Some(i) == self.reference,
            })
            .collect()
    }

    pub fn findings(&self) -> Findings {
        let rows = self.rows();
        let mut findings = Findings { subject: "fluid laws", ..Findings::default() };
        self.words(&rows, &mut findings);
        findings.tables = vec![self.table(&rows), self.left_out()];
        self.charts(&rows, &mut findings);
        findings.motion = Self::motions(&rows);
        findings
    }

    fn words(&self, rows: &[FluidModelRow<'_>], findings: &mut Findings) {
        let (motion, reynolds) = (self.motion(), self.models.reynolds);
        let mut say = |text: String| findings.answers.push(text);
        findings.numbers.insert("reynolds_number".into(), json!(reynolds));
        let Some(reference) = rows.iter().find(|row| row.is_reference) else {
            say(format!(
                "Re_d = {}: no law that is valid there runs to the end of this scene; nothing is compared.",
                two_digits(reynolds)
            ));
            return;
        };
        let name = reference.model.to_string();
        findings.numbers.insert("reference".into(), json!(name));
        let uncertain = reference.model.uncertainty.map(|uncertainty| uncertainty.measured(self.held));
        say(match uncertain {
            Some([of_motion, of_power]) => format!(
                "Re_d = {} by the scene's own motion. The most accurate valid law is {name}; its published uncertainty is ±{} in {motion} and ±{} in power ({}).",
                two_digits(reynolds),
                percent(of_motion),
                percent(of_power),
                reference.model.law.published.source
            ),
            None => format!(
                "Re_d = {} by the scene's own motion. No law with a published uncertainty is valid there; differences are relative to the scene's own, {name}.",
                two_digits(reynolds)
            ),
        });
        for (law, reason) in &self.models.missing {
            findings.answers.push(format!(
                "{law} is valid there too, and includes the interaction of distant parts of the rod, but is not compared: {reason}."
            ));
        }
        for (key, of) in [("uncertainty_motion", 0), ("uncertainty_power", 1)] {
            findings.numbers.insert(key.into(), json!(uncertain.map(|both| both[of])));
        }
        let seconds = reference.swim.run.processor_s;
        for row in rows.iter().filter(|row| !row.is_reference) {
            let own = if row.model.own { ", the scene's own," } else { "" };
            let range = if row.model.holds { "" } else { ", out of its range" };
            findings.answers.push(match row.differences {
                Some([of_motion, of_power]) => format!(
                    "{}{own} {} in {motion}, {} in power, at {} times the processor time{range}.",
                    row.model,
                    signed(of_motion),
                    signed(of_power),
                    two_digits(row.swim.run.processor_s / seconds)
                ),
                None => format!(
                    "{}{own} fails{range}: {}",
                    row.model,
                    row.swim.run.failure.as_ref().map_or("the result is not a number", |(_, _, reason)| reason)
                ),
            });
        }
        if let Some(limits) = uncertain {
            let (text, enough) = self.verdict(rows, reference, limits.map(|limit| UNCERTAINTY_FRACTION * limit));
            findings.answers.push(text);
            findings.numbers.insert("law_that_suffices".into(), json!(enough));
        }
    }

    /// The fluid model that the scene needs: the simplest one whose differences are within the `limits`, those of the automatic choice.
    fn verdict(&self, rows: &[FluidModelRow<'_>], reference: &FluidModelRow<'_>, limits: [f64; 2]) -> (String, String) {
        let keeps_water = self.models.water_decides && reference.model.reactive;
        let within = |row: &&FluidModelRow<'_>| {
            (row.model.reactive || !keeps_water)
                && row.model.dropped == reference.model.dropped
                && row.differences.is_some_and(|both| both.iter().zip(limits).all(|(x, limit)| x.abs() <= limit))
        };
        let uncertain =
            |row: &FluidModelRow<'_>| row.model.uncertainty.map_or(f64::INFINITY, |known| known.measured(self.held)[0]);
        // Ordered by properties of the law, not by the time that a run took on this machine: dense laws last, before them those
        // with the reactive force. Of the others the simplest comes first: laws with drag linear in the velocity, then the
        // narrowest range, then the smallest uncertainty.
        let order = |a: &&FluidModelRow<'_>, b: &&FluidModelRow<'_>| {
            let dense = |row: &FluidModelRow<'_>| matches!(row.model.law.reach, Dependence::Rod { .. });
            let curved = |row: &FluidModelRow<'_>| row.model.law.resistance.is_none();
            (dense(a), a.model.reactive, curved(a))
                .cmp(&(dense(b), b.model.reactive, curved(b)))
                .then(a.model.law.reynolds.total_cmp(&b.model.law.reynolds))
                .then(uncertain(a).total_cmp(&uncertain(b)))
        };
        let taken = rows.iter().filter(|row| row.model.holds).filter(within).min_by(order).unwrap_or(reference);
        let motion = self.motion();
        let water = if keeps_water {
            " Added mass may decide whether the rod is stable, which a motion from rest need not show: laws without it are not considered."
        } else {
            ""
        };
        let text = match taken.differences {
            Some([of_motion, of_power]) if !taken.is_reference => format!(
                "Verdict: {} is sufficient here: it differs by {} in {motion} and {} in power, within a quarter of the published uncertainty of {}; {}.{water}",
                taken.model,
                percent(of_motion.abs()),
                percent(of_power.abs()),
                reference.model,
                match self.models.missing.first() {
                    None => "this scene needs no more accurate law".to_string(),
                    Some((law, _)) => format!("whether it needs {law} is not known"),
                }
            ),
            _ => {
                let nearest = rows
                    .iter()
                    .filter(|row| !row.is_reference && row.model.holds && (row.model.reactive || !keeps_water))
                    .filter_map(|row| Some((row, row.differences?)));
                let excess =
                    |both: &[f64; 2]| both.iter().zip(limits).map(|(x, limit)| x.abs() / limit).fold(0.0, f64::max);
                let nearest = nearest.min_by(|a, b| excess(&a.1).total_cmp(&excess(&b.1)));
                let none = if keeps_water { "no other law with added mass is valid" } else { "no other law is valid" };
                let why = nearest.map_or(none.to_string(), |(row, [of_motion, of_power])| {
                    format!(
                        "the closest simpler law, {}, differs by {} in {motion} and {} in power",
                        row.model,
                        percent(of_motion.abs()),
                        percent(of_power.abs())
                    )
                });
                format!("Verdict: {} is needed here: {why}.{water}", reference.model)
            }
        };
        (text, taken.model.to_string())
    }

    fn table(&self, rows: &[FluidModelRow<'_>]) -> Table {
        let motion = if self.held { "thrust_n" } else { "speed_m_s" };
        let columns = [
            "law",
            "reactive",
            "scenes_own",
            "reference",
            motion,
            "power_into_fluid_w",
            "actuation_power_w",
            "efficiency",
        ]
        .into_iter()
        .chain([if self.held { "difference_thrust" } else { "difference_speed" }, "difference_power"])
        .chain([
            if self.held { "published_uncertainty_thrust" } else { "published_uncertainty_speed" },
            "published_uncertainty_power",
        ])
        .chain(StudyRun::COSTS)
        .chain(["failure"]);
        let line = |row: &FluidModelRow<'_>| {
            let (run, means) = (&row.swim.run, row.swim.means);
            let published = row.model.uncertainty.map(|uncertainty| uncertainty.measured(self.held));
            let mut line = vec![
                json!(row.model.law.name),
                json!(row.model.reactive),
                json!(row.model.own),
                json!(row.is_reference),
                json!(means.map(|means| means.motion)),
                json!(means.map(|means| means.power)),
                json!(row.swim.actuation_power),
                json!(row.swim.efficiency),
                json!(row.differences.map(|both| both[0])),
                json!(row.differences.map(|both| both[1])),
                json!(published.map(|both| both[0])),
                json!(published.map(|both| both[1])),
            ];
            line.extend(run.costs());
            line.push(run.failure.as_ref().map_or(Value::Null, |(_, _, reason)| json!(reason)));
            line
        };
        Table {
            file: "laws.csv",
            title: "The same motion under every law",
            columns: columns.map(str::to_string).collect(),
            rows: rows.iter().map(line).collect(),
        }
    }

    fn left_out(&self) -> Table {
        Table {
            file: "left-out.csv",
            title: "Laws that are not valid here",
            columns: ["law", "reason"].map(str::to_string).to_vec(),
            rows: self.models.refused.iter().map(|(law, reason)| vec![json!(law), json!(reason)]).collect(),
        }
    }
}
