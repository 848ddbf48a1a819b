//! What a contact is between: a point of tissue, and a point of a tool or of other tissue.

use super::{Contact, ContactWeights, Friction, Mode};
use crate::Vec3;
use crate::body::{Body, Nodal};
use crate::grid::MaterialPoint;
use crate::solve::spring::PointSpring;
use serde::{Deserialize, Serialize};

/// A point of tissue against one of a tool, whose motion is prescribed.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct ToolEnds {
    /// The point of tissue.
    pub weights: ContactWeights,
    /// The tool's point at t + dt, m.
    pub tool_point_m: Vec3,
    /// The tool's point at t, m.
    pub tool_point_before_m: Vec3,
}

impl ToolEnds {
    /// A material point against a point of a tool that goes from `before_m` to `at_m` in the step.
    #[must_use]
    pub fn of(body: &Body, point: &MaterialPoint, [before_m, at_m]: [Vec3; 2]) -> Self {
        Self { weights: ContactWeights::of(body, point, 1.0), tool_point_m: at_m, tool_point_before_m: before_m }
    }
}

impl Contact<ToolEnds> {
    /// Begins the step as far compressed as the last one ended, whatever depth it is found at: a depth that it did not
    /// come to by pressing has no force. In this step what is missing is made up for, by as much as the tool moves and
    /// `comes_out_m` more, as if its surface grew by it: that work is the tool's.
    pub fn begin_compressed_by(&mut self, compressed_m: f64, comes_out_m: f64) {
        let way_m = (self.ends.tool_point_m - self.ends.tool_point_before_m).norm();
        let missing_m = (self.gap_before_m - compressed_m).max(0.0);
        let still_missing_m = (missing_m - way_m - comes_out_m).max(0.0);
        self.ends.tool_point_before_m -= self.direction * missing_m;
        self.ends.tool_point_m -= self.direction * still_missing_m;
        self.gap_before_m -= missing_m;
        self.gap_predicted_m -= still_missing_m;
    }

    /// Goes on as it is between tissue and a tool that stay where they are.
    pub fn stay(&mut self) {
        self.ends.tool_point_before_m = self.ends.tool_point_m;
        self.come_to_rest();
    }

    /// Lets it rub with this coefficient, by the normal force at the beginning of the step.
    pub fn rub(&mut self, body: &Body, coefficient: f64) {
        let tool_m = self.ends.tool_point_m - self.ends.tool_point_before_m;
        let moving_m_per_s = self.ends.weights.sum(&body.state.velocity_m_per_s) - tool_m / body.dt_s();
        let sliding_m_per_s = moving_m_per_s - self.direction * moving_m_per_s.dot(&self.direction);
        self.friction = Friction::on_tool(coefficient * self.stiffness_n_per_m * self.gap_before_m, sliding_m_per_s);
    }

    /// Adds its impulse, and that of its friction, to a right side: (node, N s).
    pub fn add_impulses(&self, dt_s: f64, impulses: &mut Vec<(u32, [f64; 3])>) {
        let impulse = self.impulse(dt_s);
        impulses.extend(self.ends.weights.iter().map(|(node, w)| (node, (impulse * w).into())));
    }

    /// Its spring alone, times the square of [`Body::quasi_static_dt_s`]: it holds though it has given, for what comes
    /// back comes back against it, and nothing rubs.
    #[must_use]
    pub fn quasi_static_spring(&self, dt_s: f64) -> PointSpring {
        let stiffness = dt_s * dt_s * self.stiffness_n_per_m;
        PointSpring::new(self.ends.weights.iter(), self.direction.into(), stiffness)
    }
}

/// The springs of contacts with tools in a body's matrix: one for each point, of which contacts come one after the
/// other.
pub fn point_springs<'a>(contacts: impl Iterator<Item = &'a Contact>, dt_s: f64) -> impl Iterator<Item = PointSpring> {
    let mut contacts = contacts.filter(|c| c.mode == Mode::Spring).peekable();
    std::iter::from_fn(move || {
        let first = contacts.next()?;
        let mut spring = first.point_spring(first.ends.weights.iter(), dt_s);
        while let Some(next) = contacts.next_if(|next| next.ends.weights == first.ends.weights) {
            next.add_to(&mut spring, dt_s);
        }
        Some(spring)
    })
}

/// One end of a contact between tissue and tissue.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct TissueEnd {
    /// Index of the body.
    pub body: u32,
    /// The point's weights; those of the surface are negative, so that the ends add up to what the one
    /// moves relative to the other.
    pub weights: ContactWeights,
}

/// A point of tissue, and the surface under it.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct TissueEnds {
    /// The point, and the surface.
    pub ends: [TissueEnd; 2],
    /// The patch of the first end's body that the point is the middle of.
    pub patch: u32,
}

impl TissueEnds {
    /// Sum over the ends of a nodal vector of their bodies: what the point has more of than the surface.
    #[must_use]
    pub fn relative<'a>(&self, values: impl Fn(u32) -> &'a Nodal) -> Vec3 {
        self.ends.iter().map(|end| end.weights.sum(values(end.body))).sum()
    }

    /// Whether its ends are in different bodies.
    #[must_use]
    pub fn joins_bodies(&self) -> bool {
        self.ends[0].body != self.ends[1].body
    }

    /// Nodes of a body that the contact acts on and their weights.
    pub fn weights_in(&self, body: u32) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.ends.iter().filter(move |end| end.body == body).flat_map(|end| end.weights.iter())
    }
}
