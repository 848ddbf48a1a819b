//! What sessions do and what waits in them.

use std::fmt;
use std::sync::Arc;

use kerf_physics::Stage;
use kerf_session::{Counts, Phase, Registry, Session, Watched};
use prometheus_client::registry::Unit::{Bytes, Joules, Seconds};

use super::page::Page;

/// What a session is doing, as a label has it.
fn state(phase: &Phase) -> &'static str {
    match phase {
        Phase::Running => "running",
        Phase::Paused => "paused",
        Phase::Failed { .. } => "failed",
        Phase::Closing => "closing",
    }
}

const STATES: [&str; 4] = ["running", "paused", "failed", "closing"];

pub fn write(page: &mut Page<'_>, registry: &Registry) -> fmt::Result {
    let sessions: Vec<_> = registry.list().into_iter().map(|session| (session.watched(), session)).collect();
    present(page, registry, &sessions)?;
    waiting(page, &sessions)?;
    by_session(page, &sessions)?;
    steps(page, registry.counts())?;
    work(page, registry.counts())?;
    energy_and_faults(page, registry.counts())
}

type Seen = (Watched, Arc<Session>);

fn sum(sessions: &[Seen], of: impl Fn(&Watched) -> usize) -> u64 {
    sessions.iter().map(|(watched, _)| of(watched) as u64).sum()
}

fn present(page: &mut Page<'_>, registry: &Registry, sessions: &[Seen]) -> fmt::Result {
    let count = |of| sum(sessions, |watched| usize::from(state(&watched.phase) == of));
    page.gauges(("sessions", None, "Sessions, by what they do."), "state", STATES.map(|of| (of, count(of))))?;
    let hanging = sum(sessions, |watched| usize::from(watched.hangs));
    let help = "Sessions whose thread has stayed away for longer than session.hangs_after_s, though it should step.";
    page.gauge(("sessions_hanging", None, help), hanging)?;
    let limit = registry.limits().max_sessions;
    page.gauge(("sessions_limit", None, "Sessions that there may be (session.max_sessions)."), limit)?;
    let help = "Memory of sessions and their checkpoints, as it was estimated before they were built.";
    page.gauge(("sessions_memory", Some(Bytes), help), registry.taken_memory_bytes())?;
    let limit_bytes = registry.limits().max_memory_mib.map_or(f64::INFINITY, |mib| mib * 1048576.0);
    let help = "What kerf_sessions_memory_bytes may come to (session.max_memory_mib).";
    page.gauge(("sessions_memory_limit", Some(Bytes), help), limit_bytes)?;
    page.gauge(("viewers", None, "Viewers of all sessions."), sum(sessions, |watched| watched.viewers))?;
    let help = "Drivers of all sessions: control streams, and clients that send poses one call at a time.";
    page.gauge(("drivers", None, help), sum(sessions, |watched| watched.drivers))
}

fn waiting(page: &mut Page<'_>, sessions: &[Seen]) -> fmt::Result {
    let help = "Inbox: commands that wait for the next tick of their session.";
    page.gauge(("inbox_commands", None, help), sum(sessions, |watched| watched.waiting_commands))?;
    let help = "Outbox: patches of structure that are kept for viewers who are behind.";
    page.gauge(("outbox_patches", None, help), sum(sessions, |watched| watched.kept_patches))?;
    let help = "Outbox: what those patches hold.";
    page.gauge(("outbox_patches", Some(Bytes), help), sum(sessions, |watched| watched.kept_patch_bytes))?;
    let help = "Sessions in which a viewer waits for a keyframe that is yet to be taken.";
    page.gauge(("pending_keyframes", None, help), sum(sessions, |watched| usize::from(watched.awaits_keyframe)))
}

/// The few that name a session. Nobody is to learn of private ones here.
fn by_session(page: &mut Page<'_>, sessions: &[Seen]) -> fmt::Result {
    let is_told = |session: &Session| session.owner().is_none_or(|owner| !owner.is_private);
    let told: Vec<_> = sessions
        .iter()
        .filter(|(_, session)| is_told(session))
        .map(|(watched, session)| (session.id().to_string(), watched, session))
        .collect();
    let help = "Time of the session's steps over the time that they have, of the last second; above 1 steps are late.";
    page.gauges(
        ("session_load_ratio", None, help),
        "session",
        told.iter().map(|(id, _, session)| (id, session.load())),
    )?;
    let help = "Since the session's thread last came by, to step or to look after its clients.";
    page.gauges(
        ("session_away", Some(Seconds), help),
        "session",
        told.iter().map(|(id, watched, _)| (id, watched.away_ns as f64 * 1e-9)),
    )?;
    let help = "Energy since the session's scene was at rest that its ledger does not explain.";
    page.gauges(
        ("session_residual", Some(Joules), help),
        "session",
        told.iter().map(|(id, watched, _)| (id, watched.done.residual_j)),
    )
}

fn steps(page: &mut Page<'_>, counts: &Counts) -> fmt::Result {
    let help = "Time of steps: paced ones have a deadline, called ones a client asks for one after the other.";
    let steps = [("paced", &counts.paced_steps), ("called", &counts.called_steps)];
    page.durations(("step", help), "kind", &steps)?;
    let help = "How long after their deadline late steps ended; the count is that of late steps.";
    page.durations(("step_lag", help), "kind", &[("paced", &counts.lags)])?;
    let help = "Time of steps by stage; surfaces for viewers are made beside steps, and not in it.";
    let stages = Stage::ALL.into_iter().filter(|stage| !matches!(stage, Stage::Surface | Stage::Adaptation));
    let stages = stages.map(|stage| (stage.name(), counts.stage_ns[stage as usize].get() as f64 * 1e-9));
    page.counters(("step_stage", Some(Seconds), help), "stage", stages)?;
    let help = "Times that a session gave up time that it had lost, as it was later than session.max_lag_s.";
    page.counter(("reanchors", None, help), counts.reanchors.get())
}

fn work(page: &mut Page<'_>, counts: &Counts) -> fmt::Result {
    let help = "Steps whose work was bounded so that they keep their deadlines.";
    page.counter(("budgeted_steps", None, help), counts.budgeted_steps.get())?;
    let help = "Work that budgeted steps might do, in units that do not depend on the machine.";
    page.counter(("step_budget_work_units", None, help), counts.budget_units.get())?;
    page.counter(("step_work_units", None, "Work that budgeted steps did."), counts.work_units.get())?;
    let help = "Budgeted steps that the bound cut short: what was left of them waited for the next one.";
    page.counter(("cut_short_steps", None, help), counts.cut_short_steps.get())?;
    let help = "Steps with a solve that did not get to its tolerance, though it was taken up again.";
    page.counter(("unconverged_steps", None, help), counts.unconverged_steps.get())?;
    let help = "Steps after which contacts were still to change, though their work was not used up.";
    page.counter(("unsettled_steps", None, help), counts.unsettled_steps.get())?;
    page.counter(("parted_links", None, "Links between voxels that parted."), counts.parted_links.get())
}

fn energy_and_faults(page: &mut Page<'_>, counts: &Counts) -> fmt::Result {
    let help = "Energy that the ledgers of steps do not explain, as a sum of magnitudes.";
    page.counter(("energy_residual", Some(Joules), help), counts.residual.get_j())?;
    let help = "Work of tools on tissue, as a sum of magnitudes, to compare kerf_energy_residual_joules_total with.";
    page.counter(("tool_work", Some(Joules), help), counts.tool_work.get_j())?;
    let faults = &counts.faults;
    let kinds = [
        ("node_state", &faults.node_state),
        ("tool_wrench", &faults.tool_wrench),
        ("energy", &faults.energy),
        ("panic", &faults.panic),
    ];
    let help =
        "State that was not finite or had energy from nowhere and was taken back; and panics, which fail a session.";
    page.counters(("faults", None, help), "kind", kinds.map(|(kind, count)| (kind, count.get())))
}
