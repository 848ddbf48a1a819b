//! The patches that can meet one another before the tissue has moved on: found now and then, with some
//! slack (Verlet 1967), so that a step looks at those pairs alone. Where links part, or something has moved farther than
//! its slack, only the patches there are looked for again ([`Candidates::follow`]).

mod follow;
mod hash;
mod nodes;

use super::press::PlacedPatch;
use crate::Vec3;
use crate::body::Body;
use crate::boundary::SurfacePatch;
use crate::grow::make_room;
use follow::Follower;
use nodes::Nodes;

/// Nodes may move by this fraction of the smallest element's edge before patches there are found anew. It changes what is
/// looked at and when, never what is found: less is found anew more often, more looks at more pairs in each step: with
/// three times as much, also at those whose normals are at right angles.
const SLACK_ELEMENTS: f64 = 0.04;
/// Others that a patch has room for on average: where there are more, a step that finds them allocates.
const ROOM_FOR_OTHERS: usize = 32;
/// Patches that may meet others and that there is room for, with theirs: of most of a surface none does.
const ROOM_FOR_MEETING: usize = 256;

/// Room for the others of so many patches.
fn room_for_others(patches: usize) -> usize {
    ROOM_FOR_OTHERS * patches.min(ROOM_FOR_MEETING)
}

/// Patches that may meet another.
#[derive(Debug, Default)]
pub struct Candidates {
    /// By body.
    bodies: Vec<OfBody>,
    /// The patches that were looked at.
    seen: Vec<SeenPatch>,
    lists: Lists,
    reach: Reach,
    /// Those after links parted or things moved on: scratch.
    follower: Follower,
}

/// How far along each axis patches may be from what they meet.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reach {
    /// Where nothing moves, m.
    pub still_m: f64,
    /// More for as far as the two travel towards each other in the step, each this far at most, m.
    pub most_travel_m: f64,
}

impl Reach {
    /// Whether two patches may meet within a step.
    #[must_use]
    pub fn meets(&self, a: &PlacedPatch, b: &PlacedPatch, dt_s: f64) -> bool {
        let beyond_m = (a.at_m - b.at_m).amax() - self.still_m;
        beyond_m <= 0.0 || beyond_m <= self.most_travel_m.min((a.velocity_m_per_s - b.velocity_m_per_s).norm() * dt_s)
    }
}

/// A patch as it was when it was looked for.
#[derive(Clone, Copy, Debug)]
struct SeenPatch {
    /// Index of its body, and its own among the body's patches.
    name: [u32; 2],
    at_m: Vec3,
    /// Outward unit normal, scene frame.
    normal: Vec3,
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
    nodes: Nodes,
    /// Its first patch among those that were looked at, if any of its patches was.
    first: Option<u32>,
    patches: Vec<SurfacePatch>,
    /// Version of the surface that they are of.
    version: u64,
    /// By element, whether its patches are looked for again: scratch.
    again: Vec<bool>,
}

/// What each patch may meet.
#[derive(Debug, Default)]
struct Lists {
    /// Those that may meet others, by their place among all that were looked at, ascending.
    patches: Vec<u32>,
    /// For each of them the others that it may meet, by their place among them, ascending, one list after the other;
    /// and where its list ends.
    others: Vec<u32>,
    ends: Vec<u32>,
    /// By patch, how many candidates come before it: scratch, kept between searches.
    places: Vec<u32>,
}

impl Candidates {
    /// Makes room for as many as there may be.
    pub fn reserve<'a>(&mut self, bodies: impl ExactSizeIterator<Item = &'a Body>, patches: usize) {
        make_room(&mut self.seen, patches);
        self.lists.reserve(patches);
        self.bodies.resize_with(bodies.len(), OfBody::default);
        let mut nodes_of_all = 0;
        for (of_body, body) in self.bodies.iter_mut().zip(bodies) {
            let OfBody { nodes, patches, again, .. } = of_body;
            nodes.reserve(body.node_count());
            nodes_of_all += body.node_count();
            make_room(patches, body.boundary().patches().len());
            make_room(again, body.base().elements.len());
        }
        self.follower.reserve(patches, nodes_of_all);
    }

    /// Forgets them: they are to be found anew.
    pub fn forget(&mut self) {
        self.bodies.iter_mut().for_each(|of_body| of_body.nodes.forget());
    }

    /// Whether nothing else can meet anything within reach in the step that begins.
    #[must_use]
    pub fn hold<'a>(&self, mut bodies: impl Iterator<Item = &'a Body>) -> bool {
        self.bodies.iter().all(|of_body| bodies.next().is_some_and(|body| of_body.nodes.hold(body)))
    }

    /// Looks for those of what has moved on, or for all where they were forgotten: of all bodies that are cut or near
    /// another.
    pub fn look_again<'a>(&mut self, bodies: impl Iterator<Item = &'a Body> + Clone, reach: Reach) {
        self.reach = reach;
        self.look(bodies, |_| &[]);
    }

    /// Body and patch of each, ascending.
    pub fn patches(&self) -> impl ExactSizeIterator<Item = [u32; 2]> + '_ {
        self.lists.patches.iter().map(|patch| self.seen[*patch as usize].name)
    }

    /// The candidates that one of them may meet, by their place among them, ascending.
    pub fn others(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        self.lists.of(index).iter().map(|other| *other as usize)
    }
}

impl Lists {
    fn reserve(&mut self, patches: usize) {
        for list in [&mut self.patches, &mut self.ends, &mut self.places] {
            make_room(list, patches);
        }
        make_room(&mut self.others, room_for_others(patches));
    }

    fn clear(&mut self) {
        [&mut self.patches, &mut self.others, &mut self.ends, &mut self.places].into_iter().for_each(Vec::clear);
    }

    /// Adds the next patch with the others that `write` adds, by their place among all that were looked at.
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
