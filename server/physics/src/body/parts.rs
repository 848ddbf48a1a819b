//! The separate pieces of a body, which only ever split.

use super::Body;
use super::rigid_motion::{Totals, Turn};
use crate::grid::VoxelId;
use crate::grid::levels::{LevelChange, NONE};
use crate::walk::Kept;
use serde::{Deserialize, Serialize};

/// The separate pieces of a body.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct RigidParts {
    pub(super) element_part: Kept<Vec<u32>>,
    pub(super) node_part: Kept<Vec<u32>>,
    pub(super) held: Vec<bool>,
    /// Young's modulus times volume of each part, J.
    pub(super) stiff_j: Vec<f64>,
    /// Times that a state of each part was remembered since it was last lost; as many as can be if it never was.
    pub(super) steady_steps: Vec<u32>,
    /// Whether each part was put away.
    pub(super) away: Vec<bool>,
    /// A node of each part.
    pub(super) first_node: Vec<u32>,
    /// Elements of the parts that are not held: all that has to be summed over.
    pub(super) loose: Kept<Vec<u32>>,
    /// Whether a part is left alone this step, and what it is to gain.
    pub(super) skip: Vec<bool>,
    pub(super) totals: Vec<Totals>,
    /// How a part turns in this step, unless it is along straight lines.
    pub(super) turns: Vec<Option<Turn>>,
}

impl RigidParts {
    pub(super) fn new(body: &Body) -> Self {
        let (element_part, count) = body.base().parts();
        let mut node_part = vec![NONE; body.node_count()];
        for (element, data) in body.base().elements.iter().enumerate() {
            data.nodes.iter().for_each(|n| node_part[*n as usize] = element_part[element]);
        }
        let mut held = vec![false; count as usize];
        body.state.held.elements().iter().for_each(|element| held[element_part[*element as usize] as usize] = true);
        let (skip, totals) = (held.clone(), vec![Totals::default(); count as usize]);
        let loose = (0..element_part.len() as u32).filter(|e| !held[element_part[*e as usize] as usize]);
        let loose = Kept::from(loose.collect::<Vec<_>>());
        let turns = vec![None; count as usize];
        let stiff_j = stiff_by_part_j(body, &element_part, count);
        let away = vec![false; count as usize];
        let mut first_node = vec![NONE; count as usize];
        for (node, part) in node_part.iter().enumerate().rev().filter(|(_, part)| **part != NONE) {
            first_node[*part as usize] = node as u32;
        }
        let steady_steps = vec![u32::MAX; count as usize];
        let (element_part, node_part) = (Kept::from(element_part), Kept::from(node_part));
        Self { element_part, node_part, held, stiff_j, steady_steps, away, first_node, loose, skip, totals, turns }
    }

    /// Follows a change of the elements, whose nodes and holds the body has by now. Parts only ever split: while there
    /// are as many as before, what is new is in the part that it split from.
    pub(super) fn follow(&mut self, body: &Body, change: &LevelChange) {
        // The coarsest elements hang together as the finest do, and are few.
        let coarsest = &body.state.levels[body.state.levels.len() - 1];
        if coarsest.parts().1 != self.part_count() {
            let before = std::mem::replace(self, Self::new(body));
            self.inherit(&before, change);
            return;
        }
        for &(new, from) in &change.split_elements {
            let part = self.element_part[from as usize];
            self.element_part.push(part);
            if !self.held[part as usize] {
                self.loose.push(new);
            }
        }
        for &(_, from) in &change.split_nodes {
            let part = self.node_part[from as usize];
            self.node_part.push(part);
        }
        self.forget_turns();
    }

    /// Takes what is remembered of parts from those that they split from.
    fn inherit(&mut self, before: &Self, change: &LevelChange) {
        let kept = (0..before.element_part.len() as u32).map(|element| (element, element));
        for (element, from) in kept.chain(change.split_elements.iter().copied()) {
            let [part, was] = [self.element_part[element as usize], before.element_part[from as usize]];
            self.steady_steps[part as usize] = before.steady_steps[was as usize];
            self.away[part as usize] = before.away[was as usize];
        }
    }

    /// Young's modulus times volume of all parts, J; parting links changes neither.
    pub(super) fn stiff_j(&self) -> f64 {
        self.stiff_j.iter().sum()
    }

    /// The same of the part that has least of it, J.
    pub(super) fn least_stiff_j(&self) -> f64 {
        self.stiff_j.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Whether an element's part was put away.
    pub(super) fn is_away(&self, element: usize) -> bool {
        self.away[self.element_part[element] as usize]
    }

    /// Whether they are of so many elements and nodes.
    pub(super) fn fits(&self, elements: usize, nodes: usize) -> bool {
        let parts = self.held.len();
        [self.element_part.len(), self.node_part.len()] == [elements, nodes]
            && [self.skip.len(), self.totals.len(), self.turns.len()] == [parts; 3]
            && [self.stiff_j.len(), self.steady_steps.len(), self.away.len(), self.first_node.len()] == [parts; 4]
            && self.element_part.iter().all(|part| (*part as usize) < parts)
            && self.node_part.iter().all(|part| *part == NONE || (*part as usize) < parts)
            && self.loose.iter().all(|element| (*element as usize) < elements)
    }

    /// Lets go of how parts turn in the step that is going on.
    pub(super) fn forget_turns(&mut self) {
        self.turns.fill(None);
    }

    pub(super) fn any_turns(&self) -> bool {
        self.turns.iter().any(Option::is_some)
    }

    pub(super) fn part_count(&self) -> u32 {
        self.held.len() as u32
    }

    /// The piece that a node belongs to, if nothing holds that piece.
    pub(super) fn loose_part(&self, node: usize) -> Option<usize> {
        let part = self.node_part[node];
        (part != NONE && !self.held[part as usize]).then_some(part as usize)
    }
}

fn stiff_by_part_j(body: &Body, element_part: &[u32], count: u32) -> Vec<f64> {
    let mut modulus_pa = vec![0.0; count as usize];
    for voxel in (0..body.state.grid.voxels().len() as u32).map(VoxelId) {
        modulus_pa[element_part[body.element_of(voxel)] as usize] += body.material_of(voxel).young_modulus_pa;
    }
    modulus_pa.iter().map(|sum| body.state.grid.voxel_size_m().powi(3) * sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Crossing, LinkId};
    use crate::workers::Workers;

    const SCENE: &str = r#"
version = 1
name = "bar"
[[objects]]
name = "bar"
shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.12, 0.02, 0.02] } }
voxel_size_m = 0.0025
level = 1
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [0.004, 1.0, 1.0] } }]
"#;

    #[test]
    fn parts_follow_cuts_to_what_they_would_be_if_they_were_counted_anew() {
        let mut body = Body::of_text(SCENE);
        // Across the bar, within a layer of elements and between two: half way, then through.
        for (x, rows, parts) in [(20, 0..4, 1), (20, 4..8, 2), (31, 0..4, 2), (31, 4..8, 3), (10, 0..6, 3)] {
            let cells = rows.flat_map(|y| (0..8).map(move |z| [x, y, z]));
            let crossing = Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] };
            let links: Vec<_> = cells.map(|cell| (LinkId { cell, axis: 0 }, crossing)).collect();
            let parted = body.part_links(&links).parted;
            assert_eq!(parted.len(), links.len());
            body.update_topology(&Workers::serial(), &parted);
            let (followed, anew) = (&body.state.rigid, RigidParts::new(&body));
            assert_eq!(followed.part_count(), parts);
            assert_eq!((&followed.element_part, &followed.node_part), (&anew.element_part, &anew.node_part));
            assert_eq!((&followed.held, &followed.loose), (&anew.held, &anew.loose));
        }
    }
}
