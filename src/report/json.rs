//! `report.json`: the results for machines.

use crate::verify::{Check, Results};
use serde::Serialize;
use std::io;

/// The results as the content of `report.json`:
/// `{"passed", "failed", "checks": [{"name", "scene", "claim", "value", "bound", "passed", "why"}…], "not_judged": [{"name", "scene", "claim",
/// "why"}…]}`; what could not be judged counts neither as passed nor as failed.
///
/// Numbers are in the shortest form that reads back to the same double. NaN and infinity are no JSON numbers: they
/// become `null`, such a check has failed, and its `why` begins with what the number was.
///
/// # Errors
/// What the serializer reports; none is known for this data.
pub fn json(results: &Results) -> io::Result<String> {
    let checks = results.checks.iter().map(Record::of).collect();
    let not_judged = results.not_judged.iter().map(LeftOut::of).collect();
    let document = Document { passed: results.passed(), failed: results.failed(), checks, not_judged };
    Ok(serde_json::to_string_pretty(&document)? + "\n")
}

#[derive(Serialize)]
struct Document<'a> {
    passed: usize,
    failed: usize,
    checks: Vec<Record<'a>>,
    not_judged: Vec<LeftOut<'a>>,
}

#[derive(Serialize)]
struct LeftOut<'a> {
    name: &'a str,
    scene: &'a str,
    claim: &'static str,
    why: &'a str,
}

impl<'a> LeftOut<'a> {
    fn of(check: &'a Check) -> Self {
        Self { name: &check.name, scene: &check.scene, claim: check.claim.id(), why: &check.why }
    }
}

#[derive(Serialize)]
struct Record<'a> {
    name: &'a str,
    scene: &'a str,
    claim: &'static str,
    value: Option<f64>,
    bound: Option<f64>,
    passed: bool,
    why: String,
}

impl<'a> Record<'a> {
    fn of(check: &'a Check) -> Self {
        let number = |x: f64| x.is_finite().then_some(x);
        let notes = [("value", check.value), ("bound", check.bound)].map(|(name, x)| match number(x) {
            Some(_) => String::new(),
            None => format!("{name} is {x}; "),
        });
        Self {
            name: &check.name,
            scene: &check.scene,
            claim: check.claim.id(),
            value: number(check.value),
            bound: number(check.bound),
            passed: check.passed(),
            why: notes.concat() + &check.why,
        }
    }
}
