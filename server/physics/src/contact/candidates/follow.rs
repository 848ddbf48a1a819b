//! What a cut changes of them: pairs of patches that stay as they were stay as they were found.

use super::{Candidates, Lists, OfBody, facing};
use crate::body::Body;
use crate::contact::patch_hash::{PatchHash, PlacedPatch};

/// Stands for a patch that is gone or has changed.
const GONE: u32 = u32::MAX;
/// Fraction of the slack that nodes may have used up where patches that changed are placed among those that did not:
/// by 0.15 of it their elements have turned since the others were placed, by 0.15 they turn from there, 0.25 together.
const MOST_SLACK_USED: f64 = 2.0 / 3.0;

/// The patches after links parted, beside those before.
struct Follower {
    hash: PatchHash,
    /// By patch in the hash before, its place in the one after; [`GONE`] where it changed.
    after: Vec<u32>,
    /// By patch in the hash after, whether it stayed as it was.
    stayed: Vec<bool>,
}

impl Candidates {
    /// Follows surfaces whose links parted. `changed` are, by body, the elements that carry their patches in another
    /// way than before, ascending.
    pub fn follow(&mut self, bodies: &[&Body], changed: &[&[u32]]) {
        let cut = bodies.iter().map(|body| body.boundary().walls().len() > 0);
        let is_first_cut = cut.zip(&self.bodies).any(|(is_cut, of_body)| is_cut && of_body.first.is_none());
        self.bodies.iter_mut().zip(bodies).for_each(|(of_body, body)| of_body.follow_nodes(body));
        if is_first_cut || self.moved_m(bodies.iter().copied()) > MOST_SLACK_USED * self.slack_m {
            self.forget();
            return;
        }
        let follower = self.place(bodies, changed);
        let found = follower.find();
        self.lists = follower.merge(&self.lists, &found);
        self.hash = follower.hash;
    }

    /// Places the patches that changed where the nodes were when the others were placed.
    fn place(&mut self, bodies: &[&Body], changed: &[&[u32]]) -> Follower {
        let placed = self.hash.placed();
        let patches = bodies.iter().map(|body| body.boundary().patches().len()).sum();
        let mut follower = Follower { hash: PatchHash::default(), after: vec![GONE; placed.len()], stayed: Vec::new() };
        follower.hash.reserve(patches);
        for (index, (of_body, body)) in self.bodies.iter_mut().zip(bodies).enumerate() {
            let next = follower.stayed.len() as u32;
            let Some(start) = of_body.first else { continue };
            of_body.first = Some(next);
            for (patch, before) in (0..).zip(of_body.follow_patches(body, changed[index])) {
                follower.stayed.push(before != GONE);
                follower.hash.push(if before == GONE {
                    PlacedPatch::of(body, &of_body.found_at_m, [index as u32, patch])
                } else {
                    let was = (start + before) as usize;
                    follower.after[was] = next + patch;
                    PlacedPatch { patch, ..placed[was] }
                });
            }
        }
        follower.hash.build(self.reach_m);
        follower
    }
}

impl OfBody {
    /// New nodes lie where those do that they split from, and from here on they move by themselves.
    fn follow_nodes(&mut self, body: &Body) {
        if !self.found_at_m.is_empty() {
            self.found_at_m.extend_from_slice(&body.state.position_m[self.found_at_m.len()..]);
        }
    }

    /// What each of its patches was before, or [`GONE`].
    fn follow_patches(&mut self, body: &Body, changed: &[u32]) -> Vec<u32> {
        let after = body.boundary().patches();
        let mut before = (0..).zip(&self.patches).peekable();
        let stayed = after.iter().map(|patch| {
            while before.next_if(|(_, was)| was.key() < patch.key()).is_some() {}
            let same = before.next_if(|(_, was)| *was == patch && changed.binary_search(&patch.element).is_err());
            same.map_or(GONE, |(index, _)| index)
        });
        let stayed = stayed.collect();
        self.patches.clear();
        self.patches.extend_from_slice(after);
        stayed
    }
}

impl Follower {
    /// The pairs of a patch that changed and one that it may meet, of either order, ascending.
    fn find(&self) -> Vec<[u32; 2]> {
        let mut pairs = Vec::new();
        for patch in (0..self.stayed.len()).filter(|patch| !self.stayed[*patch]) {
            for other in facing(&self.hash, patch) {
                pairs.push([patch as u32, other]);
                if self.stayed[other as usize] {
                    pairs.push([other, patch as u32]);
                }
            }
        }
        pairs.sort_unstable();
        pairs
    }

    /// The pairs that stay together with those that were found.
    fn merge(&self, before: &Lists, found: &[[u32; 2]]) -> Lists {
        let mut lists = Lists::default();
        lists.reserve(self.stayed.len());
        let after = |place: u32| self.after[before.patches[place as usize] as usize];
        let mut kept = (0..before.patches.len())
            .map(|place| (after(place as u32), place))
            .filter(|kept| kept.0 != GONE)
            .peekable();
        let mut found = found.iter().peekable();
        for patch in 0..self.stayed.len() as u32 {
            lists.push(|list| {
                if let Some((_, place)) = kept.next_if(|kept| kept.0 == patch) {
                    list.extend(before.of(place).iter().map(|other| after(*other)).filter(|other| *other != GONE));
                }
                list.extend(std::iter::from_fn(|| found.next_if(|pair| pair[0] == patch)).map(|pair| pair[1]));
            });
        }
        lists.finish();
        lists
    }
}
