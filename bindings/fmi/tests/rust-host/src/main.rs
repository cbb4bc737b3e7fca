//! Steps an FMU with rust-fmi: `rust-host FMU VARIABLE STEP COUNT` prints the bits of the variable after each step.

use std::error::Error;

use fmi::fmi2::import::Fmi2Import;
use fmi::fmi2::instance::{CoSimulation as _, Common as _};
use fmi::fmi3::import::Fmi3Import;
use fmi::fmi3::{CoSimulation as _, Common as _, Fmi3Model as _, GetSet as _};
use fmi::schema::MajorVersion;
use fmi::schema::traits::FmiModelDescription as _;
use fmi::traits::FmiImport as _;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [fmu, name, step, count] = arguments.as_slice() else { return Err("arguments: FMU VARIABLE STEP COUNT".into()) };
    let (step, count): (f64, usize) = (step.parse()?, count.parse()?);
    let times = (0..count).map(|i| i as f64 * step);
    let absent = || format!("there is no {name}");
    let mut value = [0.0];
    match fmi::import::peek_descr_path(fmu)?.major_version()? {
        MajorVersion::FMI2 => {
            let import: Fmi2Import = fmi::import::from_path(fmu)?;
            let variables = &import.model_description().model_variables.variables;
            let reference = variables.iter().find(|variable| variable.name == *name).ok_or_else(absent)?.value_reference;
            let mut tail = import.instantiate_cs("tail", false, true)?;
            tail.setup_experiment(None, 0.0, None)?;
            tail.enter_initialization_mode()?;
            tail.exit_initialization_mode()?;
            for time in times {
                tail.do_step(time, step, true)?;
                tail.get_real(&[reference], &mut value)?;
                println!("{}", value[0].to_bits());
            }
            tail.terminate()?;
        }
        MajorVersion::FMI3 => {
            let import: Fmi3Import = fmi::import::from_path(fmu)?;
            let mut variables = import.model_description().model_variables.iter_abstract();
            let found = variables.find(|variable| variable.name() == name).ok_or_else(absent)?;
            let reference = found.value_reference();
            let mut tail = import.instantiate_cs("tail", false, true, false, false, &[])?;
            tail.enter_initialization_mode(None, 0.0, None)?;
            tail.exit_initialization_mode()?;
            let (mut event, mut end, mut early, mut last) = (false, false, false, 0.0);
            for time in times {
                tail.do_step(time, step, true, &mut event, &mut end, &mut early, &mut last)?;
                tail.get_float64(&[reference], &mut value)?;
                println!("{}", value[0].to_bits());
            }
            tail.terminate()?;
        }
        other => return Err(format!("{other:?}: neither FMI 2.0 nor 3.0").into()),
    }
    Ok(())
}
