//! A device, its servo and its link, put together.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, anyhow};
use kerf_proto::v1;

use crate::config::{DeviceConfig, StationConfig};
use crate::device::{Device, DeviceError};
use crate::link::{Link, LinkSettings, LinkStatus, SharedSession};
use crate::servo::model::Update;
use crate::servo::runner::{self, Motion, Runner, Sample, Slots};

/// Ticks that wait for the monitor: four seconds.
const SAMPLES: usize = 4096;
/// Pause between two attempts to open a device that is gone.
const REOPEN_PAUSE: Duration = Duration::from_millis(500);
/// Time for the force to be taken out when the station leaves, beside the fade itself.
const LEAVE_MARGIN: Duration = Duration::from_millis(30);

/// Opens a device, again and again where it is lost.
pub type Opener = Box<dyn FnMut() -> Result<Box<dyn Device>, DeviceError> + Send>;

/// How the servo's thread is doing, for people.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ThreadStatus {
    /// Real-time priority, or why not.
    pub priority: String,
    /// What is wrong with the device.
    pub device_fault: Option<String>,
    /// The device has come to its end.
    pub has_ended: bool,
}

/// A running station.
pub struct Station {
    /// The device's name, for people.
    pub name: String,
    /// Samples of the servo's ticks.
    pub samples: rtrb::Consumer<Sample>,
    link: Link,
    is_leaving: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    status: Arc<std::sync::Mutex<ThreadStatus>>,
    fade: Duration,
}

impl Station {
    /// Starts a device's servo and its link to a session.
    ///
    /// # Errors
    /// The device cannot be opened, or a thread cannot be started.
    pub fn start(
        config: &StationConfig,
        device: &DeviceConfig,
        mut open: Opener,
        tool_ids: Arc<[u32]>,
        session: Arc<SharedSession>,
    ) -> anyhow::Result<Self> {
        let (updates, contacts) = triple_buffer::triple_buffer(&Update::default());
        let (motions, motion) = triple_buffer::triple_buffer(&Motion::default());
        let (sample, samples) = rtrb::RingBuffer::new(SAMPLES);
        let (is_leaving, stop) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let first = open()?;
        let name = first.info().name.clone();
        let slots = Slots { updates: contacts, motions, samples: sample, is_leaving: Arc::clone(&is_leaving) };
        let mut runner = Runner::new(runner::settings(first.info(), device), device, Arc::clone(&tool_ids), slots);
        let settings = LinkSettings::new(config, device, session, tool_ids);
        let link = Link::start(settings, motion, updates)?;
        let status = Arc::new(std::sync::Mutex::new(ThreadStatus::default()));
        let thread = {
            let (stop, status) = (Arc::clone(&stop), Arc::clone(&status));
            std::thread::Builder::new().name("station-servo".into()).spawn(move || {
                let tell = |change: &dyn Fn(&mut ThreadStatus)| {
                    if let Ok(mut status) = status.lock() {
                        change(&mut status);
                    }
                };
                let priority = raise_priority();
                tell(&|status| status.priority.clone_from(&priority));
                let mut device = Ok(first);
                while !stop.load(Ordering::Relaxed) {
                    match device.and_then(|mut device| device.run(&mut runner, &stop)) {
                        Ok(()) => {
                            tell(&|status| status.has_ended = true);
                            return;
                        }
                        Err(error) => tell(&|status| status.device_fault = Some(error.to_string())),
                    }
                    std::thread::sleep(REOPEN_PAUSE);
                    device = open();
                    if device.is_ok() {
                        tell(&|status| status.device_fault = None);
                    }
                }
            })?
        };
        let fade = Duration::from_secs_f64(device.servo.fade_s) + LEAVE_MARGIN;
        Ok(Self { name, samples, link, is_leaving, stop, thread: Some(thread), status, fade })
    }

    /// How the link is doing.
    #[must_use]
    pub fn link(&self) -> LinkStatus {
        self.link.status()
    }

    /// How the servo's thread is doing.
    #[must_use]
    pub fn thread(&self) -> ThreadStatus {
        self.status.lock().map(|status| status.clone()).unwrap_or_default()
    }
}

impl Drop for Station {
    /// Takes the force out before the device is let go.
    fn drop(&mut self) {
        self.is_leaving.store(true, Ordering::Relaxed);
        std::thread::sleep(self.fade);
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Asks for a real-time thread: the calling one. What came of it, for people.
pub(crate) fn raise_priority() -> String {
    use thread_priority::{ThreadPriority, set_current_thread_priority};
    #[cfg(unix)]
    {
        use thread_priority::{
            RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
        };
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let half = ThreadPriority::Crossplatform(50.try_into().expect("between 0 and 99"));
        if set_thread_priority_and_policy(thread_native_id(), half, policy).is_ok() {
            return "real-time".into();
        }
    }
    match set_current_thread_priority(ThreadPriority::Max) {
        Ok(()) => "highest, not real-time".into(),
        Err(_) => "normal: real-time needs CAP_SYS_NICE or an rtprio limit of 50 in /etc/security/limits.conf".into(),
    }
}

/// Ids of a device's tools in a scene, by their names; the first tool where none is named.
///
/// # Errors
/// A name that is not in the scene.
pub fn tool_ids(device: &DeviceConfig, scene: &v1::SceneSummary) -> anyhow::Result<Arc<[u32]>> {
    let names: Vec<String> = scene.tools.iter().map(|tool| tool.name.clone()).collect();
    if device.tools.is_empty() {
        anyhow::ensure!(!names.is_empty(), "scene `{}` has no tools", scene.name);
        return Ok([0].into());
    }
    let id = |name: &String| {
        let index = kerf_script::tool_index(name, &names);
        let index = index.ok_or_else(|| anyhow!("tool `{name}` is not one of: {}", names.join(", ")))?;
        u32::try_from(index).context("the scene has too many tools")
    };
    device.tools.iter().map(id).collect()
}
