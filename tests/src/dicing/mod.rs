//! Models diced by random plunges of a blade, at rates from 60 Hz to 1 kHz and speeds to 1 m/s: what comes of it when
//! cuts cross and chips fall. Nothing is to be rolled back, and no energy to come from nowhere.

pub mod campaign;
mod plunge;
pub mod report;
