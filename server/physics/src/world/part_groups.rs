//! Parts that press on each other keep the momentum of their sum.

use super::body_slot::BodySlot;
use crate::body::Totals;
use crate::contact::TissueContact;
use crate::contact::ends::TissueEnd;

/// Groups of parts, of all bodies.
#[derive(Clone, Default)]
pub(super) struct PartGroups {
    /// First part of each body in the lists by part.
    first: Vec<usize>,
    /// Body of each part.
    body: Vec<usize>,
    /// A part of the same group that comes before, or the part itself.
    root: Vec<usize>,
    /// By root: what its group is to gain; `None`: something outside holds or touches it.
    gain: Vec<Option<Totals>>,
}

impl PartGroups {
    /// Room for the parts that there are.
    pub(super) fn reserve(&mut self, slots: &[BodySlot]) {
        self.first.clear();
        self.body.clear();
        for (index, slot) in slots.iter().enumerate() {
            self.first.push(self.body.len());
            self.body.resize(self.body.len() + slot.body.part_count() as usize, index);
        }
        self.root.resize(self.body.len(), 0);
        self.gain.resize(self.body.len(), None);
    }

    /// Joins the parts at the ends of each of the `springs`, and gives each what its group is to gain.
    pub(super) fn join<'a>(&mut self, slots: &mut [BodySlot], springs: impl Iterator<Item = &'a TissueContact>) {
        self.root.iter_mut().enumerate().for_each(|(part, root)| *root = part);
        for spring in springs {
            let [a, b] = spring.ends.ends.map(|end| self.root_of(self.part_at(slots, &end)));
            self.root[a.max(b)] = a.min(b);
        }
        for part in 0..self.body.len() {
            let (body, own) = self.own(part);
            let gain = slots[body].body.gain_of_part(own);
            let root = self.root_of(part);
            self.gain[root] = if root == part {
                gain
            } else {
                self.gain[root].zip(gain).map(|(group, gain)| group.joined(&gain).solved())
            };
        }
        for part in 0..self.body.len() {
            let (body, own) = self.own(part);
            let gain = self.gain[self.root_of(part)];
            slots[body].body.set_gain_of_part(own, gain);
        }
    }

    fn part_at(&self, slots: &[BodySlot], end: &TissueEnd) -> usize {
        let body = end.body as usize;
        let (node, _) = end.weights.iter().next().expect("a point has nodes");
        self.first[body] + slots[body].body.part_of_node(node) as usize
    }

    /// Body of a part, and its number there.
    fn own(&self, part: usize) -> (usize, u32) {
        let body = self.body[part];
        (body, (part - self.first[body]) as u32)
    }

    fn root_of(&self, mut part: usize) -> usize {
        while self.root[part] != part {
            part = self.root[part];
        }
        part
    }
}
