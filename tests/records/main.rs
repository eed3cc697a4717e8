//! Figures of whole reports, held to lists: see [`record`].

mod accuracy;
mod chart;
mod faults;
mod inspect;
mod integrate;
mod led;
mod record;
mod system;
mod verify;
