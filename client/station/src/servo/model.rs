//! The local model of the contact that the servo evaluates.

use kerf_script::Pose;
use nalgebra::{Matrix3, Vector3};

/// What the server said last.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Update {
    /// Rises with each contact that comes in; 0 before the first.
    pub number: u64,
    /// The tool that it is about, an index into the scene's.
    pub tool_id: u32,
    /// When it came in, ns on [`kerf_load::clock`].
    pub arrived_ns: u64,
    /// When the pose was taken that it reflects, ns on the same clock; 0: none yet.
    pub echo_ns: u64,
    /// The contact; `None`: nothing is touched.
    pub model: Option<LocalModel>,
    /// Time over which it takes the place of the one before, s.
    pub blend_s: f64,
    /// From a pose's sending to the arrival of the first contact that reflects it, s; smoothed.
    pub round_trip_s: f64,
    /// Age from which no force is rendered, s.
    pub max_age_s: f64,
}

impl Update {
    /// Whether every number of it is one.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let numbers = [self.blend_s, self.round_trip_s, self.max_age_s];
        self.model.is_none_or(|model| model.is_finite()) && numbers.iter().all(|number| number.is_finite())
    }
}

/// Force on the tool near a pose, in the scene's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalModel {
    /// Pose of the tool that `force_n` belongs to.
    pub reference: Pose,
    /// Force on the tool there, N.
    pub force_n: Vector3<f64>,
    /// Force lost per metre that the tool moves, N/m; symmetric.
    pub stiffness_n_per_m: Matrix3<f64>,
    /// Force lost per radian that the tool turns, N/rad.
    pub turning_n_per_rad: Matrix3<f64>,
    /// Velocity of the tool that `force_n` belongs to, m/s.
    pub velocity_m_per_s: Vector3<f64>,
    /// Force lost per change of that velocity, N s/m; symmetric.
    pub damping_n_s_per_m: Matrix3<f64>,
    /// What the contact does along one direction.
    pub along: Along,
}

/// What a contact does along one direction, whatever the stiffness says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Along {
    /// It pushes the way it pushes now, and does not pull a tool back that leaves it.
    Pushes,
    /// It yields: along this unit vector it pushes no harder than this, N, and does not pull.
    Yields {
        /// The cutting direction, reversed.
        direction: Vector3<f64>,
        /// Greatest force, N.
        cap_n: f64,
        /// Present where that is what a cut begins at.
        give: Option<Give>,
    },
    /// Jaws hold the tissue: it pushes and pulls.
    Holds,
}

/// How a cut begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Give {
    /// Force at which most of the edge gives, N.
    pub at_n: f64,
    /// What the cap is from then on, N.
    pub left_n: f64,
}

/// Force of a contact at a pose, and how it changes there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reaction {
    /// On the tool at rest, N.
    pub force_n: Vector3<f64>,
    /// Force lost per metre, N/m.
    pub stiffness_n_per_m: Matrix3<f64>,
    /// Force lost per speed, N s/m.
    pub damping_n_s_per_m: Matrix3<f64>,
}

impl LocalModel {
    /// The force at a pose. It goes on linearly where the server does not vouch for it any more (its validity radius): a
    /// force that stayed as it is there would let the tool into a wall that the next contact throws it out of.
    #[must_use]
    pub fn reaction(&self, pose: &Pose) -> Reaction {
        let within = Reaction {
            force_n: self.elastic_n(pose),
            stiffness_n_per_m: self.stiffness_n_per_m,
            damping_n_s_per_m: self.damping_n_s_per_m,
        };
        match self.along {
            Along::Holds => within,
            Along::Yields { direction, cap_n, .. } => within.bounded(&direction, cap_n),
            Along::Pushes => match self.force_n.try_normalize(f64::MIN_POSITIVE) {
                Some(direction) => within.bounded(&direction, f64::INFINITY),
                None => within,
            },
        }
    }

    /// The force on the tool at a pose and a velocity if nothing yielded, N.
    fn unbounded_n(&self, pose: &Pose, velocity_m_per_s: &Vector3<f64>) -> Vector3<f64> {
        self.elastic_n(pose) - self.damping_n_s_per_m * velocity_m_per_s
    }

    /// The same at rest, N.
    fn elastic_n(&self, pose: &Pose) -> Vector3<f64> {
        let moved_m = pose.position_m - self.reference.position_m;
        let turned_rad = (pose.orientation * self.reference.orientation.inverse()).scaled_axis();
        let at_rest_n = self.force_n + self.damping_n_s_per_m * self.velocity_m_per_s;
        at_rest_n - self.stiffness_n_per_m * moved_m - self.turning_n_per_rad * turned_rad
    }

    /// Whether the cut that has not begun yet begins with the tool there, at this velocity.
    #[must_use]
    pub fn gives(&self, pose: &Pose, velocity_m_per_s: &Vector3<f64>) -> bool {
        match self.along {
            Along::Yields { direction, give: Some(give), .. } => {
                self.unbounded_n(pose, velocity_m_per_s).dot(&direction) >= give.at_n
            }
            _ => false,
        }
    }

    /// The cut has begun.
    pub fn give(&mut self) {
        if let Along::Yields { cap_n, give, .. } = &mut self.along
            && let Some(given) = give.take()
        {
            *cap_n = cap_n.min(given.left_n);
        }
    }

    /// The tool has come there at this velocity: what the contact would hold beyond its cap it has lost, so that a tool that
    /// turns round is let go of at once, and not where the cap was reached.
    pub fn slip(&mut self, pose: &Pose, velocity_m_per_s: &Vector3<f64>) {
        if let Along::Yields { direction, cap_n, .. } = self.along {
            let beyond_n = self.unbounded_n(pose, velocity_m_per_s).dot(&direction) - cap_n.max(0.0);
            self.force_n -= direction * beyond_n.max(0.0);
        }
    }

    /// Whether every number of it is one.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let Self { reference, force_n, stiffness_n_per_m, turning_n_per_rad, velocity_m_per_s, .. } = self;
        let along = match &self.along {
            Along::Yields { direction, cap_n, give } => {
                direction.sum() + cap_n + give.map_or(0.0, |give| give.at_n + give.left_n)
            }
            Along::Pushes | Along::Holds => 0.0,
        };
        let numbers = force_n.iter().chain(stiffness_n_per_m).chain(turning_n_per_rad).chain(&self.damping_n_s_per_m);
        let numbers = numbers.chain(velocity_m_per_s);
        is_finite(reference) && numbers.chain([&along]).all(|number| number.is_finite())
    }
}

impl Reaction {
    /// The same with a force of 0 to `most_n` along a direction; where that bound acts the force does not change.
    fn bounded(self, direction: &Vector3<f64>, most_n: f64) -> Self {
        let along_n = self.force_n.dot(direction);
        let bounded_n = along_n.clamp(0.0, most_n.max(0.0));
        if bounded_n == along_n {
            return self;
        }
        let across = Matrix3::identity() - direction * direction.transpose();
        Self {
            force_n: self.force_n + direction * (bounded_n - along_n),
            stiffness_n_per_m: across * self.stiffness_n_per_m * across,
            damping_n_s_per_m: across * self.damping_n_s_per_m * across,
        }
    }
}

/// Whether every number of a pose is one.
#[must_use]
pub fn is_finite(pose: &Pose) -> bool {
    pose.position_m.iter().chain(pose.orientation.coords.iter()).all(|number| number.is_finite())
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;

    pub(crate) fn at(x: f64, y: f64, z: f64) -> Pose {
        Pose { position_m: Vector3::new(x, y, z), orientation: UnitQuaternion::identity() }
    }

    /// 1 N upwards at the origin, 500 N/m.
    pub(crate) fn floor() -> LocalModel {
        LocalModel {
            reference: at(0.0, 0.0, 0.0),
            force_n: Vector3::y(),
            stiffness_n_per_m: Matrix3::from_diagonal(&Vector3::new(100.0, 500.0, 100.0)),
            turning_n_per_rad: Matrix3::zeros(),
            velocity_m_per_s: Vector3::zeros(),
            damping_n_s_per_m: Matrix3::zeros(),
            along: Along::Pushes,
        }
    }

    #[test]
    fn the_force_is_linear_however_far_the_tool_goes_in() {
        let force = |x, y| floor().reaction(&at(x, y, 0.0)).force_n;
        assert!((force(1e-3, -2e-3) - Vector3::new(-0.1, 2.0, 0.0)).norm() < 1e-12);
        assert!((force(0.0, -0.5).y - 251.0).abs() < 1e-9);
    }

    #[test]
    fn a_tool_that_leaves_is_not_pulled_back_unless_its_jaws_hold() {
        let leaving = at(1e-3, 4e-3, 0.0);
        assert!((floor().reaction(&leaving).force_n - Vector3::new(-0.1, 0.0, 0.0)).norm() < 1e-12);
        let holding = LocalModel { along: Along::Holds, ..floor() };
        assert!((holding.reaction(&leaving).force_n.y + 1.0).abs() < 1e-12);
    }

    #[test]
    fn while_cutting_the_force_is_capped_along_the_cut_and_free_across_it() {
        let cutting =
            LocalModel { along: Along::Yields { direction: Vector3::y(), cap_n: 1.5, give: None }, ..floor() };
        let deep = cutting.reaction(&at(2e-3, -3e-3, 0.0));
        assert!((deep.force_n - Vector3::new(-0.2, 1.5, 0.0)).norm() < 1e-12, "{deep:?}");
        assert_eq!(deep.stiffness_n_per_m[(1, 1)], 0.0);
        assert_eq!(deep.stiffness_n_per_m[(0, 0)], 100.0);
        assert_eq!(cutting.reaction(&at(0.0, 4e-3, 0.0)).force_n.y, 0.0);
    }

    #[test]
    fn an_edge_that_turns_round_is_let_go_of_where_it_turns() {
        let mut cutting =
            LocalModel { along: Along::Yields { direction: Vector3::y(), cap_n: 1.5, give: None }, ..floor() };
        let force_n = |model: &LocalModel, y| model.reaction(&at(0.0, y, 0.0)).force_n.y;
        let rest = Vector3::zeros();
        cutting.slip(&at(0.0, -5e-3, 0.0), &rest);
        assert!((force_n(&cutting, -5e-3) - 1.5).abs() < 1e-12);
        assert!((force_n(&cutting, -4e-3) - 1.0).abs() < 1e-12, "500 N/m back from there");
        cutting.slip(&at(0.0, -4e-3, 0.0), &rest);
        assert!((force_n(&cutting, -5e-3) - 1.5).abs() < 1e-12, "nothing more is lost below the cap");
        let mut pressing = floor();
        pressing.slip(&at(0.0, -5e-3, 0.0), &rest);
        assert_eq!(pressing, floor());
    }

    #[test]
    fn turning_the_tool_changes_the_force() {
        let mut model = floor();
        model.turning_n_per_rad[(1, 2)] = 2.0;
        let mut pose = at(0.0, 0.0, 0.0);
        pose.orientation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.1);
        assert!((model.reaction(&pose).force_n.y - 0.8).abs() < 1e-12);
    }

    #[test]
    fn a_number_that_is_none_is_found_wherever_it_stands() {
        assert!(floor().is_finite());
        let mut models = [floor(); 6];
        models[0].force_n.z = f64::NAN;
        models[1].stiffness_n_per_m[(1, 2)] = f64::INFINITY;
        models[2].reference.position_m.x = f64::NAN;
        models[3].along = Along::Yields { direction: Vector3::y(), cap_n: f64::NAN, give: None };
        let give = Some(Give { at_n: 1.0, left_n: f64::NAN });
        models[5].along = Along::Yields { direction: Vector3::y(), cap_n: 1.0, give };
        models[4].damping_n_s_per_m[(0, 0)] = f64::NAN;
        assert!(models.iter().all(|model| !model.is_finite()));
    }
}
