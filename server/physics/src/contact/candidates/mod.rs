//! The patches that can meet one another before the tissue has moved on: found now and then, among all of
//! them, with some slack (Verlet 1967), so that a step looks at those pairs alone. Where links part only the patches
//! that changed are looked for again ([`Candidates::follow`]).

mod follow;

use super::patch_hash::{PatchHash, PlacedPatch};
use super::press::FACING;
use crate::body::{Body, Nodal};
use crate::boundary::SurfacePatch;

/// Nodes may move by this fraction of the smallest element's edge before the patches are found anew. It changes what is
/// looked at and when, never what is found: less is found anew more often, more looks at more pairs in each step.
const SLACK_ELEMENTS: f64 = 0.125;
/// What the cosine between two normals may fall by meanwhile: elements whose nodes move by the slack turn by
/// 0.15, where their edges are at right angles; this is for 0.25 each.
const TURN: f64 = 0.5;
/// Others that a patch has room for on average: where there are more, a step that finds them allocates.
const ROOM_FOR_OTHERS: usize = 64;

/// Patches that may meet another.
#[derive(Debug, Default)]
pub struct Candidates {
    /// By body.
    bodies: Vec<OfBody>,
    /// The patches that were looked at, where they were then.
    hash: PatchHash,
    lists: Lists,
    /// How far others may have been from them along each axis, m.
    reach_m: f64,
    /// How far nodes may move, m.
    slack_m: f64,
}

/// A copy finds its own: they change what is looked at, never what is found.
impl Clone for Candidates {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// A body as it was when they were found.
#[derive(Debug, Default)]
struct OfBody {
    /// Where its nodes were, m; empty where they are to be found.
    found_at_m: Nodal,
    /// Its first patch in the hash, if its patches were looked at.
    first: Option<u32>,
    patches: Vec<SurfacePatch>,
}

/// What each patch may meet.
#[derive(Debug, Default)]
struct Lists {
    /// Those that may meet others, by their place in the hash, ascending.
    patches: Vec<u32>,
    /// For each of them the others that it may meet, by their place among them, ascending, one list after the other;
    /// and where its list ends.
    others: Vec<u32>,
    ends: Vec<u32>,
    /// By patch in the hash, how many candidates come before it: scratch, kept between searches.
    places: Vec<u32>,
}

impl Candidates {
    /// Makes room for as many as there may be.
    pub fn reserve<'a>(&mut self, bodies: impl ExactSizeIterator<Item = &'a Body>, patches: usize) {
        self.hash.reserve(patches);
        self.lists.reserve(patches);
        self.bodies.resize_with(bodies.len(), OfBody::default);
        for (of_body, body) in self.bodies.iter_mut().zip(bodies) {
            let OfBody { found_at_m, patches, .. } = of_body;
            found_at_m.reserve(body.node_count().saturating_sub(found_at_m.len()));
            patches.reserve(body.boundary().patches().len().saturating_sub(patches.len()));
        }
    }

    /// Forgets them: they are to be found anew.
    pub fn forget(&mut self) {
        self.bodies.iter_mut().for_each(|of_body| of_body.found_at_m.clear());
    }

    /// Whether nothing else can meet anything within `reach_m` along an axis.
    #[must_use]
    pub fn hold<'a>(&self, bodies: impl Iterator<Item = &'a Body>, reach_m: f64) -> bool {
        let moved_m = self.moved_m(bodies);
        moved_m <= self.slack_m && reach_m + 2.0 * moved_m <= self.reach_m
    }

    /// How far a node has moved at most, m; infinite where they are to be found.
    fn moved_m<'a>(&self, bodies: impl Iterator<Item = &'a Body>) -> f64 {
        let mut moved2_m2 = 0.0f64;
        for (OfBody { found_at_m, .. }, body) in self.bodies.iter().zip(bodies) {
            if found_at_m.len() != body.node_count() {
                return f64::INFINITY;
            }
            for (a, b) in found_at_m.iter().zip(&body.state.position_m) {
                moved2_m2 = moved2_m2.max((0..3).map(|i| (a[i] - b[i]).powi(2)).sum());
            }
        }
        moved2_m2.sqrt()
    }

    /// Begins to find them; returns how far from a patch others are to be looked for along each axis, m, where
    /// they meet within `reach_m`.
    pub fn begin<'a>(&mut self, bodies: impl Iterator<Item = &'a Body>, reach_m: f64) -> f64 {
        self.hash.clear();
        let mut edge_m = f64::INFINITY;
        for (of_body, body) in self.bodies.iter_mut().zip(bodies) {
            of_body.found_at_m.clone_from(&body.state.position_m);
            of_body.first = None;
            edge_m = edge_m.min(body.lattice_edge_m());
        }
        self.slack_m = SLACK_ELEMENTS * edge_m;
        self.reach_m = reach_m + 2.0 * self.slack_m;
        self.reach_m
    }

    /// Looks at the patches of a body.
    pub fn add(&mut self, index: usize, body: &Body) {
        let OfBody { first, patches, .. } = &mut self.bodies[index];
        *first = Some(self.hash.placed().len() as u32);
        patches.clear();
        patches.extend_from_slice(body.boundary().patches());
        for patch in 0..patches.len() {
            self.hash.push(PlacedPatch::of(body, &body.state.position_m, [index as u32, patch as u32]));
        }
    }

    /// Finds them among the patches of the bodies that were added since [`Self::begin`].
    pub fn find(&mut self) {
        let Self { hash, lists, .. } = self;
        hash.build(self.reach_m);
        lists.clear();
        (0..hash.placed().len()).for_each(|patch| lists.push(|list| list.extend(facing(hash, patch))));
        lists.finish();
    }

    /// Body and patch of each, ascending.
    pub fn patches(&self) -> impl ExactSizeIterator<Item = [u32; 2]> + '_ {
        self.lists
            .patches
            .iter()
            .map(|patch| self.hash.placed()[*patch as usize])
            .map(|placed| [placed.body, placed.patch])
    }

    /// The candidates that one of them may meet, by their place among them, ascending.
    pub fn others(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        self.lists.of(index).iter().map(|other| *other as usize)
    }
}

/// The patches of a hash that one of them may meet, in the order that it finds them in.
fn facing(hash: &PatchHash, patch: usize) -> impl Iterator<Item = u32> + '_ {
    let placed = hash.placed();
    let PlacedPatch { at_m, normal, .. } = &placed[patch];
    hash.near(at_m).filter(move |other| normal.dot(&placed[*other].normal) <= FACING + TURN).map(|other| other as u32)
}

impl Lists {
    fn reserve(&mut self, patches: usize) {
        for list in [&mut self.patches, &mut self.ends, &mut self.places] {
            list.reserve(patches.saturating_sub(list.len()));
        }
        self.others.reserve((ROOM_FOR_OTHERS * patches).saturating_sub(self.others.len()));
    }

    fn clear(&mut self) {
        [&mut self.patches, &mut self.others, &mut self.ends, &mut self.places].into_iter().for_each(Vec::clear);
    }

    /// Adds the next patch of the hash with the others that `write` adds, by their place in the hash.
    fn push(&mut self, write: impl FnOnce(&mut Vec<u32>)) {
        let patch = self.places.len() as u32;
        self.places.push(self.patches.len() as u32);
        let first = self.others.len();
        write(&mut self.others);
        if self.others.len() > first {
            self.others[first..].sort_unstable();
            self.patches.push(patch);
            self.ends.push(self.others.len() as u32);
        }
    }

    /// Once all patches were added: whom one may meet may meet it, and so is among them.
    fn finish(&mut self) {
        self.others.iter_mut().for_each(|other| *other = self.places[*other as usize]);
    }

    fn of(&self, index: usize) -> &[u32] {
        let first = index.checked_sub(1).map_or(0, |before| self.ends[before] as usize);
        &self.others[first..self.ends[index] as usize]
    }
}
