//! What falls out of the scene's reach is put away: a chip that nothing is under would fall for ever, ever faster, and the
//! body that it was cut from would never sleep.

use super::body_slot::BodySlot;
use super::description::Description;
use super::state::State;
use super::tool_contact::ToolContact;
use crate::body::Body;
use crate::math::Aabb;
use crate::workers::Workers;

/// The scene reaches this many of its diagonals beyond its objects at rest. Ours: 3 m around the built-in liver, which
/// what falls is away in for 0.8 s; whatever a hand still plays with is nearer. More costs steps in which a body cannot
/// sleep.
const REACH_DIAGONALS: f64 = 10.0;

/// The box in which pieces of `bodies` at rest may be.
pub(super) fn reach<'a>(bodies: impl Iterator<Item = &'a Body>) -> Aabb {
    let objects = bodies.map(Body::bounds).reduce(|all, one| all.with(&one)).unwrap_or(Aabb::around([]));
    objects.grown(REACH_DIAGONALS * (objects.max_m - objects.min_m).norm())
}

/// Puts away what has left the scene's reach; returns how many pieces that are.
pub(super) fn put_away(workers: &Workers<'_>, description: &Description, state: &mut State) -> u32 {
    state.awake().map(|slot| slot.put_away(workers, &description.reach)).sum()
}

impl BodySlot {
    /// The ledger takes the kinetic energy of what is put away for damped.
    fn put_away(&mut self, workers: &Workers<'_>, reach: &Aabb) -> u32 {
        let springs = self.contacts.iter().flat_map(ToolContact::springs);
        let touched = springs.flat_map(|contact| contact.ends.weights.iter().map(|(node, _)| node));
        let count = self.body.put_away(workers, reach, touched);
        if count > 0 {
            let energy = self.body.energy();
            let stopped_j = self.ledger.after.kinetic_j - energy.kinetic_j;
            self.ledger.solved.kinetic_j -= stopped_j;
            self.ledger.braked_j += stopped_j;
            self.ledger.after = energy;
        }
        count
    }
}
