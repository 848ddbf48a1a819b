//! Those who drive tools of a session, and the reports that they read.

use std::sync::Arc;

use tokio::sync::watch;

use super::Session;
use crate::clock::MonotonicClock;
use crate::error::SessionError;
use crate::limits::to_ns;
use crate::pose_check::PoseSample;
use crate::pose_refusal::PoseRefusal;
use crate::step_report::StepReport;
use crate::tool_slot::{DriverId, Loss};

/// One who drives tools of a session. Its end lifts and frees them.
pub struct Driver {
    session: Arc<Session>,
    id: DriverId,
    tools: Vec<usize>,
    reports: watch::Receiver<Arc<StepReport>>,
}

impl Driver {
    /// A driver that is connected and has no tools yet.
    pub(super) fn new(session: Arc<Session>, id: DriverId, reports: watch::Receiver<Arc<StepReport>>) -> Self {
        Self { session, id, tools: Vec::new(), reports }
    }

    /// Its id, as in the echoes of its poses.
    #[must_use]
    pub fn id(&self) -> DriverId {
        self.id
    }

    /// Tools that the driver has claimed.
    #[must_use]
    pub fn tools(&self) -> &[usize] {
        &self.tools
    }

    /// Its session.
    #[must_use]
    pub fn session(&self) -> &Arc<Session> {
        &self.session
    }

    /// Takes more tools, all or none.
    ///
    /// # Errors
    /// A tool is not there or taken.
    pub fn claim(&mut self, tools: &[usize]) -> Result<(), SessionError> {
        self.session.inbox.claim(self.id, tools, MonotonicClock::now_ns())?;
        for &tool in tools {
            if !self.tools.contains(&tool) {
                self.tools.push(tool);
            }
        }
        Ok(())
    }

    /// From now on the reports have models of its tools' contacts, brought up to date `rate_hz` times a second. Without
    /// this they have none, and nobody pays for any.
    pub fn ask_for_models(&self, rate_hz: f64) {
        self.session.inbox.ask_for_models(self.id, &self.tools, to_ns(1.0 / rate_hz));
    }

    /// Where a tool is now.
    ///
    /// # Errors
    /// Why the pose was refused; it has then changed nothing.
    pub fn submit(&self, tool: usize, sample: &PoseSample) -> Result<(), PoseRefusal> {
        self.check_claimed(tool)?;
        self.session.inbox.submit(self.id, tool, sample, MonotonicClock::now_ns())
    }

    /// A tool leaves the scene until its next pose.
    ///
    /// # Errors
    /// The tool is not this driver's.
    pub fn lift(&self, tool: usize) -> Result<(), PoseRefusal> {
        self.check_claimed(tool)?;
        self.session.inbox.lift(self.id, tool, MonotonicClock::now_ns())
    }

    fn check_claimed(&self, tool: usize) -> Result<(), PoseRefusal> {
        let tools = self.session.scene.desc.tools.len();
        if tool >= tools {
            return Err(PoseRefusal::NoTool { tool: tool as u64, tools });
        }
        match self.tools.contains(&tool) {
            true => Ok(()),
            false => Err(PoseRefusal::NotClaimed { tool: tool as u64 }),
        }
    }

    /// Tools that were lost since the last call, and how.
    pub fn take_lost_tools(&self) -> Vec<(usize, Loss)> {
        let lost = |tool: usize| Some((tool, self.session.inbox.take_eviction(self.id, tool)?));
        self.tools.iter().copied().filter_map(lost).collect()
    }

    /// The session's reports since this driver began.
    #[must_use]
    pub fn reports(&self) -> Reports {
        Reports { receiver: self.reports.clone() }
    }

    /// The newest report since this driver began; `None` before the first.
    #[must_use]
    pub fn last_report(&self) -> Option<Arc<StepReport>> {
        // Never marked as seen, so that this stays true from the first report on.
        let reported = self.reports.has_changed().unwrap_or(false);
        reported.then(|| Arc::clone(&self.reports.borrow()))
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        self.session.inbox.disconnect_driver(self.id);
    }
}

/// The reports of a session, latest-wins: who is slow misses some.
pub struct Reports {
    receiver: watch::Receiver<Arc<StepReport>>,
}

impl Reports {
    /// The newest report, once there is one that was not seen; `None` once the session has ended.
    pub async fn next(&mut self) -> Option<Arc<StepReport>> {
        self.receiver.changed().await.ok()?;
        Some(Arc::clone(&self.receiver.borrow_and_update()))
    }
}
