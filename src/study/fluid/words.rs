//! What the runs say, in words and numbers.

use serde_json::{Value, json};

use super::swim::Swim;
use super::{Ladder, Rung};
use crate::cycle::Means;
use crate::fluid::laws::Dependence;
use crate::number_format::{percent, two_digits};
use crate::report::{Findings, Table};
use crate::scene::Scene;
use crate::study::trial::Trial;

/// All that is known when every run is made.
pub struct Report<'a> {
    pub scene: &'a Scene,
    pub ladder: &'a Ladder,
    pub swims: &'a [Swim],
    /// The rung that differences are against.
    pub reference: Option<usize>,
    pub held: bool,
}

/// A rung with its run.
#[derive(Clone, Copy)]
pub struct Row<'a> {
    pub rung: &'a Rung,
    pub swim: &'a Swim,
    /// Differences of motion and power from the reference, relative.
    pub differences: Option<[f64; 2]>,
    pub is_reference: bool,
}

fn signed(part: f64) -> String {
    if part < 0.0 { format!("−{}", percent(-part)) } else { format!("+{}", percent(part)) }
}

impl<'a> Report<'a> {
    /// What is compared beside the power.
    pub fn motion(&self) -> &'static str {
        if self.held { "thrust" } else { "speed" }
    }

    pub fn rows(&self) -> Vec<Row<'a>> {
        let truth = self.reference.and_then(|i| self.swims[i].means);
        let against = |means: Means| truth.map(|truth| means.differences(&truth));
        let rungs = self.ladder.rungs.iter().zip(self.swims).enumerate();
        rungs
            .map(|(i, (rung, swim))| Row {
                rung,
                swim,
                differences: swim.means.and_then(against),
                is_reference: Some(i) == self.reference,
            })
            .collect()
    }

    pub fn findings(&self) -> Findings {
        let rows = self.rows();
        let mut findings = Findings { subject: "laws of the fluid", ..Findings::default() };
        self.words(&rows, &mut findings);
        findings.tables = vec![self.table(&rows), self.left_out()];
        self.charts(&rows, &mut findings);
        findings.motion = Self::motions(&rows);
        findings
    }

    fn words(&self, rows: &[Row<'_>], findings: &mut Findings) {
        let (motion, reynolds) = (self.motion(), self.ladder.reynolds);
        let mut say = |text: String| findings.answers.push(text);
        findings.numbers.insert("reynolds_number".into(), json!(reynolds));
        let Some(reference) = rows.iter().find(|row| row.is_reference) else {
            say(format!(
                "Re_d = {}: no law that holds there runs to the end of this scene; nothing is compared.",
                two_digits(reynolds)
            ));
            return;
        };
        let name = reference.rung.to_string();
        findings.numbers.insert("reference".into(), json!(name));
        let uncertain = reference.rung.uncertainty.map(|uncertainty| uncertainty.measured(self.held));
        say(match uncertain {
            Some([of_motion, of_power]) => format!(
                "Re_d = {} by the scene's own motion. The highest law that holds is {name}; by what is published it is itself good to ±{} in {motion} and ±{} in power ({}).",
                two_digits(reynolds),
                percent(of_motion),
                percent(of_power),
                reference.rung.law.published.source
            ),
            None => format!(
                "Re_d = {} by the scene's own motion. No law with a published uncertainty holds there; differences are from the scene's own, {name}.",
                two_digits(reynolds)
            ),
        });
        for (key, of) in [("uncertainty_motion", 0), ("uncertainty_power", 1)] {
            findings.numbers.insert(key.into(), json!(uncertain.map(|both| both[of])));
        }
        let seconds = reference.swim.trial.processor_s;
        for row in rows.iter().filter(|row| !row.is_reference) {
            let own = if row.rung.own { ", the scene's own," } else { "" };
            let range = if row.rung.holds { "" } else { ", out of its range" };
            findings.answers.push(match row.differences {
                Some([of_motion, of_power]) => format!(
                    "{}{own} {} in {motion}, {} in power, at {} times the processor time{range}.",
                    row.rung,
                    signed(of_motion),
                    signed(of_power),
                    two_digits(row.swim.trial.processor_s / seconds)
                ),
                None => format!(
                    "{}{own} fails{range}: {}",
                    row.rung,
                    row.swim.trial.failure.as_ref().map_or("no number came out", |(_, _, reason)| reason)
                ),
            });
        }
        if let Some(limits) = uncertain {
            let (text, enough) = self.verdict(rows, reference, limits);
            findings.answers.push(text);
            findings.numbers.insert("law_that_suffices".into(), json!(enough));
        }
    }

    /// Which rung the scene needs: the simplest one whose differences are within what the reference is uncertain by.
    fn verdict(&self, rows: &[Row<'_>], reference: &Row<'_>, limits: [f64; 2]) -> (String, String) {
        let keeps_water = self.ladder.water_decides && reference.rung.reactive;
        let within = |row: &&Row<'_>| {
            (row.rung.reactive || !keeps_water)
                && row.rung.dropped == reference.rung.dropped
                && row.differences.is_some_and(|both| both.iter().zip(limits).all(|(x, limit)| x.abs() <= limit))
        };
        let uncertain =
            |row: &Row<'_>| row.rung.uncertainty.map_or(f64::INFINITY, |known| known.measured(self.held)[0]);
        // By what a law is, not by what a run took on this machine: dense laws last, the reactive force before those, of the
        // others the simplest: one whose drag is linear in the velocity, then that of the narrowest range, then the surest.
        let order = |a: &&Row<'_>, b: &&Row<'_>| {
            let dense = |row: &Row<'_>| matches!(row.rung.law.reach, Dependence::Rod { .. });
            let curved = |row: &Row<'_>| row.rung.law.resistance.is_none();
            (dense(a), a.rung.reactive, curved(a))
                .cmp(&(dense(b), b.rung.reactive, curved(b)))
                .then(a.rung.law.reynolds.total_cmp(&b.rung.law.reynolds))
                .then(uncertain(a).total_cmp(&uncertain(b)))
        };
        let taken = rows.iter().filter(|row| row.rung.holds).filter(within).min_by(order).unwrap_or(reference);
        let motion = self.motion();
        let water = if keeps_water {
            " The water's inertia decides whether the rod is stable, which a motion from rest need not show: laws without it are left out."
        } else {
            ""
        };
        let text = match taken.differences {
            Some([of_motion, of_power]) if !taken.is_reference => format!(
                "Verdict: {} is good to {} in {motion} and {} in power here, within what {} itself is uncertain by; more than that this scene does not need.{water}",
                taken.rung,
                percent(of_motion.abs()),
                percent(of_power.abs()),
                reference.rung
            ),
            _ => {
                let nearest = rows
                    .iter()
                    .filter(|row| !row.is_reference && row.rung.holds && (row.rung.reactive || !keeps_water))
                    .filter_map(|row| Some((row, row.differences?)));
                let excess =
                    |both: &[f64; 2]| both.iter().zip(limits).map(|(x, limit)| x.abs() / limit).fold(0.0, f64::max);
                let nearest = nearest.min_by(|a, b| excess(&a.1).total_cmp(&excess(&b.1)));
                let why = nearest.map_or("no other law holds".to_string(), |(row, [of_motion, of_power])| {
                    format!(
                        "the nearest below, {}, is off by {} in {motion} and {} in power",
                        row.rung,
                        percent(of_motion.abs()),
                        percent(of_power.abs())
                    )
                });
                format!("Verdict: {} is needed here: {why}.{water}", reference.rung)
            }
        };
        (text, taken.rung.to_string())
    }

    fn table(&self, rows: &[Row<'_>]) -> Table {
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
        .chain(Trial::COSTS)
        .chain(["failure"]);
        let line = |row: &Row<'_>| {
            let (trial, means) = (&row.swim.trial, row.swim.means);
            let published = row.rung.uncertainty.map(|uncertainty| uncertainty.measured(self.held));
            let mut line = vec![
                json!(row.rung.law.name),
                json!(row.rung.reactive),
                json!(row.rung.own),
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
            line.extend(trial.costs());
            line.push(trial.failure.as_ref().map_or(Value::Null, |(_, _, reason)| json!(reason)));
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
            title: "Laws that cannot hold here",
            columns: ["law", "reason"].map(str::to_string).to_vec(),
            rows: self.ladder.refused.iter().map(|(law, reason)| vec![json!(law), json!(reason)]).collect(),
        }
    }
}
