//! The patches that can meet another one before the tissue has moved on: found now and then, among all of
//! them, with some slack (Verlet 1967), so that a step looks at those alone.

use super::patch_hash::{PatchHash, PlacedPatch};
use super::press::FACING;
use crate::body::{Body, Nodal};

/// Nodes may move by this share of the smallest element's edge before the patches are found anew.
const SLACK_ELEMENTS: f64 = 0.125;
/// What the cosine between two normals may fall by meanwhile: elements whose nodes move by the slack turn by
/// 0.15, where their edges are at right angles; this is for 0.25 each.
const TURN: f64 = 0.5;

/// Patches that may meet another.
#[derive(Clone, Debug, Default)]
pub struct Candidates {
    /// Body and patch, ascending.
    patches: Vec<[u32; 2]>,
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
        self.patches.clear();
        self.patches.reserve(patches);
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
            for (a, b) in found_at_m.iter().zip(&body.position_m) {
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
            found_at_m.clone_from(&body.position_m);
            edge_m = edge_m.min(body.lattice_edge_m());
        }
        self.slack_m = SLACK_ELEMENTS * edge_m;
        self.reach_m = reach_m + 2.0 * self.slack_m;
        self.reach_m
    }

    /// Finds them among the patches of a hash that was built for [`Self::begin`]'s reach.
    pub fn find(&mut self, hash: &PatchHash) {
        let may_face = |a: &PlacedPatch, b: &PlacedPatch| a.normal.dot(&b.normal) <= FACING + TURN;
        let placed = hash.placed();
        let meeting = placed.iter().filter(|a| hash.near(&a.at_m).any(|b| may_face(a, &placed[b])));
        self.patches.extend(meeting.map(|placed| [placed.body, placed.patch]));
    }

    /// Body and patch of each, ascending.
    #[must_use]
    pub fn patches(&self) -> &[[u32; 2]] {
        &self.patches
    }
}
