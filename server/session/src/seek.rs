//! Where a recording that is played is, and where it is to go.

/// Where to go and how fast to go on; absent: as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seek {
    /// Time since the recording began, s.
    pub time_s: Option<f64>,
    /// Times the speed of its making.
    pub speed: Option<f64>,
}

/// Where a recording that is played is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// Time since the recording began, s.
    pub time_s: f64,
    /// Its length, s.
    pub length_s: f64,
    /// Times the speed of its making.
    pub speed: f64,
    /// Step that is shown.
    pub step: u64,
}
