//! `caudal variables`: lists the variables that hosts read and set.

use std::path::Path;
use std::process::ExitCode;

use caudal::error::Result;
use caudal::scene::Scene;
use caudal::variable::{Size, VARIABLES, Variable};

use super::print;

pub fn variables(scene: Option<&Path>) -> Result<ExitCode> {
    let row = |variable: &Variable, size: String| {
        let Variable { name, unit, causality, description, .. } = variable;
        print(&format!("{name:<26} {size:>8}  {unit:<6} {:<12} {description}", causality.name()));
    };
    match scene {
        Some(path) => {
            let model = Scene::load(path)?.model()?;
            for variable in VARIABLES.iter().filter(|variable| variable.exists_in(&model)) {
                row(variable, variable.len(&model).to_string());
            }
        }
        None => {
            for variable in VARIABLES {
                let size = match variable.size {
                    Size::Scalar => "1",
                    Size::Nodes => "nodes",
                    Size::Joints => "joints",
                };
                row(variable, size.to_string());
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}
