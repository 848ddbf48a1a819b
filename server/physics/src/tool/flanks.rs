//! The flanks of a blade: the surface that its edge sweeps towards the spine, and its thickness.

use super::edge::Edge;
use crate::Vec3;
use serde::{Deserialize, Serialize};

/// Strips that are looked at together: a wall far from all of them is told so by one box.
const STRIPS_PER_GROUP: usize = 16;

/// The middle surface behind an edge, `edge + t y`, and how far the flanks stand off it. Tool frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flanks {
    strips: Vec<Strip>,
    /// Bounds of each [`STRIPS_PER_GROUP`] strips seen along y: least x and z, most x and z, m.
    groups: Vec<[f64; 4]>,
    /// Height above the edge, m.
    height_m: f64,
    thickness: Thickness,
}

/// Thickness of a blade by the height above its edge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Thickness {
    /// Half of it where it is full, m.
    half_m: f64,
    /// Rise of half of it per height up to there; infinite: it is full from the edge on.
    rise: f64,
}

impl Thickness {
    /// Up to `full_m`, from an edge with this angle between the flanks, rad.
    #[must_use]
    pub fn new(full_m: f64, wedge_angle_rad: Option<f64>) -> Self {
        // Through the vector library's own polynomial: the same bits on every machine.
        let tan = |angle: f64| wide::f64x4::splat(angle).tan().to_array()[0];
        Self { half_m: 0.5 * full_m, rise: wedge_angle_rad.map_or(f64::INFINITY, |angle| tan(0.5 * angle)) }
    }

    /// Thickness where it is full, m.
    fn full_m(&self) -> f64 {
        2.0 * self.half_m
    }

    /// Height over which it grows, m; `None` without a wedge.
    fn wedge_height_m(&self) -> Option<f64> {
        self.rise.is_finite().then(|| self.half_m / self.rise)
    }

    /// Half of it at a height above the edge, m, and how it rises there with the height.
    fn half_at(&self, height_m: f64) -> (f64, f64) {
        let wedge_m = self.rise * height_m;
        if wedge_m < self.half_m { (wedge_m, self.rise) } else { (self.half_m, 0.0) }
    }
}

/// What a straight piece of the edge sweeps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Strip {
    middle_m: Vec3,
    /// Unit tangent of the piece seen along y, and half of its length, m.
    along: Vec3,
    half_m: f64,
    normal: Vec3,
    /// Unit normals where it meets the strip before and after it; none at the ends of the edge.
    corners: [Option<Vec3>; 2],
    /// Rise of the edge along the strip.
    slope: f64,
}

/// A point of the middle surface, tool frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlankPoint {
    /// Where it is, m.
    pub position_m: Vec3,
    /// Unit normal of the surface there.
    pub normal: Vec3,
    /// Height above the edge, m.
    pub height_m: f64,
    /// Distance from it along `normal` of the point it was looked up for, m.
    pub offset_m: f64,
    /// Gradient of `height_m`.
    up: Vec3,
}

/// A flank at a point of the middle surface, tool frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlankFace {
    /// Unit normal out of the blade.
    pub outward: Vec3,
    /// How deep the point that was looked up is inside the blade, m.
    pub depth_m: f64,
}

impl Flanks {
    /// Thickness where it is full, m.
    #[must_use]
    pub fn thickness_m(&self) -> f64 {
        self.thickness.full_m()
    }

    /// Height over which a wedge grows to the thickness, m; `None` where it is full from the edge on.
    #[must_use]
    pub(crate) fn wedge_height_m(&self) -> Option<f64> {
        self.thickness.wedge_height_m()
    }

    /// Of a blade with this edge.
    #[must_use]
    pub fn behind(edge: &Edge, height_m: f64, thickness: Thickness) -> Self {
        let mut strips: Vec<Strip> = edge
            .pieces()
            .iter()
            .map(|piece| {
                let level = Vec3::new(piece.along.x, 0.0, piece.along.z);
                let length = level.norm();
                let along = level / length;
                Strip {
                    middle_m: piece.middle_m,
                    along,
                    half_m: 0.5 * piece.length_m * length,
                    normal: Vec3::new(-along.z, 0.0, along.x),
                    corners: [None; 2],
                    slope: piece.along.y / length,
                }
            })
            .collect();
        for i in 1..strips.len() {
            // Where the edge turns back on itself either side's normal is as good.
            let between = (strips[i - 1].normal + strips[i].normal).try_normalize(1e-6).unwrap_or(strips[i].normal);
            (strips[i - 1].corners[1], strips[i].corners[0]) = (Some(between), Some(between));
        }
        let bounds = |group: &[Strip]| {
            let ends = group.iter().flat_map(|s| [s.middle_m - s.along * s.half_m, s.middle_m + s.along * s.half_m]);
            let none = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
            ends.fold(none, |b, p| [b[0].min(p.x), b[1].min(p.z), b[2].max(p.x), b[3].max(p.z)])
        };
        let groups = strips.chunks(STRIPS_PER_GROUP).map(bounds).collect();
        Self { strips, groups, height_m, thickness }
    }

    /// Height above the edge, m.
    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.height_m
    }

    /// The flank on the side of `point` that its normal points to, or where `side` is -1 on the other.
    #[must_use]
    pub fn face(&self, point: &FlankPoint, side: f64) -> FlankFace {
        let (half_m, rise) = self.thickness.half_at(point.height_m);
        let gradient = point.normal * side - point.up * rise;
        let steepness = (1.0 + rise * rise * point.up.norm_squared()).sqrt();
        FlankFace { outward: gradient / steepness, depth_m: (half_m - side * point.offset_m) / steepness }
    }

    /// The point of the middle surface nearest to `local_m` at the same y, where one within `reach_m` lies
    /// behind the edge.
    #[must_use]
    pub fn nearest(&self, local_m: &Vec3, reach_m: f64) -> Option<FlankPoint> {
        let near = |[x0, z0, x1, z1]: [f64; 4]| {
            (x0 - reach_m..=x1 + reach_m).contains(&local_m.x) && (z0 - reach_m..=z1 + reach_m).contains(&local_m.z)
        };
        let groups = self.strips.chunks(STRIPS_PER_GROUP).zip(&self.groups).filter(|(_, bounds)| near(**bounds));
        let mut nearest: Option<(f64, FlankPoint)> = None;
        for found in groups.flat_map(|(strips, _)| strips).filter_map(|strip| strip.nearest(local_m)) {
            if found.0 <= reach_m && nearest.is_none_or(|best| found.0 < best.0) {
                nearest = Some(found);
            }
        }
        nearest.map(|(_, point)| point)
    }
}

impl Strip {
    /// Distance to the strip at the same y, and the point of it that is nearest; none beyond the edge's ends.
    fn nearest(&self, local_m: &Vec3) -> Option<(f64, FlankPoint)> {
        let offset = local_m - self.middle_m;
        let u = offset.dot(&self.along);
        let at = u.clamp(-self.half_m, self.half_m);
        let normal = if u < at {
            self.corners[0]?
        } else if u > at {
            self.corners[1]?
        } else {
            self.normal
        };
        let mut position_m = self.middle_m + self.along * at;
        let height_m = local_m.y - (self.middle_m.y + self.slope * at);
        position_m.y = local_m.y;
        let aside = local_m - position_m;
        let up = Vec3::y() - self.along * self.slope;
        Some((aside.norm(), FlankPoint { position_m, normal, height_m, offset_m: aside.dot(&normal), up }))
    }
}
