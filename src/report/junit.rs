//! `junit.xml`: the results for test runners and build servers.

use super::text;
use crate::verify::{Check, Results};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use std::io;

/// The results as a JUnit document: a suite per claim, a case per check.
///
/// # Errors
/// What the serializer reports; none is known for this data.
pub fn junit(results: &Results) -> io::Result<String> {
    let mut report = Report::new("sprung verify");
    for (claim, checks) in results.by_claim() {
        let mut suite = TestSuite::new(claim.title());
        suite.add_test_cases(checks.into_iter().map(case));
        report.add_test_suite(suite);
    }
    report.to_string().map_err(io::Error::other)
}

fn case(check: &Check) -> TestCase {
    let mut status = TestCaseStatus::success();
    if !check.passed() {
        status = TestCaseStatus::non_success(NonSuccessKind::Failure);
        status.set_message(text::comparison(check)).set_description(text::failure(check));
    }
    let mut case = TestCase::new(format!("{} [{}]", check.name, check.scene), status);
    case.set_classname(check.claim.id());
    case
}
