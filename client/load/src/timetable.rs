//! When poses are sent, and what the numbers of poses and contacts say of it.

/// When and how often poses are sent.
#[derive(Clone, Copy, Debug)]
pub struct Timetable {
    /// When the script begins, on the monotonic clock, ns.
    pub start_ns: u64,
    /// Poses a second and tool, Hz.
    pub rate_hz: f64,
    /// When the script ends, s after its start.
    pub duration_s: f64,
}

impl Timetable {
    /// Script time of a tick, s.
    #[must_use]
    pub fn time_of_tick_s(&self, tick: u64) -> f64 {
        tick as f64 / self.rate_hz
    }

    /// When a tick is due, on the monotonic clock, ns: the time of the motion that its poses tell of.
    #[must_use]
    pub fn due_ns(&self, tick: u64) -> u64 {
        self.start_ns + (self.time_of_tick_s(tick) * 1e9) as u64
    }

    /// When the script ends, on the monotonic clock, ns.
    #[must_use]
    pub fn end_ns(&self) -> u64 {
        self.start_ns + (self.duration_s * 1e9) as u64
    }

    /// Sequence number of a tick's poses: 0 means "none yet" on the wire.
    #[must_use]
    pub fn seq_of_tick(tick: u64) -> u64 {
        tick + 1
    }

    /// Tick of a pose by its sequence number; `None` for "none yet".
    #[must_use]
    pub fn tick_of_seq(seq: u64) -> Option<u64> {
        seq.checked_sub(1)
    }
}
