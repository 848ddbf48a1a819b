//! A server, its clients, the network between them and the disk below, by seed and in virtual time.
//!
//! Everything is the program's own but for threads, clock, sockets and disk: sessions are tasks, bytes are carried by a
//! network that delays, stalls and breaks, and the journal is on a disk that forgets. A seed gives the same run each time.

mod clients;
mod network;
mod server;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use fastrand::Rng;
use kerf_replica::Replica;
use kerf_session::Session;
use kerf_session::clock::MonotonicClock;
use kerf_session::virtual_time::VirtualTime;
use tempfile::TempDir;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, timeout};

use crate::journal::by_hand::seeds;
use crate::journal::virtual_disk::{Faults, VirtualDisk};
use clients::{Seen, View, drive, touch, watch};
use network::{Network, Quality};
use server::{Server, Track};

/// Seeds that are tried. The variable `WORLDS` says another number, `WORLDS_SEED` the first of them.
const SEEDS: u64 = 8;
/// How long things happen.
const STORM: Duration = Duration::from_secs(4);
/// Within this all is as it should be once nothing happens any more.
const CALM: Duration = Duration::from_secs(2);
/// And within this what happened last is seen.
const SHOWN: Duration = Duration::from_secs(1);
/// What was within this is now: longer than a step that something else of the machine held up.
const RECENTLY: Duration = Duration::from_millis(250);
/// How long before a kill the first step that it takes may have ended. The steps themselves may be more: a session that
/// was held up catches up with what is due.
const MOST_TAKEN: Duration = Duration::from_millis(60);

/// What happened in the worlds of all seeds.
#[derive(Debug, Default, PartialEq)]
struct Tally {
    steps: usize,
    contacts: u64,
    forces: u64,
    hardest_n: f64,
    streams: u64,
    dialled: u64,
    felt: u64,
    views: u64,
    kills: usize,
    power_cuts: usize,
    lost: usize,
    taken: Duration,
    trace: u64,
}

impl Tally {
    fn add(&mut self, world: &World) {
        let seen = world.seen.lock();
        self.steps += world.track.lock().unwrap_or_else(PoisonError::into_inner).footprints.len();
        self.contacts += seen.contacts;
        self.forces += seen.forces;
        self.hardest_n = self.hardest_n.max(seen.hardest_n);
        self.streams += seen.streams;
        self.dialled += seen.dialled;
        self.felt += seen.felt;
        self.views += seen.views;
        self.trace ^= seen.traces.iter().fold(world.seed, |all, trace| all.rotate_left(21) ^ trace);
    }

    fn with(self, other: Self) -> Self {
        Self {
            steps: self.steps + other.steps,
            contacts: self.contacts + other.contacts,
            forces: self.forces + other.forces,
            hardest_n: self.hardest_n.max(other.hardest_n),
            streams: self.streams + other.streams,
            dialled: self.dialled + other.dialled,
            felt: self.felt + other.felt,
            views: self.views + other.views,
            kills: self.kills + other.kills,
            power_cuts: self.power_cuts + other.power_cuts,
            lost: self.lost + other.lost,
            taken: self.taken.max(other.taken),
            trace: self.trace ^ other.trace,
        }
    }
}

/// One seed's.
struct World {
    seed: u64,
    random: Rng,
    folder: TempDir,
    disk: Arc<VirtualDisk>,
    /// It has no faults: only a power cut takes what was written.
    is_good_disk: bool,
    network: Network,
    track: Arc<Mutex<Track>>,
    seen: Seen,
}

impl World {
    fn new(seed: u64) -> Self {
        let mut random = Rng::with_seed(seed);
        let faults = match random.u32(0..8) {
            0 => Faults { full: 0.02, sync: 0.0 },
            1 => Faults { full: 0.0, sync: 0.02 },
            _ => Faults::default(),
        };
        Self {
            seed,
            folder: tempfile::tempdir().unwrap(),
            disk: Arc::new(VirtualDisk::new(random.u64(..), faults)),
            is_good_disk: faults.full + faults.sync == 0.0,
            network: Network::new(random.u64(..)),
            track: Arc::default(),
            seen: Seen::default(),
            random,
        }
    }

    /// How long each step takes.
    fn step_lengths(&mut self) -> impl FnMut() -> Duration + use<> {
        let mut random = self.random.fork();
        move || match random.u32(0..2000) {
            // The machine had something else to do.
            0 => Duration::from_millis(120),
            1..20 => Duration::from_millis(3),
            _ => Duration::from_micros(100),
        }
    }

    async fn start(&mut self, confirmed: Option<usize>) -> anyhow::Result<Server> {
        let disk = (self.folder.path(), &self.disk);
        Server::start(&self.network, disk, &self.track, confirmed, self.random.fork()).await
    }

    fn quality(&mut self) -> Quality {
        let mut ms = |most: u32| self.random.u32(0..=most) * Duration::from_millis(1);
        Quality { delay: ms(60), jitter: ms(20), ..Quality::default() }
    }

    /// What may happen to a session and to its clients.
    async fn something(&mut self, session: &Session) {
        let name = ["a", "b"][self.random.usize(0..2)];
        match self.random.u32(0..12) {
            0 => self.network.cut(),
            1 => {
                let stall = self.random.u32(100..1500) * Duration::from_millis(1);
                let quality = Quality { stalls: 0.02, stall, ..self.quality() };
                self.network.set(quality);
            }
            2 => {
                let quality = self.quality();
                self.network.set(quality);
            }
            3 => drop(session.pause().await),
            4..6 => drop(session.resume().await),
            6 => drop(session.reset().await),
            7 => drop(session.save_checkpoint(name).await),
            8 => drop(session.restore_checkpoint(name).await),
            _ => {}
        }
    }

    /// Kills a server, perhaps with the machine, and starts the next one; `None` where the session is lost as it may be.
    async fn kill(&mut self, server: Server, tally: &mut Tally) -> Option<Server> {
        let seed = self.seed;
        let killed_ns = MonotonicClock::now_ns();
        let confirmed = server.kill(&self.network, &self.disk).await;
        let is_power_cut = self.random.u32(0..3) == 0;
        if is_power_cut {
            self.disk.cut_power();
        }
        (tally.kills, tally.power_cuts) = (tally.kills + 1, tally.power_cuts + usize::from(is_power_cut));
        sleep(self.random.u32(0..800) * Duration::from_millis(1)).await;
        let server = match self.start(Some(confirmed)).await {
            Ok(server) => server,
            Err(error) => {
                assert!(confirmed == 0 || !self.is_good_disk, "seed {seed}: {confirmed} steps are lost: {error:#}");
                tally.lost += 1;
                return None;
            }
        };
        let mut track = self.track.lock().unwrap_or_else(PoisonError::into_inner);
        let of = track.footprints.len();
        let taken = track.go_back(&server.began, killed_ns);
        let (taken, taken_ns) =
            taken.unwrap_or_else(|| panic!("seed {seed}: it was never as in step {}", server.began.0));
        if self.is_good_disk && !is_power_cut {
            let since = Duration::from_nanos(taken_ns);
            tally.taken = tally.taken.max(since);
            assert!(
                since <= MOST_TAKEN,
                "seed {seed}: a kill took {taken} of {of} steps, the first {since:?} before it"
            );
        }
        assert!(of - taken >= confirmed, "seed {seed}: {confirmed} of {of} steps were confirmed, {taken} are lost");
        Some(server)
    }

    /// Nothing happens any more, and all is as it should be.
    async fn calm_down(&self, session: &Session) {
        let seed = self.seed;
        self.network.set(Quality::default());
        let _ = session.resume().await;
        sleep(CALM).await;
        let seen = self.seen.lock();
        let ago = |at: Option<Instant>| at.map_or(Duration::MAX, |at| at.elapsed());
        assert!(ago(seen.felt_at) < RECENTLY, "seed {seed}: the driver hears nothing for {:?}", ago(seen.felt_at));
        assert!(ago(seen.drawn_at) < RECENTLY, "seed {seed}: the viewer sees nothing for {:?}", ago(seen.drawn_at));
        let rendered = ago(seen.rendered_at);
        assert!(rendered < RECENTLY, "seed {seed}: the station renders nothing for {rendered:?}: {:?}", seen.station);
    }

    /// Who has followed all the way sees what one sees who comes now.
    async fn compare(&self, session: &Session) {
        let seed = self.seed;
        let step = session.pause().await.unwrap();
        sleep(SHOWN).await;
        let fresh = arrive(&self.network, &session.id().to_string()).await;
        let seen = self.seen.lock();
        assert_eq!(seen.wrong, Vec::<String>::new(), "seed {seed}");
        let followed = &seen.replica;
        for seen in [followed, &fresh] {
            assert_eq!(seen.moment().map(|moment| moment.step), Some(step), "seed {seed}");
        }
        assert_eq!(followed.topology_version(), fresh.topology_version(), "seed {seed}");
        for (followed, fresh) in followed.bodies().iter().zip(fresh.bodies()) {
            assert!(followed.quads() == fresh.quads() && followed.vertices() == fresh.vertices(), "seed {seed}");
        }
    }
}

/// A world from its beginning to its end.
async fn world(seed: u64, tally: &mut Tally) {
    let mut world = World::new(seed);
    let _sessions = VirtualTime::begin(world.step_lengths());
    let network = world.network.clone();
    let dial = move || {
        let network = network.clone();
        Box::pin(async move { network.channel().await }) as _
    };
    let _stations = kerf_station::virtual_time::VirtualTime::begin(dial, MonotonicClock::now_ns);
    let mut server = world.start(None).await.unwrap();
    let (network, session_id, seen) = (&world.network, server.session.id().to_string(), &world.seen);
    let mut clients = JoinSet::new();
    clients.spawn(drive(network.clone(), session_id.clone(), world.random.fork(), seen.clone()));
    clients.spawn(touch(session_id.clone(), seen.clone()));
    clients.spawn(watch(network.clone(), session_id, seen.clone()));

    let end = Instant::now() + STORM;
    while Instant::now() < end {
        sleep(world.random.u32(1..400) * Duration::from_millis(1)).await;
        if world.random.u32(0..8) > 0 {
            world.something(&server.session).await;
        } else if let Some(next) = world.kill(server, tally).await {
            server = next;
        } else {
            return;
        }
    }
    world.calm_down(&server.session).await;
    world.compare(&server.session).await;
    tally.add(&world);
    server.kill(&world.network, &world.disk).await;
}

/// What a viewer sees who comes now.
async fn arrive(network: &Network, session_id: &str) -> Replica {
    let channel = network.channel().await.expect("a network that is calm");
    let mut view = View::open(channel, session_id).await.expect("a view");
    let mut replica = Replica::default();
    while let Ok(Some((_, message))) = timeout(Duration::from_millis(200), view.next()).await {
        replica.apply(&message).unwrap();
    }
    replica
}

/// Worlds of these seeds, one after the other on each core.
fn worlds(seeds: std::ops::Range<u64>) -> Tally {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let one_after_the_other = |first: u64| {
        let mut tally = Tally::default();
        for seed in seeds.clone().skip(first as usize).step_by(threads) {
            let mut runtime = tokio::runtime::Builder::new_current_thread();
            let runtime = runtime.enable_time().start_paused(true).build().unwrap();
            runtime.block_on(world(seed, &mut tally));
        }
        tally
    };
    std::thread::scope(|scope| {
        let running: Vec<_> =
            (0..threads as u64).map(|first| scope.spawn(move || one_after_the_other(first))).collect();
        running.into_iter().map(|thread| thread.join().expect("a world that holds")).fold(Tally::default(), Tally::with)
    })
}

#[test]
fn clients_come_back_and_nothing_confirmed_is_lost_whatever_the_network_and_the_disk_do() {
    println!("{:?}", worlds(seeds("WORLDS", SEEDS)));
}

#[test]
fn a_seed_gives_the_same_world_again() {
    assert_eq!(worlds(3..4), worlds(3..4));
}
