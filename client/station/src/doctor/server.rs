//! The server.

use super::{Finding, Outcome};
use crate::config::ServerConfig;
use crate::link::probe;

/// Whether it answers, how fast, and whether it speaks our protocol.
pub fn finding(config: &ServerConfig) -> Finding {
    let subject = format!("server {}", config.url);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let answer = runtime.map_err(|error| error.to_string()).and_then(|runtime| runtime.block_on(probe(config)));
    match answer {
        Err(why) => Finding::other(
            Outcome::Bad,
            subject,
            why,
            "start a server (`kerf-server serve`), or set server.url to where one is",
        ),
        Ok(found) => match found.version {
            Err(why) => Finding::other(Outcome::Bad, subject, why, "use a station and a server of the same release"),
            Ok(version) => Finding::good(
                subject,
                format!(
                    "speaks protocol {version}, answers in {:.1} ms, knows {} scenes",
                    1e3 * found.round_trip.as_secs_f64(),
                    found.scenes.len()
                ),
            ),
        },
    }
}
