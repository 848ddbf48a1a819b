//! The patches that can meet one another before the tissue has moved on: found now and then, among all of
//! them, with some slack (Verlet 1967), so that a step looks at those pairs alone.

use super::patch_hash::{PatchHash, PlacedPatch};
use super::press::FACING;
use crate::body::{Body, Nodal};

/// Nodes may move by this fraction of the smallest element's edge before the patches are found anew. It changes what is
/// looked at and when, never what is found: less is found anew more often, more looks at more pairs in each step.
const SLACK_ELEMENTS: f64 = 0.125;
/// What the cosine between two normals may fall by meanwhile: elements whose nodes move by the slack turn by
/// 0.15, where their edges are at right angles; this is for 0.25 each.
const TURN: f64 = 0.5;
/// Others that a patch has room for on average: where there are more, a step that finds them allocates.
const ROOM_FOR_OTHERS: usize = 64;

/// Patches that may meet another.
#[derive(Clone, Debug, Default)]
pub struct Candidates {
    /// Body and patch, ascending.
    patches: Vec<[u32; 2]>,
    /// For each of them the others that it may meet, by their place among them, ascending, one list after the other;
    /// and where its list ends.
    others: Vec<u32>,
    ends: Vec<u32>,
    /// By patch in the hash, how many candidates come before it: scratch, kept between searches.
    places: Vec<u32>,
    /// Where the nodes were when they were found, by body, m; empty where they are to be found.
    found_at_m: Vec<Nodal>,
    /// How far others may have been from them along each axis, m.
    reach_m: f64,
    /// How far nodes may move, m.
    slack_m: f64,
}

impl Candidates {
    /// Forgets them and makes room for as many as there may be.
    pub fn reserve<'a>(&mut self, bodies: impl ExactSizeIterator<Item = &'a Body>, patches: usize) {
        for list in [&mut self.ends, &mut self.places] {
            list.clear();
            list.reserve(patches);
        }
        self.patches.clear();
        self.patches.reserve(patches);
        self.others.clear();
        self.others.reserve(ROOM_FOR_OTHERS * patches);
        self.found_at_m.resize(bodies.len(), Nodal::new());
        for (found_at_m, body) in self.found_at_m.iter_mut().zip(bodies) {
            found_at_m.clear();
            found_at_m.reserve(body.node_count());
        }
    }

    /// Whether nothing else can meet anything within `reach_m` along an axis.
    #[must_use]
    pub fn hold<'a>(&self, bodies: impl Iterator<Item = &'a Body>, reach_m: f64) -> bool {
        let mut moved2_m2 = 0.0f64;
        for (found_at_m, body) in self.found_at_m.iter().zip(bodies) {
            if found_at_m.len() != body.node_count() {
                return false;
            }
            for (a, b) in found_at_m.iter().zip(&body.state.position_m) {
                moved2_m2 = moved2_m2.max((0..3).map(|i| (a[i] - b[i]).powi(2)).sum());
            }
        }
        let moved_m = moved2_m2.sqrt();
        moved_m <= self.slack_m && reach_m + 2.0 * moved_m <= self.reach_m
    }

    /// Begins to find them; returns how far from a patch others are to be looked for along each axis, m, where
    /// they meet within `reach_m`.
    pub fn begin<'a>(&mut self, bodies: impl Iterator<Item = &'a Body>, reach_m: f64) -> f64 {
        self.patches.clear();
        let mut edge_m = f64::INFINITY;
        for (found_at_m, body) in self.found_at_m.iter_mut().zip(bodies) {
            found_at_m.clone_from(&body.state.position_m);
            edge_m = edge_m.min(body.lattice_edge_m());
        }
        self.slack_m = SLACK_ELEMENTS * edge_m;
        self.reach_m = reach_m + 2.0 * self.slack_m;
        self.reach_m
    }

    /// Finds them among the patches of a hash that was built for [`Self::begin`]'s reach.
    pub fn find(&mut self, hash: &PatchHash) {
        let Self { patches, others, ends, places, .. } = self;
        [&mut *others, &mut *ends, &mut *places].into_iter().for_each(Vec::clear);
        let placed = hash.placed();
        let may_face = |a: &PlacedPatch, b: &PlacedPatch| a.normal.dot(&b.normal) <= FACING + TURN;
        for a in placed {
            places.push(patches.len() as u32);
            let first = others.len();
            others.extend(hash.near(&a.at_m).filter(|b| may_face(a, &placed[*b])).map(|b| b as u32));
            if others.len() > first {
                // Whatever the order that the hash finds them in.
                others[first..].sort_unstable();
                patches.push([a.body, a.patch]);
                ends.push(others.len() as u32);
            }
        }
        // Whom it may meet may meet it.
        others.iter_mut().for_each(|other| *other = places[*other as usize]);
    }

    /// Body and patch of each, ascending.
    #[must_use]
    pub fn patches(&self) -> &[[u32; 2]] {
        &self.patches
    }

    /// The candidates that one of them may meet, by their place among them, ascending.
    pub fn others(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        let first = index.checked_sub(1).map_or(0, |before| self.ends[before] as usize);
        self.others[first..self.ends[index] as usize].iter().map(|other| *other as usize)
    }
}
