//! The terms of the energy ledger, one line each: whoever sums, writes or checks them goes by this table.

use crate::step_io::EnergyStep;

/// What a term's number is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TermKind {
    /// An energy that is there after the step.
    Level,
    /// What the step brought in from outside.
    Work,
    /// What the step spent, or left unexplained.
    Spent,
}

/// A term of [`EnergyStep`].
#[derive(Clone, Copy, Debug)]
pub struct EnergyTerm {
    /// Name of its field.
    pub name: &'static str,
    /// What its number is.
    pub kind: TermKind,
    get: fn(&EnergyStep) -> f64,
    slot: fn(&mut EnergyStep) -> &mut f64,
}

impl EnergyTerm {
    /// Its value, J.
    #[must_use]
    pub fn of(&self, energy: &EnergyStep) -> f64 {
        (self.get)(energy)
    }
}

macro_rules! terms {
    ($($kind:ident $field:ident),* $(,)?) => {
        [$(EnergyTerm {
            name: stringify!($field),
            kind: TermKind::$kind,
            get: |energy| energy.$field,
            slot: |energy| &mut energy.$field,
        }),*]
    };
}

/// Every field of [`EnergyStep`], levels first. The works are the levels' rises and what was spent, summed up.
pub const ENERGY_TERMS: &[EnergyTerm] = &terms![
    Level elastic_j,
    Level contact_j,
    Level kinetic_j,
    Work tool_work_j,
    Work load_work_j,
    Spent fracture_j,
    Spent front_slip_j,
    Spent initiation_j,
    Spent parting_j,
    Spent damping_j,
    Spent friction_j,
    Spent contact_loss_j,
    Spent numerical_j,
    Spent residual_j,
];

impl EnergyStep {
    /// Books a step after those before it: levels are replaced, all else is summed up.
    pub fn book(&mut self, step: &EnergyStep) {
        for term in ENERGY_TERMS {
            let before = if term.kind == TermKind::Level { 0.0 } else { term.of(self) };
            *(term.slot)(self) = before + term.of(step);
        }
    }

    /// What is unexplained over the work of the tools; `None` where they did none.
    #[must_use]
    pub fn residual_over_tool_work(&self) -> Option<f64> {
        (self.tool_work_j != 0.0).then(|| self.residual_j / self.tool_work_j)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_of_a_step_is_a_term_once() {
        let mut energy = EnergyStep::default();
        for (index, term) in ENERGY_TERMS.iter().enumerate() {
            *(term.slot)(&mut energy) = 1.0 + index as f64;
        }
        // A field that is no term would be zero, one that is two terms would have lost a value.
        assert_eq!(size_of::<EnergyStep>(), ENERGY_TERMS.len() * size_of::<f64>());
        ENERGY_TERMS.iter().enumerate().for_each(|(index, term)| assert_eq!(term.of(&energy), 1.0 + index as f64));
    }

    #[test]
    fn a_ledger_sums_works_and_replaces_levels() {
        let mut ledger = EnergyStep::default();
        let step = EnergyStep { tool_work_j: 1.0, elastic_j: 2.0, residual_j: 0.25, ..EnergyStep::default() };
        ledger.book(&step);
        ledger.book(&step);
        assert_eq!((ledger.tool_work_j, ledger.elastic_j, ledger.residual_j), (2.0, 2.0, 0.5));
        assert_eq!(ledger.residual_over_tool_work(), Some(0.25));
        assert_eq!(EnergyStep::default().residual_over_tool_work(), None);
    }
}
