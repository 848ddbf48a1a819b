//! What a cut, and what moves on, changes of them: pairs of patches that stay as they were stay as they were found.

use super::hash::PointHash;
use super::nodes::Motion;
use super::{Candidates, Lists, OfBody, SLACK_ELEMENTS, SeenPatch, room_for_others};
use crate::Vec3;
use crate::body::Body;
use crate::contact::press::FACING;
use crate::grow::make_room;
use crate::math::Aabb;

/// What the cosine between two normals may fall by while patches are not looked for: elements whose nodes move by the
/// slack turn by 0.048, where their edges are at right angles; this is for 0.08 each. Fast ones may turn by more.
pub(super) const TURN: f64 = 0.16;
/// Stands for a patch that is gone or is looked for again.
const GONE: u32 = u32::MAX;

/// The patches after links parted or things moved on, beside those before.
#[derive(Debug, Default)]
pub(super) struct Follower {
    seen: Vec<SeenPatch>,
    lists: Lists,
    /// Of them what may be near one that is looked for again.
    hash: PointHash,
    /// By patch before, its place after; [`GONE`] where it is looked for again.
    after: Vec<u32>,
    /// By patch after, how far it may move if it is looked for again, m.
    again_m: Vec<Option<f64>>,
    /// Pairs of a patch that is looked for again and one that it may meet, ascending by the first; and pairs that one
    /// found which the other does not look for.
    found: Vec<[u32; 2]>,
    returned: Vec<[u32; 2]>,
    /// Of a body's patches, what each was before, or [`GONE`].
    before: Vec<u32>,
    /// Of all nodes along an axis, m/s.
    speeds: Vec<f64>,
}

impl Candidates {
    /// Follows surfaces whose links parted, and what has moved on. `changed` are, by body, the elements that carry their
    /// patches in another way than before, ascending.
    pub fn follow<'a, 'b>(
        &mut self,
        bodies: impl Iterator<Item = &'a Body> + Clone,
        changed: impl Fn(usize) -> &'b [u32],
    ) {
        if !self.bodies.iter().any(|of_body| of_body.nodes.is_forgotten()) {
            self.look(bodies, changed);
        }
    }

    /// Looks for patches of which elements are `changed` or moved on, or for all where they were forgotten.
    pub(super) fn look<'a, 'b>(
        &mut self,
        bodies: impl Iterator<Item = &'a Body> + Clone,
        changed: impl Fn(usize) -> &'b [u32],
    ) {
        let edge_m = bodies.clone().map(Body::lattice_edge_m).fold(f64::INFINITY, f64::min);
        let motion = Motion {
            slack_m: SLACK_ELEMENTS * edge_m,
            most_travel_m: self.reach.most_travel_m,
            common_m_per_s: self.follower.common_m_per_s(bodies.clone()),
        };
        self.bodies.iter_mut().zip(bodies.clone()).for_each(|(of, body)| of.nodes.place_again(body, motion));
        self.place(bodies, changed);
        self.follower.find(self.reach.still_m, motion.slack_m);
        self.follower.merge(&self.lists);
        std::mem::swap(&mut self.seen, &mut self.follower.seen);
        std::mem::swap(&mut self.lists, &mut self.follower.lists);
    }

    /// Places the patches that are looked for again, where their nodes were placed.
    fn place<'a, 'b>(&mut self, bodies: impl Iterator<Item = &'a Body> + Clone, changed: impl Fn(usize) -> &'b [u32]) {
        // Nodes that were not placed now have used less than all they may, and may move by it yet.
        let most_m = self.bodies.iter().map(|of_body| of_body.nodes.most_of_all_m()).fold(0.0, f64::max);
        let near_m = self.reach.still_m + 4.0 * most_m;
        let Self { bodies: of_bodies, follower, seen, .. } = self;
        follower.begin(seen.len());
        for (index, (of_body, body)) in of_bodies.iter_mut().zip(bodies.clone()).enumerate() {
            let start = of_body.first.take();
            let bounds = body.bounds().grown(near_m);
            let mut others = bodies.clone().enumerate().filter(|(other, _)| *other != index);
            if body.boundary().walls().len() == 0 && !others.any(|(_, other)| other.bounds().meets(&bounds)) {
                continue;
            }
            let next = follower.again_m.len() as u32;
            of_body.first = Some(next);
            of_body.follow_patches(body, &mut follower.before);
            of_body.find_again(body, changed(index));
            for (patch, data) in (0..).zip(&of_body.patches) {
                let before = follower.before[patch as usize];
                let stays = before != GONE && !of_body.again[data.element as usize];
                if let Some(was) = start.filter(|_| stays).map(|start| (start + before) as usize) {
                    follower.after[was] = next + patch;
                    follower.add(SeenPatch { name: [index as u32, patch], ..seen[was] }, None);
                } else {
                    let nodes = &body.base().elements[data.element as usize].nodes;
                    let placed = SeenPatch {
                        name: [index as u32, patch],
                        at_m: body.weights(&data.point).place_m(of_body.nodes.found_at_m()),
                        normal: body.rotation(data.element as usize) * data.normal,
                    };
                    follower.add(placed, Some(of_body.nodes.most_m(nodes)));
                }
            }
        }
    }
}

impl OfBody {
    /// Takes its patches, and says what each of them was before, or [`GONE`].
    fn follow_patches(&mut self, body: &Body, before: &mut Vec<u32>) {
        let after = body.boundary().patches();
        before.clear();
        if self.version == body.boundary().version() {
            before.extend(0..self.patches.len() as u32);
            return;
        }
        let mut known = (0..).zip(&self.patches).peekable();
        before.extend(after.iter().map(|patch| {
            while known.next_if(|(_, was)| was.key() < patch.key()).is_some() {}
            known.next_if(|(_, was)| *was == patch).map_or(GONE, |(index, _)| index)
        }));
        self.patches.clear();
        self.patches.extend_from_slice(after);
        self.version = body.boundary().version();
    }

    /// Finds the elements whose patches are looked for again: those `changed`, and those with a node that was placed.
    fn find_again(&mut self, body: &Body, changed: &[u32]) {
        let Self { nodes, again, .. } = self;
        again.clear();
        again.extend(body.base().elements.iter().map(|element| nodes.any_placed(&element.nodes)));
        changed.iter().for_each(|element| again[*element as usize] = true);
    }
}

impl Follower {
    pub(super) fn reserve(&mut self, patches: usize, nodes: usize) {
        make_room(&mut self.seen, patches);
        self.hash.reserve(patches);
        self.lists.reserve(patches);
        for list in [&mut self.after, &mut self.before] {
            make_room(list, patches);
        }
        make_room(&mut self.again_m, patches);
        for pairs in [&mut self.found, &mut self.returned] {
            make_room(pairs, room_for_others(patches));
        }
        make_room(&mut self.speeds, nodes);
    }

    fn begin(&mut self, before: usize) {
        self.seen.clear();
        self.again_m.clear();
        self.after.clear();
        self.after.resize(before, GONE);
    }

    /// Adds the next patch, and how far it may move if it is looked for again, m.
    fn add(&mut self, patch: SeenPatch, again_m: Option<f64>) {
        self.seen.push(patch);
        self.again_m.push(again_m);
    }

    /// The median along each axis. What is held does not move with the rest: then none.
    fn common_m_per_s<'a>(&mut self, bodies: impl Iterator<Item = &'a Body> + Clone) -> Vec3 {
        if bodies.clone().any(Body::is_anything_held) {
            return Vec3::zeros();
        }
        Vec3::from_fn(|axis, _| {
            self.speeds.clear();
            self.speeds.extend(bodies.clone().flat_map(|body| &body.state.velocity_m_per_s).map(|v| v[axis]));
            let middle = self.speeds.len() / 2;
            *self.speeds.select_nth_unstable_by(middle, f64::total_cmp).1
        })
    }

    /// The pairs of a patch that is looked for again. Of two that are the farther one that moves looks for both.
    fn find(&mut self, still_m: f64, slack_m: f64) {
        let Self { seen, hash, again_m, found, returned, .. } = self;
        found.clear();
        returned.clear();
        let again = again_m.iter().enumerate().filter_map(|(patch, m)| {
            let (may_move_m, seen) = ((*m)?, &seen[patch]);
            Some((patch, may_move_m, seen.at_m, seen.normal))
        });
        let reach_m = |may_move_m: f64| still_m + may_move_m + may_move_m.max(slack_m);
        let boxes = again.clone().map(|(_, may_move_m, at_m, _)| Aabb::around([at_m]).grown(reach_m(may_move_m)));
        let Some(within) = boxes.reduce(|all, one| all.with(&one)) else { return };
        let near =
            (0..).zip(seen.iter()).map(|(patch, seen)| (patch, seen.at_m)).filter(|(_, at_m)| within.contains(at_m));
        hash.build(near, still_m + 2.0 * slack_m);
        for (patch, may_move_m, at_m, normal) in again {
            let is_fast = may_move_m > slack_m;
            for other in hash.near(at_m, reach_m(may_move_m)) {
                let other_m = again_m[other].unwrap_or(slack_m);
                let other_is_fast = other_m > slack_m;
                let looks = if is_fast {
                    !other_is_fast || (other_m, other) < (may_move_m, patch)
                } else {
                    !other_is_fast && normal.dot(&seen[other].normal) <= FACING + TURN
                };
                if !looks || (seen[other].at_m - at_m).amax() > still_m + may_move_m + other_m {
                    continue;
                }
                found.push([patch as u32, other as u32]);
                if is_fast || again_m[other].is_none() {
                    returned.push([other as u32, patch as u32]);
                }
            }
        }
        returned.sort_unstable();
    }

    /// The pairs that stay together with those that were found.
    fn merge(&mut self, before: &Lists) {
        let Self { lists, after, again_m, found, returned, .. } = self;
        lists.clear();
        let after = |place: u32| after[before.patches[place as usize] as usize];
        let mut kept = (0..before.patches.len())
            .map(|place| (after(place as u32), place))
            .filter(|kept| kept.0 != GONE)
            .peekable();
        let (mut found, mut returned) = (found.iter().peekable(), returned.iter().peekable());
        for patch in 0..again_m.len() as u32 {
            lists.push(|list| {
                if let Some((_, place)) = kept.next_if(|kept| kept.0 == patch) {
                    list.extend(before.of(place).iter().map(|other| after(*other)).filter(|other| *other != GONE));
                }
                for pairs in [&mut found, &mut returned] {
                    list.extend(std::iter::from_fn(|| pairs.next_if(|pair| pair[0] == patch)).map(|pair| pair[1]));
                }
            });
        }
        lists.finish();
    }
}
