//! What servos did, tick by tick, as an MCAP file: Foxglove draws it, `kerf.read_log` reads it into arrays.
//!
//! It is written on the thread that reports, from the samples that servos leave behind: a disk that is slow costs ticks
//! in the file, never one of the hand's. A file that is cut off is read as far as it goes.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::Context;
use kerf_script::Pose;
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use nalgebra::{UnitQuaternion, Vector3};
use serde_json::{Value, json};

use crate::servo::core::State;
use crate::servo::runner::Sample;

/// Messages are objects as this says; numbers are SI, frames those of the scene but for the device's own.
const SCHEMA: &str = include_str!("log_schema.json");
const ENCODING: &str = "json";

/// A file that is written.
pub struct Log {
    file: mcap::Writer<BufWriter<File>>,
    /// Of each device.
    channels: Vec<u16>,
    newest_ns: u64,
}

impl Log {
    /// Begins a file for devices of these names.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn create<'a>(path: &Path, devices: impl IntoIterator<Item = &'a str>) -> anyhow::Result<Self> {
        let sink = File::create(path).with_context(|| format!("--log {}", path.display()))?;
        let options = WriteOptions::new()
            .library(concat!("kerf-station ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .disable_seeking(true);
        let mut file = options.create(BufWriter::new(sink))?;
        let schema = file.add_schema("kerf.StationTick", "jsonschema", SCHEMA.as_bytes())?;
        let channels = devices
            .into_iter()
            .enumerate()
            .map(|(index, name)| {
                let about = BTreeMap::from([("device".to_owned(), name.to_owned())]);
                file.add_channel(schema, &format!("/device/{index}"), ENCODING, &about)
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { file, channels, newest_ns: 0 })
    }

    /// Writes a tick of a device, by its place among the names.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&mut self, device: usize, sample: &Sample) -> anyhow::Result<()> {
        self.newest_ns = self.newest_ns.max(sample.at_ns);
        let header = MessageHeader {
            channel_id: self.channels[device],
            sequence: 0,
            log_time: self.newest_ns,
            publish_time: sample.at_ns,
        };
        self.file.write_to_known_channel(&header, &serde_json::to_vec(&tick(sample))?)?;
        Ok(())
    }

    /// Ends the file with its index.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn finish(mut self) -> anyhow::Result<()> {
        self.file.finish()?;
        Ok(self.file.into_inner().flush()?)
    }
}

fn tick(sample: &Sample) -> Value {
    let Sample { at_ns, dt_s, spent_ns, device, force_n, rendered, contacts, motion_age_s, model } = sample;
    json!({
        "at_ns": at_ns,
        "dt_s": dt_s,
        "spent_ns": spent_ns,
        "state": state(rendered.state),
        "device": {
            "position_m": xyz(&device.position_m),
            "orientation": quaternion(&device.orientation),
            "buttons": device.buttons,
            "force_n": xyz(force_n),
        },
        "tool": rendered.tool.as_ref().map(pose),
        "force_n": xyz(&rendered.force_n),
        "contact_n": xyz(&rendered.contact_n),
        "coupling_n_per_m": rendered.coupling_n_per_m,
        "contacts": contacts,
        "motion_age_s": motion_age_s,
        "model": model.as_ref().map(|model| json!({
            "reference": pose(&model.reference),
            "force_n": xyz(&model.force_n),
            "stiffness_n_per_m": model.stiffness_n_per_m.transpose().as_slice(),
        })),
    })
}

fn state(state: State) -> &'static str {
    match state {
        State::Stale => "stale",
        State::Held(_) => "held",
        State::Tripped(_) => "tripped",
        State::Ramping => "ramping",
        State::Rendering => "rendering",
    }
}

fn xyz(v: &Vector3<f64>) -> Value {
    json!({ "x": v.x, "y": v.y, "z": v.z })
}

fn quaternion(q: &UnitQuaternion<f64>) -> Value {
    json!({ "x": q.i, "y": q.j, "z": q.k, "w": q.w })
}

fn pose(pose: &Pose) -> Value {
    json!({ "position_m": xyz(&pose.position_m), "orientation": quaternion(&pose.orientation) })
}
