//! Fracture energy that rises with the speed of the front.

use crate::scene::RateDesc;

/// `Gc(v) = Gc max(1, v / v0)^p`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ToughnessRate {
    /// v0, m/s.
    pub reference_speed_m_per_s: f64,
    /// p.
    pub exponent: f64,
}

impl From<RateDesc> for ToughnessRate {
    fn from(desc: RateDesc) -> Self {
        Self { reference_speed_m_per_s: desc.reference_speed_m_per_s, exponent: desc.exponent }
    }
}

impl ToughnessRate {
    /// Gc at a speed of the front over Gc at rest.
    #[must_use]
    pub fn factor(&self, speed_m_per_s: f64) -> f64 {
        power((speed_m_per_s / self.reference_speed_m_per_s).max(1.0), self.exponent)
    }
}

/// Power through the vector library's own polynomials: the same bits on every machine.
fn power(base: f64, exponent: f64) -> f64 {
    (wide::f64x4::splat(base).ln() * wide::f64x4::splat(exponent)).exp().to_array()[0]
}
