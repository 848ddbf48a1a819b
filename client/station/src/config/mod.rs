//! The station's configuration: one TOML file. Every field has a default; unknown fields are refused.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The configuration of a station.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StationConfig {
    /// The server.
    pub server: ServerConfig,
    /// What goes over the network.
    pub link: LinkConfig,
    /// The devices, each with tools of its own; at least one. Default: one simulated Omni.
    pub devices: Vec<DeviceConfig>,
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
}

impl Default for LinkConfig {
    fn default() -> Self {
        Self { pose_rate_hz: 500.0, contact_rate_hz: 250.0, deadband: 0.05 }
    }
}

/// One device and what it drives.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DeviceConfig {
    /// What it is. Default: a simulated Omni.
    pub kind: DeviceKind,
    /// Names of the tools it drives, one at a time, the first one first. Default: the scene's first tool.
    pub tools: Vec<String>,
    /// How its frame lies in the scene.
    pub mapping: MappingConfig,
    /// What its buttons do.
    pub buttons: Vec<ButtonConfig>,
}

/// What a device is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum DeviceKind {
    /// A Phantom Omni and a hand, both simulated.
    Simulated(SimulatedConfig),
}

impl Default for DeviceKind {
    fn default() -> Self {
        Self::Simulated(SimulatedConfig::default())
    }
}

/// A simulated device.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulatedConfig {}

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
    /// Point of the device, m, in its own frame, ...
    pub device_origin_m: [f64; 3],
    /// ... that lies at this point of the scene, m.
    pub scene_origin_m: [f64; 3],
}

impl Default for MappingConfig {
    fn default() -> Self {
        Self {
            axes: [Axis::X, Axis::Y, Axis::Z],
            scale: 1.0,
            force_scale: 1.0,
            device_origin_m: [0.0; 3],
            scene_origin_m: [0.0; 3],
        }
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
