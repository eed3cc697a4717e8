//! Results as HTML with plots and drawings, as JSON, as JUnit, and as text for the terminal.
//!
//! All output is a function of the data alone, without clock, host or random identifiers: the same results give the same bytes.

mod axis;
mod chart_html;
mod check_html;
mod definiteness_html;
pub mod drawing;
mod formats;
mod html;
pub mod inspection;
pub mod number;
mod page;
pub mod plot;
mod sheet;
pub mod spy;
pub mod statics;
pub mod tiles;
pub mod view;

pub use chart_html::chart_html;
pub use definiteness_html::{definiteness_html, definiteness_text};
pub use formats::{failure, json, junit, text};
pub use html::html;

/// One value of every item.
fn list<'a, T: 'a, V>(items: impl IntoIterator<Item = &'a T>, value: impl FnMut(&'a T) -> V) -> Vec<V> {
    items.into_iter().map(value).collect()
}
