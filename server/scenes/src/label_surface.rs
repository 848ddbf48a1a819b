//! The surface of some labels of a map, as a closed triangle mesh.
//!
//! Naive surface nets (Gibson, "Constrained elastic surface nets", 1998): a vertex per cell of eight
//! voxels' centres that the surface passes, at the mean of where it crosses the cell's edges, half-way
//! between voxels; a quad about each crossing. The steps of the voxels are then smoothed away without
//! shrinking what they bound (Taubin, "A signal processing approach to fair surface design", 1995), no
//! vertex farther than its cell reaches. What is at the map's rim is closed there.

use std::collections::BTreeMap;

use kerf_physics::scene::TriangleMesh;
use nalgebra::Vector3;

use crate::nifti::LabelMap;

/// Fractions of the way to the mean of its neighbours that a vertex goes in turn: smoothing, and back from the
/// shrinking that it does.
const SMOOTHING: [f64; 2] = [0.5, -0.53];
/// Times that both are gone: a ball's normals gain little beyond.
const SMOOTHINGS: u32 = 4;
/// Half the edge of a cell, voxels.
const HALF_CELL: f64 = 0.5;

/// Axes of a link and of the cells around it, in cyclic order.
const AXES: [[usize; 3]; 3] = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];

/// The boundary of the voxels whose label is among `labels`, or is not 0 where `labels` is empty; m,
/// scene axes, from the file's origin.
///
/// # Errors
/// A label that no voxel has, or no label at all.
pub(crate) fn surface(map: &LabelMap, labels: &[u16]) -> Result<TriangleMesh, String> {
    refuse_absent(map, labels)?;
    let is_wanted = |voxel| match (map.label(voxel), labels) {
        (0, _) => false,
        (_, []) => true,
        (label, some) => some.contains(&label),
    };
    let mut nets = Nets { map, vertices: BTreeMap::new(), crossings: Vec::new(), quads: Vec::new() };
    let [nx, ny, nz] = map.dims.map(|n| n as i64);
    for k in -1..nz {
        for j in -1..ny {
            for i in -1..nx {
                let here = is_wanted([i, j, k]);
                for axes in AXES {
                    let mut next = [i, j, k];
                    next[axes[0]] += 1;
                    if here != is_wanted(next) {
                        nets.add_quad([i, j, k], axes, here);
                    }
                }
            }
        }
    }
    Ok(nets.finish())
}

fn refuse_absent(map: &LabelMap, labels: &[u16]) -> Result<(), String> {
    let mut is_present = vec![false; 1 << 16];
    map.labels.iter().for_each(|label| is_present[usize::from(*label)] = true);
    let present: Vec<usize> = (1..is_present.len()).filter(|label| is_present[*label]).collect();
    let listed = || {
        let names: Vec<_> = present.iter().take(32).map(usize::to_string).collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    };
    match labels.iter().find(|label| **label == 0 || !is_present[usize::from(**label)]) {
        Some(0) => Err("labels: no voxel has the label 0 that is inside; labels are 1 to 65535".into()),
        Some(absent) => Err(format!("labels: no voxel has the label {absent}; the file's labels are {}", listed())),
        None if present.is_empty() => Err("every voxel has the label 0, which is outside".into()),
        None => Ok(()),
    }
}

/// Vertices by the cell they are in, and what they are the mean of.
struct Nets<'a> {
    map: &'a LabelMap,
    vertices: BTreeMap<[i64; 3], u32>,
    /// Sum of the crossings of each vertex' cell, in voxels, and their number.
    crossings: Vec<(Vector3<f64>, f64)>,
    /// Counter-clockwise seen from outside.
    quads: Vec<[u32; 4]>,
}

impl Nets<'_> {
    /// The quad across the link from `voxel` along the first axis, through the four cells about it.
    fn add_quad(&mut self, voxel: [i64; 3], [along, u, v]: [usize; 3], lower_is_inside: bool) {
        let mut at = Vector3::from(voxel.map(|index| index as f64));
        at[along] += 0.5;
        // Counter-clockwise seen from the link's upper end.
        let corners = [[-1, -1], [0, -1], [0, 0], [-1, 0]].map(|[du, dv]| {
            let mut cell = voxel;
            (cell[u], cell[v]) = (cell[u] + du, cell[v] + dv);
            self.vertex(cell, &at)
        });
        let [a, b, c, d] = corners;
        self.quads.push(if lower_is_inside { [a, b, c, d] } else { [d, c, b, a] });
    }

    /// The vertex of the cell from a voxel's centre up, which a crossing at `at` adds to.
    fn vertex(&mut self, cell: [i64; 3], at: &Vector3<f64>) -> u32 {
        let next = self.crossings.len() as u32;
        let id = *self.vertices.entry(cell).or_insert(next);
        if id == next {
            self.crossings.push((Vector3::zeros(), 0.0));
        }
        let (sum, count) = &mut self.crossings[id as usize];
        *sum += at;
        *count += 1.0;
        id
    }

    fn finish(self) -> TriangleMesh {
        let mut points: Vec<_> = self.crossings.iter().map(|(sum, count)| sum / *count).collect();
        for share in (0..SMOOTHINGS).flat_map(|_| SMOOTHING) {
            self.smooth(&mut points, share);
        }
        let place = |point: &Vector3<f64>| (self.map.first_m + self.map.edges_m * point).into();
        TriangleMesh {
            positions: points.iter().map(place).collect(),
            triangles: self.quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect(),
        }
    }

    /// Moves every vertex a fraction of the way to the mean of its neighbours, within its cell.
    fn smooth(&self, points: &mut [Vector3<f64>], share: f64) {
        let mut sums = vec![(Vector3::zeros(), 0.0); points.len()];
        for quad in &self.quads {
            for (corner, id) in quad.iter().enumerate() {
                let (sum, count) = &mut sums[*id as usize];
                *sum += points[quad[(corner + 1) % 4] as usize] + points[quad[(corner + 3) % 4] as usize];
                *count += 2.0;
            }
        }
        for (cell, id) in &self.vertices {
            let (sum, count) = &sums[*id as usize];
            let point = &mut points[*id as usize];
            let centre = Vector3::from(cell.map(|index| index as f64 + HALF_CELL));
            let moved = (sum / *count - *point) * share + *point - centre;
            *point = centre + moved.map(|x| x.clamp(-HALF_CELL, HALF_CELL));
        }
    }
}
