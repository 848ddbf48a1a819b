//! How many poses a driver may send.

use std::time::Instant;

use kerf_proto::v1;

use crate::config::setting;

/// Poses that may come at once, s of the rate: what a network held up for so long comes together.
const BURST_S: f64 = 1.0;

/// What is left of a driver's poses; it fills up at the rate that the driver was granted.
#[derive(Debug)]
pub struct PoseBudget {
    rate_hz: f64,
    tools: f64,
    left: f64,
    told: Instant,
}

impl PoseBudget {
    /// For a driver of `tools` tools that may send `rate_hz` poses a second and tool.
    pub fn new(rate_hz: f64, tools: usize, now: Instant) -> Self {
        let tools = tools as f64;
        Self { rate_hz, tools, left: rate_hz * tools * BURST_S, told: now }
    }

    /// Takes one pose; refuses it where the driver has sent too many.
    pub fn take(&mut self, tool_id: u32, seq: u64, now: Instant) -> Result<(), v1::PoseRejected> {
        let per_s = self.rate_hz * self.tools;
        let gained = now.saturating_duration_since(self.told).as_secs_f64() * per_s;
        self.told = now;
        self.left = (self.left + gained).min(per_s * BURST_S);
        if self.left < 1.0 {
            let name = setting!(control.max_pose_rate_hz);
            let limit = format!("at most {} poses a second and tool ({name})", self.rate_hz);
            return Err(v1::PoseRejected { tool_id, seq, field: "pose".into(), limit });
        }
        self.left -= 1.0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_burst_is_taken_and_the_rate_is_kept_thereafter() {
        let begin = Instant::now();
        let mut budget = PoseBudget::new(100.0, 2, begin);
        let mut taken = |after_s: f64, poses: u64| {
            let now = begin + Duration::from_secs_f64(after_s);
            (0..poses).filter(|seq| budget.take(0, *seq, now).is_ok()).count()
        };
        assert_eq!(taken(0.0, 500), 200);
        assert_eq!(taken(0.5, 500), 100);
        assert_eq!(taken(60.0, 500), 200);
    }
}
