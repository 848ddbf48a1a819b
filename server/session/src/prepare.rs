//! What precedes the building of a session: its scene is read, set by the dial, judged and admitted.

use std::sync::Arc;

use kerf_physics::SoundScene;
use kerf_scenes::cost::Cost;
use kerf_scenes::dial::{Choice, ParetoFronts};
use tokio::sync::OwnedSemaphorePermit;

use crate::admission::{Admission, Admitted};
use crate::error::SessionError;
use crate::limits::SessionLimits;
use crate::past::Past;
use crate::session_options::SessionOptions;

/// What a session that is being made holds.
pub(crate) struct Permits {
    /// To be one of the server's sessions; until its end.
    pub slot: OwnedSemaphorePermit,
    /// To be one of those that are built now.
    pub build: OwnedSemaphorePermit,
}

/// A scene that a session may be built of.
pub(crate) struct Prepared {
    pub scene: SoundScene,
    /// What has happened to it already.
    pub past: Option<Past>,
    pub choice: Option<Choice>,
    pub admitted: Admitted,
    pub permits: Permits,
}

/// Sets a scene by the dial, estimates what it costs and takes that from what is left. Takes milliseconds to
/// seconds, on a thread that may wait.
pub(crate) fn prepare(
    (scene, past): (SoundScene, Option<Past>),
    options: &SessionOptions,
    limits: &SessionLimits,
    pareto_fronts: &ParetoFronts,
    admission: &Arc<Admission>,
    permits: Permits,
) -> Result<Prepared, SessionError> {
    // The dial had its say when the session was created.
    let (scene, choice) = if past.is_some() { (scene, None) } else { pareto_fronts.settle(scene, options.dial)? };
    let rate_hz = scene.desc.rate_hz;
    if !(1.0..=limits.max_rate_hz).contains(&rate_hz) {
        return Err(SessionError::Rate { rate_hz, limit_hz: limits.max_rate_hz });
    }
    let stands = past.as_ref().map_or(options.start_paused, Past::stands);
    let admitted = admission.admit(&Cost::of(&scene)?, rate_hz, stands)?;
    Ok(Prepared { scene, past, choice, admitted, permits })
}
