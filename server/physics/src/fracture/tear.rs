//! Tearing: a cut goes on without a blade where pulled tissue sets free more energy than parting it takes.
//!
//! Where the cuts of a body end, intact links lie in the plane of parted ones. Such ends are kept by element cell.
//! Now and then a step takes the energy release rate at one cell's ends, in turn. Where it exceeds Gc the cut goes on
//! in its plane by the edge of an element. It runs no faster than the material's shear waves, which carry the news of
//! what has opened.

use std::collections::BTreeMap;

use super::anchor::fracture_energy;
use super::release::{Tip, released};
use super::sweep::{PartingCost, part_quad};
use crate::Vec3;
use crate::body::Body;
use crate::grid::{Crossing, Grid, Ijk, Link, LinkId};

/// A place where a cut ends: a parted link and the intact one beside it that its plane crosses.
#[derive(Clone, Copy, Debug, PartialEq)]
struct End {
    ahead: LinkId,
    /// Where the plane crosses the parted link, reference configuration, m.
    at_m: Vec3,
    /// Unit normal of the cut.
    normal: Vec3,
    /// Unit direction in the cut toward the intact link.
    toward: Vec3,
    /// Step in which the link behind it parted.
    since: u64,
}

/// Ends of a body's cuts, by the lattice cell they lie in.
#[derive(Clone, Debug, Default)]
pub struct Tearing {
    ends: BTreeMap<Ijk, Vec<End>>,
    last: Option<Ijk>,
    step: u64,
}

impl Tearing {
    /// Whether nothing is cut.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Ends of the cuts that a body has already.
    #[must_use]
    pub fn of(body: &Body) -> Self {
        let cells = body.state.grid.voxels().iter().map(|voxel| voxel.ijk);
        let links = cells.flat_map(|cell| [0, 1, 2].map(|axis| LinkId { cell, axis }));
        let parted: Vec<_> = links.filter(|link| matches!(body.state.grid.link(*link), Link::Parted(_))).collect();
        let mut tearing = Self::default();
        tearing.update(body, &parted);
        tearing
    }

    /// Follows the links that parted in a step.
    pub fn update(&mut self, body: &Body, parted: &[LinkId]) {
        let grid = &body.state.grid;
        for ends in self.ends.values_mut() {
            ends.retain(|end| grid.is_intact(end.ahead));
        }
        for &link in parted {
            let Link::Parted(crossing) = grid.link(link) else { continue };
            let scale = 1 << body.base().exponent;
            for end in ends_at(grid, link, &crossing, self.step) {
                self.ends.entry(link.cell.map(|c| c.div_euclid(scale))).or_default().push(end);
            }
        }
        self.ends.retain(|_, ends| !ends.is_empty());
    }

    /// Goes on by a step. Where the step `samples`, takes the next cell's ends, and adds the links ahead of them to
    /// `links` where they tear.
    pub fn advance(&mut self, body: &Body, samples: bool, links: &mut Vec<(LinkId, Crossing)>) -> PartingCost {
        self.step += 1;
        if !samples {
            return PartingCost::default();
        }
        let after = self.last.and_then(|last| self.ends.range(next(last)..).next());
        let Some((&cell, ends)) = after.or_else(|| self.ends.iter().next()) else { return PartingCost::default() };
        self.last = Some(cell);
        let Some(place) = Place::new(body, ends) else { return PartingCost::default() };
        let least = ends.iter().map(|end| fracture_energy(body, end.ahead)).fold(f64::INFINITY, f64::min);
        let rested_s = (self.step - place.since) as f64 * body.dt_s();
        if rested_s * place.wave_m_per_s < place.tip.element_edge_m || !least.is_finite() {
            return PartingCost::default();
        }
        let length_m: f64 = self.ends.values().flatten().map(|end| end.length_m(body, &place.tip)).sum();
        if released(body, &place.tip).j_per_m < least * length_m {
            return PartingCost::default();
        }
        let first = links.len();
        part_quad(body, place.strip(), links);
        PartingCost::of(body, &mut links[first..])
    }
}

/// The least key greater than a cell's.
fn next(cell: Ijk) -> Ijk {
    [cell[0], cell[1], cell[2] + 1]
}

/// Ends of the cut that a parted link belongs to, at the link.
fn ends_at(grid: &Grid, link: LinkId, crossing: &Crossing, since: u64) -> impl Iterator<Item = End> {
    let axis = link.axis as usize;
    let normal = Vec3::from(crossing.normal.map(f64::from));
    let at_m = {
        let mut at = grid.centre_m(link.cell);
        at[axis] += f64::from(crossing.t) * grid.voxel_size_m();
        at
    };
    let shifts = [(axis + 1) % 3, (axis + 2) % 3].into_iter().flat_map(|other| [(other, -1), (other, 1)]);
    shifts.filter_map(move |(other, step)| {
        // How high the plane crosses the column beside, in links.
        let height = f64::from(crossing.t) - normal[other] / normal[axis] * f64::from(step);
        let mut ahead = link;
        ahead.cell[other] += step;
        ahead.cell[axis] += height.floor() as i32;
        let mut toward = Vec3::zeros();
        toward[other] = f64::from(step);
        let toward = (toward - normal * toward.dot(&normal)).try_normalize(1e-6)?;
        grid.is_intact(ahead).then_some(End { ahead, at_m, normal, toward, since })
    })
}

impl End {
    /// Length of front that an end stands for, as it counts around `tip`, m: along the lattice a front of direction m
    /// has |m_i| / h ends per length on the lattice's side i.
    fn length_m(&self, body: &Body, tip: &Tip) -> f64 {
        let facing = self.toward.dot(&tip.ahead);
        if facing <= 0.0 {
            return 0.0;
        }
        body.state.grid.voxel_size_m() * facing * tip.weight_at(body, &self.at_m)
    }
}

/// The ends in one cell, as one piece of front.
struct Place {
    tip: Tip,
    /// Reach of the ends along the front from the tip, m.
    reach_m: [f64; 2],
    since: u64,
    wave_m_per_s: f64,
}

impl Place {
    /// `None` where the ends face each other.
    fn new(body: &Body, ends: &[End]) -> Option<Self> {
        let h = body.state.grid.voxel_size_m();
        let weight = 1.0 / ends.len() as f64;
        let middle_m = ends.iter().map(|e| (e.at_m + e.toward * (0.5 * h)) * weight).sum::<Vec3>();
        let first = ends.first()?.normal;
        let normal = ends.iter().map(|e| e.normal * e.normal.dot(&first).signum()).sum::<Vec3>().normalize();
        let toward = ends.iter().map(|e| e.toward).sum::<Vec3>();
        let ahead = (toward - normal * toward.dot(&normal)).try_normalize(0.5)?;
        let along = ahead.cross(&normal);
        let along_m = ends.iter().map(|e| (e.at_m - middle_m).dot(&along));
        let (low, high) = along_m.fold((0.0f64, 0.0f64), |(low, high), s| (low.min(s), high.max(s)));
        let voxel = body.state.grid.voxel_at(ends[0].ahead.cell)?;
        let element = body.element_of(voxel);
        let elastic = body.material_of(voxel).elastic;
        Some(Self {
            tip: Tip { position_m: middle_m, ahead, along, element_edge_m: body.element_edge_m(element) },
            reach_m: [low - 0.5 * h, high + 0.5 * h],
            since: ends.iter().map(|e| e.since).max()?,
            wave_m_per_s: (elastic.mu_pa / elastic.density_kg_per_m3).sqrt(),
        })
    }

    /// Corners of the strip by which the cut goes on.
    fn strip(&self) -> [Vec3; 4] {
        let Tip { position_m, ahead, along, element_edge_m } = self.tip;
        let [low, high] = self.reach_m.map(|s| position_m + along * s);
        [low, high, high + ahead * element_edge_m, low + ahead * element_edge_m]
    }
}
