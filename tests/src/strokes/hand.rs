//! One random stroke.

use kerf_physics::step_io::ToolMotion;
use kerf_physics::{Pose, Quat, Vec3};

use super::model::BLADES;
use crate::extremes::scenes::{SplitMix64, line};

/// Fraction of the strokes that a straight edge makes; the others share the rest.
const STRAIGHT_SHARE: f64 = 0.8;
const SPEED_M_PER_S: [f64; 2] = [0.05, 1.0];
/// How far an edge moves along itself while it cuts, over how far it goes forward, at most.
const MOST_SLICE: f64 = 0.5;
/// Where a stroke ends, over the way that leaves the whole box behind.
const DEPTH: [f64; 2] = [0.2, 1.1];

/// A straight way of one blade, at constant attitude and speed.
pub(super) struct Stroke {
    pub tool: usize,
    from: Pose,
    by_m: Vec3,
    steps: u32,
}

impl Stroke {
    /// Aimed at any place of the box `[min, max]`, from any side, with the whole box ahead of the edge at
    /// its start.
    pub fn random(rng: &mut SplitMix64, [min, max]: [Vec3; 2], margin_m: f64, dt_s: f64) -> Self {
        let tool = if rng.unit() < STRAIGHT_SHARE { 0 } else { 1 + rng.index(BLADES.len() - 1) };
        let orientation = Quat::from_scaled_axis(std::f64::consts::PI * rng.vector());
        let aim = min + Vec3::from_fn(|a, _| rng.unit() * (max[a] - min[a]));
        let forward = orientation * -Vec3::y();
        let slice = MOST_SLICE * (2.0 * rng.unit() - 1.0);
        let along = forward + orientation * Vec3::x() * slice;
        let corner = |c: usize| Vec3::from_fn(|a, _| if c >> a & 1 == 1 { max[a] } else { min[a] });
        let ahead = (0..8).map(|c| (corner(c) - aim).dot(&forward));
        let (near, far) = ahead.fold((0.0f64, 0.0f64), |(near, far), at| (near.min(at), far.max(at)));
        let begin = near - margin_m;
        let depth = DEPTH[0] + (DEPTH[1] - DEPTH[0]) * rng.unit();
        let by_m = along * (depth * (far - begin));
        let speed = SPEED_M_PER_S[0] + (SPEED_M_PER_S[1] - SPEED_M_PER_S[0]) * rng.unit();
        let steps = (by_m.norm() / (speed * dt_s)).ceil().max(1.0) as u32;
        Self { tool, from: Pose { position_m: aim + along * begin, orientation }, by_m, steps }
    }

    /// What the blade does in each step, the lift included.
    pub fn motions(&self) -> impl Iterator<Item = ToolMotion> {
        let enter = std::iter::once(ToolMotion::enter_at(self.from));
        enter.chain(line(self.from, self.by_m, self.steps)).chain(std::iter::once(ToolMotion::Lift))
    }
}
