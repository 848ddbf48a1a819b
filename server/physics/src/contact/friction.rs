//! Coulomb friction of the flanks on the walls they press on.

use super::{Contact, Mode};
use crate::body::Body;

/// Slower than this a wall sticks but for a creep in proportion to the force, m/s: a hundredth of the speed
/// of a slow stroke. A law with a jump at rest would not be solved by a step.
const CREEP_M_PER_S: f64 = 1e-3;

/// What rubs on the flanks of one tool.
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
        self.contacts.extend(flanks.iter().filter_map(|flank| rubbing(body, flank, self.coefficient)));
    }
}

/// `-mu N v / max(|v|, v_creep)`, implicit in v, along the way in which the wall slides if the tissue keeps
/// its velocity.
fn rubbing(body: &Body, flank: &Contact, coefficient: f64) -> Option<Contact> {
    let limit_n = coefficient * flank.stiffness_n_per_m * flank.gap_before_m;
    if limit_n <= 0.0 {
        return None;
    }
    let drift = flank.weights.sum(&body.velocity_m_per_s) * body.dt_s();
    let past = flank.tool_point_m - flank.tool_point_before_m - drift;
    let slide = past - flank.direction * past.dot(&flank.direction);
    let direction = slide.try_normalize(0.0)?;
    let creep_m = CREEP_M_PER_S * body.dt_s();
    let gap_predicted_m = slide.norm();
    Some(Contact {
        direction,
        stiffness_n_per_m: limit_n / creep_m,
        gap_before_m: 0.0,
        gap_predicted_m,
        limit_n,
        yield_n: limit_n,
        slack_m: 0.0,
        bilateral: true,
        mode: if gap_predicted_m > creep_m { Mode::Yield } else { Mode::Spring },
        ..*flank
    })
}
