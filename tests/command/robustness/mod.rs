//! What the program does where something is wrong: with numbers, with the system it runs on, with the patience of its user.

mod checkpoints;
mod environment;
mod interrupts;
mod numbers;
