//! A smooth, blunt tool: a capsule, or a sphere where its axis has no length.

use crate::scene::CapsuleDesc;
use crate::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

/// A normal that points less than this far (cosine) along the one a point came in by is of the other side.
const SAME_SIDE: f64 = 0.5;
/// Closer than this fraction of the radius counts as touching.
const TOUCH: f64 = 1e-6;
/// Most steps of a sweep: it halves its distance or better in each, but for a graze.
const MOST_SWEEP_STEPS: u32 = 32;

/// All points within `radius_m` of a segment of the tool's x axis about its origin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Capsule {
    /// Radius, m.
    pub radius_m: f64,
    /// Half of the segment's length, m.
    pub half_length_m: f64,
}

impl From<&CapsuleDesc> for Capsule {
    fn from(desc: &CapsuleDesc) -> Self {
        Self { radius_m: desc.radius_m, half_length_m: 0.5 * desc.length_m }
    }
}

/// Where a point stands to the capsule, tool frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Point of the surface that the point would leave by, m.
    pub surface_m: Vec3,
    /// Unit normal there, out of the capsule.
    pub normal: Vec3,
    /// Distance of the point from the surface along the normal, negative inside, m.
    pub distance_m: f64,
}

impl Capsule {
    fn on_axis(&self, local_m: &Vec3) -> Vec3 {
        Vec3::new(local_m.x.clamp(-self.half_length_m, self.half_length_m), 0.0, 0.0)
    }

    /// The point of the surface nearest to a point of the tool frame.
    #[must_use]
    pub fn nearest(&self, local_m: &Vec3) -> Nearest {
        let axis_m = self.on_axis(local_m);
        let away = local_m - axis_m;
        let normal = away.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vec3::y);
        let surface_m = axis_m + normal * self.radius_m;
        Nearest { surface_m, normal, distance_m: away.norm() - self.radius_m }
    }

    /// Centre that the normal at a point of the surface turns about, m, and its change over the way along the surface,
    /// 1/m, tool frame.
    #[must_use]
    pub(crate) fn turning(&self, surface_m: &Vec3) -> (Vec3, Mat3) {
        let centre_m = self.on_axis(surface_m);
        let normal = self.nearest(surface_m).normal;
        let mut across = Mat3::identity() - normal * normal.transpose();
        if surface_m.x.abs() < self.half_length_m {
            across -= Vec3::x() * Vec3::x().transpose();
        }
        (centre_m, across / self.radius_m)
    }

    /// Where a point stands that has gone from `from_m` to `to_m` as seen by the tool: by the side that it
    /// came in through, however far it has gone beyond. (A step's motion is taken to be straight.)
    #[must_use]
    pub(crate) fn nearest_after(&self, from_m: &Vec3, to_m: &Vec3) -> Nearest {
        let now = self.nearest(to_m);
        let Some(entry) = self.entry(from_m, to_m) else { return now };
        if now.normal.dot(&entry.normal) > SAME_SIDE {
            return now;
        }
        // Past the axis: out by the plane that touches where it came in.
        Nearest { distance_m: (to_m - entry.surface_m).dot(&entry.normal), ..entry }
    }

    /// Where the way from one point to another meets the capsule first, by steps of the distance.
    fn entry(&self, from_m: &Vec3, to_m: &Vec3) -> Option<Nearest> {
        let way = to_m - from_m;
        let length = way.norm();
        let mut gone = 0.0;
        for _ in 0..MOST_SWEEP_STEPS {
            let at = self.nearest(&(from_m + way * if length > 0.0 { gone / length } else { 0.0 }));
            if at.distance_m <= TOUCH * self.radius_m {
                return Some(at);
            }
            gone += at.distance_m;
            if gone > length {
                break;
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAPSULE: Capsule = Capsule { radius_m: 0.01, half_length_m: 0.02 };

    fn close(a: &Nearest, surface_m: Vec3, normal: Vec3, distance_m: f64) {
        assert!((a.surface_m - surface_m).norm() < 1e-7, "{a:?}");
        assert!((a.normal - normal).norm() < 1e-6, "{a:?}");
        assert!((a.distance_m - distance_m).abs() < 1e-7, "{a:?}");
    }

    #[test]
    fn the_surface_is_a_cylinder_between_two_half_spheres() {
        close(&CAPSULE.nearest(&Vec3::new(0.015, 0.012, 0.0)), Vec3::new(0.015, 0.01, 0.0), Vec3::y(), 0.002);
        close(&CAPSULE.nearest(&Vec3::new(-0.025, 0.0, 0.0)), Vec3::new(-0.03, 0.0, 0.0), -Vec3::x(), -0.005);
    }

    #[test]
    fn a_point_leaves_by_the_side_it_came_in_through() {
        let [above, within, beyond, below] = [0.011, 0.004, -0.004, -0.03].map(|y| Vec3::new(0.0, y, 0.0));
        close(&CAPSULE.nearest_after(&above, &within), Vec3::new(0.0, 0.01, 0.0), Vec3::y(), -0.006);
        close(&CAPSULE.nearest_after(&above, &beyond), Vec3::new(0.0, 0.01, 0.0), Vec3::y(), -0.014);
        close(&CAPSULE.nearest_after(&above, &below), Vec3::new(0.0, 0.01, 0.0), Vec3::y(), -0.04);
        close(&CAPSULE.nearest_after(&within, &beyond), Vec3::new(0.0, 0.01, 0.0), Vec3::y(), -0.014);
        let [aside, past] = [0.011, -0.03].map(|y| Vec3::new(0.0, y, 0.015));
        assert!(CAPSULE.nearest_after(&aside, &past).distance_m > 0.0, "it has passed by");
    }
}
