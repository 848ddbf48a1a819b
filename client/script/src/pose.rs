//! A pose, and its cells in a row of CSV.

use csv::StringRecord;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Headers of a pose's cells.
pub const POSE_COLUMNS: [&str; 7] = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"];

/// Pose of a tool in the scene frame; `kerf/v1/types.proto` defines the tool frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Reference point, m.
    pub position_m: Vector3<f64>,
    /// Rotation from the tool frame to the scene frame.
    pub orientation: UnitQuaternion<f64>,
}

impl Pose {
    /// Its cells: the shortest text that reads back to the same numbers.
    #[must_use]
    pub fn cells(&self) -> [String; 7] {
        let [p, q] = [self.position_m.as_slice(), self.orientation.coords.as_slice()];
        std::array::from_fn(|i| if i < 3 { p[i] } else { q[i - 3] }.to_string())
    }

    /// Reads the cells of a row from the column `first` on. The quaternion stays as it stands there: its length is
    /// off 1 by `rounding` at most.
    ///
    /// # Errors
    /// The column and what is wrong with it.
    pub fn of_cells(record: &StringRecord, first: usize, rounding: f64) -> Result<Self, String> {
        let mut numbers = [0.0; POSE_COLUMNS.len()];
        for (i, (value, name)) in numbers.iter_mut().zip(POSE_COLUMNS).enumerate() {
            *value = number(name, &record[first + i])?;
        }
        let [x, y, z, i, j, k, w] = numbers;
        let quaternion = Quaternion::new(w, i, j, k);
        let length = quaternion.norm();
        if (length - 1.0).abs() > rounding {
            return Err(format!("columns qx to qw: the quaternion's length is {length}, not 1"));
        }
        Ok(Self { position_m: Vector3::new(x, y, z), orientation: UnitQuaternion::new_unchecked(quaternion) })
    }
}

pub(crate) fn number(column: &str, text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| format!("column {column}: `{text}` is not a finite number"))
}
