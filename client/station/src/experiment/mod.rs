//! What a hand feels, by the network and by what the station renders: in virtual time with a spring for a server, and
//! through a network that is made worse on purpose with a real one.

pub mod closed_loop;
pub mod network;
pub mod virtual_time;

use std::net::SocketAddr;
use std::path::Path;

/// Plays all of it, draws the plots into a folder and returns the report's text; `loopback` is what was measured before.
///
/// # Errors
/// The server does not answer, or a file cannot be written.
pub fn report(loopback: &str, server: SocketAddr, folder: &Path) -> anyhow::Result<String> {
    let through_a_network = closed_loop::report(server, folder)?;
    let in_virtual_time = virtual_time::report(folder)?;
    Ok(format!("# Haptics\n\nWritten by `make haptics`.\n\n{loopback}{through_a_network}{in_virtual_time}"))
}

/// What is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Rendering {
    /// The server's force as it came, held until the next one.
    Held,
    /// The local model behind the coupling.
    Model,
    /// The same with the passivity observer and controller.
    Passive,
}

impl Rendering {
    const ALL: [Self; 3] = [Self::Held, Self::Model, Self::Passive];

    fn name(self) -> &'static str {
        match self {
            Self::Held => "held force",
            Self::Model => "local model",
            Self::Passive => "local model, passive",
        }
    }
}
