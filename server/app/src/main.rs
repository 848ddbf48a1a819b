//! `kerf-server`: soft tissue that can be cut, without a network or (with `serve`) over one.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use kerf_server::allocate::{self, AllocateArgs};
use kerf_server::remote::{self, SessionArgs};
use kerf_server::replay::{self, ReplayArgs};
use kerf_server::scene_args::SceneArgs;
use kerf_server::security::token_command::{self, TokenArgs};
use kerf_server::serve::{self, ServeArgs};
use kerf_server::top::{self, TopArgs};
use kerf_server::{check, scenes, schema, simulate, tradeoff};

/// Gives the memory of sessions that have ended back to the system. glibc's keeps it: after 900 sessions, up to 32 at a time,
/// a server held 780 MB for none, with this one 118 MB (`make soak`). Steps take 1.01 times as long. mimalloc's threads take
/// three times the memory of a session.
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

/// Simulates soft tissue that is cut.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Serves sessions over gRPC until it is told to stop.
    Serve(ServeArgs),
    /// Serves a recorded session to viewers as if it were live, or verifies it.
    Replay(ReplayArgs),
    /// Asks a server that runs for its sessions, saves their states and takes them back.
    Session(SessionArgs),
    /// Shows what a server's sessions are doing, second by second.
    Top(TopArgs),
    /// Asks Agones's allocator for a server of a fleet with room for a session, and prints its address.
    Allocate(AllocateArgs),
    /// Makes tokens, with which clients are let in.
    Token(TokenArgs),
    /// Lists the built-in scenes.
    Scenes,
    /// Prints the JSON schema of a scene.
    Schema,
    /// Says what is wrong with a scene, and what its elements are asked to carry.
    Check(SceneArgs),
    /// Runs a scene without a network and writes tables, the last surface and a summary.
    Simulate(simulate::Options),
    /// Sweeps a scene's settings and writes what each costs and how far off it is.
    Tradeoff(Box<tradeoff::Options>),
    /// One run of `tradeoff`: a job on standard input.
    #[command(hide = true)]
    TradeoffRun {
        /// File of the run.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::Serve(args) => serve::run(args),
        Command::Replay(args) => replay::run(&args),
        Command::Session(args) => remote::run(&args),
        Command::Top(args) => top::run(&args),
        Command::Allocate(args) => allocate::run(&args),
        Command::Token(args) => token_command::run(args),
        Command::Scenes => scenes::run(),
        Command::Schema => schema::run(),
        Command::Check(args) => check::run(&args),
        Command::Simulate(options) => simulate::run(&options),
        Command::Tradeoff(options) => tradeoff::run(&options),
        Command::TradeoffRun { out } => tradeoff::process::run(&out),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Where nobody reads it the status says it.
            let _ = writeln!(std::io::stderr(), "error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
