//! What a vertex takes over from the indentation, and from how far.

use super::profile::Profile;
use crate::Vec3;

/// What a vertex of the region takes over from the nearest point of the indentation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carried {
    /// Displacement at the indentation, m, scene frame.
    pub by_m: Vec3,
    /// How the material there follows it.
    pub profile: Profile,
}

/// A vertex that the march has reached, or that it starts from.
#[derive(Clone, Copy, Debug)]
pub struct Reached {
    /// Geodesic distance from the indentation, m.
    pub distance_m: f64,
    /// From where it was reached.
    pub carried: Carried,
    /// Its distance is final.
    pub(super) settled: bool,
}

impl Carried {
    /// `share` of the way from `self` to `other`.
    pub(super) fn towards(&self, other: &Self, share: f64) -> Self {
        let mix = |a: f64, b: f64| a + share * (b - a);
        Self {
            by_m: self.by_m.lerp(&other.by_m, share),
            profile: Profile {
                reach_m: mix(self.profile.reach_m, other.profile.reach_m),
                bulge: mix(self.profile.bulge, other.profile.bulge),
            },
        }
    }
}
