//! What the program does where something is wrong: with numbers, with the system it runs on, with the patience of its user.

mod checkpoints;
#[path = "../command/mod.rs"]
mod command;
mod environment;
mod interrupts;
mod numbers;
