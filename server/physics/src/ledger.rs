//! The energy ledger: every joule of a step, computed term by term; what is left is reported as the
//! residual.

use crate::body::{BodyEnergy, StepEnergies};
use crate::contact::Contact;
use crate::fracture::FrontBook;
use crate::step_io::EnergyStep;
use serde::{Deserialize, Serialize};

/// Energies of one body around a step.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct BodyLedger {
    /// Before the step.
    pub before: BodyEnergy,
    /// After the solve, before links parted.
    pub solved: BodyEnergy,
    /// After links parted.
    pub after: BodyEnergy,
    /// What the step did to the elements.
    pub step: StepEnergies,
    /// Work of the external loads, J.
    pub load_work_j: f64,
    /// Work of the impulses that keep the momentum of free parts after the solve, J.
    pub momentum_j: f64,
    /// Work that braking free parts took, J.
    pub braked_j: f64,
    /// Kinetic energy that turning free parts made, J.
    pub turned_j: f64,
}

impl BodyLedger {
    /// Of a body that nothing happened to.
    #[must_use]
    pub fn at_rest(energy: BodyEnergy) -> Self {
        Self { before: energy, solved: energy, after: energy, ..Self::default() }
    }
}

/// Contact's share of a step.
#[derive(Clone, Copy, Debug, Default)]
pub struct ContactLedger {
    /// Work of the tools, J.
    pub tool_work_j: f64,
    /// Of the fronts.
    pub front: FrontBook,
    /// Energy in the other springs, of flanks, of what is held and between tissue and tissue, at the end of
    /// the step, J.
    pub spring_stored_j: f64,
    /// Work of these springs, `sum f d gap`, J.
    pub spring_work_j: f64,
    /// Dissipated by friction, J.
    pub friction_j: f64,
}

impl ContactLedger {
    /// Adds a spring that is no front's.
    pub fn add<E>(&mut self, contact: &Contact<E>, dt_s: f64) {
        self.spring_work_j += contact.work_j();
        self.spring_stored_j += contact.stored_j();
        self.friction_j += contact.friction_j(dt_s);
    }
}

/// The ledger of a step. `before` is the ledger of the step before it.
#[must_use]
pub fn book<'a>(
    bodies: impl Iterator<Item = &'a BodyLedger> + Clone,
    contact: &ContactLedger,
    before: &EnergyStep,
    springs_before_j: f64,
) -> EnergyStep {
    let sum = |f: &dyn Fn(&BodyLedger) -> f64| bodies.clone().map(f).sum::<f64>();
    let elastic_before = sum(&|b| b.before.elastic_j);
    let kinetic_before = sum(&|b| b.before.kinetic_j);
    let mut energy = EnergyStep {
        tool_work_j: contact.tool_work_j,
        load_work_j: sum(&|b| b.load_work_j),
        elastic_j: sum(&|b| b.after.elastic_j),
        contact_j: contact.front.stored_j + contact.spring_stored_j,
        kinetic_j: sum(&|b| b.after.kinetic_j),
        fracture_j: contact.front.fracture_j,
        front_slip_j: contact.front.slip_j,
        initiation_j: contact.front.initiation_j,
        damping_j: sum(&|b| b.step.elements.damping_j + b.step.elements.viscous_j + b.braked_j)
            + contact.front.damping_j,
        parting_j: sum(&|b| b.solved.elastic_j - b.after.elastic_j + b.solved.kinetic_j - b.after.kinetic_j),
        friction_j: contact.friction_j,
        contact_loss_j: contact.front.lost_j + contact.spring_work_j - (contact.spring_stored_j - springs_before_j),
        numerical_j: 0.0,
        residual_j: 0.0,
    };
    // Implicit Euler loses 1/2 dv^T M dv + 1/2 dx^T K dx, but for what linearising the elastic force
    // leaves: dU + f . dx - 1/2 dx^T K dx, with what dashpots took counted as dU.
    energy.numerical_j = sum(&|b| {
        let step = &b.step.elements;
        let taken = b.solved.elastic_j - b.before.elastic_j + step.viscous_j;
        let linearisation = taken + step.force_work_j - step.elastic_j;
        b.step.inertial_j + step.elastic_j + b.step.geometric_j - linearisation - b.momentum_j - b.turned_j
    });
    let stored =
        energy.elastic_j - elastic_before + energy.kinetic_j - kinetic_before + energy.contact_j - before.contact_j;
    energy.residual_j = energy.tool_work_j + energy.load_work_j
        - stored
        - energy.fracture_j
        - energy.front_slip_j
        - energy.initiation_j
        - energy.damping_j
        - energy.friction_j
        - energy.contact_loss_j
        - energy.parting_j
        - energy.numerical_j;
    energy
}
