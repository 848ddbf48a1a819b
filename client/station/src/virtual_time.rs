//! A station in virtual time: tasks of one thread in the place of threads, a simulated hand, a network that a test makes.

use std::sync::Arc;
use std::time::Duration;

use kerf_load::clock;
use nalgebra::Vector3;

use crate::config::{DeviceConfig, SimulatedConfig, StationConfig};
use crate::device::simulated::Simulated;
use crate::device::{Device, Servo};
use crate::link::virtual_network::{self, Dialled};
use crate::link::{Link, LinkSettings, LinkStatus, SharedSession};
use crate::servo::model::Update;
use crate::servo::runner::{Motion, Runner, Sample, Slots, settings};

/// A servo's tick.
const TICK: Duration = Duration::from_millis(1);
/// Ticks that are told of at a time.
const SAMPLES: usize = 16;

/// As long as it lives stations of this thread are in virtual time.
pub struct VirtualTime(());

impl VirtualTime {
    /// Begins: stations dial so, whatever the server's address, and read this clock.
    pub fn begin(dial: impl Fn() -> Dialled + 'static, clock: fn() -> u64) -> Self {
        virtual_network::dial_by(Some(Box::new(dial)));
        clock::follow(Some(clock));
        Self(())
    }
}

impl Drop for VirtualTime {
    fn drop(&mut self) {
        virtual_network::dial_by(None);
        clock::follow(None);
    }
}

/// Drives a tool of a session with a simulated device, for ever; tells of each tick.
pub async fn drive(
    config: StationConfig,
    (device, simulated): (DeviceConfig, SimulatedConfig),
    (session_id, tool_id): (&str, u32),
    mut tell: impl FnMut(&Sample, &LinkStatus),
) {
    let (updates, contacts) = triple_buffer::triple_buffer(&Update::default());
    let (motions, motion) = triple_buffer::triple_buffer(&Motion::default());
    let (samples, mut sampled) = rtrb::RingBuffer::new(SAMPLES);
    let mut omni = Simulated::new(&simulated);
    let slots = Slots { updates: contacts, motions, samples, is_leaving: Arc::default() };
    let mut runner = Runner::new(settings(omni.info(), &device), &device, [tool_id].into(), slots);
    let link = LinkSettings::new(&config, &device, SharedSession::join(session_id), [tool_id].into());
    let (status, link) = Link::as_task(link, motion, updates);
    let servo = async {
        let mut force_n = Vector3::zeros();
        let mut ticks = tokio::time::interval(TICK);
        loop {
            ticks.tick().await;
            let state = omni.step(TICK.as_secs_f64(), &force_n);
            force_n = runner.tick(clock::now_ns(), &state);
            while let Ok(sample) = sampled.pop() {
                tell(&sample, &status.get());
            }
        }
    };
    tokio::join!(link, servo);
}
