//! The loopback round trip of pose to force at 250 Hz: `kerf-load` cuts the built-in liver by its
//! scripted strokes, on a server in this process, with one viewer.

use std::net::SocketAddr;

use anyhow::{Context, Result};
use clap::Parser;
use kerf_load::args::Args;
use kerf_load::report::{QuantilesMs, Report};
use kerf_load::run;
use kerf_server::config::ServerConfig;
use kerf_server::serve::Server;
use kerf_session::{StepTallies, StepTally};

const RATE_HZ: f64 = 250.0;
/// What transport and scheduling may add to a round trip, ms.
const TRANSPORT_MS: f64 = 1.0;
/// Across the whole liver, 5 cm deep; a quarter of a minute, so that a thousandth is a few poses.
const STROKES: [&str; 8] = ["--strokes", "4", "--depth", "0.05", "--speed", "0.05", "--jitter", "0"];

fn main() -> Result<()> {
    // Cargo also runs benches as tests; this one takes a quarter of a minute and asserts nothing.
    if !std::env::args().any(|argument| argument == "--bench") {
        return Ok(());
    }
    let config = ServerConfig { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..ServerConfig::default() };
    // As `kerf-server serve` and `kerf-load` do it: a runtime each.
    let mut network = tokio::runtime::Builder::new_multi_thread();
    let network = network.worker_threads(config.network_threads).enable_all().build()?;
    let client = tokio::runtime::Builder::new_current_thread().enable_all().build()?;

    let server = network.block_on(Server::start(config))?;
    let (address, rate) = (server.address().to_string(), RATE_HZ.to_string());
    let load = ["kerf-load", "--server", &address, "--scene", "liver", "--keep-session", "--rate", &rate];
    let args = Args::try_parse_from(load.iter().chain(&STROKES).chain(&["--progress", "off"]))?;
    let report = client.block_on(run::run(&args))?.report;
    let sessions = server.registry().list();
    let session = sessions.first().context("the session was kept")?;
    let steps = network.block_on(session.query(|inspection| inspection.steps.clone()))?;
    print(&report, &steps)?;
    network.block_on(server.stop());
    Ok(())
}

fn print(report: &Report, steps: &StepTallies) -> Result<()> {
    println!("{report}");
    print_steps("steps", &steps.all);
    print_steps("cutting", &steps.cutting);
    let QuantilesMs { p99, .. } = report.round_trip_ms.context("no pose came back")?;
    let (period_ms, step_p99_ms) = (1e3 / RATE_HZ, quantile_ms(&steps.all, 0.99));
    let limit_ms = period_ms + step_p99_ms + TRANSPORT_MS;
    println!(
        "limit        p99 of the round trip {p99:.2} ms, limit {limit_ms:.2} ms \
         (period {period_ms:.2} + p99 of the step {step_p99_ms:.2} + {TRANSPORT_MS:.2}): {}",
        if p99 <= limit_ms { "kept" } else { "EXCEEDED" }
    );
    Ok(())
}

fn print_steps(name: &str, steps: &StepTally) {
    let (count, late) = (steps.duration_ns.len(), steps.late);
    println!(
        "{name:<12} median {:.2} ms, p99 {:.2} ms, {late} of {count} steps late ({:.1} %)",
        quantile_ms(steps, 0.5),
        quantile_ms(steps, 0.99),
        100.0 * late as f64 / count.max(1) as f64
    );
}

fn quantile_ms(steps: &StepTally, quantile: f64) -> f64 {
    steps.duration_ns.value_at_quantile(quantile) as f64 * 1e-6
}
