//! A log that nobody reads, or that takes nothing, costs no session; what it says of refused connections.

use std::fs::File;
use std::io::Read;
use std::net::TcpStream;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use super::process::{Process, soon};

/// Steps that a session goes on by: a second of them.
const STEPS: u64 = 500;

/// Logs more than a pipe holds, checks that a session lives on meanwhile, and says how the server ends.
async fn survives(mut process: Process) -> ExitStatus {
    let session_id = process.create().await.session.unwrap().session_id;
    for _ in 0..3 {
        let step = process.until(&session_id, |_| true).await.step;
        process.until(&session_id, |described| described.step > step + STEPS).await;
        process.create().await;
    }
    process.stop()
}

/// Everything, so that each call says kilobytes.
const ALL: [&str; 2] = ["--log-filter", "trace"];

#[tokio::test(flavor = "multi_thread")]
async fn a_log_that_nobody_reads_stops_neither_sessions_nor_the_way_out() {
    let (unread, stderr) = std::io::pipe().unwrap();
    assert!(survives(Process::serve(&ALL, stderr).await).await.success());
    drop(unread);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_log_whose_reader_has_gone_stops_neither_sessions_nor_the_way_out() {
    let (reader, stderr) = std::io::pipe().unwrap();
    drop(reader);
    assert!(survives(Process::serve(&ALL, stderr).await).await.success());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_log_on_a_full_disk_stops_neither_sessions_nor_the_way_out() {
    let full = File::options().write(true).open("/dev/full").unwrap();
    assert!(survives(Process::serve(&ALL, Stdio::from(full)).await).await.success());
}

#[tokio::test(flavor = "multi_thread")]
async fn refused_connections_are_told_once_with_the_limit_that_was_in_the_way() {
    let log = tempfile::NamedTempFile::new().unwrap();
    let set = ["--set", "transport.max_connections_per_peer=2"];
    let process = Process::serve(&set, log.reopen().unwrap()).await;
    let open: Vec<_> = (0..8).map(|_| TcpStream::connect(process.address).unwrap()).collect();
    // Accepted in their order: the last one is closed once all were looked at.
    soon("the end of the last", async {
        let mut last = &open[7];
        last.set_nonblocking(true).unwrap();
        while !matches!(last.read(&mut [0]), Ok(0)) {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    })
    .await;
    // It is written by a thread of its own.
    let said = soon("the line in the log", async {
        loop {
            let said = std::fs::read_to_string(log.path()).unwrap();
            if said.contains("a connection was refused") && said.ends_with('\n') {
                break said;
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    })
    .await;
    let lines: Vec<&str> = said.lines().filter(|line| line.contains("a connection was refused")).collect();
    assert!(matches!(lines[..], [line] if line.contains("transport.max_connections_per_peer")), "{said}");
    assert!(!said.contains('\u{1b}'), "colours are for terminals: {said:?}");
}
