//! Vertices that leave their dual cells: those of the rim of a cut for the blade, and those of the skin beside it to make room.
//!
//! A cut often meets the skin outside of the dual cell that both pass. In the cell the rim would be a tooth of up to a
//! voxel; outside of it the skin may fold back on its next vertex, and triangles may pass through others. So the vertices
//! move one after another, each as far as it can without that, in two turns: in each those of the skin, then those of the
//! rim. The order is one of dual cells, and where a vertex comes to be depends on what is near it alone: a surface that is
//! rebuilt piece by piece equals one that is built at once.

use std::collections::BTreeSet;
use std::ops::{Range, RangeInclusive};

use super::crossing::{Placed, cosine, normal_m2};
use super::{QUADS_PER_CELL, Quad, Surface, Touched, VERTICES_PER_CELL, VertexId, point, sort_dedup, triangulate};
use crate::grid::Grid;
use crate::math::Aabb;
use crate::{Mat3, Vec3};

/// Turns in which vertices move. After one alone 1 % of the rims of a sphere of 16 voxels are 0.34 voxels off the blade, after
/// two 0.16.
const TURNS: usize = 2;
/// Shares of the way that are tried.
const SHARES: [f64; 5] = [1.0, 0.8, 0.6, 0.4, 0.2];
/// How far the skin beside a rim makes room, as a share of what the rim's vertices want on average. From a half to all of
/// it leaves rims as near to the blade.
const ROOM: f64 = 0.75;
/// How much less the skin beside a rim moves across itself than along itself; at its edges and where it is bent, across
/// them too.
const ON_SKIN: f64 = 300.0;
/// Cells, from a dual cell's own along each axis, whose quads its vertices may come to pass through.
const NEAR: RangeInclusive<i32> = -2..=2;
/// Dual cells with the vertices of these quads.
const SEEN: RangeInclusive<i32> = -3..=2;
/// Dual cells that see a vertex of one.
const SEEING: RangeInclusive<i32> = -2..=3;
/// Cells whose links have quads with a vertex of a dual cell.
const STAR: RangeInclusive<i32> = 0..=1;
/// Dual cells with the vertices of a cell's quads.
const CORNERS: RangeInclusive<i32> = -1..=0;
/// Twice a triangle's least area, h^2: thinner ones look folded in single precision.
const LEAST_AREA: f64 = 0.02;
/// Cosine of the angle between neighbours' normals that is kept where it was as much, and how much a smaller one may change:
/// no fold, whatever single precision makes of it.
const LEAST_COSINE: f64 = 0.02;
const COSINE_SLACK: f64 = 1e-3;

/// A vertex that leaves where it was contoured: reference positions, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mover {
    /// On the skin in its dual cell.
    pub(super) from_m: [f32; 3],
    /// Where the blade met the skin; `None` beside the rim.
    pub(super) wanted_m: Option<[f32; 3]>,
    /// Where it is after each turn.
    reached_m: [[f32; 3]; TURNS],
}

impl Mover {
    /// One that has not moved yet.
    pub(super) fn new(from_m: [f32; 3], wanted_m: Option<[f32; 3]>) -> Self {
        Self { from_m, wanted_m, reached_m: [from_m; TURNS] }
    }

    /// Where it is in the end.
    pub(super) fn position_m(&self) -> [f32; 3] {
        self.reached_m[TURNS - 1]
    }
}

/// When the vertices of a dual cell move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Turn {
    number: usize,
    is_rim: bool,
    /// A number of the dual cell in no order of places: few vertices wait for each other in a row.
    scattered: u32,
    dual_cell: u32,
}

impl Turn {
    fn of(number: usize, is_rim: bool, dual_cell: u32) -> Self {
        // An odd factor: every dual cell has a number of its own.
        Self { number, is_rim, scattered: dual_cell.wrapping_mul(0x9e37_79b1), dual_cell }
    }
}

/// A vertex at a turn's time: those that come later have not moved.
struct Place {
    id: VertexId,
    now_m: Vec3,
    contoured_m: Vec3,
    wanted_m: Option<Vec3>,
}

/// A triangle at a turn's time.
struct Neighbour {
    ids: [VertexId; 3],
    is_skin: bool,
    placed: Placed,
}

impl Neighbour {
    /// Twice its area along its normal where nothing has moved, m².
    fn contoured_normal_m2(&self, places: &[Place]) -> Vec3 {
        normal_m2(&self.ids.map(|id| place(places, id).contoured_m))
    }

    fn is_of(&self, vertices: &[VertexId]) -> bool {
        self.ids.iter().any(|id| vertices.contains(id))
    }

    /// Its corners with vertices moved.
    fn moved(&self, moves: &[VertexId], to_m: &Vec3) -> [Vec3; 3] {
        std::array::from_fn(|corner| match moves.contains(&self.ids[corner]) {
            true => *to_m,
            false => self.placed.corners_m[corner],
        })
    }

    fn is_skin_beside(&self, other: &Self) -> bool {
        self.is_skin && other.is_skin && self.ids.iter().filter(|id| other.ids.contains(id)).count() == 2
    }
}

/// A triangle of the skin, and twice its area along its normal where nothing has moved.
struct SkinTriangle<'a> {
    triangle: &'a Neighbour,
    before_m2: Vec3,
}

impl Surface {
    /// Where a vertex was contoured, reference position, m.
    pub(super) fn contoured_m(&self, id: VertexId) -> Vec3 {
        point(self.movers.get(&id).map_or_else(|| self.vertices[&id].position_m, |mover| mover.from_m))
    }

    /// Moves those vertices anew that may pass through the quads of these links.
    pub(super) fn settle_rims(&mut self, grid: &Grid, links: &[u32], touched: &mut Touched) {
        if self.movers.is_empty() {
            return;
        }
        let mut cells: Vec<u32> = links.iter().map(|link| link / 3).collect();
        sort_dedup(&mut cells);
        let mut queue = BTreeSet::new();
        self.queue_near(&cells, NEAR, None, &mut queue);
        if queue.is_empty() {
            return;
        }
        let beside: Vec<VertexId> =
            self.runs_near(&cells, CORNERS).flat_map(|ids| self.vertices.range(ids)).map(|(id, _)| *id).collect();
        for id in beside {
            if self.make_room(grid, id, touched) {
                self.queue_near(&[id / VERTICES_PER_CELL], SEEING, None, &mut queue);
            }
        }
        while let Some(turn) = queue.pop_first() {
            let first = turn.dual_cell * VERTICES_PER_CELL;
            let of_cell = self.movers.range(first..first + VERTICES_PER_CELL);
            let movers: Vec<(VertexId, Mover)> = of_cell
                .filter(|(_, mover)| mover.wanted_m.is_some() == turn.is_rim)
                .map(|(id, mover)| (*id, *mover))
                .collect();
            // The sides of a cut lie on each other, so they go together.
            let is_together = |(_, a): &(VertexId, Mover), (_, b): &(VertexId, Mover)| {
                (a.from_m, a.wanted_m) == (b.from_m, b.wanted_m)
            };
            for together in movers.chunk_by(is_together) {
                let ids: Vec<VertexId> = together.iter().map(|(id, _)| *id).collect();
                let reached_m = self.reached_m(grid, turn, &ids);
                let mut has_moved = false;
                for id in ids {
                    let mover = self.movers.get_mut(&id).expect("it was among the movers");
                    has_moved |= std::mem::replace(&mut mover.reached_m[turn.number], reached_m) != reached_m;
                    let settled_m = mover.position_m();
                    self.put(id, settled_m, touched);
                }
                if has_moved {
                    self.queue_near(&[turn.dual_cell], SEEING, Some(turn), &mut queue);
                }
            }
        }
    }

    /// Ids of the vertices of the dual cells at such distances from `cells`, which ascend: in runs, ascending.
    fn runs_near(
        &self,
        cells: &[u32],
        distances: RangeInclusive<i32>,
    ) -> impl Iterator<Item = Range<VertexId>> + use<> {
        let near = |row: Range<u32>| self.lattice.near(row, distances.clone());
        let mut runs: Vec<_> = self.lattice.rows(cells).flat_map(near).collect();
        runs.sort_unstable_by_key(|run| run.start);
        runs.dedup_by(|next, run| {
            let meets = next.start <= run.end;
            if meets {
                run.end = run.end.max(next.end);
            }
            meets
        });
        runs.into_iter().map(|run| run.start * VERTICES_PER_CELL..run.end * VERTICES_PER_CELL)
    }

    /// Queues the movers of the dual cells at such distances from these, for their turns after a turn or for all.
    fn queue_near(
        &self,
        cells: &[u32],
        distances: RangeInclusive<i32>,
        after: Option<Turn>,
        queue: &mut BTreeSet<Turn>,
    ) {
        for (id, mover) in self.runs_near(cells, distances).flat_map(|ids| self.movers.range(ids)) {
            let turns = (0..TURNS).map(|turn| Turn::of(turn, mover.wanted_m.is_some(), id / VERTICES_PER_CELL));
            queue.extend(turns.filter(|turn| after.is_none_or(|after| *turn > after)));
        }
    }

    /// Lets a vertex of the skin make room for a rim beside it, or no more. Returns whether that is new.
    fn make_room(&mut self, grid: &Grid, id: VertexId, touched: &mut Touched) -> bool {
        let mover = self.movers.get(&id);
        if mover.is_some_and(|mover| mover.wanted_m.is_some()) {
            return false;
        }
        let is_rim = |id: &VertexId| self.movers.get(id).is_some_and(|mover| mover.wanted_m.is_some());
        let (mut is_beside, mut is_of_cut) = (false, false);
        for (quad, is_skin) in self.quads_near(grid, id / VERTICES_PER_CELL, STAR) {
            for ids in triangulate(quad).into_iter().filter(|ids| ids.contains(&id)) {
                is_of_cut |= !is_skin;
                is_beside |= ids.iter().any(is_rim);
            }
        }
        match (mover, is_beside && !is_of_cut) {
            (None, true) => {
                let from_m = self.vertices[&id].position_m;
                self.movers.insert(id, Mover::new(from_m, None));
                true
            }
            (Some(mover), false) => {
                let from_m = mover.from_m;
                self.movers.remove(&id);
                self.put(id, from_m, touched);
                true
            }
            _ => false,
        }
    }

    fn put(&mut self, id: VertexId, position_m: [f32; 3], touched: &mut Touched) {
        let vertex = self.vertices.get_mut(&id).expect("a mover is a vertex");
        touched.before.entry(id).or_insert(*vertex);
        vertex.position_m = position_m;
    }

    /// The vertices that those of a turn see, ids ascending.
    fn places(&self, turn: Turn) -> Vec<Place> {
        let mut places = Vec::new();
        for run in self.lattice.near(turn.dual_cell..turn.dual_cell + 1, SEEN) {
            let ids = run.start * VERTICES_PER_CELL..run.end * VERTICES_PER_CELL;
            let mut movers = self.movers.range(ids.clone()).peekable();
            for (id, vertex) in self.vertices.range(ids) {
                let mover = movers.next_if(|(mover, _)| *mover == id).map(|(_, mover)| mover);
                let now_m = mover.map_or(vertex.position_m, |mover| {
                    let own = |number: &usize| Turn::of(*number, mover.wanted_m.is_some(), id / VERTICES_PER_CELL);
                    let last = (0..TURNS).rev().find(|number| own(number) < turn);
                    last.map_or(mover.from_m, |number| mover.reached_m[number])
                });
                places.push(Place {
                    id: *id,
                    now_m: point(now_m),
                    contoured_m: point(mover.map_or(vertex.position_m, |mover| mover.from_m)),
                    wanted_m: mover.and_then(|mover| mover.wanted_m).map(point),
                });
            }
        }
        places
    }

    /// The quads of the links at such distances from a dual cell; whether they are of the skin and no wall of a cut.
    fn quads_near<'a>(
        &'a self,
        grid: &'a Grid,
        dual_cell: u32,
        distances: RangeInclusive<i32>,
    ) -> impl Iterator<Item = (Quad, bool)> + 'a {
        let runs = self.lattice.near(dual_cell..dual_cell + 1, distances);
        let ids = runs.map(|run| run.start * QUADS_PER_CELL..run.end * QUADS_PER_CELL);
        let quads = ids.flat_map(|ids| self.quads.range(ids));
        quads.map(|(id, quad)| (*quad, self.is_skin(grid, *id)))
    }

    /// The triangles of these quads.
    fn neighbours<'a>(
        &'a self,
        grid: &'a Grid,
        dual_cell: u32,
        distances: RangeInclusive<i32>,
        places: &'a [Place],
    ) -> impl Iterator<Item = Neighbour> + 'a {
        self.quads_near(grid, dual_cell, distances).flat_map(|(quad, is_skin)| {
            let corners_m = quad.map(|id| place(places, id).now_m);
            let triangle = |which: [u32; 3]| Neighbour {
                ids: which.map(|corner| quad[corner as usize]),
                is_skin,
                placed: Placed::new(which.map(|corner| corners_m[corner as usize])),
            };
            triangulate([0, 1, 2, 3]).map(triangle)
        })
    }

    /// How far vertices of a dual cell that lie on each other come in a turn, reference position, m.
    fn reached_m(&self, grid: &Grid, turn: Turn, together: &[VertexId]) -> [f32; 3] {
        let places = self.places(turn);
        let Place { now_m: here_m, wanted_m, .. } = place(&places, together[0]);
        let star = self.neighbours(grid, turn.dual_cell, STAR, &places);
        let star: Vec<_> = star.filter(|triangle| triangle.is_of(together)).collect();
        let wanted_m = wanted_m.unwrap_or_else(|| here_m + room_m(&star, &places));
        let stays_m = here_m.map(|c| c as f32).into();
        if wanted_m == *here_m {
            return stays_m;
        }
        let passed = star.iter().flat_map(|triangle| triangle.placed.corners_m);
        let passed = Aabb::around(passed.chain([wanted_m]));
        let others = self.neighbours(grid, turn.dual_cell, NEAR, &places);
        let others: Vec<_> =
            others.filter(|triangle| triangle.placed.bounds.meets(&passed) && !triangle.is_of(together)).collect();
        let with_normal = |triangle| SkinTriangle { triangle, before_m2: triangle.contoured_normal_m2(&places) };
        let skin = star.iter().filter(|triangle| triangle.is_skin).map(|triangle| {
            let beside = star.iter().chain(&others).filter(|other| triangle.is_skin_beside(other));
            (with_normal(triangle), beside.map(with_normal).collect())
        });
        let skin: Vec<(SkinTriangle<'_>, Vec<SkinTriangle<'_>>)> = skin.collect();
        let least_m2 = LEAST_AREA * grid.voxel_size_m().powi(2);
        let spoils = |to_m: &Vec3| {
            let is_spoilt = skin.iter().any(|(SkinTriangle { triangle, before_m2 }, beside)| {
                let normal = normal_m2(&triangle.moved(together, to_m));
                let folds = |other: &SkinTriangle<'_>| {
                    let least = (cosine(before_m2, &other.before_m2) - COSINE_SLACK).min(LEAST_COSINE);
                    cosine(&normal, &normal_m2(&other.triangle.moved(together, to_m))) < least
                };
                let is_turned = normal.dot(before_m2) < 0.0 || normal.norm() < least_m2.min(before_m2.norm());
                is_turned || beside.iter().any(folds)
            });
            is_spoilt
                || star.iter().any(|triangle| {
                    let placed = Placed::new(triangle.moved(together, to_m));
                    others.iter().any(|other| placed.crosses(&other.placed))
                })
        };
        let mut stops_m = SHARES.into_iter().map(|share| here_m.lerp(&wanted_m, share));
        stops_m.find(|to_m| !spoils(to_m)).map_or(stays_m, |to_m| to_m.map(|c| c as f32).into())
    }
}

fn place(places: &[Place], id: VertexId) -> &Place {
    &places[places.binary_search_by_key(&id, |place| place.id).expect("corners of quads nearby are among them")]
}

/// The room that rims want of a vertex of the skin with these triangles, along the skin, m.
fn room_m(star: &[Neighbour], places: &[Place]) -> Vec3 {
    let ids: BTreeSet<VertexId> = star.iter().flat_map(|triangle| triangle.ids).collect();
    let wants_m = ids.into_iter().map(|id| place(places, id)).filter_map(|rim| Some(rim.wanted_m? - rim.now_m));
    let (count, sum_m) = wants_m.fold((0, Vec3::zeros()), |(count, sum_m), want_m| (count + 1, sum_m + want_m));
    let normals = star.iter().filter_map(|triangle| triangle.contoured_normal_m2(places).try_normalize(0.0));
    let off_skin: Mat3 = normals.map(|normal| normal * normal.transpose()).sum();
    let held = Mat3::identity() + off_skin * (ON_SKIN / star.len() as f64);
    held.try_inverse().map_or_else(Vec3::zeros, |along_skin| along_skin * sum_m * (ROOM / f64::from(count.max(1))))
}
