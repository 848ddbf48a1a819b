//! Looks after sessions whose threads hang, tells the log which, and health checks that there are any.
//!
//! The server as a whole goes on serving then: whoever restarts it for one session that hangs ends all the others. So
//! health checks have a name for sessions beside the server's own.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use kerf_session::{Registry, SessionId};
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

/// What a health check asks for to learn whether a session hangs.
pub const SESSIONS: &str = "kerf.sessions";

/// How often sessions are looked at: the log is as exact as this.
const LOOK: Duration = Duration::from_millis(500);

/// Looks after sessions until it is stopped.
pub async fn watch(registry: Arc<Registry>, health: HealthReporter) {
    let mut looks = tokio::time::interval(LOOK);
    let mut hung = BTreeSet::new();
    loop {
        looks.tick().await;
        let hangs = hanging(&registry);
        if hangs.is_empty() != hung.is_empty() {
            let status = if hangs.is_empty() { ServingStatus::Serving } else { ServingStatus::NotServing };
            health.set_service_status(SESSIONS, status).await;
        }
        for session in hangs.difference(&hung) {
            tracing::error!(%session, "the session's thread hangs: it neither steps nor looks after its clients");
        }
        for session in hung.difference(&hangs) {
            tracing::warn!(%session, "the session's thread goes on, or the session is gone");
        }
        hung = hangs;
    }
}

fn hanging(registry: &Registry) -> BTreeSet<SessionId> {
    registry.list().iter().filter(|session| session.watched().hangs).map(|session| session.id()).collect()
}
