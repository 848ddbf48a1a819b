//! `kerf-server`: simulates soft tissue that is cut, for stations and viewers on the network.

use clap::{Parser, Subcommand};
use kerf_server::serve::{self, ServeArgs};

/// Simulates soft tissue that is cut, for stations and viewers on the network.
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
}

fn main() -> anyhow::Result<()> {
    match Cli::parse().command {
        Command::Serve(args) => serve::run(args),
    }
}
