//! The command `sprung`: arguments, exit statuses, messages and files, and what it does where something is wrong.

#[path = "../common/rejections.rs"]
#[macro_use]
mod rejected;
#[path = "../common/sandbox.rs"]
mod sandbox;

mod at;
mod breakdown;
mod first_minute;
mod inspect;
mod interrupt;
mod manners;
mod matrix;
mod new;
mod rejected_scenes;
mod robustness;
mod run;
mod snapshots;
mod statics;
mod units;
mod verify;
