//! `junit.xml`: the results for test runners and build servers.

use super::text;
use crate::verify::{Check, Results};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use std::io;

/// The results as a JUnit document: a suite per claim, a case per check; what could not be judged is skipped.
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
    if !results.not_judged.is_empty() {
        let mut suite = TestSuite::new("Not judged on these scenes");
        suite.add_test_cases(results.not_judged.iter().map(|check| {
            let mut status = TestCaseStatus::skipped();
            status.set_message(check.why.as_str());
            let mut case = TestCase::new(format!("{} [{}]", check.name, check.scene), status);
            case.set_classname(check.claim.id());
            case
        }));
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
