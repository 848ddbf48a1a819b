//! Limits that a run is held to, for tests and CI.

use clap::Args;

/// Limits; what is not given is not checked, except that replicas have to match.
#[derive(Clone, Debug, Default, Args)]
pub struct LimitArgs {
    /// Greatest 99th percentile of the round trip, ms
    #[arg(long, value_name = "MS")]
    pub max_p99_ms: Option<f64>,
    /// Greatest fraction of the server's steps that may be late, 0 to 1
    #[arg(long, value_name = "SHARE")]
    pub max_late_step_share: Option<f64>,
    /// Greatest fraction of the poses that may be sent late or be left out, 0 to 1
    #[arg(long, value_name = "SHARE")]
    pub max_late_send_share: Option<f64>,
    /// Least contacts a second, Hz
    #[arg(long, value_name = "HZ")]
    pub min_contact_rate: Option<f64>,
    /// Most messages that may not fit a replica
    #[arg(long, value_name = "COUNT", default_value_t = 0)]
    pub max_mismatches: u64,
}
