//! The messages of Haply's Inverse service that are used, by its documents of version 3.5; what else is in them is let
//! pass. Its frame is x right, y away from the user, z up; ours is the Omni's: x right, y up, z towards the user.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Name by which the service's own programs show the station.
const PROFILE: &str = "kerf-station";

/// What the service says: first all there is, then one message for each that it gets.
#[derive(Debug, Default, Deserialize)]
pub struct Inventory {
    /// Arms.
    #[serde(default)]
    pub inverse3: Vec<Arm>,
    /// Grips on a cable.
    #[serde(default)]
    pub verse_grip: Vec<Grip>,
    /// Grips without a cable.
    #[serde(default)]
    pub wireless_verse_grip: Vec<Grip>,
}

/// An arm.
#[derive(Debug, Deserialize)]
pub struct Arm {
    /// What it goes by.
    pub device_id: String,
    /// Only in the first message.
    pub config: Option<ArmConfig>,
    /// Where it is.
    #[serde(default)]
    pub state: ArmState,
    /// How it is.
    #[serde(default)]
    pub status: Status,
}

/// What an arm is.
#[derive(Debug, Deserialize)]
pub struct ArmConfig {
    /// inverse3, inverse3x, minverse.
    #[serde(rename = "type")]
    pub kind: String,
    /// Of its firmware.
    pub extended_firmware_version: Option<String>,
}

/// Where an arm is, m and m/s.
#[derive(Debug, Default, Deserialize)]
pub struct ArmState {
    /// Of its tip.
    pub cursor_position: Option<Triple>,
    /// Of its tip.
    pub cursor_velocity: Option<Triple>,
}

/// How a device is; what is absent is well.
#[derive(Debug, Default, Deserialize)]
pub struct Status {
    /// Whether it is calibrated.
    pub calibrated: Option<bool>,
    /// Whether its motors have power.
    pub power_supply: Option<bool>,
    /// Whether it can be driven.
    pub ready: Option<bool>,
}

impl Status {
    /// Why it cannot be driven, with what to do.
    #[must_use]
    pub fn hold(&self) -> Option<&'static str> {
        match (self.power_supply, self.calibrated, self.ready) {
            (Some(false), ..) => Some("the motors have no power: plug in the power supply"),
            (_, Some(false), _) => Some("not calibrated: put the grip on the inkwell until the light is steady"),
            (_, _, Some(false)) => Some("not ready: see Haply's Hub for what it waits for"),
            _ => None,
        }
    }
}

/// A grip.
#[derive(Debug, Deserialize)]
pub struct Grip {
    #[serde(default)]
    state: GripState,
}

#[derive(Debug, Default, Deserialize)]
struct GripState {
    orientation: Option<Turn>,
    /// Of a grip with one button.
    #[serde(default)]
    button: bool,
    #[serde(default)]
    buttons: Buttons,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Buttons {
    a: bool,
    b: bool,
    c: bool,
}

impl Grip {
    /// Bit i: button i is down.
    #[must_use]
    pub fn buttons(&self) -> u32 {
        let Buttons { a, b, c } = self.state.buttons;
        u32::from(a || self.state.button) | u32::from(b) << 1 | u32::from(c) << 2
    }

    /// In our frame.
    #[must_use]
    pub fn orientation(&self) -> Option<UnitQuaternion<f64>> {
        let Turn { w, x, y, z } = self.state.orientation?;
        UnitQuaternion::try_new(Quaternion::new(w, x, z, -y), 1e-6)
    }
}

/// Three numbers along the service's axes.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
pub struct Triple {
    x: f64,
    y: f64,
    z: f64,
}

impl From<Triple> for Vector3<f64> {
    fn from(Triple { x, y, z }: Triple) -> Self {
        Self::new(x, z, -y)
    }
}

impl From<Vector3<f64>> for Triple {
    fn from(ours: Vector3<f64>) -> Self {
        Self { x: ours.x, y: -ours.z, z: ours.y }
    }
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct Turn {
    w: f64,
    x: f64,
    y: f64,
    z: f64,
}

/// What the service is told.
#[derive(Debug, Serialize)]
pub struct Command<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    session: Option<Session>,
    inverse3: [ArmCommand<'a>; 1],
}

#[derive(Debug, Serialize)]
struct Session {
    configure: Configure,
}

#[derive(Debug, Serialize)]
struct Configure {
    profile: Profile,
}

#[derive(Debug, Serialize)]
struct Profile {
    name: &'static str,
}

#[derive(Debug, Serialize)]
struct ArmCommand<'a> {
    device_id: &'a str,
    commands: Commands,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Commands {
    SetCursorForce { vector: Triple },
}

impl<'a> Command<'a> {
    /// Has an arm render a force, N, until the next command; the first command says who we are.
    #[must_use]
    pub fn force(device_id: &'a str, force_n: Vector3<f64>, is_first: bool) -> Self {
        let session = is_first.then_some(Session { configure: Configure { profile: Profile { name: PROFILE } } });
        let commands = Commands::SetCursorForce { vector: force_n.into() };
        Self { session, inverse3: [ArmCommand { device_id, commands }] }
    }
}
