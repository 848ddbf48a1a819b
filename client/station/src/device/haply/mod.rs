//! Haply's Inverse3, through the vendor's Inverse service on this machine: JSON over a WebSocket.
//!
//! The service answers each message with one, so the station sets the rhythm. It goes on with the last force that it
//! was told; therefore zero is told, and its answer awaited, before the connection is left. The vendor's crate is not
//! used: it brings an HTTP client, a TLS library and an old nalgebra for what is here one file of messages.

pub mod message;

use std::io::ErrorKind;
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use kerf_load::clock;
use kerf_load::pacer::Schedule;
use nalgebra::{UnitQuaternion, Vector3};
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

use self::message::{Arm, Command, Inventory};
use super::{Device, DeviceError, DeviceInfo, DeviceState, Servo};
use crate::config::HaplyConfig;

/// What the service does not tell: assumptions, which were not tried on an arm.
const PEAK_FORCE_N: f64 = 5.0;
const MAX_STIFFNESS_N_PER_M: f64 = 800.0;
const MAX_DAMPING_N_S_PER_M: f64 = 5.0;
const MASS_KG: f64 = 0.1;
const RATE_HZ: f64 = 1000.0;
/// About the arm's base, in our frame.
const WORKSPACE_M: [[f64; 3]; 2] = [[-0.12, 0.05, 0.05], [0.12, 0.30, 0.22]];
/// Longest wait for an answer of the service, which is on this machine.
const SILENCE: Duration = Duration::from_millis(200);
/// What to do when the service does not answer.
const SERVICE_REMEDY: &str = "start Haply's Hub or its Inverse service, and see that `url` is the service's";

/// An Inverse3.
pub struct Haply {
    info: DeviceInfo,
    device_id: String,
    /// Of the arm, as the service tells it.
    firmware: Option<String>,
    url: String,
    socket: WebSocket<MaybeTlsStream<TcpStream>>,
    is_first: bool,
}

impl Haply {
    /// Connects to the service and takes an arm.
    ///
    /// # Errors
    /// What was tried and how it failed.
    pub fn open(config: &HaplyConfig) -> Result<Self, DeviceError> {
        let failed = |what: String, remedy: &str| DeviceError {
            device: format!("Haply at {}", config.url),
            what,
            remedy: remedy.into(),
        };
        let (mut socket, _) = tungstenite::connect(&config.url)
            .map_err(|error| failed(format!("the service does not answer: {error}"), SERVICE_REMEDY))?;
        if let MaybeTlsStream::Plain(stream) = socket.get_ref() {
            // Without these a message may wait 40 ms for others, and a dead service holds the servo for ever.
            stream
                .set_nodelay(true)
                .and_then(|()| stream.set_read_timeout(Some(SILENCE)))
                .and_then(|()| stream.set_write_timeout(Some(SILENCE)))
                .map_err(|error| failed(format!("the connection cannot be set up: {error}"), SERVICE_REMEDY))?;
        }
        let inventory = read(&mut socket).map_err(|what| failed(what, SERVICE_REMEDY))?;
        let known: Vec<String> = inventory.inverse3.iter().map(|arm| arm.device_id.clone()).collect();
        let is_wanted = |arm: &Arm| config.device_id.as_ref().is_none_or(|id| *id == arm.device_id);
        let Some(arm) = inventory.inverse3.into_iter().find(is_wanted) else {
            let wanted = config.device_id.as_ref().map_or("no arm".into(), |id| format!("no arm `{id}`"));
            let what = format!("the service knows {wanted}; it knows {known:?}");
            return Err(failed(what, "plug the arm in and see that Haply's Hub shows it, or mend `device_id`"));
        };
        let (kind, firmware) =
            arm.config.map_or(("inverse3".into(), None), |config| (config.kind, config.extended_firmware_version));
        let info = DeviceInfo {
            name: format!("Haply {kind} {}", arm.device_id),
            rate_hz: RATE_HZ,
            peak_force_n: PEAK_FORCE_N,
            max_stiffness_n_per_m: MAX_STIFFNESS_N_PER_M,
            max_damping_n_s_per_m: MAX_DAMPING_N_S_PER_M,
            apparent_mass_kg: MASS_KG,
            workspace_m: WORKSPACE_M.map(Vector3::from),
        };
        Ok(Self { info, device_id: arm.device_id, firmware, url: config.url.clone(), socket, is_first: true })
    }

    /// Version of the arm's firmware, as the service told it.
    #[must_use]
    pub fn firmware(&self) -> Option<&str> {
        self.firmware.as_deref()
    }

    /// Tells a force and reads where the arm is then.
    fn exchange(&mut self, force_n: Vector3<f64>) -> Result<DeviceState, DeviceError> {
        let command = Command::force(&self.device_id, force_n, std::mem::take(&mut self.is_first));
        let text = serde_json::to_string(&command).expect("numbers and texts");
        let inventory = self
            .socket
            .send(Message::text(text))
            .map_err(|error| format!("the connection to the service is lost: {error}"))
            .and_then(|()| read(&mut self.socket));
        let inventory = inventory.map_err(|what| self.failed(what, SERVICE_REMEDY))?;
        let Some(arm) = inventory.inverse3.iter().find(|arm| arm.device_id == self.device_id) else {
            return Err(self.failed("the arm is gone".into(), "check its cable and power, and start the station again"));
        };
        let grip = inventory.wireless_verse_grip.first().or(inventory.verse_grip.first());
        let position = arm.state.cursor_position.map(Vector3::from);
        Ok(DeviceState {
            position_m: position.unwrap_or_default(),
            orientation: grip.and_then(message::Grip::orientation).unwrap_or_else(UnitQuaternion::identity),
            velocity_m_per_s: arm.state.cursor_velocity.map(Vector3::from).unwrap_or_default(),
            buttons: grip.map_or(0, message::Grip::buttons),
            hold: arm.status.hold().or(position.is_none().then_some("the service tells no position")),
        })
    }

    fn failed(&self, what: String, remedy: &str) -> DeviceError {
        DeviceError { device: format!("{} at {}", self.info.name, self.url), what, remedy: remedy.into() }
    }

    fn drive(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        let mut schedule = Schedule::new(clock::now_ns(), RATE_HZ);
        let mut force_n = Vector3::zeros();
        while !stop.load(Ordering::Relaxed) {
            clock::sleep_until_ns(schedule.deadline_ns());
            schedule.take(clock::now_ns());
            let state = self.exchange(force_n)?;
            let wanted_n = servo.tick(clock::now_ns(), &state);
            let norm_n = wanted_n.norm();
            let may_push = state.hold.is_none() && norm_n.is_finite();
            force_n = if may_push { wanted_n * (PEAK_FORCE_N / norm_n.max(PEAK_FORCE_N)) } else { Vector3::zeros() };
        }
        Ok(())
    }
}

impl Device for Haply {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        let outcome = self.drive(servo, stop);
        // Its answer says that the service has it. Where the connection is lost the service itself lets go.
        let cleared = self.exchange(Vector3::zeros());
        outcome.and(cleared.map(|_| ()))
    }
}

impl Drop for Haply {
    fn drop(&mut self) {
        // Best effort: the service notices a closed connection by itself.
        let _ = self.socket.close(None);
        let _ = self.socket.flush();
    }
}

/// The service's next message.
fn read(socket: &mut WebSocket<MaybeTlsStream<TcpStream>>) -> Result<Inventory, String> {
    loop {
        match socket.read() {
            Ok(Message::Text(text)) => {
                return serde_json::from_str(&text)
                    .map_err(|error| format!("the service's message is not known: {error}"));
            }
            Ok(Message::Close(_)) => return Err("the service closed the connection".into()),
            Ok(_) => {}
            Err(tungstenite::Error::Io(error))
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) =>
            {
                return Err(format!("the service has not answered for {} ms", SILENCE.as_millis()));
            }
            Err(error) => return Err(format!("the connection to the service is lost: {error}")),
        }
    }
}
