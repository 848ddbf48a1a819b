//! `kerf-station`: connects a haptic device to a session.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use clap::{Parser, Subcommand};
use kerf_station::config::StationConfig;
use kerf_station::link::{LinkState, SharedSession};
use kerf_station::monitor::Monitor;
use kerf_station::station::{Station, tool_ids};
use kerf_station::{device, doctor, experiment, monitor};

/// Connects haptic devices to a session of a Kerf server.
#[derive(Debug, Parser)]
#[command(name = "kerf-station", version)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Drives a session's tools until Ctrl-C
    Run(RunArgs),
    /// Says in plain words what is well and what is not about devices, machine and server; fails if something is not
    Doctor(doctor::Args),
    /// Measures what a hand feels by round trip, in virtual time and through a server; writes haptics.md and its plots
    Experiment {
        /// Folder for them
        folder: PathBuf,
        /// Address of the server, which should have nothing else to do
        #[arg(long)]
        server: std::net::SocketAddr,
        /// Lines that `run --json` printed, to be summed up in the report
        #[arg(long)]
        loopback: Option<PathBuf>,
    },
    /// Prints the format of the configuration as a JSON schema
    Schema,
    /// Prints the configuration with every default filled in
    PrintConfig {
        /// Configuration (TOML)
        #[arg(long)]
        config: Option<PathBuf>,
    },
}

#[derive(Debug, Parser)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["scene", "session"])))]
struct RunArgs {
    /// Configuration (TOML); without one a simulated Omni at 127.0.0.1:50051
    #[arg(long)]
    config: Option<PathBuf>,
    /// Address of the server, in place of the configuration's
    #[arg(long, env = "KERF_SERVER")]
    server: Option<String>,
    /// Creates a session of this scene, and closes it at the end
    #[arg(long)]
    scene: Option<String>,
    /// Joins this session
    #[arg(long)]
    session: Option<String>,
    /// Ends after this time, s
    #[arg(long)]
    duration: Option<f64>,
    /// How long to wait for a server that is still starting, s
    #[arg(long, default_value_t = 0.0)]
    wait_for_server: f64,
    /// Prints a JSON object a line, instead of a line for people
    #[arg(long)]
    json: bool,
}

fn main() -> anyhow::Result<()> {
    match Args::parse().command {
        Command::Run(args) => run(&args),
        Command::Doctor(args) => {
            if !args.execute()? {
                std::process::exit(1);
            }
            Ok(())
        }
        Command::Experiment { folder, server, loopback } => {
            let measured = loopback.as_deref().map_or(Ok(String::new()), monitor::loopback_text)?;
            Ok(std::fs::write(folder.join("haptics.md"), experiment::report(&measured, server, &folder)?)?)
        }
        Command::Schema => {
            println!("{}", serde_json::to_string_pretty(&schemars::schema_for!(StationConfig))?);
            Ok(())
        }
        Command::PrintConfig { config } => {
            print!("{}", toml::to_string_pretty(&load(config.as_ref())?)?);
            Ok(())
        }
    }
}

fn load(path: Option<&PathBuf>) -> anyhow::Result<StationConfig> {
    path.map_or_else(|| Ok(StationConfig::default()), |path| Ok(StationConfig::load(path)?))
}

fn run(args: &RunArgs) -> anyhow::Result<()> {
    let mut config = load(args.config.as_ref())?;
    if let Some(server) = &args.server {
        config.server.url.clone_from(server);
    }
    let session = match (&args.scene, &args.session) {
        (Some(scene), _) => SharedSession::create(scene),
        (None, session) => SharedSession::join(session.as_deref().unwrap_or_default()),
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let patience = Instant::now() + Duration::from_secs_f64(args.wait_for_server.clamp(0.0, 3600.0));
    let (scene, session_id) = loop {
        match runtime.block_on(session.describe(&config.server)) {
            Err(_) if Instant::now() < patience => std::thread::sleep(Duration::from_millis(200)),
            described => break described.map_err(|why| anyhow!(why))?,
        }
    };
    eprintln!("session {session_id} of `{}`", scene.name);
    let mut stations = Vec::new();
    for device in &config.devices {
        let opener = device.clone();
        let open = Box::new(move || device::open(&opener));
        let ids = tool_ids(device, &scene)?;
        stations.push((Station::start(&config, device, open, ids, Arc::clone(&session))?, Monitor::default()));
    }
    // The last of the stations closes it.
    drop(session);
    watch(args, &mut stations, &runtime)
}

/// Shows what the stations do until they have ended, time is up or Ctrl-C is pressed.
fn watch(args: &RunArgs, stations: &mut [(Station, Monitor)], runtime: &tokio::runtime::Runtime) -> anyhow::Result<()> {
    let mut interrupted = Box::pin(tokio::signal::ctrl_c());
    let is_live = !args.json && std::io::stdout().is_terminal();
    let period = Duration::from_millis(if is_live { 100 } else { 1000 });
    let end = args.duration.map(|s| Instant::now() + Duration::from_secs_f64(s.max(0.0)));
    loop {
        let waited = runtime.block_on(async { tokio::time::timeout(period, &mut interrupted).await });
        let mut all_ended = true;
        for (station, monitor) in stations.iter_mut() {
            while let Ok(sample) = station.samples.pop() {
                monitor.take(sample);
            }
            if let Some(report) = monitor.report(station) {
                show(&report, args.json, is_live)?;
            }
            all_ended &= station.thread().has_ended;
            let link = station.link();
            if link.state == LinkState::Failed {
                return Err(anyhow!(link.last_fault.unwrap_or_default()));
            }
        }
        if waited.is_ok() || all_ended || end.is_some_and(|end| Instant::now() >= end) {
            if is_live {
                println!();
            }
            return Ok(());
        }
    }
}

fn show(report: &kerf_station::monitor::Report, is_json: bool, is_live: bool) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    if is_json {
        writeln!(out, "{}", serde_json::to_string(report)?)?;
    } else if is_live {
        write!(out, "\r\x1b[2K{report}")?;
    } else {
        writeln!(out, "{report}")?;
    }
    out.flush()?;
    Ok(())
}
