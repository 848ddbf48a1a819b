//! The program `kerf-server`: its commands and reports.

mod agones;
mod checkpoint_files;
mod cli;
mod door;
mod drained;
mod first_start;
mod hepatectomy;
mod journal;
mod killed;
mod limited;
mod log;
mod manifests;
mod metrics;
mod moved;
mod opened_cut;
mod process;
mod remote;
mod ring;
mod secured;
mod station;
mod stopped;
mod tls;
mod top;
mod traces;
mod tradeoff;
mod unit;
