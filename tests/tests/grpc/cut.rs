//! A blade that cuts, and replicas that follow: their surface is the server's at every version.

use std::collections::BTreeMap;
use std::pin::pin;

use kerf_physics::surface::Surface;
use kerf_physics::{NoClock, Workers, World};
use kerf_proto::v1::{self, view_response};
use kerf_replica::{Body, Replica};
use kerf_session::{Reel, TapeEntry};
use tonic::transport::Channel;

use super::super::surface_hash::recomputed;
use super::harness::{Harness, Station, View, endpoint, next, no_expiry, view_request};

/// Heights of the edge, m: over the block, half way down, and at what holds it.
pub const ABOVE_M: f32 = 0.015;
pub const MIDDLE_M: f32 = 0.005;
pub const FOOT_M: f32 = -0.004;

/// The edge turned about the vertical, then about its own normal: it crosses the links one after another.
fn askew(seq: u64, height_m: f32) -> v1::ToolPose {
    let ((sin_yaw, cos_yaw), (sin_tilt, cos_tilt)) = (0.2_f32.sin_cos(), 0.15_f32.sin_cos());
    let orientation =
        Some(v1::Quat { x: sin_yaw * sin_tilt, y: sin_yaw * cos_tilt, z: cos_yaw * sin_tilt, w: cos_yaw * cos_tilt });
    let pose = Some(v1::Pose { position_m: Some(v1::Vec3 { x: 0.0, y: height_m, z: 4e-4 }), orientation });
    v1::ToolPose { tool_id: 0, seq, client_ns: 0, pose, ..Default::default() }
}

/// A blade on its way down. Each pose waits until a step has used the one before, so that the way
/// does not depend on the machine's speed.
pub struct Stroke {
    pub station: Station,
    seq: u64,
}

impl Stroke {
    pub async fn begin(harness: &Harness, session: &str) -> Self {
        Self::of(harness.drive(session, &[0]).await.unwrap())
    }

    pub fn of(station: Station) -> Self {
        Self { station, seq: 0 }
    }

    pub async fn press(&mut self, from_m: f32, to_m: f32) {
        const STEP_M: f32 = 2e-4;
        for index in 0..=((from_m - to_m) / STEP_M).round() as u64 {
            self.seq += 1;
            self.station.send(askew(self.seq, from_m - STEP_M * index as f32)).await;
            self.station.contact_where(|contact| contact.echo_seq == self.seq).await;
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    Keyframe,
    Patch,
}

/// What a replica was at one version.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Structure {
    version: u64,
    source: Source,
    /// What the server said.
    stated_hash: u64,
    hash: u64,
    counts: Counts,
}

/// Vertices and quads of all surfaces.
type Counts = (usize, usize);

/// A viewer that keeps a replica and notes each structure that it had.
pub struct Watcher {
    view: View,
    pub replica: Replica,
    structures: Vec<Structure>,
}

impl Watcher {
    pub async fn join(harness: &Harness, channel: Channel, session: &str) -> Self {
        Self::join_as(harness, channel, view_request(session)).await
    }

    pub async fn join_as(harness: &Harness, channel: Channel, request: v1::ViewRequest) -> Self {
        let view = harness.view_as(channel, request).await.expect("a view");
        let mut watcher = Self { view, replica: Replica::default(), structures: Vec::new() };
        watcher.until(|replica| replica.moment().is_some()).await;
        watcher
    }

    pub async fn until(&mut self, holds: impl Fn(&Replica) -> bool) {
        while !holds(&self.replica) {
            let message = next(&mut self.view).await;
            self.apply(&message);
        }
    }

    /// Follows the view while `work` goes on.
    pub async fn during<T>(&mut self, work: impl Future<Output = T>) -> T {
        let mut work = pin!(work);
        loop {
            tokio::select! {
                done = &mut work => return done,
                message = next(&mut self.view) => self.apply(&message),
            }
        }
    }

    fn apply(&mut self, message: &view_response::Message) {
        self.replica.apply(message).unwrap();
        let (source, version, stated_hash) = match message {
            view_response::Message::Keyframe(keyframe) => {
                (Source::Keyframe, keyframe.topology_version, keyframe.surface_hash)
            }
            view_response::Message::Patch(patch) => (Source::Patch, patch.to_version, patch.surface_hash),
            _ => return,
        };
        let bodies = self.replica.bodies();
        let hash = recomputed(&self.replica);
        let sum = |count: fn(&Body) -> usize| bodies.iter().map(count).sum();
        let counts = (sum(|body| body.vertices().len()), sum(|body| body.quads().len()));
        self.structures.push(Structure { version, source, stated_hash, hash, counts });
    }

    /// Hash of the surface at each version that it had.
    pub fn hashes(&self) -> BTreeMap<u64, u64> {
        self.structures.iter().map(|structure| (structure.version, structure.hash)).collect()
    }

    fn last(&self) -> Structure {
        *self.structures.last().expect("a keyframe")
    }
}

/// What the session's inputs lead to in a world that nobody watches: the counts at every version, of
/// surfaces contoured anew, and the hash in the end.
fn unwatched(harness: &Harness, session: &str, reel: &Reel) -> (BTreeMap<u64, Counts>, u64) {
    let session = harness.server.registry().get(session).unwrap();
    let mut world = World::new(&session.scene().clone().judge().unwrap()).unwrap();
    let mut counts = BTreeMap::from([(0, surface_counts(&world))]);
    for entry in reel.tape.take().0 {
        let TapeEntry::Step(taped) = entry else { continue };
        let output = world.step(&Workers::serial(), &NoClock, &taped.inputs.as_inputs());
        if output.fracture.parted_links > 0 {
            let version = output.topology_version;
            counts.insert(version, surface_counts(&world));
        }
    }
    (counts, world.surface_hash())
}

fn surface_counts(world: &World) -> Counts {
    let surfaces = world.bodies().into_iter().map(|body| Surface::build(body.grid()));
    surfaces
        .fold((0, 0), |(vertices, quads), surface| (vertices + surface.vertices().len(), quads + surface.quads().len()))
}

#[tokio::test]
async fn replicas_have_the_servers_surface_at_every_version_of_a_cut() {
    let mut harness = Harness::with(no_expiry).await;
    let (session, reel) = harness.create_on_tape().await;
    let mut first = Watcher::join(&harness, harness.channel.clone(), &session).await;
    let mut stroke = Stroke::begin(&harness, &session).await;
    first.during(stroke.press(ABOVE_M, MIDDLE_M)).await;
    let half_way = harness.describe(&session).await.topology_version;
    let mut second = Watcher::join(&harness, harness.channel.clone(), &session).await;
    first.during(second.during(stroke.press(MIDDLE_M, FOOT_M))).await;
    harness.pause(&session).await;
    let version = harness.describe(&session).await.topology_version;
    for watcher in [&mut first, &mut second] {
        watcher.until(|replica| replica.topology_version() == Some(version)).await;
    }

    let (counts, hash) = unwatched(&harness, &session, &reel);
    assert!(half_way >= 3 && version >= half_way + 3, "version {half_way} half way, {version} in the end");
    assert_eq!(counts.len() as u64, version + 1);
    assert!(counts[&version].1 > counts[&0].1, "a cut lays faces open");
    for watcher in [&first, &second] {
        let versions: Vec<u64> = watcher.structures.iter().map(|structure| structure.version).collect();
        assert!(versions[0] <= half_way, "the patches of the second half come as patches");
        // Each patch applied, so there was no gap; several steps' changes come as one.
        assert!(versions.is_sorted_by(|a, b| a < b) && versions.last() == Some(&version), "{versions:?} to {version}");
        assert!(versions.len() > 3, "a keyframe, then patches: {versions:?}");
        for (index, structure) in watcher.structures.iter().enumerate() {
            assert_eq!(structure.source, if index == 0 { Source::Keyframe } else { Source::Patch });
            assert_eq!(structure.hash, structure.stated_hash, "{structure:?}");
            assert_eq!(structure.counts, counts[&structure.version], "{structure:?}");
        }
        assert_eq!(watcher.last().hash, hash);
    }
}

#[tokio::test]
async fn a_blade_first_seen_in_the_tissue_cuts_nothing_before_it_was_clear() {
    let mut harness = Harness::with(no_expiry).await;
    let session = harness.create().await.unwrap();
    let mut stroke = Stroke::begin(&harness, &session).await;
    stroke.press(MIDDLE_M, FOOT_M).await;
    assert_eq!(harness.describe(&session).await.topology_version, 0, "it waits until it is clear");
    stroke.press(ABOVE_M, FOOT_M).await;
    assert!(harness.describe(&session).await.topology_version > 0, "it cuts");
}

#[tokio::test]
async fn a_replica_shows_the_surface_at_the_blade_until_it_is_taken_away() {
    let mut harness = Harness::with(no_expiry).await;
    let session = harness.create().await.unwrap();
    let mut watcher = Watcher::join(&harness, harness.channel.clone(), &session).await;
    let mut stroke = Stroke::begin(&harness, &session).await;
    let adapted = |replica: &Replica| replica.bodies().iter().any(|body| !body.adapted_offsets_m().is_empty());
    assert!(!adapted(&watcher.replica));
    watcher.during(stroke.press(ABOVE_M, MIDDLE_M)).await;
    watcher.until(adapted).await;
    drop(stroke);
    watcher.until(|replica| replica.moment().is_some() && !adapted(replica)).await;
}

#[tokio::test]
async fn a_viewer_that_falls_off_the_structure_log_goes_on_from_a_keyframe() {
    const KEPT: usize = 2;
    let mut harness = Harness::with(|config| {
        no_expiry(config);
        config.session.max_log_patches = KEPT;
        config.session.view_rate_hz = 500.0;
    })
    .await;
    let (session, reel) = harness.create_on_tape().await;
    // A window of one state, so that the transport does not read on for the viewer.
    let narrow = endpoint(harness.server.address()).initial_stream_window_size(1024).connect().await.unwrap();
    let mut stalled = Watcher::join(&harness, narrow, &session).await;
    // Sixty states fall due, and fill what room there is, before anything parts.
    let joined = harness.describe(&session).await.step;
    harness.until(&session, |described| described.step > joined + 500).await;
    let mut stroke = Stroke::begin(&harness, &session).await;
    stroke.press(ABOVE_M, MIDDLE_M).await;
    // A busy machine's steps come after the hand. Then it reads on, and follows the rest.
    harness.until(&session, |described| described.topology_version > KEPT as u64).await;
    let half_way = harness.describe(&session).await.topology_version;
    stalled.until(|replica| replica.topology_version() >= Some(half_way)).await;
    stalled.during(stroke.press(MIDDLE_M, FOOT_M)).await;
    harness.pause(&session).await;
    let version = harness.describe(&session).await.topology_version;
    stalled.until(|replica| replica.topology_version() == Some(version)).await;

    let versions: Vec<u64> = stalled.structures.iter().map(|structure| structure.version).collect();
    let fell_off =
        |pair: &[Structure]| pair[1].source == Source::Keyframe && pair[1].version > pair[0].version + KEPT as u64;
    assert!(stalled.structures.windows(2).any(fell_off), "{versions:?} of {version}");
    assert!(version > half_way, "the second half parts links too");
    assert!(stalled.structures.iter().all(|structure| structure.hash == structure.stated_hash));
    let (counts, hash) = unwatched(&harness, &session, &reel);
    assert_eq!((stalled.last().counts, stalled.last().hash), (counts[&version], hash));
}
