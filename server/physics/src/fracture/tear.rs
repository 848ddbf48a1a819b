//! Tearing: a cut goes on without a blade where pulled tissue sets free more energy than parting it takes.
//!
//! Where the cuts of a body end, intact links lie in the plane of parted ones. The ends in a cell of the lattice make a
//! station. A step takes the energy release rate at each station whose surroundings have changed enough for it to
//! tear. Where it exceeds Gc the cut goes on in its plane by the edge of an element. It runs no faster than Rayleigh
//! waves, which carry the news of what has opened: a crack that tension opens does not overtake them (Freund 1990).
//! Ends that face each other, or are of several cuts, leave a ligament between them ([`super::ligament`]).

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use super::anchor::fracture_energy;
use super::crack::{Crack, Way};
use super::ligament;
use super::release::{Tip, held_around_j, released};
use super::sweep::{PartingCost, part_quad};
use crate::Vec3;
use crate::body::Body;
use crate::grid::{Crossing, Grid, Ijk, Link, LinkId};

/// What is around a front that is at Gc holds about Gc times the square of an element's edge: within a radius r of a
/// crack that is sheared along its front just Gc r per length (Irwin 1957). With less than this share of it a station
/// is not looked at.
const LEAST_HELD: f64 = 0.25;
/// How many times faster than the energy around it, both relative, a station's release rate is thought to change.
/// Ours: as it rises with the square of the load 1 would do, but for what a blade close by adds.
const RELEASE_PER_HELD: f64 = 4.0;
/// Length of the mean of the normals of ends of one cut, at least. Ours: of two cuts at right angles it is 0.71 where each has
/// half of the ends, of one whose edge turns by 90 degrees within an element 0.9.
const ONE_CUT: f64 = 0.8;
/// The same of the directions from ends to what holds ahead of one front. Ours: of a front at 45 degrees to the lattice it
/// is 0.71, of ends that face each other 0.
const ONE_FRONT: f64 = 0.5;
/// Links by which a cut may rise to the column beside and still be crossed there by the next link of the same direction.
/// Ours: where it is steeper, links across find its ends.
const STEEPEST: f64 = 2.0;
/// Least relative change of the energy around a station for which it is looked at again.
const LEAST_CHANGE: f64 = 5e-3;

/// A place where a cut ends: a parted link and the intact one beside it that its plane crosses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct End {
    ahead: LinkId,
    /// Where the plane crosses the parted link, reference configuration, m.
    at_m: Vec3,
    /// Unit normal of the cut.
    normal: Vec3,
    /// Unit direction in the cut toward the intact link.
    toward: Vec3,
    /// When the link behind it parted, s.
    since_s: f64,
}

/// The ends in one cell of the lattice.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Station {
    ends: Vec<End>,
    /// The least toughness ahead of them; infinite where nothing can be cut.
    gc_j_per_m2: f64,
    /// The ends as one piece of front; absent where they face each other or are of several cuts.
    place: Option<Place>,
    /// What was found when it was looked at; absent where it was not since its ends changed.
    seen: Option<Seen>,
    /// Whether a ligament between its ends has torn since they changed.
    ligament_torn: bool,
}

/// What was found at a station.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Seen {
    /// Elastic energy around it, J.
    held_j: f64,
    /// Energy release rate over Gc.
    drive: f64,
}

/// Ends of a body's cuts, by the lattice cell they lie in.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Tearing {
    stations: BTreeMap<Ijk, Station>,
    step: u64,
    /// Links that tore in the last step, in order, and when the cut came to where it stands beyond them, s.
    torn: Vec<(LinkId, f64)>,
    /// Stations to look at: scratch, kept between steps.
    #[serde(skip)]
    due: Vec<Ijk>,
}

/// What a step found at the ends of a body's cuts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Torn {
    /// What parting took that tore.
    pub cost: PartingCost,
    /// Stations that were looked at.
    pub looks: u32,
}

impl Tearing {
    /// Whether nothing is cut.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.stations.is_empty()
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
        let now_s = self.now_s(body);
        let mut changed = std::collections::BTreeSet::new();
        for (&cell, station) in &mut self.stations {
            let before = station.ends.len();
            station.ends.retain(|end| grid.is_intact(end.ahead));
            if station.ends.len() < before {
                changed.insert(cell);
            }
        }
        for &link in parted {
            let Link::Parted(crossing) = grid.link(link) else { continue };
            let scale = 1 << body.base().exponent;
            let torn = self.torn.binary_search_by_key(&link, |torn| torn.0);
            let since_s = torn.map_or(now_s, |index| self.torn[index].1);
            for end in ends_at(grid, link, &crossing, since_s) {
                let cell = link.cell.map(|c| c.div_euclid(scale));
                self.stations.entry(cell).or_default().ends.push(end);
                changed.insert(cell);
            }
        }
        self.torn.clear();
        for cell in changed {
            if let Some(station) = self.stations.get_mut(&cell) {
                *station = Station::new(body, std::mem::take(&mut station.ends));
            }
        }
        self.stations.retain(|_, station| !station.ends.is_empty());
    }

    /// Goes on by a step. Adds the links ahead of the ends that tear to `links`.
    pub fn advance(&mut self, body: &Body, crack: &mut Crack, links: &mut Vec<(LinkId, Crossing)>) -> Torn {
        self.step += 1;
        self.torn.clear();
        let now_s = self.now_s(body);
        let first = links.len();
        let mut cut_already = PartingCost::default();
        let mut due = std::mem::take(&mut self.due);
        due.clear();
        due.extend(self.stations.iter().filter_map(|(cell, station)| station.is_due(body, now_s).then_some(*cell)));
        for cell in &due {
            let Station { place: Some(place), gc_j_per_m2, .. } = self.stations[cell] else { continue };
            let drive = released(body, &place.tip).j_per_m / (gc_j_per_m2 * self.length_m(body, &place.tip));
            let seen = Seen { held_j: held_around_j(body, &place.tip), drive };
            if let Some(station) = self.stations.get_mut(cell) {
                station.seen = Some(seen);
            }
            if drive >= 1.0 {
                let own = links.len();
                part_quad(body, place.strip(), links);
                let cut_m2 = crack.tear(body, &place.way(), place.reach_m, place.tip.element_edge_m);
                cut_already.area_m2 += cut_m2;
                cut_already.fracture_j += gc_j_per_m2 * cut_m2;
                let reached_s = place.may_go_on_s().max(now_s - body.dt_s());
                self.torn.extend(links[own..].iter().map(|link| (link.0, reached_s)));
            }
        }
        let looks = due.len() as u32;
        self.due = due;
        self.tear_ligaments(body, links);
        self.torn.sort_unstable_by_key(|torn| torn.0);
        let mut cost = PartingCost::of(body, &mut links[first..]);
        cost.area_m2 -= cut_already.area_m2;
        cost.fracture_j -= cut_already.fracture_j;
        Torn { cost, looks }
    }

    /// Adds the links of ligaments that tear. Links that are spared then stay until the ends around them change.
    fn tear_ligaments(&mut self, body: &Body, links: &mut Vec<(LinkId, Crossing)>) {
        let now_s = self.now_s(body);
        let is_ligament = |station: &Station| station.place.is_none() && !station.ligament_torn;
        for (cell, station) in self.stations.iter_mut().filter(|(_, station)| is_ligament(station)) {
            let own = links.len();
            for element in body.base().elements_in(*cell).map(|element| element as usize) {
                if ligament::may_tear(body, element, station.gc_j_per_m2) {
                    ligament::tear(body, element, links);
                }
            }
            station.ligament_torn = links.len() > own;
            self.torn.extend(links[own..].iter().map(|link| (link.0, now_s)));
        }
    }

    fn now_s(&self, body: &Body) -> f64 {
        self.step as f64 * body.dt_s()
    }

    /// Length of front that counts around a tip, m.
    fn length_m(&self, body: &Body, tip: &Tip) -> f64 {
        self.stations.values().flat_map(|station| &station.ends).map(|end| end.length_m(body, tip)).sum()
    }
}

impl Station {
    fn new(body: &Body, ends: Vec<End>) -> Self {
        let gc_j_per_m2 = ends.iter().map(|end| fracture_energy(body, end.ahead)).fold(f64::INFINITY, f64::min);
        let place = if gc_j_per_m2.is_finite() { Place::new(body, &ends) } else { None };
        Self { ends, gc_j_per_m2, place, ..Self::default() }
    }

    /// Whether a look may find that it tears: the news of its opening have come as far as it would tear, and what is
    /// around it holds so much energy, and so much more or less than when it was looked at, that it may.
    fn is_due(&self, body: &Body, now_s: f64) -> bool {
        let Some(place) = self.place.as_ref().filter(|place| place.may_go_on_s() <= now_s) else { return false };
        let held_j = held_around_j(body, &place.tip);
        if held_j < LEAST_HELD * self.gc_j_per_m2 * place.tip.element_edge_m.powi(2) {
            return false;
        }
        self.seen.is_none_or(|seen| {
            let missing = (1.0 - seen.drive).abs() / (RELEASE_PER_HELD * seen.drive.abs().max(1.0));
            (held_j - seen.held_j).abs() >= missing.max(LEAST_CHANGE) * seen.held_j
        })
    }
}

/// Ends of the cut that a parted link belongs to, at the link.
fn ends_at(grid: &Grid, link: LinkId, crossing: &Crossing, since_s: f64) -> impl Iterator<Item = End> {
    let axis = link.axis as usize;
    let normal = Vec3::from(crossing.normal.map(f64::from));
    let at_m = {
        let mut at = grid.centre_m(link.cell);
        at[axis] += f64::from(crossing.t) * grid.voxel_size_m();
        at
    };
    let shifts = [(axis + 1) % 3, (axis + 2) % 3].into_iter().flat_map(|other| [(other, -1), (other, 1)]);
    shifts.filter_map(move |(other, step)| {
        let slope = normal[other] / normal[axis];
        if slope.abs() > STEEPEST {
            return None;
        }
        // How high the plane crosses the column beside, in links.
        let height = f64::from(crossing.t) - slope * f64::from(step);
        let mut ahead = link;
        ahead.cell[other] += step;
        ahead.cell[axis] += height.floor() as i32;
        let mut toward = Vec3::zeros();
        toward[other] = f64::from(step);
        let toward = (toward - normal * toward.dot(&normal)).try_normalize(1e-6)?;
        grid.is_intact(ahead).then_some(End { ahead, at_m, normal, toward, since_s })
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
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Place {
    tip: Tip,
    /// Reach of the ends along the front from the tip, m.
    reach_m: [f64; 2],
    /// When the last of the ends was made, s.
    since_s: f64,
    /// Speed of Rayleigh waves, m/s.
    wave_m_per_s: f64,
}

impl Place {
    /// `None` where the ends face each other or are of several cuts.
    fn new(body: &Body, ends: &[End]) -> Option<Self> {
        let h = body.state.grid.voxel_size_m();
        let weight = 1.0 / ends.len() as f64;
        let middle_m = ends.iter().map(|e| (e.at_m + e.toward * (0.5 * h)) * weight).sum::<Vec3>();
        let first = ends.first()?.normal;
        let normals = ends.iter().map(|e| e.normal * e.normal.dot(&first).signum()).sum::<Vec3>();
        let normal = normals.try_normalize(ONE_CUT * ends.len() as f64)?;
        let toward = ends.iter().map(|e| e.toward).sum::<Vec3>();
        let ahead = (toward - normal * toward.dot(&normal)).try_normalize(ONE_FRONT * ends.len() as f64)?;
        let along = ahead.cross(&normal);
        let along_m = ends.iter().map(|e| (e.at_m - middle_m).dot(&along));
        let (low, high) = along_m.fold((0.0f64, 0.0f64), |(low, high), s| (low.min(s), high.max(s)));
        let voxel = body.state.grid.voxel_at(ends[0].ahead.cell)?;
        let element = body.element_of(voxel);
        let elastic = body.material_of(voxel).elastic;
        Some(Self {
            tip: Tip { position_m: middle_m, ahead, along, element_edge_m: body.element_edge_m(element) },
            reach_m: [low - 0.5 * h, high + 0.5 * h],
            since_s: ends.iter().map(|e| e.since_s).fold(0.0, f64::max),
            wave_m_per_s: elastic.rayleigh_wave_m_per_s(),
        })
    }

    /// When the news of what has opened have come as far as it would tear, s.
    fn may_go_on_s(&self) -> f64 {
        self.since_s + self.tip.element_edge_m / self.wave_m_per_s
    }

    /// From where, and which way, it goes on.
    fn way(&self) -> Way {
        Way { position_m: self.tip.position_m, ahead: self.tip.ahead, along: self.tip.along }
    }

    /// Corners of the strip by which the cut goes on.
    fn strip(&self) -> [Vec3; 4] {
        let Tip { position_m, ahead, along, element_edge_m } = self.tip;
        let [low, high] = self.reach_m.map(|s| position_m + along * s);
        [low, high, high + ahead * element_edge_m, low + ahead * element_edge_m]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workers::Workers;

    #[test]
    fn a_cut_ends_beside_the_links_that_it_parts() {
        let mut body = Body::of_text(
            r#"
            version = 1
            name = "block"
            [[objects]]
            name = "block"
            shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.24, 0.24, 0.08] } }
            voxel_size_m = 0.01
            level = 2
            material = { young_modulus_pa = 1e5, poisson_ratio = 0.3, fracture_energy_j_per_m2 = 10.0 }
            "#,
        );
        // Upright but for 2 in 24 voxels, halfway down.
        let corner = |y: f64, z: f64| Vec3::new(0.1133 + (0.24 - y) / 12.0, y, z);
        let mut links = Vec::new();
        part_quad(&body, [corner(0.3, -1.0), corner(0.3, 1.0), corner(0.1, 1.0), corner(0.1, -1.0)], &mut links);
        let parted = body.part_links(&links).parted;
        body.update_topology(&Workers::serial(), &parted);
        let tearing = Tearing::of(&body);
        let grid = &body.state.grid;
        let ends: Vec<&End> = tearing.stations.values().flat_map(|station| &station.ends).collect();
        assert!(ends.len() >= 8, "one below each column of its end: {}", ends.len());
        for end in ends {
            let ahead_m = (grid.centre_m(end.ahead.cell) + grid.centre_m(end.ahead.upper())) * 0.5;
            let away = (ahead_m - end.at_m).norm() / grid.voxel_size_m();
            assert!(away < 3.0, "{away} voxels from {:?} to {:?}", end.at_m, end.ahead);
        }
    }
}
