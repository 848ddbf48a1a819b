//! Logging. A log is never worth a session: lines go to standard error by a thread of their own, and those that nobody
//! reads, or that cannot be written, are left out.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::io::{self, IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use anyhow::{Context, Result};
use kerf_session::TRACES;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer};

use crate::config::{LogFormat, ServerConfig};
use crate::traces::Traces;

/// Lines that wait to be written: what a busy server says in a minute. More only takes memory while nobody reads.
const MAX_LINES: usize = 1024;
/// Most time that the last lines get at the end: a reader that is there takes them at once.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// What is told of the server while it runs; its end writes and sends what waits.
pub struct Telemetry {
    /// Ends before the log, which has what becomes of it.
    _traces: Option<Traces>,
    _log: Log,
}

/// Logs to standard error from now on, panics too, and sends traces where the configuration says so.
///
/// # Errors
/// The filter is none, the system gives no thread, certificates cannot be read, or the process logs already.
pub fn init(config: &ServerConfig) -> Result<Telemetry> {
    let filter = EnvFilter::try_new(&config.log.filter);
    let filter = filter.with_context(|| format!("log.filter = {:?}", config.log.filter))?;
    // Spans that are traced would stand before each line that is written within them.
    let filter = filter.add_directive(format!("{TRACES}=off").parse()?);
    let traces = Traces::begin(&config.traces)?;
    let (log, lines) = Log::begin(io::stderr())?;
    let layer = tracing_subscriber::fmt::layer();
    // Colours are for terminals, not for journald, an engine's log or a file; `NO_COLOR` the layer asks for itself.
    let layer = if io::stderr().is_terminal() { layer } else { layer.with_ansi(false) };
    let writer = layer.with_writer(move || lines.clone());
    let writer = match config.log.format {
        LogFormat::Text => writer.boxed(),
        LogFormat::Json => writer.json().boxed(),
    };
    let subscriber = tracing_subscriber::registry().with(traces.as_ref().map(Traces::layer));
    let started = subscriber.with(writer.with_filter(filter)).try_init();
    started.map_err(|error| anyhow::anyhow!("log: {error}"))?;
    std::panic::set_hook(Box::new(|panic| {
        let (thread, backtrace) = (std::thread::current(), Backtrace::capture());
        let backtrace = (backtrace.status() == BacktraceStatus::Captured).then_some(backtrace);
        tracing::error!(thread = thread.name(), backtrace = backtrace.map(tracing::field::display), "{panic}");
    }));
    Ok(Telemetry { _traces: traces, _log: log })
}

/// A log that is written.
struct Log {
    lines: SyncSender<Entry>,
    written: Receiver<()>,
}

enum Entry {
    Line(Vec<u8>),
    /// Nothing comes after it.
    End,
}

impl Log {
    /// A log whose lines go to `sink`, and what takes them.
    fn begin(sink: impl Write + Send + 'static) -> Result<(Self, Lines)> {
        let (lines, waiting) = sync_channel(MAX_LINES);
        let (end, written) = sync_channel(1);
        let lost = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&lost);
        let run = move || {
            write_all(sink, &waiting, &counted);
            // Whoever waited may have gone.
            let _ = end.send(());
        };
        std::thread::Builder::new().name("kerf-log".into()).spawn(run).context("no thread for the log")?;
        Ok((Self { lines: lines.clone(), written }, Lines { lines, lost }))
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        // Where there is no room nobody reads.
        if self.lines.try_send(Entry::End).is_ok() {
            let _ = self.written.recv_timeout(LAST_WORDS);
        }
    }
}

fn write_all(mut sink: impl Write, waiting: &Receiver<Entry>, lost: &AtomicU64) {
    while let Ok(Entry::Line(line)) = waiting.recv() {
        if sink.write_all(&line).is_err() {
            // A log that is full or closed takes the next one, or none.
            lost.fetch_add(1, Ordering::Relaxed);
            continue;
        }
        match lost.swap(0, Ordering::Relaxed) {
            0 => {}
            lines => tracing::warn!(lines, "the log was full or not read in time: lines of it are lost"),
        }
    }
}

/// Takes lines and never waits.
#[derive(Clone)]
struct Lines {
    lines: SyncSender<Entry>,
    lost: Arc<AtomicU64>,
}

impl Write for Lines {
    /// Takes a whole line, or loses it.
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        if self.lines.try_send(Entry::Line(line.to_vec())).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    /// A log that is read as soon as this is unlocked.
    #[derive(Clone, Default)]
    struct Reader(Arc<Mutex<Vec<u8>>>);

    impl Write for Reader {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn lines_that_nobody_reads_are_lost_and_counted_and_those_before_are_written_at_the_end() {
        let reader = Reader::default();
        let (log, mut lines) = Log::begin(reader.clone()).unwrap();
        let unread = reader.0.lock().unwrap();
        for _ in 0..2 * MAX_LINES {
            lines.write_all(b"line\n").unwrap();
        }
        // One is being written, and the others wait.
        let lost = lines.lost.load(Ordering::Relaxed) as usize;
        assert!((MAX_LINES - 1..=MAX_LINES).contains(&lost), "{lost}");
        drop(unread);
        // Until they are told of, and there is room for another.
        while lines.lost.load(Ordering::Relaxed) > 0 || reader.0.lock().unwrap().len() < MAX_LINES {
            std::thread::yield_now();
        }
        lines.write_all(b"last\n").unwrap();
        drop(log);
        assert!(reader.0.lock().unwrap().ends_with(b"line\nlast\n"));
    }

    #[test]
    fn a_log_without_a_reader_ends_without_it() {
        let reader = Reader::default();
        let (log, mut lines) = Log::begin(reader.clone()).unwrap();
        let _unread = reader.0.lock().unwrap();
        lines.write_all(b"line\n").unwrap();
        drop(log);
    }
}
