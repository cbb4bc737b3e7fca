//! `caudal check`.

use std::process::ExitCode;

use caudal::check::Assessment;
use caudal::error::Result;
use caudal::report::Output;

use super::{Prepared, SceneArguments, output_folder, refuse, say};

pub fn check(arguments: &SceneArguments) -> Result<ExitCode> {
    let Prepared { document, scene, stepper, assessment } = arguments.prepare()?;
    let facts =
        [&assessment.facts[..], &Assessment::fluids(&scene, &stepper), &Assessment::ladder(&scene, &stepper)?].concat();
    let width = facts.iter().map(|fact| fact.name.chars().count()).max().unwrap_or(0);
    for fact in &facts {
        let blanks = " ".repeat(width - fact.name.chars().count());
        say(&format!("{}{blanks}  {}", fact.name, fact.text));
    }
    for warning in &assessment.warnings {
        say(&format!("warning: {warning}"));
    }
    let refused =
        assessment.refused(&document).or_else(|| Output::fits(&output_folder(&scene), &scene, &stepper).err());
    Ok(refused.map_or(ExitCode::SUCCESS, |error| refuse(&error)))
}
