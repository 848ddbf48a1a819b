//! `kerf-server top`: what the sessions of a server are doing, second by second, or once.
//!
//! The server's list of sessions has all of it, and no session is asked: one that hangs is shown, and one that nobody
//! uses is not kept alive by being looked at.

mod sample;
mod table;

use std::io::{IsTerminal as _, stdout};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use clap::Args;
use kerf_access::{Access, Wire, root_cause};
use kerf_proto::v1;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyModifiers};
use tokio::runtime::{Builder, Runtime};

use crate::remote::TIMEOUT;
use sample::Sample;

/// Arguments of `top`.
#[derive(Args, Clone, Debug)]
pub struct TopArgs {
    /// Address of the server, also as https://NAME:PORT.
    #[arg(long, env = "KERF_SERVER", value_name = "ADDRESS:PORT", default_value = "127.0.0.1:50051")]
    pub server: String,
    /// What the server asks for.
    #[command(flatten)]
    pub access: Access,
    /// Time between two looks, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0)]
    pub interval: f64,
    /// Prints one table, of what happened between two looks, and ends; as it does where there is no terminal.
    #[arg(long)]
    pub once: bool,
}

/// Shows the sessions until `q` or Ctrl-C.
///
/// # Errors
/// No server answers there, it refuses, or the terminal does not work.
pub fn run(args: &TopArgs) -> Result<()> {
    ensure!((0.1..=3600.0).contains(&args.interval), "--interval {}: must be 0.1 to 3600", args.interval);
    let runtime = Builder::new_current_thread().enable_all().build().context("runtime")?;
    let mut source = Source::connect(&runtime, args)?;
    let first = source.look(&runtime)?;
    let interval = Duration::from_secs_f64(args.interval);
    if args.once || !stdout().is_terminal() {
        std::thread::sleep(interval);
        print!("{}", table::plain(&source.look(&runtime)?.since(&first)));
        return Ok(());
    }
    let mut terminal = ratatui::try_init().context("terminal")?;
    let outcome = show(&mut terminal, &runtime, &mut source, (first, interval));
    ratatui::restore();
    outcome
}

/// Where samples come from.
struct Source(SessionServiceClient<Wire>);

impl Source {
    fn connect(runtime: &Runtime, args: &TopArgs) -> Result<Self> {
        let endpoint = args.access.endpoint(&args.server)?;
        let channel = runtime.block_on(endpoint.connect_timeout(TIMEOUT).timeout(TIMEOUT).connect());
        let channel =
            channel.map_err(|error| anyhow!("no Kerf server answers at {} ({})", args.server, root_cause(&error)))?;
        Ok(Self(SessionServiceClient::new(args.access.token()?.over(channel))))
    }

    fn look(&mut self, runtime: &Runtime) -> Result<Sample> {
        let listed = runtime.block_on(self.0.list_sessions(v1::ListSessionsRequest {}));
        let listed = listed.map_err(|status| anyhow!("{}", status.message()))?.into_inner();
        Ok(Sample { at: Instant::now(), listed })
    }
}

/// Looks at each interval; a server that is gone is looked for again.
fn show(
    terminal: &mut DefaultTerminal,
    runtime: &Runtime,
    source: &mut Source,
    (mut last, interval): (Sample, Duration),
) -> Result<()> {
    let mut seen = last.since(&last);
    let mut trouble = None;
    loop {
        terminal.draw(|frame| table::draw(frame, &seen, trouble.as_deref()))?;
        if is_left_within(interval)? {
            return Ok(());
        }
        match source.look(runtime) {
            Ok(next) => {
                seen = next.since(&last);
                (last, trouble) = (next, None);
            }
            Err(error) => trouble = Some(format!("{error:#}")),
        }
    }
}

/// Whether somebody wants to leave before the time is over.
fn is_left_within(interval: Duration) -> Result<bool> {
    let end = Instant::now() + interval;
    while let Some(left) = end.checked_duration_since(Instant::now()) {
        if !event::poll(left)? {
            break;
        }
        let leaves = |key: KeyEvent| match key.code {
            KeyCode::Char('q') | KeyCode::Esc => true,
            KeyCode::Char('c') => key.modifiers.contains(KeyModifiers::CONTROL),
            _ => false,
        };
        if matches!(event::read()?, Event::Key(key) if leaves(key)) {
            return Ok(true);
        }
    }
    Ok(false)
}
