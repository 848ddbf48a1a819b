//! `kerf-server replay`: a recording, shown to viewers as if it were live, or simulated once more and compared.

use std::io::Write as _;
use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use kerf_physics::Workers;
use kerf_session::player::SPEEDS;
use kerf_session::{Replay, Seek};

use crate::config::{ConfigArgs, ServerConfig};
use crate::progress::{Progress, say};
use crate::recording::convert::{object_stats, scene};
use crate::recording::reader::{Ending, Recording};
use crate::recording::{FileFootage, verify};
use crate::serve::{Server, serve_until_told};
use crate::telemetry;

/// Arguments of `replay`.
#[derive(Args, Clone, Debug)]
pub struct ReplayArgs {
    /// The recording, as a server with `record_dir` writes it.
    #[arg(value_name = "FILE.mcap")]
    pub file: PathBuf,
    /// Times the speed of its making, 0.01 to 100.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub speed: f64,
    /// Time since the recording began to start from, s.
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub from: f64,
    /// Serves nothing: simulates the session once more, through resets and checkpoints, and compares the hash of the state
    /// after every step. Ends with status 1 and names the first step that differs.
    #[arg(long, conflicts_with_all = ["speed", "from"])]
    pub verify: bool,
    /// Threads lent to the steps of --verify. Default: as many as the machine has. The result does not depend on it.
    #[arg(long, value_name = "N", requires = "verify")]
    pub threads: Option<usize>,
    /// As of `serve`: where to listen and more.
    #[command(flatten)]
    pub config: ConfigArgs,
}

/// Serves a recording until SIGTERM or SIGINT, or verifies it.
///
/// # Errors
/// The file is no recording, a step differs, or the server cannot start.
pub fn run(args: &ReplayArgs) -> Result<()> {
    let recording = Recording::open(&args.file)?;
    if recording.ending() == Ending::CutOff {
        say(
            "warning: the recording ends without its index, as one whose server was killed; it is read to its last whole chunk",
        );
    }
    if args.verify { check(recording, args.threads) } else { serve(recording, args) }
}

fn check(mut recording: Recording, threads: Option<usize>) -> Result<()> {
    let threads = threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    ensure!((1..=256).contains(&threads), "--threads {threads} is not between 1 and 256");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let mut progress = None;
    let verified = verify::verify(&mut recording, &Workers::of(&pool), |steps| {
        progress.get_or_insert_with(|| Progress::new(steps)).advance();
    });
    progress.into_iter().for_each(|progress| progress.finish());
    let verify::Verified { steps, resets, restores, state_hash, .. } = verified?;
    println!(
        "{steps} steps, {resets} resets and {restores} ways back to checkpoints: every state is as recorded, the last \
         with hash {state_hash:016x}"
    );
    Ok(())
}

fn serve(recording: Recording, args: &ReplayArgs) -> Result<()> {
    ensure!(
        SPEEDS.contains(&args.speed),
        "--speed {} is not between {} and {}",
        args.speed,
        SPEEDS.start(),
        SPEEDS.end()
    );
    ensure!(args.from >= 0.0, "--from {} is below 0", args.from);
    let mut config = ServerConfig::load(&args.config)?;
    let _telemetry = telemetry::init(&config)?;
    // The recording takes the only place: nothing else is created here, and nothing recorded.
    config.session.max_sessions = 1;
    config.record_dir = None;
    // It does not end by itself.
    config.session.drain_s = 0.0;
    let replay = Replay {
        scene: scene(recording.header())?,
        objects: object_stats(recording.header()),
        footage: Box::new(FileFootage::new(recording)),
        seek: Seek { time_s: Some(args.from), speed: Some(args.speed) },
    };
    serve_until_told(config, async |server: &Server| {
        let session = server.registry().play(replay)?;
        // Nobody has to read it.
        let _ = writeln!(std::io::stdout(), "session {}: open {} in a browser to watch", session.id(), server.url());
        Ok(())
    })
}
