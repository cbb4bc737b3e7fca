//! `caudal check`: prints the assessment of a scene.

use std::process::ExitCode;

use caudal::assessment::{Assessment, AssessmentLine};
use caudal::error::Result;
use caudal::report::RunOutput;
use serde_json::json;

use super::progress::{Progress, Unit};
use super::run::{end_at_interrupt, first_loads};
use super::{SceneArguments, output_folder, print, print_unless_quiet, refuse};

pub fn check(arguments: &SceneArguments, json: bool) -> Result<ExitCode> {
    end_at_interrupt();
    let progress = Progress::of(Unit::Parts, 0.0);
    progress.note("start of the run");
    let (document, scene, stepper) = arguments.prepare()?;
    progress.note("dimensionless numbers and modes");
    let assessment = Assessment::of(&scene, &stepper)?;
    progress.note("models of the fluid");
    let fluid_models = Assessment::fluid_models(&scene, &stepper);
    progress.note("cheaper models");
    let mut facts = [&assessment.facts[..], &fluid_models, &Assessment::models(&scene, &stepper)?].concat();
    progress.note("loads in the first cycles");
    let refused = RunOutput::fits(&output_folder(&scene), &scene, &stepper).err().map(|error| document.located(error));
    facts.extend(first_loads(&scene, stepper).map(|text| AssessmentLine { name: "loads", text }));
    drop(progress);
    if json {
        let facts: Vec<_> = facts.iter().map(|fact| json!({ "name": fact.name, "text": fact.text })).collect();
        let content = json!({
            "name": scene.name,
            "facts": facts,
            "warnings": assessment.all_warnings().collect::<Vec<_>>(),
            "first_frequency_rad_s": assessment.first_frequency,
            "tip_amplitude_m": assessment.tip_amplitude,
            "reynolds_number": assessment.reynolds,
            "frequency_ratio": assessment.frequency_ratio,
            "sperm_number": assessment.sperm_number,
            "inertia_ratio": assessment.inertia_ratio,
            "refused": refused.as_ref().map(ToString::to_string),
        });
        print(&format!("{content:#}"));
        return Ok(refused.map_or(ExitCode::SUCCESS, |error| refuse(&error)));
    }
    let width = facts.iter().map(|fact| fact.name.chars().count()).max().unwrap_or(0);
    for fact in &facts {
        let blanks = " ".repeat(width - fact.name.chars().count());
        print_unless_quiet(&format!("{}{blanks}  {}", fact.name, fact.text));
    }
    for warning in assessment.all_warnings() {
        print_unless_quiet(&format!("warning: {warning}"));
    }
    Ok(refused.map_or(ExitCode::SUCCESS, |error| refuse(&error)))
}
