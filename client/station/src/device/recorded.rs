//! Strokes from a file instead of a hand: the file's poses are the device's, and no force moves it.

use std::fs::File;
use std::sync::atomic::AtomicBool;

use kerf_script::Track;
use nalgebra::Vector3;

use super::{Device, DeviceError, DeviceInfo, DeviceState, Servo, paced, unmoved};
use crate::config::RecordedConfig;

/// Half the box that a recording may use, m.
const REACH_M: f64 = 10.0;

/// A recording that is played.
pub struct Recorded {
    info: DeviceInfo,
    track: Track,
    speed: f64,
    time_s: f64,
    before: Option<Vector3<f64>>,
}

impl Recorded {
    /// Reads a recording; `tools` are the names that its rows may go by.
    ///
    /// # Errors
    /// The file, and row and column in it.
    pub fn open(config: &RecordedConfig, tools: &[String]) -> Result<Self, DeviceError> {
        let failed = |what: String, remedy: &str| DeviceError {
            device: config.file.display().to_string(),
            what,
            remedy: remedy.into(),
        };
        let file = File::open(&config.file)
            .map_err(|error| failed(format!("cannot be opened: {error}"), "set `file` to the path of a recording"))?;
        let names = if tools.is_empty() { vec!["0".to_owned()] } else { tools.to_vec() };
        let tracks = kerf_script::read(file, &names)
            .map_err(|error| failed(error.to_string(), "mend the file, or name its tool in `tools`"))?;
        let track = tracks.into_iter().next().expect("a script has a track");
        Ok(Self {
            info: unmoved(config.file.display().to_string(), REACH_M),
            track: track.lifted_at_end(),
            speed: config.speed,
            time_s: 0.0,
            before: None,
        })
    }

    /// Time passes; `None` at the end of the recording.
    fn step(&mut self, dt_s: f64) -> Option<DeviceState> {
        self.time_s += dt_s * self.speed;
        let Some(placement) = self.track.at(self.time_s) else {
            self.before = None;
            let lifted = DeviceState { hold: Some("lifted"), ..DeviceState::default() };
            return (self.time_s < self.track.end_s()).then_some(lifted);
        };
        let position_m = placement.pose.position_m;
        let moved_m = self.before.map_or_else(Vector3::zeros, |before| position_m - before);
        self.before = Some(position_m);
        Some(DeviceState {
            position_m,
            orientation: placement.pose.orientation,
            velocity_m_per_s: moved_m / dt_s.max(1e-6),
            // The first button closes jaws.
            buttons: u32::from(placement.opening < 0.5),
            hold: None,
        })
    }
}

impl Device for Recorded {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        paced::run(servo, stop, self.info.rate_hz, |dt_s, _| self.step(dt_s));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn recording(rows: &str) -> (tempfile::NamedTempFile, RecordedConfig) {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        write!(file, "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw\n{rows}").unwrap();
        let config = RecordedConfig { file: file.path().into(), speed: 2.0 };
        (file, config)
    }

    #[test]
    fn a_recording_is_played_at_its_speed_and_ends() {
        let (_file, config) = recording("0,0,0,0,0,0,0,0,1\n1,0,0.1,0,0,0,0,0,1\n");
        let mut recorded = Recorded::open(&config, &[]).unwrap();
        let state = (0..250).map(|_| recorded.step(1e-3)).last().unwrap().unwrap();
        assert!((state.position_m.x - 0.05).abs() < 1e-9, "{state:?}");
        assert!((state.velocity_m_per_s.x - 0.2).abs() < 1e-6, "{state:?}");
        assert_eq!((0..260).map(|_| recorded.step(1e-3)).last().unwrap(), None);
    }

    #[test]
    fn what_is_wrong_with_a_file_is_told_with_what_to_do() {
        let (_file, config) = recording("0,knife,0,0,0,0,0,0,1\n");
        let error = Recorded::open(&config, &[]).err().unwrap().to_string();
        assert!(error.contains("row 2: column tool") && error.contains("`tools`"), "{error}");
        let gone = RecordedConfig { file: "nowhere.csv".into(), speed: 1.0 };
        assert!(Recorded::open(&gone, &[]).err().unwrap().to_string().contains("nowhere.csv: cannot be opened"));
    }
}
