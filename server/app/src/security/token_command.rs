//! `kerf-server token`: makes tokens.

use std::io::Write as _;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use anyhow::{Context, Result, ensure};
use clap::{Args, Subcommand};

use super::roles::Role;
use super::tokens::{Wanted, add, write_secretly};

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;

/// Arguments of `token`.
#[derive(Args, Clone, Debug)]
pub struct TokenArgs {
    /// What is to be done.
    #[command(subcommand)]
    pub action: Action,
}

/// What is to be done about tokens.
#[derive(Clone, Debug, Subcommand)]
pub enum Action {
    /// Makes a token and shows it once: the file gets its digest alone. A server that runs takes it within a second. To
    /// take it back, remove its entry from the file.
    New(New),
}

/// A new token.
#[derive(Args, Clone, Debug)]
pub struct New {
    /// Whose it is.
    #[arg(long)]
    pub name: String,
    /// What it is good for.
    #[arg(long)]
    pub role: Role,
    /// The one session that it is good for, by its id. Default: all that its role may see.
    #[arg(long, value_name = "SESSION")]
    pub session: Option<String>,
    /// Days that it is good for. Default: until it is taken back.
    #[arg(long, value_name = "DAYS")]
    pub days: Option<f64>,
    /// The server's file of tokens (security.token_file, or tokens.toml in security.dir); made where there is none.
    #[arg(long, value_name = "FILE")]
    pub file: PathBuf,
    /// Writes the token to this file, which its owner alone may read, and shows nothing.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Makes what is asked for.
///
/// # Errors
/// The file makes no sense, has a token of this name, or cannot be written.
pub fn run(args: TokenArgs) -> Result<()> {
    let Action::New(New { name, role, session, days, file, out }) = args.action;
    let expires = days.map(|days| {
        ensure!(days > 0.0 && days <= 36_500.0, "--days {days} is not greater than 0 and at most 36500");
        Ok(SystemTime::now() + Duration::from_secs_f64(days * DAY_S))
    });
    let token = add(&file, Wanted { name, role, expires: expires.transpose()?, session })?;
    match out {
        Some(out) => write_secretly(&out, &format!("{}\n", token.reveal())),
        None => writeln!(std::io::stdout(), "{}", token.reveal()).context("standard output"),
    }
}
