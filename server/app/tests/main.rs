//! The program `kerf-server`: its commands and reports.

mod checkpoint_files;
mod cli;
mod hepatectomy;
mod journal;
mod killed;
mod limited;
mod log;
mod process;
mod remote;
mod slit;
mod tradeoff;
