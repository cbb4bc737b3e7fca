//! caudal as a Python package: scenes, the stepper and whole runs, with NumPy arrays, as `caudal._caudal`.  A thin layer: every
//! call is one call of the library. What is easier in Python (plots, data frames, documentation pages) is in `python/caudal`.
//! Python's lock is released while the library computes.

mod attention;
mod comparison;
mod design;
mod distributed;
mod error;
mod locks;
mod run;
mod scene;
mod simulation;
mod stepper;
mod study;
mod sweep;
mod values;

use pyo3::prelude::*;

#[pymodule]
fn _caudal(module: &Bound<'_, PyModule>) -> PyResult<()> {
    caudal::wording::set_frontend(caudal::wording::Frontend::Python);
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<stepper::Variable>()?;
    module.add_class::<stepper::Snapshot>()?;
    module.add_class::<stepper::StepDerivative>()?;
    module.add_class::<stepper::Stepper>()?;
    module.add_class::<stepper::SteppersTogether>()?;
    module.add_function(wrap_pyfunction!(scene::rebuild, module)?)?;
    module.add_function(wrap_pyfunction!(stepper::variable, module)?)?;
    module.add_function(wrap_pyfunction!(stepper::snapshot, module)?)?;
    module.add_class::<simulation::Simulation>()?;
    module.add_function(wrap_pyfunction!(simulation::parameters, module)?)?;
    module.add_function(wrap_pyfunction!(run::run, module)?)?;
    module.add_function(wrap_pyfunction!(comparison::compare, module)?)?;
    module.add_function(wrap_pyfunction!(run::write_vtk, module)?)?;
    module.add_function(wrap_pyfunction!(run::pictures, module)?)?;
    module.add_function(wrap_pyfunction!(run::write_film, module)?)?;
    module.add_function(wrap_pyfunction!(values::toml, module)?)?;
    module.add_function(wrap_pyfunction!(stepper::units, module)?)?;
    module.add_class::<sweep::SweepAtWork>()?;
    module.add_function(wrap_pyfunction!(sweep::held_descriptors, module)?)?;
    module.add_function(wrap_pyfunction!(sweep::cases, module)?)?;
    module.add_function(wrap_pyfunction!(study::study, module)?)?;
    module.add_class::<distributed::JobHandle>()?;
    module.add_function(wrap_pyfunction!(study::runs_of, module)?)?;
    module.add_function(wrap_pyfunction!(study::runs, module)?)?;
    module.add_function(wrap_pyfunction!(design::parts, module)?)?;
    module.add_function(wrap_pyfunction!(design::simulate_parts, module)?)?;
    module.add_function(wrap_pyfunction!(design::design, module)?)
}
