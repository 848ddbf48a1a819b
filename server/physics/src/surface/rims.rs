//! Vertices of rims that leave their dual cells for the blade.
//!
//! A cut often meets the skin outside of the dual cell that both pass. In the cell the rim would be a tooth of up to a
//! voxel; outside of it triangles may pass through others. So a vertex goes toward where it is wanted as far as it can
//! without that, whether its neighbours stay in their cells or are where they are wanted. That depends on what is near it
//! alone and not on the order: a surface that is rebuilt piece by piece equals one that is built at once.

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

/// Where all vertices are for a trial.
#[derive(Clone, Copy)]
enum Neighbours {
    InCells,
    WhereWanted,
}

/// Shares of the way that are tried.
const SHARES: [f64; 4] = [1.0, 0.75, 0.5, 0.25];
/// Cells, from a dual cell's own along each axis, whose quads its vertices may come to pass through.
const NEAR: RangeInclusive<i32> = -2..=2;

impl Surface {
    /// Where a vertex is best in its dual cell, reference position, m.
    pub(super) fn in_cell_m(&self, id: VertexId) -> Vec3 {
        self.placed_m(id, Neighbours::InCells)
    }

    fn placed_m(&self, id: VertexId, neighbours: Neighbours) -> Vec3 {
        let position_m = match (self.rims.get(&id), neighbours) {
            (Some(rim), Neighbours::InCells) => rim.in_cell_m,
            (Some(rim), Neighbours::WhereWanted) => rim.wanted_m,
            (None, _) => self.vertices[&id].position_m,
        };
        Vec3::from(position_m.map(f64::from))
    }

    /// Puts those vertices of rims where they can be that may pass through the quads of these links.
    pub(super) fn settle_rims(&mut self, links: &[u32], change: &mut SurfaceChange) {
        let mut cells: Vec<u32> = links.iter().map(|link| link / 3).collect();
        sort_dedup(&mut cells);
        let reached = -NEAR.end()..=-NEAR.start();
        let runs = cells.iter().flat_map(|cell| self.lattice.near(*cell, reached.clone()));
        let ids = runs.map(|run| run.start * VERTICES_PER_CELL..run.end * VERTICES_PER_CELL);
        let mut rims: Vec<(VertexId, Rim)> =
            ids.flat_map(|ids| self.rims.range(ids)).map(|(id, rim)| (*id, *rim)).collect();
        rims.sort_unstable_by_key(|(id, _)| *id);
        rims.dedup_by_key(|(id, _)| *id);
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
        let near: Vec<[VertexId; 3]> =
            ids.flat_map(|ids| self.quads.range(ids)).flat_map(|(_, quad)| triangulate(*quad)).collect();
        let moves = |id: &VertexId| together.iter().any(|(other, _)| other == id);
        let is_of_star = |ids: &[VertexId; 3]| ids.iter().any(moves);
        let star: Vec<[VertexId; 3]> = near.iter().copied().filter(is_of_star).collect();
        let neighbours = [Neighbours::InCells, Neighbours::WhereWanted];
        let others = neighbours.map(|neighbours| {
            let place = |ids: &[VertexId; 3]| Placed::new(ids.map(|id| self.placed_m(id, neighbours)));
            near.iter().filter(|ids| !is_of_star(ids)).map(place).collect::<Vec<_>>()
        });
        let passes = |to_m: Vec3| {
            neighbours.iter().zip(&others).any(|(neighbours, others)| {
                let place = |id: VertexId| if moves(&id) { to_m } else { self.placed_m(id, *neighbours) };
                let star: Vec<Placed> = star.iter().map(|ids| Placed::new(ids.map(place))).collect();
                star.iter()
                    .enumerate()
                    .any(|(index, triangle)| star[..index].iter().chain(others).any(|other| triangle.crosses(other)))
            })
        };
        let [from_m, to_m] = [in_cell_m, wanted_m].map(|m| Vec3::from(m.map(f64::from)));
        let stops_m = SHARES.into_iter().map(|share| from_m.lerp(&to_m, share));
        let stop_m = stops_m.into_iter().find(|stop_m| !passes(*stop_m));
        stop_m.map_or(in_cell_m, |stop_m| stop_m.map(|c| c as f32).into())
    }
}
