//! What an edge sweeps, to compare with the links that parted.

use kerf_physics::{Grid, Link, Vec3};

/// What an edge sweeps along the tool's y axis, seen along it: x and z of its points, ascending in x.
pub struct Swept(pub Vec<Vec3>);

impl Swept {
    /// Distance of a point of the tool frame, and the side it is on; the ends go on for ever.
    pub fn distance_m(&self, local: &Vec3) -> f64 {
        let last = self.0.len() - 2;
        let distance = |(i, ends): (usize, &[Vec3])| {
            let [from, to] = [ends[0], ends[1]].map(|p| Vec3::new(p.x, 0.0, p.z));
            let (span, offset) = (to - from, Vec3::new(local.x, 0.0, local.z) - from);
            let low = if i == 0 { f64::NEG_INFINITY } else { 0.0 };
            let high = if i == last { f64::INFINITY } else { 1.0 };
            let aside = offset - span * (offset.dot(&span) / span.norm_squared()).clamp(low, high);
            (aside.norm(), aside.dot(&Vec3::new(-span.z, 0.0, span.x)))
        };
        let (least, _) = self
            .0
            .windows(2)
            .enumerate()
            .map(distance)
            .fold((f64::INFINITY, 0.0), |best, next| if next.0 < best.0 { next } else { best });
        let at = self.0.partition_point(|p| p.x <= local.x).clamp(1, last + 1);
        let (from, to) = (self.0[at - 1], self.0[at]);
        let height = from.z + (to.z - from.z) * (local.x - from.x) / (to.x - from.x);
        least.copysign(local.z - height)
    }

    /// Length of the edge where `inside` holds of x, m.
    pub fn length_m(&self, inside: impl Fn(f64) -> bool) -> f64 {
        self.shares(1e-4).filter(|(at, _)| inside(at.x)).map(|(_, length_m)| length_m).sum()
    }

    /// Points on the edge with the length that each stands for, at most `longest_m`.
    pub fn shares(&self, longest_m: f64) -> impl Iterator<Item = (Vec3, f64)> {
        self.0.windows(2).flat_map(move |ends| {
            let (from, span) = (Vec3::new(ends[0].x, 0.0, ends[0].z), ends[1] - ends[0]);
            let span = Vec3::new(span.x, 0.0, span.z);
            let count = (span.norm() / longest_m).ceil();
            (0..count as usize).map(move |i| (from + span * ((i as f64 + 0.5) / count), span.norm() / count))
        })
    }

    /// Points of what is swept where `depth_m` is positive, with the area that each stands for and its depth.
    pub fn surface(&self, spacing_m: f64, depth_m: impl Fn(&Vec3) -> f64) -> Vec<(Vec3, f64, f64)> {
        let mut points = Vec::new();
        for (at, length_m) in self.shares(spacing_m) {
            for row in 0..(0.1 / spacing_m) as usize {
                let point = at - Vec3::y() * (row as f64 * spacing_m);
                let depth_m = depth_m(&point);
                if depth_m > 0.0 {
                    points.push((point, length_m * spacing_m, depth_m));
                }
            }
        }
        points
    }
}

/// Crossings of the parted links, reference configuration, m.
pub fn crossings(grid: &Grid) -> Vec<Vec3> {
    let mut found = Vec::new();
    for voxel in grid.voxels() {
        // Each link once: from its lower voxel.
        for (link, _) in Grid::links_of(voxel.ijk).filter(|(link, _)| link.cell == voxel.ijk) {
            if let Link::Parted(crossing) = grid.link(link) {
                let mut at = grid.centre_m(link.cell);
                at[link.axis as usize] += f64::from(crossing.t) * grid.voxel_size_m();
                found.push(at);
            }
        }
    }
    found
}
