//! `summary.json`: what a run did and how it ended.
