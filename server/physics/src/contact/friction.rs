//! Coulomb friction of a tool on what it presses on: flanks on walls, smooth probes on surfaces.

use super::{Contact, Mode};
use crate::Vec3;
use crate::body::Body;

/// Slower than this a wall sticks but for a creep in proportion to the force, m/s: a hundredth of the speed
/// of a slow stroke. A law with a jump at rest would not be solved by a step.
const CREEP_M_PER_S: f64 = 1e-3;

/// What rubs on the flanks of one tool.
#[derive(Clone)]
pub struct FlankFriction {
    coefficient: f64,
    /// Contacts along the walls in this step: their gap is what has slid past in it.
    pub contacts: Vec<Contact>,
}

impl FlankFriction {
    /// With this coefficient, nowhere in contact.
    #[must_use]
    pub fn new(coefficient: f64) -> Self {
        Self { coefficient, contacts: Vec::new() }
    }

    /// Sets up the friction of `flanks`, whose normal forces are those at the beginning of the step.
    pub fn detect(&mut self, body: &Body, flanks: &[Contact]) {
        self.contacts.clear();
        self.contacts.extend(flanks.iter().filter_map(|flank| rubbing(body, flank, self.coefficient)).flatten());
    }
}

/// Of a contact `flank` that presses: `-mu N v / max(|v|, v_creep)`, implicit in v, along two directions of the
/// wall: the way in which it slides if the tissue keeps its velocity, and across that. While it sticks the way is
/// the tool's. N is the force at the beginning of the step.
pub(super) fn rubbing(body: &Body, flank: &Contact, coefficient: f64) -> Option<[Contact; 2]> {
    let limit_n = coefficient * flank.stiffness_n_per_m * flank.gap_before_m;
    if limit_n <= 0.0 {
        return None;
    }
    let in_wall = |by: Vec3| by - flank.direction * by.dot(&flank.direction);
    let moved = in_wall(flank.tool_point_m - flank.tool_point_before_m);
    let slide = moved - in_wall(flank.weights.sum(&body.velocity_m_per_s) * body.dt_s());
    let creep_m = CREEP_M_PER_S * body.dt_s();
    let way = slide.try_normalize(creep_m).or_else(|| moved.try_normalize(0.0));
    let way = way.unwrap_or_else(|| in_wall(Vec3::ith(flank.direction.iamin(), 1.0)).normalize());
    let stiffness_n_per_m = limit_n / slide.norm().max(creep_m);
    let along = |way: Vec3, stiffness_n_per_m: f64| {
        let gap_predicted_m = slide.dot(&way);
        let way = if gap_predicted_m < 0.0 { -way } else { way };
        Contact {
            direction: way,
            stiffness_n_per_m,
            gap_before_m: 0.0,
            gap_predicted_m: gap_predicted_m.abs(),
            limit_n,
            yield_n: limit_n,
            slack_m: 0.0,
            bilateral: true,
            mode: if stiffness_n_per_m * gap_predicted_m.abs() > limit_n { Mode::Yield } else { Mode::Spring },
            ..*flank
        }
    };
    Some([along(way, limit_n / creep_m), along(flank.direction.cross(&way), stiffness_n_per_m)])
}
