//! Two looks at a server, and what happened between them.

use std::time::Instant;

use kerf_proto::v1;

/// A look at a server.
pub struct Sample {
    /// When it was taken.
    pub at: Instant,
    /// What the server told.
    pub listed: v1::ListSessionsResponse,
}

/// What happened between two looks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    pub server: v1::ServerVitals,
    pub sessions: Vec<SessionSeen>,
}

/// The same of one session. What was counted is of the time between the looks where there are two, what it has is of now.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SessionSeen {
    pub id: String,
    pub scene: String,
    pub state: String,
    /// Steps taken over those that its rate asks for; `None` where it stands, or was not there before.
    pub kept: Option<f64>,
    /// Share of steps that were late; `None` where none was taken.
    pub late: Option<f64>,
    /// Mean time of a step, ms.
    pub step_ms: Option<f64>,
    /// The session's account of itself.
    pub vitals: v1::SessionVitals,
    /// Its journal; `None` where none is kept.
    pub journal: Option<v1::Journal>,
}

impl Sample {
    /// What happened since the sample before.
    pub fn since(&self, before: &Self) -> Seen {
        let elapsed_s = self.at.duration_since(before.at).as_secs_f64();
        let session = |now: &v1::SessionInfo| {
            let then = before.listed.sessions.iter().find(|then| then.session_id == now.session_id);
            seen(now, then.and_then(|then| then.vitals), elapsed_s)
        };
        Seen {
            server: self.listed.server.clone().unwrap_or_default(),
            sessions: self.listed.sessions.iter().map(session).collect(),
        }
    }
}

fn seen(now: &v1::SessionInfo, then: Option<v1::SessionVitals>, elapsed_s: f64) -> SessionSeen {
    let vitals = now.vitals.unwrap_or_default();
    let state = match (vitals.hangs, now.is_replay, now.state()) {
        (true, ..) => "HANGS".into(),
        (_, true, _) => "replay".into(),
        (.., state) => state.as_str_name().trim_start_matches("SESSION_STATE_").to_lowercase(),
    };
    let is_running = now.state() == v1::SessionState::Running && !now.is_replay;
    let share = |part: f64, whole: f64| (whole > 0.0).then(|| part / whole);
    let since = then.map(|then| {
        let steps = vitals.steps.saturating_sub(then.steps) as f64;
        let late = vitals.late_steps.saturating_sub(then.late_steps) as f64;
        let kept = share(steps, vitals.step_rate_hz * elapsed_s).filter(|_| is_running);
        (kept, share(late, steps), share(1e3 * (vitals.busy_s - then.busy_s), steps))
    });
    let (kept, late, step_ms) = since.unwrap_or_default();
    let (id, scene, journal) = (now.session_id.clone(), now.scene_name.clone(), now.journal.clone());
    SessionSeen { id, scene, state, kept, late, step_ms, vitals, journal }
}

#[cfg(test)]
pub mod tests {
    use std::time::Duration;

    use super::*;

    /// A session of 100 Hz that took half of its steps in the last two seconds, a fifth of them late.
    pub fn sampled() -> Seen {
        let info = |steps, late_steps, busy_s| v1::SessionInfo {
            session_id: "session-1a2b-1".into(),
            scene_name: "liver".into(),
            state: v1::SessionState::Running.into(),
            vitals: Some(v1::SessionVitals {
                step_rate_hz: 100.0,
                steps,
                late_steps,
                busy_s,
                longest_step_s: 0.031,
                viewers: 3,
                faults: 1,
                parted_links: 1234,
                memory_bytes: 41 << 20,
                ..Default::default()
            }),
            journal: Some(v1::Journal::default()),
            ..Default::default()
        };
        let server = Some(v1::ServerVitals {
            version: "0.1.0".into(),
            resident_memory_bytes: 200 << 20,
            max_sessions: 8,
            expected_sessions: 0,
        });
        let of = |sessions| v1::ListSessionsResponse { sessions, server: server.clone(), ..Default::default() };
        let at = Instant::now();
        let before = Sample { at, listed: of(vec![info(500, 7, 2.0)]) };
        let journal = Some(v1::Journal { error: "the disk is full".into() });
        let newcomer = v1::SessionInfo { session_id: "session-1a2b-2".into(), journal, ..info(40, 0, 0.1) };
        let listed = of(vec![info(600, 27, 3.5), newcomer]);
        Sample { at: at + Duration::from_secs(2), listed }.since(&before)
    }

    #[test]
    fn rates_are_of_the_time_between_two_looks_and_unknown_of_newcomers() {
        let seen = sampled();
        let [session, newcomer] = &seen.sessions[..] else { panic!("two sessions") };
        assert_eq!((session.kept, session.late), (Some(0.5), Some(0.2)));
        assert!((session.step_ms.unwrap() - 15.0).abs() < 1e-9);
        assert_eq!((newcomer.kept, newcomer.late, newcomer.step_ms), (None, None, None));
    }

    #[test]
    fn one_that_stands_keeps_no_rate_and_one_that_hangs_says_so() {
        let vitals = v1::SessionVitals { step_rate_hz: 100.0, hangs: true, ..Default::default() };
        let info =
            v1::SessionInfo { state: v1::SessionState::Paused.into(), vitals: Some(vitals), ..Default::default() };
        let seen = seen(&info, info.vitals, 1.0);
        assert_eq!((seen.state.as_str(), seen.kept, seen.late), ("HANGS", None, None));
    }
}
