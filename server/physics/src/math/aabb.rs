//! Axis-aligned boxes.

use super::Vec3;
use serde::{Deserialize, Serialize};

/// Axis-aligned box in the scene frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// Lower corner, m.
    pub min_m: Vec3,
    /// Upper corner, m.
    pub max_m: Vec3,
}

impl Aabb {
    /// The smallest box around `points`.
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        let mut aabb = Self { min_m: Vec3::repeat(f64::INFINITY), max_m: Vec3::repeat(f64::NEG_INFINITY) };
        for p in points {
            aabb.min_m = aabb.min_m.inf(&p);
            aabb.max_m = aabb.max_m.sup(&p);
        }
        aabb
    }

    /// The box around both.
    #[must_use]
    pub fn with(self, other: &Self) -> Self {
        Self { min_m: self.min_m.inf(&other.min_m), max_m: self.max_m.sup(&other.max_m) }
    }

    /// The box grown by `margin_m` on every side.
    #[must_use]
    pub fn grown(self, margin_m: f64) -> Self {
        Self { min_m: self.min_m.add_scalar(-margin_m), max_m: self.max_m.add_scalar(margin_m) }
    }

    /// Whether a point is inside.
    #[must_use]
    pub fn contains(&self, point: &Vec3) -> bool {
        (0..3).all(|a| (self.min_m[a]..=self.max_m[a]).contains(&point[a]))
    }

    /// Whether two boxes meet.
    #[must_use]
    pub fn meets(&self, other: &Self) -> bool {
        (0..3).all(|a| self.min_m[a] <= other.max_m[a] && other.min_m[a] <= self.max_m[a])
    }
}
