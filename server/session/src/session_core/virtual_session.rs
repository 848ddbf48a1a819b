//! A session that is ticked by hand against a clock that only steps and waiting move.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use kerf_physics::{OPEN, Pose, Quat, Scene, SceneDesc, SoundScene, StageClock, Vec3, Workers};
use kerf_scenes::cost::Cost;
use rustix::time::{ClockId, clock_gettime};
use tokio::sync::{oneshot, watch};

use super::{SessionCore, Wake};
use crate::admission::Admission;
use crate::error::SessionError;
use crate::inbox::{Command, Inbox};
use crate::limits::SessionLimits;
use crate::outbox::{Outbox, Viewer};
use crate::past::Past;
use crate::pose_check::PoseSample;
use crate::pose_refusal::PoseRefusal;
use crate::projector::Projector;
use crate::publisher::Publisher;
use crate::resimulation::Resimulation;
use crate::status::{Phase, SessionStatus};
use crate::step_report::StepReport;
use crate::stepping::{Stepped, Steps};
use crate::tape::{CAPACITY, TapeEntry, TapeReader, Wants};
use crate::tool_slot::DriverId;

pub const MS: u64 = 1_000_000;
pub const S: u64 = 1000 * MS;

/// Goes on by the length of a step when the step first asks for the time.
#[derive(Default)]
pub struct VirtualClock {
    pub now_ns: AtomicU64,
    step_ns: AtomicU64,
    pub panics: AtomicBool,
}

impl StageClock for VirtualClock {
    fn now_ns(&self) -> u64 {
        assert!(!self.panics.swap(false, Ordering::Relaxed), "a test's panic");
        let step_ns = self.step_ns.swap(0, Ordering::Relaxed);
        self.now_ns.fetch_add(step_ns, Ordering::Relaxed) + step_ns
    }
}

/// Processor time of this thread, ns.
pub fn thread_ns() -> i64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

/// A session that is ticked by hand.
pub struct VirtualSession {
    pub core: SessionCore,
    projector: Projector,
    /// What is handed over is shown at once.
    pub shows: bool,
    /// Processor time of this thread that went into showing, ns.
    pub showing_ns: i64,
    pub scene: SoundScene,
    pub inbox: Arc<Inbox>,
    pub outbox: Arc<Outbox>,
    bell: watch::Receiver<u64>,
    tape: Option<TapeReader>,
    pub journal: Option<TapeReader>,
    pub reports: watch::Receiver<Arc<StepReport>>,
    pub clock: VirtualClock,
    pub wake: Wake,
    /// How long steps take.
    pub step_ns: u64,
}

impl VirtualSession {
    pub fn new(desc: SceneDesc, limits: SessionLimits) -> Self {
        Self::begin(desc, limits, false, None).unwrap()
    }

    /// One with a journal, from where another journal leads.
    pub fn journaled(desc: SceneDesc, past: Option<Past>) -> Result<Self, SessionError> {
        Self::begin(desc, SessionLimits::default(), true, past)
    }

    fn begin(
        desc: SceneDesc,
        limits: SessionLimits,
        is_journaled: bool,
        past: Option<Past>,
    ) -> Result<Self, SessionError> {
        let scene = Scene { desc, meshes: Default::default() }.judge().expect("a sound scene");
        let inbox = Arc::new(Inbox::new(scene.desc.tools.len(), limits.clone()));
        let outbox = Arc::new(Outbox::new(&limits, Phase::Running));
        let (mut publisher, bell, reports) = Publisher::new(Arc::clone(&outbox));
        let tape = publisher.tape.reader(Wants::Hashes, 10 * CAPACITY);
        let journal = is_journaled.then(|| publisher.tape.reader(Wants::Bases, 10 * CAPACITY));
        let admission = Admission::new(f64::INFINITY, f64::INFINITY, f64::INFINITY, 1);
        let admitted = admission.admit(&Cost::default(), 1.0, false).unwrap();
        let built = SessionCore::new(scene.clone(), limits, Arc::clone(&inbox), publisher, admitted, past, |_| ());
        let (core, projector) = built?;
        let (clock, wake) = (VirtualClock::default(), Wake::At(0));
        Ok(Self {
            core,
            projector,
            shows: true,
            showing_ns: 0,
            scene,
            inbox,
            outbox,
            bell,
            tape: Some(tape),
            journal,
            reports,
            clock,
            wake,
            step_ns: MS / 10,
        })
    }

    pub fn now_ns(&self) -> u64 {
        self.clock.now_ns.load(Ordering::Relaxed)
    }

    pub fn tick(&mut self) {
        self.core.obey_commands();
        self.clock.step_ns.store(self.step_ns, Ordering::Relaxed);
        self.wake = self.core.tick(self.now_ns(), &Workers::serial(), &self.clock);
        self.clock.step_ns.store(0, Ordering::Relaxed);
        let began_ns = thread_ns();
        if self.shows {
            self.projector.show_waiting(&self.clock);
        }
        self.showing_ns += thread_ns() - began_ns;
    }

    /// Does all that is due in the coming time.
    pub fn run(&mut self, duration_ns: u64) {
        let end_ns = self.now_ns() + duration_ns;
        while let Wake::At(due_ns) | Wake::OnCommand { or_at_ns: due_ns } = self.wake
            && self.now_ns().max(due_ns) < end_ns
        {
            self.clock.now_ns.fetch_max(due_ns, Ordering::Relaxed);
            self.tick();
        }
        self.clock.now_ns.fetch_max(end_ns, Ordering::Relaxed);
    }

    pub fn one_step_of(&mut self, step_ns: u64) {
        let usual_ns = std::mem::replace(&mut self.step_ns, step_ns);
        let Wake::At(due_ns) = self.wake else { panic!("the session stands") };
        self.clock.now_ns.fetch_max(due_ns, Ordering::Relaxed);
        self.tick();
        self.step_ns = usual_ns;
    }

    pub fn ask<T>(&mut self, command: impl FnOnce(oneshot::Sender<T>) -> Command) -> T {
        let (answer, mut answered) = oneshot::channel();
        self.inbox.push(command(answer)).unwrap();
        self.tick();
        answered.try_recv().expect("a command is obeyed in the tick that finds it")
    }

    /// Asks for steps and ticks until they are answered.
    pub fn step_by(&mut self, steps: Steps) -> Result<Stepped, SessionError> {
        let (answer, mut answered) = oneshot::channel();
        self.inbox.push(Command::Step(steps, answer)).unwrap();
        loop {
            self.tick();
            match answered.try_recv() {
                Ok(stepped) => return stepped,
                Err(oneshot::error::TryRecvError::Empty) => {}
                Err(error) => panic!("the session gave up its steps: {error}"),
            }
        }
    }

    pub fn status(&mut self) -> SessionStatus {
        self.ask(Command::Describe)
    }

    /// What was recorded, once it has led to the session's state once more.
    pub fn resimulated(&mut self) -> Vec<TapeEntry> {
        let entries = Vec::from(self.tape.as_ref().expect("a tape").take().0);
        let mut again = Resimulation::new(&self.scene).unwrap();
        again.follow(&Workers::serial(), &entries).unwrap();
        assert_eq!(again.world().state_hash(), self.status().state_hash);
        entries
    }

    pub fn view(&self) -> Viewer {
        let mut viewer = self.outbox.join(self.bell.clone()).unwrap();
        // The first look is what asks for a keyframe.
        assert!(viewer.try_next().is_none());
        viewer
    }

    /// One who looks on for the record, at half the rate of states.
    pub fn watch_for_the_record(&self) -> Viewer {
        let mut viewer = self.outbox.join_for_the_record(self.bell.clone());
        viewer.set_interval_ns(S / 30);
        assert!(viewer.try_next().is_none());
        viewer
    }

    /// Nobody records any more.
    pub fn stop_tape(&mut self) {
        self.tape = None;
    }

    pub fn drive(&self) -> DriverId {
        let driver = self.inbox.connect_driver("").unwrap();
        self.inbox.claim(driver, &[0], self.now_ns()).unwrap();
        driver
    }

    pub fn submit(&self, driver: DriverId, seq: u64, height_m: f64) -> Result<(), PoseRefusal> {
        // Turned and tilted: the edge crosses the links one after another.
        let orientation = Quat::from_axis_angle(&Vec3::y_axis(), 0.4) * Quat::from_axis_angle(&Vec3::z_axis(), 0.3);
        let pose = Pose { position_m: Vec3::new(0.0, height_m, 4e-4), orientation };
        let sample = PoseSample { seq, client_ns: self.now_ns(), pose, opening: OPEN };
        self.inbox.submit(driver, 0, &sample, self.now_ns())
    }

    /// Puts the edge down over the block and presses it through, a pose a step of 2 ms.
    pub fn cut(&mut self, driver: DriverId, seqs: Range<u64>) {
        let first = seqs.start;
        for seq in seqs {
            self.submit(driver, seq, 0.012 - 2e-4 * (seq - first) as f64).unwrap();
            self.run(2 * MS);
        }
    }
}
