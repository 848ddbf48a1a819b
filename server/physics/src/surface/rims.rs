//! Vertices of rims that leave their dual cells for the blade.
//!
//! A cut often meets the skin outside of the dual cell that both pass. In the cell the rim would be a tooth of up to a
//! voxel; outside of it triangles may pass through others. So a vertex goes toward where it is wanted as far as it can
//! without that, whichever of its neighbours stay in their cells or are where they are wanted. That depends on what is near
//! it alone and not on the order: a surface that is rebuilt piece by piece equals one that is built at once.

use std::ops::RangeInclusive;

use super::crossing::Placed;
use super::{QUADS_PER_CELL, Surface, SurfaceChange, VERTICES_PER_CELL, VertexId, sort_dedup, triangulate};
use crate::Vec3;

/// A vertex that is wanted outside of its dual cell: reference positions, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rim {
    pub(super) in_cell_m: [f32; 3],
    pub(super) wanted_m: [f32; 3],
}

/// Shares of the way that are tried.
const SHARES: [f64; 4] = [1.0, 0.75, 0.5, 0.25];
/// Cells, from a dual cell's own along each axis, whose quads its vertices may come to pass through.
const NEAR: RangeInclusive<i32> = -2..=2;

impl Surface {
    /// Where a vertex is best in its dual cell, reference position, m.
    pub(super) fn in_cell_m(&self, id: VertexId) -> Vec3 {
        let position_m = self.rims.get(&id).map_or_else(|| self.vertices[&id].position_m, |rim| rim.in_cell_m);
        Vec3::from(position_m.map(f64::from))
    }

    /// Puts those vertices of rims where they can be that may pass through the quads of these links.
    pub(super) fn settle_rims(&mut self, links: &[u32], change: &mut SurfaceChange) {
        if self.rims.is_empty() {
            return;
        }
        let mut cells: Vec<u32> = links.iter().map(|link| link / 3).collect();
        sort_dedup(&mut cells);
        let reached = -NEAR.end()..=-NEAR.start();
        let mut runs: Vec<_> = cells.iter().flat_map(|cell| self.lattice.near(*cell, reached.clone())).collect();
        runs.sort_unstable_by_key(|run| run.start);
        runs.dedup_by(|next, run| {
            let meets = next.start <= run.end;
            if meets {
                run.end = run.end.max(next.end);
            }
            meets
        });
        let ids = runs.iter().map(|run| run.start * VERTICES_PER_CELL..run.end * VERTICES_PER_CELL);
        let rims: Vec<(VertexId, Rim)> =
            ids.flat_map(|ids| self.rims.range(ids)).map(|(id, rim)| (*id, *rim)).collect();
        // The sides of a cut lie on each other, so they go together.
        let is_together = |(a, rim): &(VertexId, Rim), (b, other): &(VertexId, Rim)| {
            a / VERTICES_PER_CELL == b / VERTICES_PER_CELL && rim == other
        };
        for together in rims.chunk_by(is_together) {
            let settled_m = self.settled_m(together);
            for (id, _) in together {
                let position_m = &mut self.vertices.get_mut(id).expect("a rim is of a vertex").position_m;
                if std::mem::replace(position_m, settled_m) != settled_m {
                    change.upserted_vertices.push(*id);
                }
            }
        }
    }

    /// How far vertices of a dual cell go that are wanted in one place, reference position, m.
    fn settled_m(&self, together: &[(VertexId, Rim)]) -> [f32; 3] {
        let (id, Rim { in_cell_m, wanted_m }) = together[0];
        let runs = self.lattice.near(id / VERTICES_PER_CELL, NEAR);
        let ids = runs.map(|run| run.start * QUADS_PER_CELL..run.end * QUADS_PER_CELL);
        let near = ids.flat_map(|ids| self.quads.range(ids)).flat_map(|(_, quad)| triangulate(*quad));
        let moves = |id: &VertexId| together.iter().any(|(other, _)| other == id);
        let (star, others): (Vec<_>, Vec<_>) = near.partition(|ids| ids.iter().any(moves));
        let others: Vec<Trial> = others.iter().flat_map(|ids| self.trials(ids, |_| None)).collect();
        let passes = |to_m: &Vec3| {
            let mut star = star.iter().flat_map(|ids| self.trials(ids, |id| moves(id).then_some(*to_m)));
            star.any(|triangle| {
                others.iter().any(|other| triangle.agrees(other) && triangle.placed.crosses(&other.placed))
            })
        };
        let [from_m, to_m] = [in_cell_m, wanted_m].map(|m| Vec3::from(m.map(f64::from)));
        let stops_m = SHARES.into_iter().map(|share| from_m.lerp(&to_m, share));
        let stop_m = stops_m.into_iter().find(|stop_m| !passes(stop_m));
        stop_m.map_or(in_cell_m, |stop_m| stop_m.map(|c| c as f32).into())
    }

    /// A triangle with each corner in its cell and where it is wanted; but for those that are moved, and where to.
    fn trials(&self, ids: &[VertexId; 3], moved_m: impl Fn(&VertexId) -> Option<Vec3>) -> impl Iterator<Item = Trial> {
        let corners = ids.map(|id| match (moved_m(&id), self.rims.get(&id)) {
            (Some(to_m), _) => [Some(to_m), None],
            (None, rim) => [Some(self.in_cell_m(id)), rim.map(|rim| Vec3::from(rim.wanted_m.map(f64::from)))],
        });
        let dual_cells = ids.map(|id| id / VERTICES_PER_CELL);
        (0..8usize).filter_map(move |which| {
            let is_wanted = [0, 1, 2].map(|corner| which >> corner & 1 == 1);
            let at = |corner: usize| corners[corner][usize::from(is_wanted[corner])];
            Some(Trial { placed: Placed::new([at(0)?, at(1)?, at(2)?]), dual_cells, is_wanted })
        })
    }
}

/// A triangle where it may come to be.
struct Trial {
    placed: Placed,
    dual_cells: [u32; 3],
    /// Which corners are where they are wanted, and not in their cells.
    is_wanted: [bool; 3],
}

impl Trial {
    /// Whether both have what they share in one place.
    fn agrees(&self, other: &Self) -> bool {
        let corners = |trial: &Self| trial.dual_cells.into_iter().zip(trial.is_wanted);
        corners(self).all(|(cell, wanted)| corners(other).all(|(others, theirs)| cell != others || wanted == theirs))
    }
}
