//! Components and vertices of one dual cell (Ju et al. 2002, with a vertex per component).

use super::SurfaceVertex;
use super::lattice::{DUAL_CELL_LINKS, corner_cell};
use super::qef::{AROUND_CELL, CELL, Qef};
use crate::Vec3;
use crate::grid::{Grid, Ijk, Link, LinkId, VoxelId};

/// The component of each corner of a dual cell: its lowest corner; four bits a corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Components(u32);

/// A dual cell with the vertices of its components, at the components' numbers.
pub(super) struct DualCell {
    pub(super) components: Components,
    pub(super) vertices: [Option<Contoured>; 8],
}

/// A vertex in its dual cell; at the rim of a cut it is where it was before the cut, and `wanted_m` is where the blade met the
/// skin.
pub(super) struct Contoured {
    pub(super) vertex: SurfaceVertex,
    pub(super) wanted_m: Option<[f32; 3]>,
}

/// What a dual cell is contoured from.
struct Stencil {
    corners: [Option<VoxelId>; 8],
    links: [Link; 12],
}

const OUTSIDE: u8 = 15;
/// Weight of the object's own surface, its skin, against a cut at the cut's rim: what a vertex is off the cut moves
/// material from one side to the other, what it is off the skin is lost to both. Ours.
const SKIN_WEIGHT: f64 = 10.0;

impl Stencil {
    fn around(grid: &Grid, dual_cell: Ijk) -> Self {
        let corners: [_; 8] = std::array::from_fn(|corner| grid.voxel_at(corner_cell(dual_cell, corner)));
        let links = DUAL_CELL_LINKS.map(|(corner, axis)| match (corners[corner], corners[corner | 1 << axis]) {
            // A third of the links at a smooth surface, at no cost.
            (None, None) => Link::Outside,
            _ => grid.link(LinkId { cell: corner_cell(dual_cell, corner), axis }),
        });
        Self { corners, links }
    }
}

impl Components {
    /// Joins the inside corners by the links that are `joining`.
    fn connected(stencil: &Stencil, joining: impl Fn(&Link) -> bool) -> Self {
        let mut lowest: [u8; 8] =
            std::array::from_fn(|corner| stencil.corners[corner].map_or(OUTSIDE, |_| corner as u8));
        // The lowest number spreads by at least one link a pass; no path has more than seven.
        loop {
            let before = lowest;
            for ((corner, axis), link) in DUAL_CELL_LINKS.into_iter().zip(&stencil.links) {
                if joining(link) {
                    let other = corner | 1 << axis;
                    let joined = lowest[corner].min(lowest[other]);
                    (lowest[corner], lowest[other]) = (joined, joined);
                }
            }
            if lowest == before {
                break;
            }
        }
        Self(lowest.iter().rev().fold(0, |packed, label| packed << 4 | u32::from(*label)))
    }

    /// Number of the component an inside corner is in.
    pub(super) fn of(self, corner: usize) -> u32 {
        self.0 >> (4 * corner) & 0xf
    }
}

/// Contours the dual cell with this lowest corner.
pub(super) fn contour(grid: &Grid, dual_cell: Ijk) -> DualCell {
    let stencil = Stencil::around(grid, dual_cell);
    let components = Components::connected(&stencil, |link| *link == Link::Intact);
    let uncut = Components::connected(&stencil, |link| matches!(link, Link::Intact | Link::Parted(_)));
    let vertices = std::array::from_fn(|component| {
        // A component is numbered by its lowest corner, so any other corner has none of its own.
        let exists = components.of(component) == component as u32;
        exists.then(|| vertex(grid, dual_cell, &stencil, [components, uncut], component as u32)).flatten()
    });
    DualCell { components, vertices }
}

/// The vertex of a component, if a crossing touches it. What was one before any cut has its vertices at one
/// place, by all of its crossings, however many cuts have come through it: their sides leave nothing out
/// between them and enclose what they did. At the front of a cut (a parted link both of whose ends are in one
/// component) that place is as far from the crossings as it will be when the front has moved on, so that the
/// vertex stays where it is when it becomes two. At the rim a cut wants the vertex along the skin from where it was before
/// the cut, so that the enclosed volume hardly changes.
fn vertex(
    grid: &Grid,
    dual_cell: Ijk,
    stencil: &Stencil,
    [components, uncut]: [Components; 2],
    component: u32,
) -> Option<Contoured> {
    let (mut skin, mut cut) = (Qef::default(), Qef::default());
    let (mut at_front, mut is_touched) = (false, false);
    for ((corner, axis), link) in DUAL_CELL_LINKS.into_iter().zip(&stencil.links) {
        let (qef, crossing) = match link {
            Link::Boundary(crossing) => (&mut skin, crossing),
            Link::Parted(crossing) => (&mut cut, crossing),
            Link::Intact | Link::Outside => continue,
        };
        let ends = [corner, corner | 1 << axis];
        if ends.iter().all(|end| uncut.of(*end) != uncut.of(component as usize)) {
            continue;
        }
        is_touched |= ends.iter().any(|end| components.of(*end) == component);
        at_front |= components.of(ends[0]) == components.of(ends[1]);
        let mut point = corner_position(corner);
        point[axis as usize] += f64::from(crossing.t);
        qef.add(point, Vec3::from(crossing.normal.map(f64::from)));
    }
    if !is_touched {
        return None;
    }
    let (local, wanted) = if skin.is_empty() {
        (cut.minimise(&if at_front { Vec3::zeros() } else { cut.mean() }, CELL), None)
    } else {
        let on_skin = skin.minimise(&skin.mean(), CELL);
        match cut.is_empty() {
            true => (on_skin, None),
            false => {
                let both = cut.and(&skin.through(&on_skin), SKIN_WEIGHT);
                let wanted = both.minimise(&on_skin, AROUND_CELL);
                (on_skin, (wanted != on_skin).then_some(wanted))
            }
        }
    };
    let position_m = |local: Vec3| -> [f32; 3] {
        (grid.centre_m(dual_cell) + (local - corner_position(0)) * grid.voxel_size_m()).map(|c| c as f32).into()
    };
    let distance2 = |corner: &usize| (corner_position(*corner) - local).norm_squared();
    let nearest = (0..8)
        .filter(|corner| components.of(*corner) == component)
        // The first of equals, hence the lowest corner.
        .min_by(|a, b| distance2(a).total_cmp(&distance2(b)))?;
    let vertex = SurfaceVertex { position_m: position_m(local), voxel: stencil.corners[nearest]? };
    Some(Contoured { vertex, wanted_m: wanted.map(position_m) })
}

/// Corner of a dual cell, in voxels from its centre.
fn corner_position(corner: usize) -> Vec3 {
    Vec3::from_fn(|axis, _| (corner >> axis & 1) as f64 - 0.5)
}
