//! An inspection of definiteness, for people and for programs.

mod explanation;
mod html;
mod json;
mod losses;
mod text;

pub use explanation::explain;
pub use html::{html, pictures};
pub use json::InspectionRecord;
pub use text::{first_answer, text};
