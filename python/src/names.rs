//! Options by the names that the command uses.

use crate::error::raised;
use pyo3::prelude::*;
use sprung::error::Invalid;
use sprung::integrate::StiffnessPolicy;
use sprung::linear::{PreconditionerKind, SolverChoice};
use sprung::plan::MethodChoice;
use sprung::scene::Kind;
use sprung::{Error, Stiffness};

/// The names of an option, for annotations and tests.
#[pyfunction]
pub fn choices(option: &str) -> Vec<&'static str> {
    match option {
        "method" => MethodChoice::ALL.map(MethodChoice::name).to_vec(),
        "stiffness" => StiffnessPolicy::ALL.map(StiffnessPolicy::name).to_vec(),
        "solver" => SolverChoice::ALL.map(SolverChoice::name).to_vec(),
        "preconditioner" => ["auto"].into_iter().chain(PreconditionerKind::ALL.map(PreconditionerKind::name)).collect(),
        "scene" => Kind::ALL.map(Kind::name).to_vec(),
        _ => Vec::new(),
    }
}

/// The one of this name.
fn find<T: Copy>(key: &str, asked: &str, all: &[T], name: impl Fn(T) -> &'static str) -> PyResult<T> {
    all.iter().copied().find(|&each| name(each) == asked).ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|&each| name(each)).collect();
        let rule = format!("must be one of {}", names.join(", "));
        raised(Error::Invalid(Invalid::new(key, format!("{asked:?}"), rule)))
    })
}

pub fn method(asked: &str) -> PyResult<MethodChoice> {
    find("method", asked, &MethodChoice::ALL, MethodChoice::name)
}

pub fn policy(asked: &str) -> PyResult<StiffnessPolicy> {
    find("stiffness", asked, &StiffnessPolicy::ALL, StiffnessPolicy::name)
}

pub fn stiffness(asked: &str) -> PyResult<Stiffness> {
    find("stiffness", asked, &Stiffness::ALL, Stiffness::name)
}

pub fn solver(asked: &str) -> PyResult<SolverChoice> {
    find("solver", asked, &SolverChoice::ALL, SolverChoice::name)
}

/// `None` chooses.
pub fn preconditioner(asked: &str) -> PyResult<Option<PreconditionerKind>> {
    if asked == "auto" {
        return Ok(None);
    }
    find("preconditioner", asked, &PreconditionerKind::ALL, PreconditionerKind::name).map(Some)
}

pub fn kind(asked: &str) -> PyResult<Kind> {
    find("kind", asked, &Kind::ALL, Kind::name)
}
