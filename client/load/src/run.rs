//! A run from connecting to the report.

use std::fs::File;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, ensure};
use futures_util::future::try_join_all;
use kerf_access::Wire;
use kerf_proto::v1;
use kerf_proto::v1::create_session_request::Dial;
use kerf_replica::{Surface, glb};
use nalgebra::Vector3;
use tokio::sync::{oneshot, watch};

use crate::args::{Args, ProgressMode, StrokeArgs};
use crate::clock;
use crate::control::{self, Receiver};
use crate::fleet::{self, Fleet, watch_resting};
use crate::metrics::ContactMetrics;
use crate::progress::{self, Progress};
use crate::report::{Report, Run, Sessions};
use crate::script::strokes::{self, Target};
use crate::script::{self, Script};
use crate::sender::{self, SendTotals};
use crate::session::{self, Session, Wishes};
use crate::setting::{self, Setting};
use crate::timetable::Timetable;
use crate::viewer::{self, SharedTotals, ViewTotals};
use crate::wire;

/// From the opening of the streams to the first pose: threads have to start.
const LEAD_NS: u64 = 100_000_000;
/// From the last pose until the streams are left: answers to the last poses come in.
const SETTLE: Duration = Duration::from_millis(300);
/// How much faster than the server's limit a script may not be, rounding of the wire included.
const SPEED_MARGIN: f64 = 0.999;

/// Longest trial of a setting, s of the script: the first contact, the first cut and what follows.
const TRIAL_S: f64 = 4.0;

/// What a run leaves.
pub struct Finished {
    /// The report, limits checked.
    pub report: Report,
    /// Every contact.
    pub contacts: ContactMetrics,
    /// The objects with their surfaces at the end, as the first viewer's replica has them.
    pub objects: Vec<glb::Object>,
}

/// Runs scripts against a server. Ends when the last script does, at `--duration` or at Ctrl-C.
///
/// # Errors
/// No server, no session, a script that cannot be run there, or a stream that broke.
pub async fn run(args: &Args) -> anyhow::Result<Finished> {
    let channel =
        session::connect(&args.server, &args.access, Duration::from_secs_f64(args.wait_for_server.clamp(0.0, 3600.0)))
            .await?;
    let candidates = setting::candidates(&args.levels, &args.step_rates);
    let chosen = setting::choose(candidates, async |setting| late_share(args, &channel, setting).await).await?;
    let fleet = Fleet::open(args, &channel, wishes(args, chosen)).await?;
    if let Some(dial) = &fleet.sessions[0].description.dial {
        eprintln!("{}", session::dial_text(dial));
    }
    drive_and_close(args, &channel, &fleet).await
}

fn wishes(args: &Args, setting: Option<Setting>) -> Wishes {
    let level = setting.and_then(|setting| setting.level).map(Dial::Level);
    Wishes { dial: level.or(args.dial.asked()), step_rate_hz: setting.map(|setting| setting.rate_hz) }
}

/// Fraction of late steps in a trial session.
async fn late_share(args: &Args, channel: &Wire, setting: Setting) -> anyhow::Result<f64> {
    let args = Args {
        duration: Some(f64::min(TRIAL_S, args.duration.unwrap_or(f64::INFINITY))),
        progress: ProgressMode::Off,
        keep_session: false,
        sessions: 1,
        ..args.clone()
    };
    let fleet = Fleet::open(&args, channel, wishes(&args, Some(setting))).await?;
    Ok(drive_and_close(&args, channel, &fleet).await?.report.server.steps.late_step_share)
}

/// Drives sessions, and ends those that were created for it.
async fn drive_and_close(args: &Args, channel: &Wire, fleet: &Fleet) -> anyhow::Result<Finished> {
    let outcome = drive_all(args, fleet).await;
    if !args.keep_session {
        let closed = fleet.close(channel).await;
        // What went wrong first is what the user wants to read.
        if outcome.is_ok() {
            closed?;
        }
    }
    outcome
}

/// Drives some of the sessions, watches all, and sums up.
async fn drive_all(args: &Args, fleet: &Fleet) -> anyhow::Result<Finished> {
    let (driven, resting) = fleet.split(args.stations);
    let (end, over) = watch::channel(false);
    let driving = async {
        let stations = driven.iter().enumerate().map(|(index, session)| {
            // Others go their own ways, and the first one alone is told of while it goes on.
            let seed = args.strokes.seed.wrapping_add(index as u64);
            let progress = if index == 0 { args.progress } else { ProgressMode::Off };
            drive(Args { strokes: StrokeArgs { seed, ..args.strokes.clone() }, progress, ..args.clone() }, session)
        });
        let driven = try_join_all(stations).await;
        // Where one fails the others' threads end too.
        let _ = end.send(true);
        driven
    };
    let (parts, watched) = tokio::try_join!(driving, watch_resting(args, resting, over))?;
    let session = &fleet.sessions[0];
    let stations = parts.len() as u32;
    let mut parts = parts.into_iter();
    let mut all = parts.next().context("at least one session is driven")?;
    for part in parts {
        all.driven.add(&part.driven);
        all.view.add(&part.view);
        all.watched_s = f64::max(all.watched_s, part.watched_s);
    }
    let run = Run {
        server_address: &args.server,
        scene: &session.scene.name,
        session_id: &session.description.session_id,
        sessions: Sessions::of(args, (stations, resting.len() as u32), &fleet.refusals, &watched),
        step_rate_hz: 1.0 / session.scene.dt_s,
        script: describe(args),
        duration_s: f64::min(all.duration_s, all.driven.sent_for_s),
        watched_s: all.watched_s,
        interrupted: all.driven.interrupted,
        viewers: args.viewers * stations,
        reference_n: all.reference_n,
        sent: all.driven.sent,
        contacts: &all.driven.contacts,
        view: &all.view,
    };
    let mut report = Report::of(&run);
    report.limits_exceeded = report.exceeded(&args.limits);
    let told = session.scene.objects.iter().zip(all.surfaces);
    let objects = told.map(|(object, surface)| glb::Object::of(object, surface)).collect();
    Ok(Finished { report, objects, contacts: all.driven.contacts })
}

/// What came of a session that was driven.
struct Part {
    driven: Driven,
    view: ViewTotals,
    /// How long the script was to take, s.
    duration_s: f64,
    watched_s: f64,
    reference_n: Option<f64>,
    surfaces: Vec<Surface>,
}

/// Drives a session over a connection of its own, as a station has one.
async fn drive(args: Args, session: &Session) -> anyhow::Result<Part> {
    let channel = session::connect(&args.server, &args.access, Duration::ZERO).await?;
    let session_id = &session.description.session_id;
    let request = fleet::view_request(&args, session);
    let surfaces = viewer::first_surfaces(channel.clone(), request.clone()).await?;
    let script = Arc::new(make_script(&args, &session.scene, &surfaces)?);
    check_speed(&script, session.description.limits.as_ref())?;
    let duration_s = f64::min(script.duration_s(), args.duration.unwrap_or(f64::INFINITY));

    let tool_ids = script.tracks.iter().map(|track| track.tool_id).collect();
    let contact_rate_hz = args.contact_rate.unwrap_or(args.rate);
    let control = control::open(channel, session_id, tool_ids, contact_rate_hz).await?;
    let totals = SharedTotals::default();
    let (stop_viewers, stop) = watch::channel(false);
    let watched_from_ns = clock::now_ns();
    let viewers =
        viewer::spawn((args.server.clone(), args.access.clone()), request, args.viewers, totals.clone(), stop)?;

    let timetable = Timetable { start_ns: clock::now_ns() + LEAD_NS, rate_hz: args.rate, duration_s };
    let progress = Progress::new(args.progress, duration_s);
    let mut driving = pin!(exchange(control, &script, timetable, progress, &totals));
    let mut viewing = pin!(fleet::join(viewers));
    let mut viewed = None;
    let driven = loop {
        tokio::select! {
            driven = &mut driving => break driven,
            // Where a viewer fails nobody is left to see what is driven.
            outcome = &mut viewing, if viewed.is_none() => viewed = Some(outcome?),
        }
    };
    // Viewers are told to stop before any error is handed on: their thread ends in each case.
    let _ = stop_viewers.send(true);
    let viewed = match viewed {
        Some(viewed) => Ok(viewed),
        None => viewing.await,
    };
    Ok(Part {
        driven: driven?,
        view: viewer::snapshot(&totals),
        duration_s,
        watched_s: (clock::now_ns() - watched_from_ns) as f64 * 1e-9,
        reference_n: steady_cut_n(&session.scene, &script),
        surfaces: viewed?,
    })
}

/// What came of the driver's stream.
struct Driven {
    sent: SendTotals,
    contacts: ContactMetrics,
    sent_for_s: f64,
    interrupted: bool,
}

impl Driven {
    /// Adds what came of another driver's stream.
    fn add(&mut self, other: &Self) {
        self.sent.add(&other.sent);
        self.contacts.add(&other.contacts);
        self.sent_for_s = f64::max(self.sent_for_s, other.sent_for_s);
        self.interrupted |= other.interrupted;
    }
}

/// Sends the script from a thread of its own and receives until it has ended.
async fn exchange(
    control: control::Control,
    script: &Arc<Script>,
    timetable: Timetable,
    mut progress: Progress,
    totals: &SharedTotals,
) -> anyhow::Result<Driven> {
    let (up, mut down) = control.split();
    let stop = Arc::new(AtomicBool::new(false));
    let (ended, mut end) = oneshot::channel();
    let mut contacts = ContactMetrics::default();
    let sender = {
        let (script, stop, in_flight) = (Arc::clone(script), Arc::clone(&stop), Arc::clone(&contacts.in_flight));
        std::thread::Builder::new().name("kerf-load-send".to_owned()).spawn(move || {
            let sent = sender::send(&script, timetable, &up, &in_flight, &stop);
            // `up` is handed back: dropping it would close the stream before the last answers.
            let _ = ended.send((sent, up));
        })?
    };
    let mut interrupted = false;
    let mut interrupt = std::pin::pin!(tokio::signal::ctrl_c());
    let mut ticks = tokio::time::interval(progress::INTERVAL);
    let ended = loop {
        tokio::select! {
            received = down.next(&mut contacts, script, &timetable) => received?,
            _ = ticks.tick() => progress.show(script_time_s(&timetable), &contacts, &viewer::snapshot(totals)),
            _ = &mut interrupt, if !interrupted => {
                interrupted = true;
                stop.store(true, Ordering::Relaxed);
            }
            ended = &mut end => break ended,
        }
    };
    let sent_for_s = script_time_s(&timetable);
    progress.finish();
    let (sent, up) = ended.ok().context("the sending thread died")?;
    settle(&mut down, &mut contacts, script, &timetable).await?;
    contacts.force_age.finish(clock::now_ns(), script, &timetable);
    drop(up);
    ensure!(sender.join().is_ok(), "the sending thread died");
    Ok(Driven { sent, contacts, sent_for_s, interrupted })
}

/// Receives the answers to the last poses.
async fn settle(
    down: &mut Receiver,
    contacts: &mut ContactMetrics,
    script: &Script,
    timetable: &Timetable,
) -> anyhow::Result<()> {
    let receive = async {
        loop {
            down.next(contacts, script, timetable).await?;
        }
    };
    tokio::time::timeout(SETTLE, receive).await.unwrap_or(Ok(()))
}

fn script_time_s(timetable: &Timetable) -> f64 {
    clock::now_ns().saturating_sub(timetable.start_ns) as f64 * 1e-9
}

fn make_script(args: &Args, scene: &v1::SceneSummary, surfaces: &[Surface]) -> anyhow::Result<Script> {
    let names: Vec<String> = scene.tools.iter().map(|tool| tool.name.clone()).collect();
    let (target, name) = target(scene, surfaces)?;
    if args.script.as_os_str() == "strokes" {
        let tool_id = script::tool_id(&args.tool, &names)?;
        strokes::strokes(tool_id, &target, &args.strokes.params()).with_context(|| format!("strokes in {name}"))
    } else {
        let path = args.script.display();
        let file = File::open(&args.script).with_context(|| format!("cannot open {path}"))?;
        Script::from_csv(file, &names, target.max_m.y).with_context(|| path.to_string())
    }
}

/// Index of the object that is cut: the first that can be, or the first at all.
fn target_index(scene: &v1::SceneSummary) -> usize {
    scene.objects.iter().position(|object| object.fracture_energy_j_per_m2.is_some()).unwrap_or(0)
}

fn target(scene: &v1::SceneSummary, surfaces: &[Surface]) -> anyhow::Result<(Target, String)> {
    let index = target_index(scene);
    let object = scene.objects.get(index).context("the scene has no objects")?;
    let surface = surfaces.get(index).context("the view shows fewer objects than the scene has")?;
    let corner = |vertex: u32| Vector3::from(surface.positions_m[vertex as usize].map(f64::from));
    let target = Target {
        min_m: wire::vector(object.rest_min_m, "object.rest_min_m")?,
        max_m: wire::vector(object.rest_max_m, "object.rest_max_m")?,
        triangles_m: surface.triangles.iter().map(|triangle| triangle.vertices.map(corner)).collect(),
    };
    Ok((target, object.name.clone()))
}

/// Refuses a script that the server would answer with lifted tools.
fn check_speed(script: &Script, limits: Option<&v1::Limits>) -> anyhow::Result<()> {
    let Some(limits) = limits else { return Ok(()) };
    let (speed, limit) = (script.max_speed_m_per_s(), limits.max_tool_speed_m_per_s);
    ensure!(
        speed <= SPEED_MARGIN * limit,
        "the script moves a tool at {speed:.3} m/s, the server takes {limit:.3} m/s"
    );
    Ok(())
}

/// Force of a steady cut: fracture energy times the length of edge that fits across the object, N.
fn steady_cut_n(scene: &v1::SceneSummary, script: &Script) -> Option<f64> {
    let object = scene.objects.get(target_index(scene))?;
    let tool = scene.tools.get(script.tracks.first()?.tool_id as usize)?;
    let (min_m, max_m) = (object.rest_min_m?, object.rest_max_m?);
    let across_m = f64::from(f32::min(max_m.x - min_m.x, max_m.z - min_m.z));
    let Some(v1::tool_summary::Kind::Blade(blade)) = &tool.kind else { return None };
    Some(object.fracture_energy_j_per_m2? * f64::min(blade.width_m, across_m))
}

fn describe(args: &Args) -> String {
    if args.script.as_os_str() == "strokes" {
        let plural = if args.strokes.strokes == 1 { "" } else { "s" };
        format!("{} stroke{plural} (random seed {})", args.strokes.strokes, args.strokes.seed)
    } else {
        args.script.display().to_string()
    }
}
