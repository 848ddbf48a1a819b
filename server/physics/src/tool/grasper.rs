//! A grasper: jaws that take hold of what is around the reference point.

use crate::scene::GrasperDesc;
use serde::{Deserialize, Serialize};

/// Jaws that open by less than this fraction close, and hold on until they open by more than
/// [`OPENS_ABOVE`]: a device that trembles between the two lets nothing go.
const CLOSES_BELOW: f64 = 0.1;
/// See [`CLOSES_BELOW`].
const OPENS_ABOVE: f64 = 0.2;

/// A grasper; the reference point is the middle of its jaws.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grasper {
    /// Radius around the reference point within which it takes hold, m.
    pub radius_m: f64,
    /// Force on the tool above which it loses its hold, N.
    pub max_force_n: f64,
}

/// Height of the pivot of a grasper's jaws over their reach. Ours: as they are drawn.
const PIVOT_OVER_RADIUS: f64 = 3.0;

impl Grasper {
    /// Height of the jaws' pivot above the reference point, m.
    pub(super) fn pivot_m(&self) -> f64 {
        PIVOT_OVER_RADIUS * self.radius_m
    }

    /// Of a scene whose stiffest material has this Young's modulus.
    pub(super) fn new(desc: &GrasperDesc, stiffest_pa: f64) -> Self {
        Self { radius_m: desc.radius_m, max_force_n: desc.slips_above_n(stiffest_pa) }
    }
}

/// What jaws do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Jaws {
    /// Hold nothing.
    #[default]
    Open,
    /// Hold what was between them as they closed.
    Closed,
}

impl Jaws {
    /// What they do at an `opening`, a fraction of the full one.
    #[must_use]
    pub fn at(self, opening: f64) -> Self {
        match self {
            Self::Open if opening < CLOSES_BELOW => Self::Closed,
            Self::Closed if opening > OPENS_ABOVE => Self::Open,
            as_before => as_before,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jaws_that_tremble_change_nothing() {
        let jaws = [1.0, 0.15, 0.09, 0.15, 0.19, 0.21, 0.15].iter().scan(Jaws::default(), |jaws, opening| {
            *jaws = jaws.at(*opening);
            Some(*jaws == Jaws::Closed)
        });
        assert_eq!(jaws.collect::<Vec<_>>(), [false, false, true, true, true, false, false]);
    }
}
