//! Contact vertices and their projection onto the blade (paper Fig. 6, Eq. 15).
//!
//! Three kinds of vertices are put on the blade:
//! - Where the blade passes through the surface, an edge of the surface that passes through the blade
//!   gets the end that is nearer to it put on the blade's edge: the surface then has a line of vertices
//!   along it, and nothing passes through.
//! - Where a cut has its bottom, walls stand on either side of the blade: a bottom vertex that the edge
//!   has gone past is put on the edge.
//! - A vertex of one wall that is inside the blade is put on the flank that the wall looks at.

use super::Dent;
use super::blade_body::{BladeBody, Foot, Passage};
use super::field::Field;
use super::geodesic::{Carried, March, Reached};
use super::mesh::Slot;
use super::profile::Profile;
use crate::Vec3;

/// A triangle whose normal is within 37 degrees of the blade's is a wall beside it, not one it passes.
const ALONG_BLADE: f64 = 0.8;
/// The blade presses on a triangle whose normal is within 53 degrees of the cutting direction. It goes
/// sideways out of the others, which follow what it presses on.
const PRESSED: f64 = 0.6;
/// Bottoms and walls farther than this from the blade's middle are of other cuts, in voxels.
const BESIDE_VOXELS: f64 = 1.0;
/// What the edge has gone past by more than its deepest contact and this many voxels it does not press
/// on: there a cut ends that parts whole links only.
const PARTED_VOXELS: f64 = 1.0;
/// Vertices this near to the blade are looked at, in voxels: both ends of an edge across it.
pub const NEAR_VOXELS: f64 = 2.0;
/// Points of the edge that are tried on either side of the nearest one, and how far they reach in
/// voxels: no farther than would take a vertex past its neighbour's place.
const TRIED: i32 = 4;
const TRIED_VOXELS: f64 = 0.5;
/// Vertices that cannot be projected may become so when their neighbours have been.
const PASSES: usize = 3;

/// An edge of the surface that the blade passes through.
#[derive(Clone, Copy)]
struct Crossed {
    /// The end nearer to the blade first.
    ends: [Slot; 2],
    beside_m: f64,
    passage: Passage,
}

/// What the blade meets of one body's surface.
#[derive(Default)]
pub struct Indentation {
    crossed: Vec<Crossed>,
    /// Bottom vertices of cuts and where on the edge they belong, m.
    bottoms: Vec<(Slot, f64)>,
    /// Wall vertices inside the blade and where on its flank they belong.
    walls: Vec<(Slot, Vec3)>,
}

impl Indentation {
    /// Room for what there may be on a surface of so many vertices.
    pub fn reserve(&mut self, vertices: usize) {
        self.clear();
        self.crossed.reserve(vertices);
        self.bottoms.reserve(vertices);
        self.walls.reserve(vertices);
    }

    fn clear(&mut self) {
        self.crossed.clear();
        self.bottoms.clear();
        self.walls.clear();
    }

    /// Finds the contact vertices among `near` and puts them on the blade; the march is to start from
    /// them and from the other ends of the edges that the blade passes.
    pub fn project(&mut self, field: &mut Field<'_>, dent: &Dent, near: &[Slot], march: &mut March) {
        let blade = &dent.blade;
        self.clear();
        near.iter().for_each(|slot| self.look_at(field, dent, *slot));
        // The clearest cases first: what they settle need not be asked of the others.
        self.crossed.sort_unstable_by_key(|crossed| (crossed.beside_m.to_bits(), crossed.ends));
        for (slot, to_m) in &self.walls {
            if field.quality_at(*slot, *to_m).is_some() {
                field.hold(*slot, *to_m);
            }
        }
        for _ in 0..PASSES {
            for (slot, arc_m) in &self.bottoms {
                put_on_edge(field, blade, *slot, *arc_m);
            }
            for crossed in &self.crossed {
                if !crossed.ends.into_iter().any(|end| field.is_held(end)) {
                    let _ = crossed.ends.into_iter().any(|end| put_on_edge(field, blade, end, crossed.passage.arc_m));
                }
            }
        }
        self.sow(field, blade, march);
    }

    /// Sorts a vertex by the triangles around it.
    fn look_at(&mut self, field: &mut Field<'_>, dent: &Dent, slot: Slot) {
        let blade = &dent.blade;
        let at = field.base_m(slot);
        let (mesh, body) = (field.mesh, field.body);
        let voxel_m = body.grid.voxel_size_m();
        let Some(foot) = blade.foot(&at).filter(|foot| foot.beside_m.abs() <= NEAR_VOXELS * voxel_m) else { return };
        let deepest_m = dent.depth_m + PARTED_VOXELS * voxel_m;
        let mut looks = [false; 2];
        for [_, b, c] in mesh.triangles_at(slot) {
            let [to_b, to_c] = [b, c].map(|other| field.base_m(other) - at);
            let normal = to_b.cross(&to_c);
            let along = normal.dot(&foot.normal);
            if along.abs() > ALONG_BLADE * normal.norm() {
                looks[usize::from(along > 0.0)] = true;
                continue;
            }
            if normal.dot(&blade.up()) < PRESSED * normal.norm() {
                continue;
            }
            // Each edge from the end with the lower number.
            for other in [b, c].into_iter().filter(|other| slot < *other) {
                let passage = blade.passage(&at, &field.base_m(other)).filter(|p| p.height_m <= deepest_m);
                self.crossed.extend(passage.map(|passage| Crossed::new(slot, other, &foot, passage)));
            }
        }
        if !blade.is_beside(&foot) || foot.beside_m.abs() > BESIDE_VOXELS * voxel_m {
            return;
        }
        match looks {
            [true, true] if foot.height_m <= deepest_m => self.bottoms.push((slot, foot.arc_m)),
            [true, false] | [false, true] => {
                // The blade stands where the wall looks.
                let side = if looks[0] { 1.0 } else { -1.0 };
                if side * foot.beside_m < blade.half_width_m(foot.height_m) {
                    self.walls.push((slot, blade.flank_point_m(&at, &foot, side)));
                }
            }
            _ => {}
        }
    }

    /// Gives the march its beginnings: the points of the surface that the blade has displaced, and what
    /// by. Where it passes through an edge of the surface that is the height of the passage, exactly, and
    /// the same for both ends, whichever of them was put on the blade.
    fn sow(&self, field: &mut Field<'_>, blade: &BladeBody, march: &mut March) {
        let down = |height_m: f64| blade.up() * -height_m;
        for crossed in &self.crossed {
            let ends_m = crossed.ends.map(|end| field.base_m(end));
            let distances =
                [crossed.passage.share, 1.0 - crossed.passage.share].map(|s| s * (ends_m[1] - ends_m[0]).norm());
            for (end, distance_m) in crossed.ends.into_iter().zip(distances) {
                seed(field, march, end, distance_m, down(crossed.passage.height_m));
            }
        }
        for (slot, _) in &self.bottoms {
            let at = field.base_m(*slot);
            let height_m = blade.foot(&at).map_or(0.0, |foot| foot.height_m);
            seed(field, march, *slot, 0.0, down(height_m));
        }
        for (slot, to_m) in &self.walls {
            let by_m = to_m - field.base_m(*slot);
            seed(field, march, *slot, 0.0, by_m);
        }
    }
}

impl Crossed {
    fn new(slot: Slot, other: Slot, foot: &Foot, passage: Passage) -> Self {
        if passage.share <= 0.5 {
            Self { ends: [slot, other], beside_m: foot.beside_m.abs(), passage }
        } else {
            let beside_m = foot.beside_m.abs() * (1.0 - passage.share) / passage.share;
            Self { ends: [other, slot], beside_m, passage: Passage { share: 1.0 - passage.share, ..passage } }
        }
    }
}

/// Starts the march from a vertex, if it is the nearest beginning there.
fn seed(field: &mut Field<'_>, march: &mut March, slot: Slot, distance_m: f64, by_m: Vec3) {
    if field.reached(slot).is_none_or(|reached| distance_m < reached.distance_m) {
        let profile = Profile::at(field.body, field.mesh.point(slot).voxel);
        field.reach(slot, Reached::seed(distance_m, Carried { by_m, profile }));
        march.push(slot, distance_m);
    }
}

/// Puts a vertex on the point of the edge near `arc_m` that leaves the best triangles (Eq. 15); whether
/// there is one.
fn put_on_edge(field: &mut Field<'_>, blade: &BladeBody, slot: Slot, arc_m: f64) -> bool {
    if field.is_held(slot) {
        return true;
    }
    let spacing_m = TRIED_VOXELS * field.body.grid.voxel_size_m() / f64::from(TRIED);
    let mut best: Option<(f64, Vec3)> = None;
    for index in -TRIED..=TRIED {
        let point_m = blade.edge_point_m(arc_m + f64::from(index) * spacing_m);
        if let Some(quality) = field.quality_at(slot, point_m)
            && best.is_none_or(|best| quality < best.0)
        {
            best = Some((quality, point_m));
        }
    }
    best.is_some_and(|(_, point_m)| {
        field.hold(slot, point_m);
        true
    })
}
