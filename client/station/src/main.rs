//! `kerf-station`: connects a haptic device to a session.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use clap::{Parser, Subcommand};
use kerf_proto::v1;
use kerf_station::config::StationConfig;
use kerf_station::link::{LinkState, SharedSession};
use kerf_station::log::Log;
use kerf_station::monitor::{Monitor, Report};
use kerf_station::run_report::RunReport;
use kerf_station::servo::runner::Sample;
use kerf_station::station::{Station, tool_ids};
use kerf_station::{device, doctor, experiment, monitor, run_report};

/// Time that a report sums up, and how often a line on a terminal is written anew.
const REPORT_PERIOD: Duration = Duration::from_secs(1);
const LIVE_PERIOD: Duration = Duration::from_millis(100);

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
    /// Plays one row of the experiment's table through a server and prints it
    Trial(experiment::closed_loop::Row),
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
    /// Writes what each tick of the servos did to this file
    #[arg(long, value_name = "FILE.mcap")]
    log: Option<PathBuf>,
    /// Writes plots of force and latency into this folder at the end
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
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
        Command::Trial(row) => row.play(),
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
    let page = format!("{}/?session={session_id}", config.server.url.trim_end_matches('/'));
    eprintln!("session {session_id} of `{}`; to be seen at {page}", scene.name);
    match start(&config, &scene, &session) {
        Ok(mut stations) => {
            // The last of the stations closes it.
            drop(session);
            stations.iter_mut().for_each(|shown| shown.monitor.page.clone_from(&page));
            let mut log = match &args.log {
                Some(path) => Some(Log::create(path, stations.iter().map(|shown| &*shown.station.name))?),
                None => None,
            };
            let watched = watch(args, &mut stations, &runtime, &mut log);
            // Also of a run that has failed: that is when it is wanted.
            log.map_or(Ok(()), Log::finish)?;
            if let Some(folder) = &args.report {
                run_report::write(folder, stations.iter().map(|shown| &shown.sums))?;
            }
            watched
        }
        Err(why) => {
            runtime.block_on(session.leave(&config.server));
            Err(why)
        }
    }
}

/// Starts a station for each device.
fn start(config: &StationConfig, scene: &v1::SceneSummary, session: &Arc<SharedSession>) -> anyhow::Result<Vec<Shown>> {
    let mut stations = Vec::new();
    for (index, device) in config.devices.iter().enumerate() {
        let opener = device.clone();
        let open = Box::new(move || device::open(&opener));
        let ids = tool_ids(device, scene)?;
        let names: Vec<_> = ids.iter().filter_map(|id| scene.tools.get(*id as usize)).map(|tool| &*tool.name).collect();
        let driven = names.join(", ");
        let station = Station::start(config, device, open, ids, Arc::clone(session))?;
        eprintln!("devices[{index}]: {} drives {driven}; Ctrl-C lets go", station.name);
        let sums = RunReport::new(&station.name);
        let monitor = Monitor::default();
        stations.push(Shown { station, monitor, sums, report: None, has_told: false, fault: None });
    }
    Ok(stations)
}

/// A station and what is shown of it.
struct Shown {
    station: Station,
    monitor: Monitor,
    /// Of the whole run.
    sums: RunReport,
    /// Of the last second.
    report: Option<Report>,
    /// Its servo's priority was told of.
    has_told: bool,
    /// The fault that was told of last.
    fault: Option<String>,
}

impl Shown {
    /// A fault that is new since the last time.
    fn new_fault(&mut self) -> Option<&str> {
        let Some(fault) = self.report.as_ref().and_then(|report| report.last_fault.as_ref()) else {
            self.fault = None;
            return None;
        };
        (self.fault.as_ref() != Some(fault)).then(|| &**self.fault.insert(fault.clone()))
    }

    /// Takes what the servo did; a report of the second that `is_due` ends, else the last one with what is so now.
    fn look(
        &mut self,
        is_due: bool,
        mut log: impl FnMut(&Sample) -> anyhow::Result<()>,
    ) -> anyhow::Result<Option<&Report>> {
        while let Ok(sample) = self.station.samples.pop() {
            log(&sample)?;
            self.sums.take(&sample);
            self.monitor.take(sample);
        }
        let priority = self.station.thread().priority;
        if !self.has_told && !priority.is_empty() {
            self.has_told = true;
            eprintln!("priority of the servo's thread: {priority}");
        }
        match &mut self.report {
            Some(report) if !is_due => self.monitor.refresh(report, &self.station),
            _ => self.report = self.monitor.report(&self.station).or_else(|| self.report.take()),
        }
        Ok(self.report.as_ref())
    }
}

/// Until somebody ends the program: Ctrl-C, a plain `kill`, or the end of its terminal. What a station made goes with it.
async fn interrupted() {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let other = |kind| signal(kind).ok();
        if let (Some(mut terminated), Some(mut hung_up)) = (other(SignalKind::terminate()), other(SignalKind::hangup()))
        {
            tokio::select! {
                _ = tokio::signal::ctrl_c() => {}
                _ = terminated.recv() => {}
                _ = hung_up.recv() => {}
            }
            return;
        }
    }
    let _ = tokio::signal::ctrl_c().await;
}

/// Shows what the stations do until they have ended, time is up or the program is ended.
fn watch(
    args: &RunArgs,
    stations: &mut [Shown],
    runtime: &tokio::runtime::Runtime,
    log: &mut Option<Log>,
) -> anyhow::Result<()> {
    let mut interrupted = Box::pin(interrupted());
    // A line that is written over and over holds one device.
    let is_live = !args.json && stations.len() == 1 && std::io::stdout().is_terminal();
    let period = if is_live { LIVE_PERIOD } else { REPORT_PERIOD };
    let end = args.duration.map(|s| Instant::now() + Duration::from_secs_f64(s.max(0.0)));
    let mut due = Instant::now() + REPORT_PERIOD;
    loop {
        let waited = runtime.block_on(async { tokio::time::timeout(period, &mut interrupted).await });
        let is_due = !is_live || Instant::now() >= due;
        if is_due {
            due = Instant::now() + REPORT_PERIOD;
        }
        let mut all_ended = true;
        for (index, shown) in stations.iter_mut().enumerate() {
            let keep = |sample: &Sample| log.as_mut().map_or(Ok(()), |log| log.write(index, sample));
            if let Some(report) = shown.look(is_due, keep)? {
                show(report, args.json, is_live)?;
            }
            // What does not fit on the line that is written over, and goes by on it, has one of its own.
            if let (true, Some(fault)) = (is_live, shown.new_fault()) {
                println!("\r\x1b[2K{fault}");
            }
            all_ended &= shown.station.thread().has_ended;
            let link = shown.station.link();
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

fn show(report: &Report, is_json: bool, is_live: bool) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    if is_json {
        writeln!(out, "{}", serde_json::to_string(report)?)?;
    } else if is_live {
        // Without wrapping: what does not fit is left out.
        write!(out, "\r\x1b[2K\x1b[?7l{report}\x1b[?7h")?;
    } else {
        writeln!(out, "{}: {report}", report.device)?;
    }
    out.flush()?;
    Ok(())
}
