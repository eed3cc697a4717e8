//! The native half of the Python package `sprung`: arrays in, arrays out.
//!
//! Everything here is called by the package's own Python files, which check and name what users give, document it and wrap what comes
//! back. States are held by numpy, so that users may change them; what is computed from one is computed from a copy, without the
//! lock of the interpreter, see [`compute`].

mod answer;
mod arrays;
mod compute;
mod error;
mod factor;
mod functions;
mod gradient;
mod inspect;
mod jacobian;
mod matrices;
mod names;
mod operator;
mod recorded;
mod run;
mod statics;
mod stepper;
mod system;
mod task;
mod verify;
mod view;

use pyo3::prelude::*;

/// The native half of `sprung`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<system::System>()?;
    module.add_class::<matrices::Assembled>()?;
    module.add_class::<factor::Factor>()?;
    module.add_class::<operator::Operator>()?;
    module.add_class::<stepper::Stepper>()?;
    module.add_class::<inspect::Inspection>()?;
    module.add_class::<statics::Equilibrium>()?;
    module.add_class::<statics::Modes>()?;
    module.add_class::<gradient::Differentiable>()?;
    module.add_function(wrap_pyfunction!(names::choices, module)?)?;
    module.add_function(wrap_pyfunction!(matrices::assemble, module)?)?;
    module.add_function(wrap_pyfunction!(factor::factor, module)?)?;
    module.add_function(wrap_pyfunction!(operator::operator, module)?)?;
    module.add_function(wrap_pyfunction!(run::run, module)?)?;
    module.add_function(wrap_pyfunction!(inspect::inspect, module)?)?;
    module.add_function(wrap_pyfunction!(jacobian::check_jacobian, module)?)?;
    module.add_function(wrap_pyfunction!(verify::verify, module)?)?;
    module.add_function(wrap_pyfunction!(statics::equilibrium, module)?)?;
    module.add_function(wrap_pyfunction!(statics::modes, module)?)?;
    module.add_function(wrap_pyfunction!(statics::mechanisms, module)?)?;
    module.add_function(wrap_pyfunction!(gradient::differentiable_run, module)?)?;
    module.add_function(wrap_pyfunction!(view::view, module)?)?;
    Ok(())
}
