//! `caudal check`.

use std::process::ExitCode;

use caudal::check::Assessment;
use caudal::error::Result;
use caudal::stepper::Stepper;

use super::{SceneArguments, say};

pub fn check(arguments: &SceneArguments) -> Result<ExitCode> {
    let (_, scene) = arguments.read()?;
    let stepper = Stepper::of(&scene)?;
    let assessment = Assessment::of(&scene, &stepper)?;
    let facts = [&assessment.facts[..], &Assessment::ladder(&scene, &stepper)?].concat();
    let width = facts.iter().map(|fact| fact.name.chars().count()).max().unwrap_or(0);
    for fact in &facts {
        let blanks = " ".repeat(width - fact.name.chars().count());
        say(&format!("{}{blanks}  {}", fact.name, fact.text));
    }
    for warning in &assessment.warnings {
        say(&format!("warning: {warning}"));
    }
    Ok(ExitCode::SUCCESS)
}
