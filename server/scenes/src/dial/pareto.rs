//! What settings of the dial were measured to cost and to err: a CSV file that `kerf-server tradeoff`
//! writes and the dial reads.
//!
//! Lines `# key = value` stand before the table: `scene`, `fingerprint` (16 hexadecimal digits),
//! `hardware`, `command` and whatever else is worth telling.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use kerf_physics::Scene;
use kerf_physics::scene::ElementKind;
use serde::{Deserialize, Serialize};

use super::setting::{FinerRegions, Setting, fingerprint};

/// The settings that were measured for a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ParetoFront {
    /// What is told of the measurement, by key.
    pub notes: BTreeMap<String, String>,
    /// The points, the dominated ones among them, in the order of the file.
    pub points: Vec<ParetoPoint>,
}

/// A setting with its errors against the reference and its cost. Errors of displacement and force are
/// over the root mean square of the reference's, where and while the tool has it move.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParetoPoint {
    /// See [`Setting::level`].
    pub level: u8,
    /// See [`Setting::voxel_scale`].
    pub voxel_scale: f64,
    /// See [`Setting::rate_hz`].
    pub rate_hz: f64,
    /// See [`Setting::relative_tolerance`].
    pub relative_tolerance: f64,
    /// See [`Setting::element`].
    pub element: ElementKind,
    /// See [`Setting::finer`].
    pub finer: FinerRegions,
    /// Composite elements at rest.
    pub elements: u64,
    /// Root mean square error of the displacement over surface and time, relative.
    pub displacement_rms_error: f64,
    /// Largest error of the displacement, relative to the reference's largest displacement.
    pub displacement_max_error: f64,
    /// Root mean square error of the tool's force over time, relative.
    pub force_rms_error: f64,
    /// Error of the depth of the cut, relative; 0 where the reference does not cut.
    pub cut_depth_error: f64,
    /// Error of the area of the cut, relative; 0 where the reference does not cut.
    pub cut_area_error: f64,
    /// Energy ledger's residual over the tool's work.
    pub energy_residual: f64,
    /// Median duration of a step, ms.
    pub median_ms: f64,
    /// 99th percentile of the duration of a step, ms.
    pub p99_ms: f64,
    /// Memory at its highest, MiB.
    pub memory_mib: f64,
}

impl ParetoPoint {
    /// The setting.
    #[must_use]
    pub fn setting(&self) -> Setting {
        Setting {
            level: self.level,
            voxel_scale: self.voxel_scale,
            rate_hz: self.rate_hz,
            relative_tolerance: self.relative_tolerance,
            element: self.element,
            finer: self.finer,
        }
    }

    /// The one error that the dial goes by: the larger of displacement's and force's, both root mean
    /// squares.
    #[must_use]
    pub fn error(&self) -> f64 {
        self.displacement_rms_error.max(self.force_rms_error)
    }

    /// Time of computing per simulated time; above 1 a session cannot keep its rate.
    #[must_use]
    pub fn load(&self) -> f64 {
        self.median_ms * 1e-3 * self.rate_hz
    }

    /// Whether another point is at least as good in error and load and better in one.
    #[must_use]
    pub fn is_dominated_by(&self, other: &Self) -> bool {
        let (error, load) = (self.error(), self.load());
        other.error() <= error && other.load() <= load && (other.error() < error || other.load() < load)
    }
}

/// A Pareto front's file with a line that is not as it should be.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("{file}: {message}")]
pub struct ParetoError {
    /// The file's name as given.
    pub file: String,
    /// What was found, and where.
    pub message: String,
}

impl ParetoFront {
    /// A Pareto front of a scene without points yet.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let notes = [("scene", scene.desc.name.clone()), ("fingerprint", format!("{:016x}", fingerprint(scene)))];
        Self { notes: notes.map(|(key, value)| (key.to_owned(), value)).into(), points: Vec::new() }
    }

    /// Fingerprint of the scene it was measured for, if it tells it.
    #[must_use]
    pub fn fingerprint(&self) -> Option<u64> {
        u64::from_str_radix(self.notes.get("fingerprint")?, 16).ok()
    }

    /// Reads a Pareto front's file.
    ///
    /// # Errors
    /// The first line that is not as it should be; a number that is not finite or is below 0.
    pub fn parse(file: &str, text: &str) -> Result<Self, ParetoError> {
        let failed = |message: String| ParetoError { file: file.to_owned(), message };
        let mut pareto = Self::default();
        for line in text.lines().filter_map(|line| line.strip_prefix('#')) {
            let (key, value) =
                line.split_once('=').ok_or_else(|| failed(format!("`#{line}` is not `# key = value`")))?;
            pareto.notes.insert(key.trim().to_owned(), value.trim().to_owned());
        }
        let mut table = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
        for row in table.deserialize::<ParetoPoint>() {
            let point = row.map_err(|e| failed(e.to_string()))?;
            if !point.is_sound() {
                return Err(failed(format!("{point:?} holds a number that is not finite or is below 0")));
            }
            pareto.points.push(point);
        }
        Ok(pareto)
    }

    /// The text of the Pareto front's file.
    ///
    /// # Panics
    /// Never: rows of numbers and names are written to memory.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = String::new();
        for (key, value) in &self.notes {
            writeln!(text, "# {key} = {value}").expect("text grows");
        }
        let mut table = csv::Writer::from_writer(Vec::new());
        self.points.iter().for_each(|point| table.serialize(point).expect("a row of numbers and names"));
        text + &String::from_utf8(table.into_inner().expect("memory does not fail")).expect("CSV of ASCII")
    }
}

impl ParetoPoint {
    fn is_sound(&self) -> bool {
        let numbers = [
            self.voxel_scale,
            self.rate_hz,
            self.relative_tolerance,
            self.displacement_rms_error,
            self.displacement_max_error,
            self.force_rms_error,
            self.cut_depth_error,
            self.cut_area_error,
            self.energy_residual,
            self.median_ms,
            self.p99_ms,
            self.memory_mib,
        ];
        numbers.iter().all(|n| n.is_finite() && *n >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalog;

    fn point(load: f64, error: f64) -> ParetoPoint {
        ParetoPoint {
            level: 2,
            voxel_scale: 1.0,
            rate_hz: 1000.0,
            relative_tolerance: 1e-3,
            element: ElementKind::Homogenised,
            finer: FinerRegions::LeftOut,
            elements: 7,
            displacement_rms_error: error,
            displacement_max_error: 0.0,
            force_rms_error: 0.5 * error,
            cut_depth_error: 0.0,
            cut_area_error: 0.0,
            energy_residual: 1e-9,
            median_ms: load,
            p99_ms: 2.0 * load,
            memory_mib: 30.5,
        }
    }

    #[test]
    fn a_pareto_front_comes_back_from_its_file() {
        let mut pareto = ParetoFront::of(&catalog::builtin("liver").unwrap());
        pareto.notes.insert("hardware".into(), "two cores".into());
        pareto.points = vec![point(1.0, 0.1), point(0.1, 0.3)];
        assert_eq!(ParetoFront::parse("pareto.csv", &pareto.to_csv()).unwrap(), pareto);
    }

    #[test]
    fn a_setting_leaves_the_fingerprint_as_it_is_and_a_material_does_not() {
        let mut scene = catalog::builtin("liver").unwrap().into_scene();
        let pareto = ParetoFront::of(&scene);
        point(1.0, 0.1).setting().apply(&mut scene.desc);
        assert_eq!(pareto.fingerprint(), Some(fingerprint(&scene)));
        scene.desc.objects[0].material.young_modulus_pa *= 1.5;
        assert_ne!(pareto.fingerprint(), Some(fingerprint(&scene)));
    }

    #[test]
    fn a_point_is_dominated_where_another_is_no_worse_and_somewhere_better() {
        assert!(point(1.0, 0.1).is_dominated_by(&point(1.0, 0.05)));
        assert!(!point(1.0, 0.1).is_dominated_by(&point(1.0, 0.1)));
        assert!(!point(1.0, 0.1).is_dominated_by(&point(1.5, 0.05)));
    }

    #[test]
    fn what_is_wrong_with_a_file_is_named() {
        let text = ParetoFront { points: vec![point(1.0, f64::NAN)], ..ParetoFront::default() }.to_csv();
        let message = ParetoFront::parse("pareto.csv", &text).unwrap_err().to_string();
        assert!(message.contains("pareto.csv") && message.contains("not finite"), "{message}");
        let message = ParetoFront::parse("pareto.csv", "# no pair\n").unwrap_err().to_string();
        assert!(message.contains("key = value"), "{message}");
    }
}
