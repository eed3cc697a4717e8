//! Reports and players as pages, by their text and in a real browser.
//!
//! Tests in a browser need Chromium on the path (`chromium`, `chromium-browser`, `google-chrome`, or what the variable CHROMIUM names);
//! without one they say so and check nothing.

#[path = "../common/sandbox.rs"]
mod sandbox;

mod browser;
mod keyboard_print;
mod layout;
mod player;
mod report;
mod sample;
mod view;
