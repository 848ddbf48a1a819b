//! A tool's wrench and the local contact model that stations render from, summed over its contacts.

use crate::Vec3;
use crate::contact::{Contact, Mode};
use crate::step_io::{ContactModel, Wrench};
use crate::tool::{Pose, ToolShape};

/// Accumulates the wrench and the local contact model of a tool.
pub(super) struct ContactModelSum {
    pose: Pose,
    forward: Vec3,
    stiffness: [[f64; 6]; 6],
    cap_n: f64,
    yields: bool,
    contacts: u32,
    radius_m: f64,
}

impl ContactModelSum {
    pub(super) fn new(pose: Pose, shape: &ToolShape) -> Self {
        Self {
            pose,
            forward: pose.orientation * -Vec3::y(),
            stiffness: [[0.0; 6]; 6],
            cap_n: 0.0,
            yields: false,
            contacts: 0,
            radius_m: shape.validity_radius_m(),
        }
    }

    /// Adds a contact's force to the wrench.
    pub(super) fn push(&self, contact: &Contact, wrench: &mut Wrench) {
        let arm = contact.ends.tool_point_m - self.pose.position_m;
        let force = -contact.applied_n();
        wrench.force_n += force;
        wrench.torque_nm += arm.cross(&force);
    }

    /// Adds what a contact does as the pose changes.
    pub(super) fn add(&mut self, contact: &Contact) {
        let arm = contact.ends.tool_point_m - self.pose.position_m;
        self.contacts += 1;
        if contact.limit_n.is_finite() {
            self.cap_n += contact.limit_n;
        }
        self.yields |= contact.mode == Mode::Yield;
        let turn = arm.cross(&contact.direction);
        let row = [0, 1, 2].map(|i| contact.direction[i]);
        let row: [f64; 6] = std::array::from_fn(|i| if i < 3 { row[i] } else { turn[i - 3] });
        for i in 0..6 {
            for j in 0..6 {
                self.stiffness[i][j] += contact.stiffness_n_per_m * row[i] * row[j];
            }
        }
    }

    pub(super) fn finish(mut self, shape: &ToolShape, wrench: Wrench) -> Option<ContactModel> {
        // Rows and columns alike: the matrix stays symmetric and definite.
        let felt = shape.felt_shares(self.contacts).map(f64::sqrt);
        for (i, row) in self.stiffness.iter_mut().enumerate() {
            row.iter_mut().enumerate().for_each(|(j, k)| *k *= felt[i / 3] * felt[j / 3]);
        }
        (self.contacts > 0).then_some(ContactModel {
            reference: self.pose,
            wrench,
            stiffness: self.stiffness,
            damping_n_s_per_m: 0.0,
            force_cap_n: (self.yields && shape.cuts_forward()).then_some(self.cap_n),
            cap_direction: -self.forward,
            validity_radius_m: self.radius_m,
        })
    }
}
