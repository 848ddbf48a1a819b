//! Which way, and how fast, the edge goes through the material at a marker.

use serde::{Deserialize, Serialize};

/// Travel over which the way is averaged, voxels: shorter than what a cut resolves, longer than what a step of the
/// solve makes of it. Ours. An edge that only presses does not know of it. Where one slices to and fro, it is the way
/// in which the force turns round: half takes 14 % off the mean force of two turns and a third more iterations, twice
/// adds 6 %.
const WINDOW_VOXELS: f64 = 0.5;
/// Travel below which nothing is known of the way, voxels: an edge that was put down has moved by rounding, and a speed
/// made of that would make its drag as stiff as rounding is small.
const LEAST_VOXELS: f64 = 1e-3;
/// Largest ratio of sliding to advance that counts: at it the push is a hundredth of Gc, beyond which the front would
/// go on for nothing. Half adds 3 % to the mean force of slicing to and fro, twice takes 0.2 % off.
const MOST_SLICE_PUSH: f64 = 10.0;

/// The edge's motion relative to the front, averaged over the last half voxel of travel.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Travel {
    forward_m: f64,
    along_m: f64,
    time_s: f64,
}

impl Travel {
    /// A step in which the edge went on by `forward_m` and slid by `along_m`. Where it rests, time goes on.
    pub(super) fn add(&mut self, forward_m: f64, along_m: f64, dt_s: f64, voxel_size_m: f64) {
        let gone_m = (forward_m * forward_m + along_m * along_m).sqrt();
        let kept = 1.0 / (1.0 + gone_m / (WINDOW_VOXELS * voxel_size_m));
        self.forward_m = kept * (self.forward_m + forward_m);
        self.along_m = kept * (self.along_m + along_m);
        self.time_s = kept * (self.time_s + dt_s);
    }

    /// Advance, not less than what makes the slice-push ratio the largest.
    fn advance_m(&self) -> f64 {
        self.forward_m.max(self.along_m.abs() / MOST_SLICE_PUSH)
    }

    /// What of [`Self::advance_m`] it has gone: 1 but where it slides more than counts.
    pub(super) fn advanced_share(&self) -> f64 {
        let advance_m = self.advance_m();
        if advance_m > 0.0 { self.forward_m.max(0.0) / advance_m } else { 1.0 }
    }

    /// The slice-push ratio xi, sliding over advance.
    pub(super) fn slice_push(&self) -> f64 {
        let advance_m = self.advance_m();
        if advance_m > 0.0 { self.along_m / advance_m } else { 0.0 }
    }

    /// Whether the edge has gone far enough to tell which way.
    pub(super) fn is_known(&self, voxel_size_m: f64) -> bool {
        (self.forward_m.powi(2) + self.along_m.powi(2)).sqrt() > LEAST_VOXELS * voxel_size_m
    }

    /// Speed of the advance, m/s.
    pub(super) fn speed_m_per_s(&self) -> f64 {
        if self.time_s > 0.0 { self.advance_m() / self.time_s } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steady_motion_is_told_after_a_few_voxels_whatever_the_step() {
        let h = 2e-3;
        for (dt_s, ratio) in [(1e-3, 2.0), (1e-2, 2.0), (1e-3, -0.5), (1e-3, 0.0)] {
            let mut travel = Travel::default();
            let speed = 0.05;
            for _ in 0..(4.0 * h / (speed * dt_s)) as usize {
                travel.add(speed * dt_s, ratio * speed * dt_s, dt_s, h);
            }
            assert!((travel.slice_push() - ratio).abs() < 1e-9, "{}", travel.slice_push());
            assert!((travel.speed_m_per_s() / speed - 1.0).abs() < 1e-9, "{}", travel.speed_m_per_s());
        }
    }

    #[test]
    fn sliding_without_advance_is_bounded_and_resting_has_no_speed() {
        let mut travel = Travel::default();
        assert_eq!((travel.slice_push(), travel.speed_m_per_s()), (0.0, 0.0));
        travel.add(0.0, -1e-3, 1e-3, 2e-3);
        assert_eq!(travel.slice_push(), -MOST_SLICE_PUSH);
        travel.add(1e-3, 0.0, 1e-3, 2e-3);
        let moving = travel.speed_m_per_s();
        (0..1000).for_each(|_| travel.add(0.0, 0.0, 1e-3, 2e-3));
        assert!(travel.speed_m_per_s() < 0.01 * moving);
    }
}
