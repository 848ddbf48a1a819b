//! How a session begins, and whose it is.

use kerf_physics::making::Making;
use kerf_physics::scene::DialDesc;
use tokio::sync::watch;

/// Whose a session is. Who lets clients in judges by it; the session does not.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Owner {
    /// The name of whoever created it.
    pub name: String,
    /// It is nobody else's business.
    pub is_private: bool,
}

/// How a session begins.
#[derive(Clone, Debug, Default)]
pub struct SessionOptions {
    /// All that it does goes onto a tape, which [`crate::Session::take_reel`] gives out.
    pub is_recorded: bool,
    /// All that brings it back goes onto a tape, which [`crate::Session::take_journal`] gives out.
    pub is_journaled: bool,
    /// It takes its first step only when it is resumed.
    pub start_paused: bool,
    /// Goes before what the scene asks of the dial.
    pub dial: Option<DialDesc>,
    /// Whose it is; `None`: nobody's. One that a journal brings back is whose it was.
    pub owner: Option<Owner>,
    /// Is told how far its scene is that is being made.
    pub making: watch::Sender<Option<Making>>,
}
