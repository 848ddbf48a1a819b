//! The station's configuration: one TOML file. Every field has a default; unknown fields are refused.

mod check;
mod parse;

use std::path::PathBuf;

use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The configuration of a station.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StationConfig {
    /// The server.
    pub server: ServerConfig,
    /// What goes over the network.
    pub link: LinkConfig,
    /// The devices, each with tools of its own; at least one. Default: one simulated Omni.
    pub devices: Vec<DeviceConfig>,
}

impl Default for StationConfig {
    fn default() -> Self {
        Self { server: ServerConfig::default(), link: LinkConfig::default(), devices: vec![DeviceConfig::default()] }
    }
}

/// The server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServerConfig {
    /// Its address; `https://` asks for TLS. Default http://127.0.0.1:50051.
    pub url: String,
    /// Certificates (PEM) of those whom the station trusts to sign the server's. Default: the system's.
    pub ca_file: Option<PathBuf>,
    /// File with the token that the server asks for. Default: none is sent.
    pub token_file: Option<PathBuf>,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self { url: "http://127.0.0.1:50051".into(), ca_file: None, token_file: None }
    }
}

/// What goes over the network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LinkConfig {
    /// Poses a second at most, Hz. Default 500.
    pub pose_rate_hz: f64,
    /// Contacts a second and tool at most, Hz. Default 250: the servo evaluates the contact model between them.
    pub contact_rate_hz: f64,
    /// What a hand does not notice is not sent: the share of the force by which it may be off. 0 sends everything.
    /// Default 0.05.
    pub deadband: f64,
    /// Longest time in which nothing is sent though nothing changes, s. Default 0.025: half of the age at which a
    /// contact begins to fade.
    pub keep_alive_s: f64,
    /// Longest silence of the server before the station dials again, s. Default 1.
    pub silence_s: f64,
}

impl Default for LinkConfig {
    fn default() -> Self {
        Self { pose_rate_hz: 500.0, contact_rate_hz: 250.0, deadband: 0.05, keep_alive_s: 0.025, silence_s: 1.0 }
    }
}

/// One device and what it drives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DeviceConfig {
    /// What it is. Default: a simulated Omni.
    pub kind: DeviceKind,
    /// Names of the tools it drives, one at a time, the first one first. Default: the scene's first tool.
    pub tools: Vec<String>,
    /// How its frame lies in the scene.
    pub mapping: MappingConfig,
    /// What its buttons do. Default: button 0 closes jaws, button 1 is the clutch.
    pub buttons: Vec<ButtonConfig>,
    /// What the servo is held to.
    pub servo: ServoConfig,
}

impl Default for DeviceConfig {
    fn default() -> Self {
        let button = |button, action| ButtonConfig { button, action };
        Self {
            kind: DeviceKind::default(),
            tools: Vec::new(),
            mapping: MappingConfig::default(),
            buttons: vec![button(0, Action::Grasp), button(1, Action::Clutch)],
            servo: ServoConfig::default(),
        }
    }
}

/// What the servo is held to, as the device feels it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServoConfig {
    /// Greatest force, N. Default: the device's.
    pub max_force_n: Option<f64>,
    /// Greatest stiffness of the coupling between hand and tool, N/m. Default: the device's.
    pub max_stiffness_n_per_m: Option<f64>,
    /// Least stiffness of the coupling, however slow the network, N/m. Default 20.
    pub min_stiffness_n_per_m: f64,
    /// Fastest change of the force, N/s. Default 500: a wall of 500 N/m that is hit at 1 m/s.
    pub slew_n_per_s: f64,
    /// Time in which force is let in after connecting, reconnecting and faults, s. Default 0.5.
    pub ramp_s: f64,
    /// Time in which force is taken out, s. Default 0.05.
    pub fade_s: f64,
}

impl Default for ServoConfig {
    fn default() -> Self {
        Self {
            max_force_n: None,
            max_stiffness_n_per_m: None,
            min_stiffness_n_per_m: 20.0,
            slew_n_per_s: 500.0,
            ramp_s: 0.5,
            fade_s: 0.05,
        }
    }
}

/// What a device is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum DeviceKind {
    /// A Phantom Omni and a hand, both simulated.
    Simulated(SimulatedConfig),
    /// A Phantom Omni, 3D Systems Touch or their kin, through the vendor's library.
    #[serde(rename = "openhaptics")]
    OpenHaptics(OpenHapticsConfig),
    /// An Inverse3 of Haply's, through the vendor's service.
    Haply(HaplyConfig),
    /// A gamepad: position only.
    #[cfg(unix)]
    Gamepad(GamepadConfig),
    /// The mouse in a terminal: position only.
    #[cfg(unix)]
    Mouse(MouseConfig),
    /// Strokes from a file.
    Recorded(RecordedConfig),
}

impl Default for DeviceKind {
    fn default() -> Self {
        Self::Simulated(SimulatedConfig::default())
    }
}

/// A simulated Omni.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulatedConfig {
    /// Mass that the hand feels at the tip, kg. Default 0.1.
    pub mass_kg: f64,
    /// Dry friction of the joints at the tip, N. Default 0.1.
    pub friction_n: f64,
    /// What the encoders tell apart, m. Default 5.5e-5.
    pub resolution_m: f64,
    /// The hand.
    pub hand: HandConfig,
}

impl Default for SimulatedConfig {
    fn default() -> Self {
        Self { mass_kg: 0.1, friction_n: 0.1, resolution_m: 5.5e-5, hand: HandConfig::default() }
    }
}

/// A simulated hand: a spring and a damper to a point that goes along a path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HandConfig {
    /// Stiffness of the grip, N/m. Default 400: firm.
    pub stiffness_n_per_m: f64,
    /// Damping of the grip, N s/m. Default 3.
    pub damping_n_s_per_m: f64,
    /// How far the hand trembles, m. Default 0.
    pub tremor_m: f64,
    /// Where the hand wants to be: time, s, and x, y, z, m, in the device's frame; times ascending, straight in between.
    pub path: Vec<[f64; 4]>,
    /// Whether the device goes away at the path's end; else the path is gone over again and again.
    pub ends: bool,
    /// Buttons that are pressed along the path.
    pub presses: Vec<PressConfig>,
}

impl Default for HandConfig {
    fn default() -> Self {
        Self {
            stiffness_n_per_m: 400.0,
            damping_n_s_per_m: 3.0,
            tremor_m: 0.0,
            path: Vec::new(),
            ends: false,
            presses: Vec::new(),
        }
    }
}

/// A button that is down for a time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PressConfig {
    /// Number of the button, from 0.
    pub button: u8,
    /// When it goes down, s along the path.
    pub from_s: f64,
    /// When it goes up, s along the path.
    pub to_s: f64,
}

/// A device of OpenHaptics.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OpenHapticsConfig {
    /// The vendor's library. Default: libHD.so and its kin, where the system looks for libraries.
    pub library: Option<PathBuf>,
    /// Name of the device in the vendor's setup tool; needed where there are several. Default: the default one.
    pub name: Option<String>,
}

/// An arm of Haply's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HaplyConfig {
    /// Where the vendor's service is. Default ws://127.0.0.1:10001.
    pub url: String,
    /// The arm. Default: the first that the service knows.
    pub device_id: Option<String>,
}

impl Default for HaplyConfig {
    fn default() -> Self {
        Self { url: "ws://127.0.0.1:10001".into(), device_id: None }
    }
}

/// A gamepad, by Linux's joystick interface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GamepadConfig {
    /// Its file. Default /dev/input/js0.
    pub file: PathBuf,
    /// Speed of the tip at a stick's end, m/s. Default 0.05.
    pub speed_m_per_s: f64,
}

impl Default for GamepadConfig {
    fn default() -> Self {
        Self { file: "/dev/input/js0".into(), speed_m_per_s: 0.05 }
    }
}

/// The mouse in a terminal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MouseConfig {
    /// How far the tip goes for a cell's width of the pointer and a notch of the wheel, m. Default 0.001.
    pub cell_m: f64,
}

impl Default for MouseConfig {
    fn default() -> Self {
        Self { cell_m: 1e-3 }
    }
}

/// Strokes from a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedConfig {
    /// CSV file with the header `time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw`.
    pub file: PathBuf,
    /// How much faster than it was recorded. Default 1.
    #[serde(default = "one")]
    pub speed: f64,
}

fn one() -> f64 {
    1.0
}

/// How a device's frame lies in the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MappingConfig {
    /// Which of the device's axes points along the scene's x, y and z. Default ["x", "y", "z"]: those of the Omni.
    pub axes: [Axis; 3],
    /// Scene metres per metre of the device. Default 1.
    pub scale: f64,
    /// Newtons of the device per newton of the scene. Default 1.
    pub force_scale: f64,
    /// Point of the device, m, in its own frame, ... Default: its origin, the middle of its reach. Of the Omni the inkwell
    /// is at [0, -0.0655, -0.0881].
    pub device_origin_m: [f64; 3],
    /// ... that lies at this point of the scene, m.
    pub scene_origin_m: [f64; 3],
    /// Whether the stylus turns the tool. Default true.
    pub turns_tool: bool,
    /// The tool's orientation where the stylus is not turned: about x, then y, then z, rad. Default 0: a blade's edge is
    /// horizontal and cuts down.
    pub tool_orientation_rad: [f64; 3],
}

impl Default for MappingConfig {
    fn default() -> Self {
        Self {
            axes: [Axis::X, Axis::Y, Axis::Z],
            scale: 1.0,
            force_scale: 1.0,
            device_origin_m: [0.0; 3],
            scene_origin_m: [0.0; 3],
            turns_tool: true,
            tool_orientation_rad: [0.0; 3],
        }
    }
}

impl MappingConfig {
    /// The matrix whose rows are the device's axes along the scene's.
    pub(crate) fn axes_matrix(&self) -> Matrix3<f64> {
        let row = |axis: &Axis| match axis {
            Axis::X => Vector3::x(),
            Axis::Y => Vector3::y(),
            Axis::Z => Vector3::z(),
            Axis::MinusX => -Vector3::x(),
            Axis::MinusY => -Vector3::y(),
            Axis::MinusZ => -Vector3::z(),
        };
        Matrix3::from_columns(&self.axes.each_ref().map(row)).transpose()
    }
}

/// An axis of a device, forwards or backwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Axis {
    /// Along x.
    #[serde(rename = "x")]
    X,
    /// Along y.
    #[serde(rename = "y")]
    Y,
    /// Along z.
    #[serde(rename = "z")]
    Z,
    /// Against x.
    #[serde(rename = "-x")]
    MinusX,
    /// Against y.
    #[serde(rename = "-y")]
    MinusY,
    /// Against z.
    #[serde(rename = "-z")]
    MinusZ,
}

/// What a button does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ButtonConfig {
    /// Number of the button, from 0.
    pub button: u8,
    /// What it does.
    pub action: Action,
}

/// What a button does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// While it is down the tool's jaws close.
    Grasp,
    /// While it is down the device moves and the tool stands.
    Clutch,
    /// When it goes down the device takes the next of its tools.
    NextTool,
    /// Forces are rendered only while it is down.
    DeadMan,
}
