//! One plunge of a blade: straight down at a place, and up again.

use kerf_physics::step_io::ToolMotion;
use kerf_physics::{Pose, Quat, Vec3};

use crate::extremes::scenes::{SplitMix64, line};

const SPEED_M_PER_S: [f64; 2] = [0.1, 1.0];
/// Where it ends, over the height of the model.
const DEPTH: [f64; 2] = [0.6, 1.0];

pub(super) struct Plunge {
    from: Pose,
    by_m: Vec3,
    /// Down, and up.
    steps: [u32; 2],
}

impl Plunge {
    /// From above the box `[min, max]`; with `turned` along z, else along x.
    pub fn random(rng: &mut SplitMix64, [min, max]: [Vec3; 2], (margin_m, dt_s): (f64, f64), turned: bool) -> Self {
        let within = |rng: &mut SplitMix64, axis: usize| min[axis] + rng.unit() * (max[axis] - min[axis]);
        let middle = 0.5 * (min + max);
        let (x, z) = if turned { (within(rng, 0), middle.z) } else { (middle.x, within(rng, 2)) };
        let quarter = if turned { 0.5 * std::f64::consts::PI } else { 0.0 };
        let way_m = margin_m + (DEPTH[0] + (DEPTH[1] - DEPTH[0]) * rng.unit()) * (max.y - min.y);
        let steps = [0, 1].map(|_| {
            let speed = rng.log(SPEED_M_PER_S[0], SPEED_M_PER_S[1]);
            (way_m / (speed * dt_s)).ceil() as u32
        });
        Self {
            from: Pose {
                position_m: Vec3::new(x, max.y + margin_m, z),
                orientation: Quat::from_scaled_axis(Vec3::y() * quarter),
            },
            by_m: Vec3::y() * -way_m,
            steps,
        }
    }

    /// What the blade does in each step, the lift included.
    pub fn motions(&self) -> impl Iterator<Item = ToolMotion> {
        let bottom = Pose { position_m: self.from.position_m + self.by_m, ..self.from };
        let enter = std::iter::once(ToolMotion::enter_at(self.from));
        let there = line(self.from, self.by_m, self.steps[0]);
        enter.chain(there).chain(line(bottom, -self.by_m, self.steps[1])).chain(std::iter::once(ToolMotion::Lift))
    }
}
