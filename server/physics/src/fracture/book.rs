//! What a front books in a step: its part of the energy ledger, and the area it has cut.

/// Energy and area booked by a front in one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrontBook {
    /// Energy in the springs at the end of the step, J.
    pub stored_j: f64,
    /// Gc times the area swept, J.
    pub fracture_j: f64,
    /// Work of the capped force on what slipped past, or what springs let go as links gave, less `fracture_j`, J.
    pub slip_j: f64,
    /// Energy set free as markers dropped from initiation to propagation, J.
    pub initiation_j: f64,
    /// What the springs lost as they relaxed with the material, less what they gained where it was strained
    /// anew, J.
    pub damping_j: f64,
    /// Dissipation of the springs' implicit step and of re-anchoring, J.
    pub lost_j: f64,
    /// Area swept through intact material, m^2.
    pub area_m2: f64,
}

impl FrontBook {
    /// Adds another front's book.
    pub fn add(&mut self, other: &Self) {
        self.stored_j += other.stored_j;
        self.fracture_j += other.fracture_j;
        self.slip_j += other.slip_j;
        self.initiation_j += other.initiation_j;
        self.damping_j += other.damping_j;
        self.lost_j += other.lost_j;
        self.area_m2 += other.area_m2;
    }
}
