//! `kerf-load`: drives a tool of a session by a script and reports how the server kept up.

use std::process::ExitCode;

use clap::Parser;
use kerf_load::args::Args;
use kerf_load::{output, run};

/// A limit given on the command line was exceeded.
const EXIT_LIMIT_EXCEEDED: u8 = 3;
/// Broken off from the keyboard: 128 + SIGINT, as shells have it.
const EXIT_INTERRUPTED: u8 = 130;

fn main() -> ExitCode {
    let args = Args::parse();
    match execute(&args) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("kerf-load: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn execute(args: &Args) -> anyhow::Result<ExitCode> {
    // One thread: a contact is stamped where it is received, without a hop between workers.
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let finished = runtime.block_on(run::run(args))?;
    println!("{}", finished.report);
    if let Some(path) = &args.json {
        output::write_report(path, &finished.report)?;
    }
    if let Some(dir) = &args.out {
        for path in output::write(dir, &finished)? {
            println!("{}", path.display());
        }
    }
    Ok(match (finished.report.interrupted, finished.report.limits_exceeded.is_empty()) {
        (true, _) => ExitCode::from(EXIT_INTERRUPTED),
        (false, true) => ExitCode::SUCCESS,
        (false, false) => ExitCode::from(EXIT_LIMIT_EXCEEDED),
    })
}
