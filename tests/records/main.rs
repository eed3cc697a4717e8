//! Figures of whole reports, held to lists: see [`record`].

mod accuracy;
mod chart;
mod inspect;
mod integrate;
mod record;
mod system;
mod verify;
