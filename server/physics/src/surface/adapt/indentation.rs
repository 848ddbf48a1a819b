//! Contact vertices and their projection onto the blade (paper Fig. 6, Eq. 15).
//!
//! First the edge takes what it has gone past:
//! - Where the blade passes through the surface, an edge of the surface that passes through the blade
//!   gets the end that is nearer to it put on the blade's edge: the surface then has a line of vertices
//!   along it, and nothing passes through.
//! - Where a cut has its bottom, walls stand on either side of the blade: a bottom vertex that the edge
//!   has gone past is put on the edge.
//!
//! When the surface around has followed, what is inside the blade yet is put on its flanks.

use super::blade_body::{BladeBody, Foot, Passage};
use super::field::Field;
use super::geodesic::March;
use super::mesh::Slot;
use super::profile::Profile;
use super::reached::Carried;
use super::{Dent, NEGLIGIBLE_VOXELS};
use crate::Vec3;

/// A cut face whose normal is within 37 degrees of the blade's is a wall beside it.
const ALONG_BLADE: f64 = 0.8;
/// The blade presses on a triangle whose normal is within 60 degrees of the cutting direction. It goes
/// sideways out of the others, which follow what it presses on.
const PRESSED: f64 = 0.5;
/// Bottoms and walls farther than this from the blade's middle are of other cuts, in voxels.
const BESIDE_VOXELS: f64 = 1.0;
/// What the edge has gone past by more than its deepest contact and this many voxels it does not press
/// on: there a cut ends that parts whole links only.
const PARTED_VOXELS: f64 = 1.0;
/// Vertices this near to the blade are looked at, in voxels: both ends of an edge across it.
pub const NEAR_VOXELS: f64 = 2.0;
/// Where the edge is farther than this, in voxels, no edge of the surface reaches the blade.
const REACH_VOXELS: f64 = 4.0;
/// Points of the edge that are tried on either side of the nearest one, and how far they reach in
/// voxels: no farther than would take a vertex past its neighbour's place.
const TRIED: i32 = 4;
const TRIED_VOXELS: f64 = 0.5;
/// Vertices that cannot be projected may become so when their neighbours have been.
const PASSES: usize = 3;

/// A vertex near a blade.
pub struct Near {
    slot: Slot,
    at_m: Vec3,
    foot: Foot,
}

impl Near {
    /// A vertex as it is now, if it is near the blade.
    pub fn find(field: &mut Field<'_>, blade: &BladeBody, slot: Slot) -> Option<Self> {
        let (at_m, voxel_m) = (field.base_m(slot), field.body.voxel_size_m());
        let foot = blade.foot(&at_m, REACH_VOXELS * voxel_m)?;
        (foot.beside_m.abs() <= NEAR_VOXELS * voxel_m).then_some(Self { slot, at_m, foot })
    }
}

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
    /// Bottom vertices of cuts: where on the edge they belong and how far it has gone past them, m.
    bottoms: Vec<(Slot, f64, f64)>,
}

impl Indentation {
    /// Finds the vertices among `near` that the edge has gone past and puts them on it; the march is to
    /// start from them and from the other ends of the edges that the blade passes.
    pub fn project(&mut self, field: &mut Field<'_>, dent: &Dent, near: &[Near], march: &mut March) {
        let blade = &dent.blade;
        self.crossed.clear();
        self.bottoms.clear();
        near.iter().for_each(|near| self.look_at(field, dent, near));
        // The clearest cases first: what they settle need not be asked of the others.
        let mesh = field.mesh;
        self.crossed.sort_unstable_by_key(|c| (c.beside_m.to_bits(), c.ends.map(|end| mesh.id(end))));
        for _ in 0..PASSES {
            for (slot, arc_m, _) in &self.bottoms {
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
    fn look_at(&mut self, field: &mut Field<'_>, dent: &Dent, near: &Near) {
        let (blade, &Near { slot, foot, .. }) = (&dent.blade, near);
        let voxel_m = field.body.voxel_size_m();
        let deepest_m = dent.depth_m + PARTED_VOXELS * voxel_m;
        let within = blade.is_beside(&foot) && foot.beside_m.abs() <= BESIDE_VOXELS * voxel_m;
        match walls_at(field, slot, &foot) {
            [true, true] if within && foot.height_m <= deepest_m => {
                self.bottoms.push((slot, foot.arc_m, foot.height_m));
            }
            [false, false] => self.find_crossed(field, dent, deepest_m, near),
            _ => {}
        }
    }

    /// Finds the edges at a vertex that the blade passes through, each from the end with the lower id.
    fn find_crossed(&mut self, field: &mut Field<'_>, dent: &Dent, deepest_m: f64, near: &Near) {
        let (blade, mesh, Near { slot, at_m, foot }) = (&dent.blade, field.mesh, near);
        for [b, c] in mesh.triangles_at(*slot) {
            for other in [b, c].into_iter().filter(|other| mesh.id(*slot) < mesh.id(*other)) {
                let other_m = field.base_m(other);
                if !blade.may_pass(foot, (other_m - at_m).norm()) {
                    continue;
                }
                let Some(passage) = blade.passage(at_m, &other_m).filter(|p| p.height_m <= deepest_m) else { continue };
                let normal = field.normal(*slot, b, c);
                let is_pressed = normal.dot(&blade.up()) >= PRESSED * normal.norm();
                if is_pressed && walls_at(field, other, foot) == [false; 2] {
                    self.crossed.push(Crossed::new(*slot, other, foot, passage));
                }
            }
        }
    }

    /// Gives the march its beginnings: the points of the surface that the edge has displaced, and what
    /// by. Where the blade passes through an edge of the surface that is the height of the passage,
    /// exactly, and the same for both ends, whichever of them was put on the blade.
    fn sow(&self, field: &mut Field<'_>, blade: &BladeBody, march: &mut March) {
        for crossed in &self.crossed {
            let [near_m, far_m] = crossed.ends.map(|end| field.base_m(end));
            let (length_m, share) = ((far_m - near_m).norm(), crossed.passage.share);
            for (end, share) in crossed.ends.into_iter().zip([share, 1.0 - share]) {
                seed(field, march, end, share * length_m, blade.up() * -crossed.passage.height_m);
            }
        }
        for (slot, _, height_m) in &self.bottoms {
            seed(field, march, *slot, 0.0, blade.up() * -*height_m);
        }
    }
}

/// Puts the vertices among `near` that are inside the blade on the flank of their side; the march is to
/// start from them.
pub(crate) fn clear_flanks(field: &mut Field<'_>, blade: &BladeBody, near: &[Near], march: &mut March) {
    for Near { slot, at_m, foot } in near {
        let at = field.base_m(*slot);
        // The edge has displaced it along the blade, so it is as near to it as it was.
        let foot = if at == *at_m { Some(*foot) } else { blade.foot(&at, f64::INFINITY) };
        let Some(foot) = foot.filter(|foot| blade.is_beside(foot)) else { continue };
        if field.is_held(*slot) || foot.beside_m.abs() > BESIDE_VOXELS * field.body.voxel_size_m() {
            continue;
        }
        let side = side_of(field, *slot, &foot);
        if side * foot.beside_m < blade.half_width_m(foot.height_m) {
            let flank_m = blade.flank_point_m(&at, &foot, side);
            if field.quality_at(*slot, flank_m).is_some() {
                field.hold(*slot, flank_m);
                seed(field, march, *slot, 0.0, flank_m - at);
            }
        }
    }
}

/// The side of the blade a vertex belongs to: that of the material behind its walls, for the blade stands
/// where they look; without walls, or at the bottom between them, the side it is on.
fn side_of(field: &mut Field<'_>, slot: Slot, foot: &Foot) -> f64 {
    match walls_at(field, slot, foot) {
        [true, false] => 1.0,
        [false, true] => -1.0,
        _ => 1.0_f64.copysign(foot.beside_m),
    }
}

/// Whether there are walls of a cut along the blade at a vertex: such that look against the blade's
/// normal, and such that look along it.
fn walls_at(field: &mut Field<'_>, slot: Slot, foot: &Foot) -> [bool; 2] {
    let mut looks = [false; 2];
    let mesh = field.mesh;
    for [b, c] in mesh.cut_triangles_at(slot) {
        let normal = field.normal(slot, b, c);
        let along = normal.dot(&foot.normal);
        if along.abs() > ALONG_BLADE * normal.norm() {
            looks[usize::from(along > 0.0)] = true;
        }
    }
    looks
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
    let profile = Profile::at(field.body.likeness, field.mesh.point(slot).voxel);
    let negligible_m = NEGLIGIBLE_VOXELS * field.body.voxel_size_m();
    march.start(field, slot, distance_m, Carried { by_m, profile }, negligible_m);
}

/// Puts a vertex on the point of the edge near `arc_m` that leaves the best triangles (Eq. 15); whether
/// there is one.
fn put_on_edge(field: &mut Field<'_>, blade: &BladeBody, slot: Slot, arc_m: f64) -> bool {
    if field.is_held(slot) {
        return true;
    }
    let spacing_m = TRIED_VOXELS * field.body.voxel_size_m() / f64::from(TRIED);
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
