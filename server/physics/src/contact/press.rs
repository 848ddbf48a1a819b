//! Narrow phase of tissue against tissue: whether a patch of one surface comes through another, by signed
//! distance in the other's reference configuration.

use crate::body::Body;
use crate::boundary::SurfacePatch;
use crate::grid::{Ijk, LinkId, MaterialPoint, VoxelId};
use crate::{Mat3, Vec3};

/// Surfaces that come closer than this many voxels in a step have a spring ready: what the solve itself
/// pushes together is then caught in the same step. Halved, more is caught a step later; doubled, more
/// springs lie ready that do nothing.
pub const MARGIN_VOXELS: f64 = 0.25;
/// Surfaces face each other where the cosine between their normals is below this, 101 degrees and more: two walls
/// of a wedge that opens by up to 79 degrees. At 0 the sides of an edge would press on each other, at -0.5 a folded
/// flap would come through beyond 60 degrees.
pub const FACING: f64 = -0.2;
/// A patch deeper than this many elements under a surface did not come through it: less than one, so that the far
/// side of a sheet of one element is not taken for the near one.
const MOST_DEPTH_ELEMENTS: f64 = 0.75;
/// A point that an evenly strained element would have farther than this many elements from its middle, along
/// an axis, is not in it however it is bent.
const MOST_ASIDE_ELEMENTS: f64 = 0.8;
/// Depths under a surface, in voxels, at which its material is looked for: it is cut out in whole voxels,
/// and an oblique surface runs up to most of one outside them: sqrt(3)/2 of a voxel where its normal is a diagonal.
const MATERIAL_VOXELS: [f64; 2] = [0.4, 0.9];
/// A point within this fraction of an element of its boundary is in it, whatever rounding says: see [`super::narrow`].
const BOUNDARY: f64 = 1e-9;

/// A patch of a body's surface where it is now.
#[derive(Clone, Copy, Debug)]
pub struct PlacedPatch {
    /// Index of the body.
    pub body: u32,
    /// Index into the body's patches.
    pub patch: u32,
    /// Position, m, scene frame.
    pub at_m: Vec3,
    /// Velocity, m/s, scene frame.
    pub velocity_m_per_s: Vec3,
    /// Outward unit normal as its element has turned, scene frame.
    pub normal: Vec3,
}

impl PlacedPatch {
    /// A patch of a body, given by both their indices.
    #[must_use]
    pub fn of(body: &Body, [index, patch]: [u32; 2]) -> Self {
        let data = &body.boundary().patches()[patch as usize];
        let weights = body.weights(&data.point);
        Self {
            body: index,
            patch,
            at_m: weights.place_m(&body.state.position_m),
            velocity_m_per_s: weights.sum(&body.state.velocity_m_per_s),
            normal: body.rotation(data.element as usize) * data.normal,
        }
    }
}

/// One patch of a body.
#[derive(Clone, Copy)]
pub struct PatchOf<'a> {
    /// The body.
    pub body: &'a Body,
    /// The patch.
    pub patch: &'a SurfacePatch,
    /// Where it is.
    pub placed: &'a PlacedPatch,
    /// Its plane; `None` where its element is crushed flat.
    pub plane: Option<&'a Plane>,
}

/// The plane of a patch as its element is strained.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    /// From the scene to the reference configuration.
    to_rest: Mat3,
    /// Unit outward normal, scene frame.
    normal: Vec3,
    /// Depth in the reference configuration over that in the scene.
    stretch: f64,
}

impl Plane {
    /// `None` where the tissue is crushed flat.
    #[must_use]
    pub fn of(body: &Body, patch: &SurfacePatch) -> Option<Self> {
        let f = body.deformation_gradient(&patch.point);
        let to_rest = f.try_inverse()?;
        let turned = to_rest.tr_mul(&patch.normal);
        let stretch = turned.norm();
        // Of material that is inside out `F^-T` turns what is outward inward.
        Some(Self { to_rest, normal: turned / stretch.copysign(f.determinant()), stretch })
    }
}

/// A patch that comes to the plane of another, or is behind it.
#[derive(Clone, Copy, Debug)]
pub struct Approach {
    /// Distance of the surface's point under the patch from the middle of its own, if the element is strained
    /// evenly, m, reference configuration.
    pub aside_m: f64,
    /// Distance of the patch from the plane, negative behind it, m.
    distance_m: f64,
    /// When it may be over the surface: now, or where it comes to the plane, as a fraction of the step; and where
    /// its foot on the plane would be then if the element is strained evenly, m, reference configuration.
    feet: [Option<(f64, Vec3)>; 2],
}

/// The point of a surface that a patch presses on, or is about to press on.
#[derive(Clone, Copy, Debug)]
pub struct PointBelow {
    /// The surface's point under the patch.
    pub point: MaterialPoint,
    /// Unit normal out of the surface, scene frame.
    pub normal: Vec3,
    /// Distance of the patch from the surface along the normal, negative inside, m.
    pub distance_m: f64,
}

impl PatchOf<'_> {
    /// `H / E` of the element that carries it, at small strain: a stiffness that rose with the strain that
    /// the contact itself makes would feed it.
    #[must_use]
    pub fn compliance_m_per_pa(&self) -> f64 {
        self.edge_m() / self.body.material_of(self.patch.point.voxel).young_modulus_pa
    }

    fn edge_m(&self) -> f64 {
        self.body.element_edge_m(self.patch.element as usize)
    }

    /// The voxel under the surface at a reference position, if it belongs to the patch's element.
    fn voxel_under(&self, at_m: &Vec3) -> Option<VoxelId> {
        let (body, element) = (self.body, self.patch.element as usize);
        let drawn_in_m = at_m + (body.rest_centre_m(element) - at_m) * BOUNDARY;
        MATERIAL_VOXELS.into_iter().find_map(|depth| {
            let inner_m = drawn_in_m - self.patch.normal * (depth * body.state.grid.voxel_size_m());
            body.state.grid.voxel_at(body.state.grid.cell_of(&inner_m)).filter(|v| body.element_of(*v) == element)
        })
    }
}

/// How the middle of `point` comes to the surface that `surface` is a patch of within `dt_s`, if both go on as
/// they move. `None` where it stays farther off than the margin, or comes to another patch.
#[must_use]
pub fn approach(point: &PatchOf<'_>, surface: &PatchOf<'_>, dt_s: f64) -> Option<Approach> {
    let same_element = point.placed.body == surface.placed.body && point.patch.element == surface.patch.element;
    if same_element || point.placed.normal.dot(&surface.placed.normal) > FACING {
        return None;
    }
    let &Plane { to_rest, normal, .. } = surface.plane?;
    let offset_m = point.placed.at_m - surface.placed.at_m;
    let distance_m = offset_m.dot(&normal);
    let travel_m = (point.placed.velocity_m_per_s - surface.placed.velocity_m_per_s) * dt_s;
    let end_m = distance_m + travel_m.dot(&normal);
    let voxel_m = surface.body.state.grid.voxel_size_m();
    if normal.dot(&point.placed.normal) > FACING
        || distance_m.min(end_m) > MARGIN_VOXELS * voxel_m
        || distance_m < -MOST_DEPTH_ELEMENTS * surface.edge_m()
    {
        return None;
    }
    // Under the point as it is, or where it comes to the plane within the step. (From a foot that is not
    // under the point the forces would turn what they act on.)
    let later = if end_m < distance_m { (distance_m / (distance_m - end_m)).clamp(0.0, 1.0) } else { 0.0 };
    let mut aside_m = f64::INFINITY;
    let feet = [Some(0.0), Some(later).filter(|when| *when > 0.0)].map(|when| {
        let there_m = offset_m + travel_m * when?;
        let from_middle_m = to_rest * (there_m - normal * there_m.dot(&normal));
        let about_m = surface.patch.point.position_m + from_middle_m;
        let from_centre_m = about_m - surface.body.rest_centre_m(surface.patch.element as usize);
        // Far off, it is under another patch.
        if from_centre_m.amax() > MOST_ASIDE_ELEMENTS * surface.edge_m() {
            return None;
        }
        aside_m = aside_m.min(from_middle_m.norm());
        Some((when?, about_m))
    });
    feet.iter().any(Option::is_some).then_some(Approach { aside_m, distance_m, feet })
}

/// Where `point` meets `surface`, which it approaches so. `None` where there is no material under it.
#[must_use]
pub fn meet(point: &PatchOf<'_>, surface: &PatchOf<'_>, approach: &Approach, dt_s: f64) -> Option<PointBelow> {
    let body = surface.body;
    let &Plane { normal, stretch, .. } = surface.plane?;
    let travel_m = (point.placed.velocity_m_per_s - surface.placed.velocity_m_per_s) * dt_s;
    let (position_m, voxel) = approach.feet.iter().flatten().find_map(|(when, about_m)| {
        let there_m = point.placed.at_m + travel_m * *when;
        let foot_m = there_m - normal * (there_m - surface.placed.at_m).dot(&normal);
        let position_m = body.invert_map_from(surface.patch.element as usize, &foot_m, about_m)?;
        Some((position_m, surface.voxel_under(&position_m)?))
    })?;
    let mut distance_m = approach.distance_m;
    let own_m = point.patch.point.position_m;
    let same_body = point.placed.body == surface.placed.body;
    if same_body && (own_m - position_m).norm() < surface.edge_m().max(point.edge_m()) {
        if point.patch.across != Some(surface.patch.element) && is_one_piece(point, voxel) {
            return None;
        }
        // At rest nothing overlaps: what seems to is what a plane leaves of a cut that is not plane. It grows
        // with the element and does not shrink with it: a spring would make its own depth by squeezing.
        let at_rest_m = (own_m - surface.patch.point.position_m).dot(&surface.patch.normal);
        distance_m -= at_rest_m.min(0.0) / stretch.min(1.0);
    }
    let offset_m = position_m - surface.patch.point.position_m;
    // Where the element bends, its surface leaves the plane.
    distance_m += offset_m.dot(&surface.patch.normal) / stretch;
    Some(PointBelow { point: MaterialPoint { position_m, voxel }, normal, distance_m })
}

/// Whether a patch and the point that it meets are in one piece of material that goes straight from one to
/// the other: the two sides of a thin sheet.
fn is_one_piece(point: &PatchOf<'_>, met: VoxelId) -> bool {
    let own = point.voxel_under(&point.patch.point.position_m).unwrap_or(point.patch.point.voxel);
    let grid = &point.body.state.grid;
    let [from, to] = [own, met].map(|v| grid.voxels()[v.index()].ijk);
    is_joined(|link| grid.is_intact(link), from, to)
}

/// Whether all links on the way from one cell to another are intact: along the straight line, one axis at
/// a time, the one that lags behind most first.
fn is_joined(is_intact: impl Fn(LinkId) -> bool, from: Ijk, to: Ijk) -> bool {
    let mut cell = from;
    let far = [0, 1, 2].map(|a| (to[a] - from[a]).abs());
    loop {
        let left = [0, 1, 2].map(|a| f64::from((to[a] - cell[a]).abs()) / f64::from(far[a].max(1)));
        let axis = (0..3).fold(0, |most, a| if left[a] > left[most] { a } else { most });
        if left[axis] == 0.0 {
            return true;
        }
        let step = (to[axis] - cell[axis]).signum();
        let mut next = cell;
        next[axis] += step;
        let link = LinkId { cell: if step > 0 { cell } else { next }, axis: axis as u8 };
        if !is_intact(link) {
            return false;
        }
        cell = next;
    }
}
