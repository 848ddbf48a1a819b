//! The surface of some labels of a map, as a closed triangle mesh.
//!
//! Naive surface nets (Gibson, "Constrained elastic surface nets", 1998): a vertex per cell of eight
//! voxels' centres that the surface passes, at the mean of where it crosses the cell's edges; a quad about
//! each crossing. A map says of a voxel only that it is inside, so where between two voxels the surface
//! crosses is taken from how much around each of them is inside (`occupancy`): half-way everywhere would make
//! terraces. The steps that are left are smoothed away without shrinking what they bound (Taubin, "A signal
//! processing approach to fair surface design", 1995), no vertex farther than its cell reaches. What is at the
//! map's rim is closed there.

use std::collections::BTreeMap;

use kerf_physics::scene::{Strays, TriangleMesh};
use nalgebra::Vector3;

use crate::label_map::LabelMap;

/// Fractions of the way to the mean of its neighbours that a vertex goes in turn: smoothing, and back from the
/// shrinking that it does.
const SMOOTHING: [f64; 2] = [0.5, -0.53];
/// Times that both are gone: a ball's normals gain little beyond.
const SMOOTHINGS: u32 = 4;
/// Binomial weights along an axis around a voxel, over 4, and those of the same blur twice, over 16. Wider ones make
/// normals better still and take more from what is small: of a ball of five voxels another hundredth.
const BLUR: [f64; 3] = [1.0, 2.0, 1.0];
const BLUR_TWICE: [f64; 5] = [1.0, 4.0, 6.0, 4.0, 1.0];
/// No crossing is nearer to a voxel's centre, voxels: what is thin keeps some thickness.
const NEAREST: f64 = 0.1;
/// Half the edge of a cell, voxels.
const HALF_CELL: f64 = 0.5;

/// A piece of fewer voxels than the largest piece's over this is left out.
const STRAY: usize = 1000;

/// Axes of a link and of the cells around it, in cyclic order.
const AXES: [[usize; 3]; 3] = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];

/// The boundary of the voxels whose label is among `labels`, or is not 0 where `labels` is empty; m,
/// scene axes, from the file's origin.
///
/// # Errors
/// A label that no voxel has, or no label at all; or more quads than `max_quads`.
pub(crate) fn surface(map: &LabelMap, labels: &[u16], max_quads: u64) -> Result<TriangleMesh, String> {
    refuse_absent(map, labels)?;
    let filled = Filled::without_strays(map, |label| label != 0 && (labels.is_empty() || labels.contains(&label)));
    let is_wanted = |voxel| filled.has(voxel);
    let mut nets = Nets { map, vertices: BTreeMap::new(), crossings: Vec::new(), quads: Vec::new() };
    let strays = filled.strays;
    let mut occupancies = BTreeMap::new();
    let mut share = |voxel| *occupancies.entry(voxel).or_insert_with(|| occupancy(voxel, is_wanted));
    let [nx, ny, nz] = map.dims.map(|n| n as i64);
    for k in -1..nz {
        for j in -1..ny {
            for i in -1..nx {
                let here = is_wanted([i, j, k]);
                for axes in AXES {
                    let mut next = [i, j, k];
                    next[axes[0]] += 1;
                    if here != is_wanted(next) {
                        if nets.quads.len() as u64 == max_quads {
                            return Err(format!(
                                "the surface has more than {max_quads} quads, all that is left of what label maps of a scene may have"
                            ));
                        }
                        let up = crossing(share([i, j, k]), share(next), here);
                        nets.add_quad([i, j, k], axes, here, up);
                    }
                }
            }
        }
    }
    Ok(TriangleMesh { strays, ..nets.finish() })
}

/// Voxels that are inside.
struct Filled<'a> {
    map: &'a LabelMap,
    is_filled: Vec<bool>,
    /// What is not among them, though its label is wanted.
    strays: Strays,
}

impl<'a> Filled<'a> {
    /// Those whose label is wanted, but for what a thousandth of the largest piece is more than: strays of a segmentation,
    /// which would stretch the box that a resolution is counted over.
    fn without_strays(map: &'a LabelMap, is_wanted: impl Fn(u16) -> bool) -> Self {
        let is_filled: Vec<bool> = map.labels.iter().map(|label| is_wanted(*label)).collect();
        let mut pieces = Vec::new();
        let mut left = Self { map, is_filled: is_filled.clone(), strays: Strays::default() };
        for first in 0..is_filled.len() {
            if left.is_filled[first] {
                pieces.push((left.take_piece(first), first));
            }
        }
        let mut filled = Self { map, is_filled, strays: Strays::default() };
        let largest = pieces.iter().map(|(voxels, _)| *voxels).max().unwrap_or_default();
        for (voxels, first) in pieces.into_iter().filter(|(voxels, _)| STRAY * voxels < largest) {
            filled.take_piece(first);
            filled.strays.pieces += 1;
            filled.strays.voxels += voxels;
        }
        filled
    }

    /// Empties all that hangs together with a voxel; how many they were.
    fn take_piece(&mut self, first: usize) -> usize {
        let [nx, ny, nz] = self.map.dims;
        let mut open = vec![first];
        let mut voxels = 0;
        self.is_filled[first] = false;
        while let Some(at) = open.pop() {
            voxels += 1;
            let place = [at % nx, at / nx % ny, at / (nx * ny)];
            for (axis, (size, stride)) in [(nx, 1), (ny, nx), (nz, nx * ny)].into_iter().enumerate() {
                let below = (place[axis] > 0).then(|| at - stride);
                let above = (place[axis] + 1 < size).then(|| at + stride);
                for next in [below, above].into_iter().flatten() {
                    if std::mem::take(&mut self.is_filled[next]) {
                        open.push(next);
                    }
                }
            }
        }
        voxels
    }

    fn has(&self, voxel: [i64; 3]) -> bool {
        self.map.index(voxel).is_some_and(|index| self.is_filled[index])
    }
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

/// How much of what is around a voxel's centre is inside: blurred over a voxel, so that it rises evenly
/// across the surface, less what blurring takes from what is bent: 2 B f - B B f.
fn occupancy(voxel: [i64; 3], is_wanted: impl Fn([i64; 3]) -> bool) -> f64 {
    let blurred = |weights: &[f64]| {
        let (reach, whole) = (weights.len() as i64 / 2, weights.iter().sum::<f64>());
        let around = || (-reach..=reach).zip(weights);
        let along = |k, j| around().filter(|(i, _)| is_wanted([voxel[0] + i, j, k])).map(|(_, w)| w).sum::<f64>();
        let across = |k| around().map(|(j, w)| w * along(k, voxel[1] + j)).sum::<f64>();
        around().map(|(k, w)| w * across(voxel[2] + k)).sum::<f64>() / whole.powi(3)
    };
    2.0 * blurred(&BLUR) - blurred(&BLUR_TWICE)
}

/// Where the surface crosses the link between two voxels, from the lower one up, voxels: where half is inside.
/// Half-way where the occupancies do not say so, as in what is thinner than the blur.
fn crossing(lower: f64, upper: f64, lower_is_inside: bool) -> f64 {
    let is_told = if lower_is_inside { lower > 0.5 && upper < 0.5 } else { lower < 0.5 && upper > 0.5 };
    if is_told { ((lower - 0.5) / (lower - upper)).clamp(NEAREST, 1.0 - NEAREST) } else { 0.5 }
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
    /// The quad across the link from `voxel` along the first axis, which the surface crosses `up` from it, through the
    /// four cells about it.
    fn add_quad(&mut self, voxel: [i64; 3], [along, u, v]: [usize; 3], lower_is_inside: bool, up: f64) {
        let mut at = Vector3::from(voxel.map(|index| index as f64));
        at[along] += up;
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
            ..TriangleMesh::default()
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
