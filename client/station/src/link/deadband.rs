//! What a hand does not notice is not sent.
//!
//! A pose goes out when the contact model says that the force has changed by more than a share of itself since the last
//! one, when the tool has gone as far as it does in a hundredth of a second (in contact, in the time between two contacts),
//! or when nothing has gone out for too long. In free motion that is a fifth of the poses, at rest a twentieth.

use nalgebra::Vector3;

use crate::servo::runner::Motion;

/// Forces below this count as this, N: what nobody feels.
const FELT_N: f64 = 0.03;
/// How old the server's pose may become by the tool's motion, s: of a tool that touches nothing, and of one in contact, for
/// whose force along the way at the cap of a cut does not tell where it is.
const MOTION_S: f64 = 0.01;
const CONTACT_S: f64 = 0.004;
/// Motion that is never sent by itself, m: the noise of encoders.
const NOISE_M: f64 = 1e-4;
/// Turn that is sent, rad.
const TURN_RAD: f64 = 0.01;

/// Decides which motions are sent.
#[derive(Clone, Copy, Debug)]
pub struct Deadband {
    /// Share of the force; 0 sends everything.
    share: f64,
    keep_alive_ns: u64,
    /// Newtons that are felt, in the scene's scale.
    felt_n: f64,
    sent: Option<Motion>,
}

impl Deadband {
    /// Nothing was sent yet; `force_scale` is the device's newtons per newton of the scene.
    #[must_use]
    pub fn new(share: f64, keep_alive_s: f64, force_scale: f64) -> Self {
        Self { share, keep_alive_ns: (keep_alive_s * 1e9) as u64, felt_n: FELT_N / force_scale, sent: None }
    }

    /// Whether a motion has to be sent; it is taken to be if so.
    pub fn passes(&mut self, motion: &Motion) -> bool {
        let passes = self.share == 0.0 || self.sent.is_none_or(|sent| self.is_news(&sent, motion));
        if passes {
            self.sent = Some(*motion);
        }
        passes
    }

    /// The server knows nothing any more.
    pub fn forget(&mut self) {
        self.sent = None;
    }

    fn is_news(&self, sent: &Motion, motion: &Motion) -> bool {
        if motion.sampled_ns.saturating_sub(sent.sampled_ns) >= self.keep_alive_ns || motion.tool != sent.tool {
            return true;
        }
        let (Some(before), Some(now)) = (sent.placement, motion.placement) else {
            return sent.placement != motion.placement;
        };
        let changed_n: Vector3<f64> = motion.contact_n - sent.contact_n;
        let touches = motion.contact_n.norm().max(sent.contact_n.norm());
        let motion_s = if touches > 0.0 { CONTACT_S } else { MOTION_S };
        let moved_m = (now.pose.position_m - before.pose.position_m).norm();
        before.opening != now.opening
            || changed_n.norm() > self.share * touches.max(self.felt_n)
            || moved_m > (motion_s * motion.speed_m_per_s).max(NOISE_M)
            || before.pose.orientation.angle_to(&now.pose.orientation) > TURN_RAD
    }
}

#[cfg(test)]
mod tests {
    use kerf_script::{Placement, Pose};
    use nalgebra::UnitQuaternion;

    use super::*;

    /// Share of 500 motions a second that pass at a speed against a stiffness, and the largest error of the force that
    /// the server has, relative to the force.
    fn passed(speed_m_per_s: f64, stiffness_n_per_m: f64) -> (f64, f64) {
        let mut deadband = Deadband::new(0.05, 0.025, 1.0);
        let (mut count, mut worst, mut known_n) = (0, 0.0_f64, 0.0);
        for tick in 0..5000_u64 {
            let y_m = speed_m_per_s * tick as f64 * 2e-3;
            let force_n = stiffness_n_per_m * y_m;
            let pose = Pose { position_m: Vector3::y() * -y_m, orientation: UnitQuaternion::identity() };
            let motion = Motion {
                sampled_ns: tick * 2_000_000,
                tool: 0,
                placement: Some(Placement { pose, opening: 1.0 }),
                contact_n: Vector3::y() * force_n,
                speed_m_per_s,
            };
            if deadband.passes(&motion) {
                (count, known_n) = (count + 1, force_n);
            }
            worst = worst.max((force_n - known_n).abs() / force_n.max(FELT_N));
        }
        (f64::from(count) / 5000.0, worst)
    }

    #[test]
    fn most_poses_stay_home_and_the_force_is_known_within_its_share() {
        for (name, speed, stiffness) in
            [("at rest", 0.0, 0.0), ("free", 0.1, 0.0), ("slow contact", 0.005, 300.0), ("slower", 0.001, 800.0)]
        {
            let (share, error) = passed(speed, stiffness);
            assert!(share < 0.4 && error <= 0.05 + 1e-9, "{name}: {share} sent, {error} off");
        }
    }

    #[test]
    fn a_tool_that_cuts_on_is_known_within_the_time_between_two_contacts() {
        let mut deadband = Deadband::new(0.05, 0.025, 1.0);
        let (speed_m_per_s, mut sent_m, mut worst_m) = (0.05, f64::NAN, 0.0_f64);
        for tick in 0..500_u64 {
            let y_m = speed_m_per_s * tick as f64 * 2e-3;
            let pose = Pose { position_m: Vector3::y() * -y_m, orientation: UnitQuaternion::identity() };
            let contact_n = Vector3::y() * 2.0;
            let sampled_ns = tick * 2_000_000;
            let placement = Some(pose.into());
            if deadband.passes(&Motion { sampled_ns, tool: 0, placement, contact_n, speed_m_per_s }) {
                sent_m = y_m;
            }
            worst_m = worst_m.max(y_m - sent_m);
        }
        assert!(worst_m <= CONTACT_S * speed_m_per_s + 1e-9, "{worst_m} m");
    }

    #[test]
    fn jaws_lifts_and_other_tools_are_told_at_once() {
        let pose = Pose { position_m: Vector3::zeros(), orientation: UnitQuaternion::identity() };
        let motion = Motion { placement: Some(pose.into()), ..Motion::default() };
        let changes: [fn(&mut Motion); 4] = [
            |motion| motion.placement = None,
            |motion| motion.placement.as_mut().unwrap().opening = 0.0,
            |motion| motion.tool = 1,
            |motion| motion.contact_n.x = 0.1,
        ];
        for change in changes {
            let mut deadband = Deadband::new(0.05, 0.025, 1.0);
            assert!(deadband.passes(&motion) && !deadband.passes(&motion));
            let mut changed = motion;
            change(&mut changed);
            assert!(deadband.passes(&changed));
        }
    }
}
