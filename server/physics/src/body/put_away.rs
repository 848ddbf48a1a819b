//! Pieces that have left the scene's reach are put away.

use super::Body;
use crate::Vec3;
use crate::math::Aabb;
use crate::workers::Workers;

impl Body {
    /// Puts away the free pieces that are outside `reach` and that no tool touches (`touched_nodes`): where they are, in
    /// their rest shape, at rest, without loads. Returns how many there were.
    pub(crate) fn put_away(
        &mut self,
        workers: &Workers<'_>,
        reach: &Aabb,
        touched_nodes: impl Iterator<Item = u32>,
    ) -> u32 {
        let parts = &self.state.rigid;
        let is_beyond = |part: usize| {
            let at_m = Vec3::from(self.state.position_m[parts.first_node[part] as usize]);
            !parts.held[part] && !parts.away[part] && !reach.contains(&at_m)
        };
        if !(0..parts.held.len()).any(is_beyond) {
            return 0;
        }
        let mut leaving: Vec<bool> = (0..parts.held.len()).map(is_beyond).collect();
        touched_nodes.for_each(|node| leaving[self.part_of_node(node) as usize] = false);
        let count = leaving.iter().filter(|leaves| **leaves).count() as u32;
        if count > 0 {
            self.bring_to_rest(workers, &leaving);
        }
        count
    }

    fn bring_to_rest(&mut self, workers: &Workers<'_>, leaving: &[bool]) {
        for (node, velocity_m_per_s) in self.state.velocity_m_per_s.iter_mut().enumerate() {
            if self.state.rigid.loose_part(node).is_some_and(|part| leaving[part]) {
                *velocity_m_per_s = [0.0; 3];
            }
        }
        self.return_to_rest_shape(leaving);
        self.state.rigid.forget_turns();
        self.state.rigid.away.iter_mut().zip(leaving).for_each(|(away, leaves)| *away |= leaves);
        self.rebuild_external_forces();
        self.evaluate(workers, 2);
    }
}
