//! Cohesive springs across what tissue's own tension opens: they take up the energy that parting costs.
//!
//! Where nodes split under tension, what the tissue transmitted there goes on as a force between the two, falling with
//! their opening to zero: `f = f_0 (1 - delta / delta_c)` (Camacho and Ortiz 1996). `delta_c` is such that the
//! springs do the work that is owed for the area: `sum f_0 delta_c / 2`. They start with a little less than what the
//! tissue transmitted: with all of it nothing would move, an equilibrium, though not a stable one.

use crate::Vec3;
use crate::body::Body;
use crate::contact::{Contact, ContactWeights, Mode, ToolEnds};
use serde::{Deserialize, Serialize};

/// Springs close along a line to the origin. One that is open by less than this fraction of its length is taken as
/// open by that much: a stiffer spring would hold the nodes as one. Ours. Half or twice changes no bit where the
/// blade pays for the cut.
const LEAST_OPENING: f64 = 0.05;

/// Share of what the tissue transmitted that springs start with. Ours: 0.9 or 0.98 give a tear the same speed.
const STARTING_SHARE: f64 = 0.95;

/// A pair of nodes that were one.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct CohesiveSpring {
    nodes: [u32; 2],
    /// Force on the first node that it started with, N.
    start_n: Vec3,
    /// Opening at which it is gone, m.
    length_m: f64,
    /// Opening now, and the largest so far, m.
    opening_m: f64,
    widest_m: f64,
}

/// The cohesive springs of one body.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct CohesiveSprings {
    springs: Vec<CohesiveSpring>,
    /// Energy of what has parted under tension and no node has split for yet, J.
    owed_j: f64,
    /// Their contacts in the step.
    pub contacts: Vec<Contact>,
}

/// What cohesive springs took in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CohesiveBook {
    /// For good, J.
    pub dissipated_j: f64,
    /// Beside it, by steps that are not infinitely small, J.
    pub lost_j: f64,
    /// Level of what closing them would give back, J.
    pub stored_j: f64,
}

impl CohesiveSprings {
    /// Owes the energy of what parted under tension.
    pub fn owe(&mut self, energy_j: f64) {
        self.owed_j = (self.owed_j + energy_j).max(0.0);
    }

    /// Lets go of everything.
    pub fn release(&mut self) {
        self.springs.clear();
        self.contacts.clear();
        self.owed_j = 0.0;
    }

    /// Joins the nodes of `body` that split (new, from) by springs that start with what pulls at the new ones. What would
    /// take springs longer than an element's edge stays owed until nodes split that more pulls at.
    pub fn join(&mut self, body: &Body, split_nodes: &[(u32, u32)]) {
        if self.owed_j <= 0.0 || split_nodes.is_empty() {
            return;
        }
        let pull_n = body.pull_n();
        let start_n = |new: u32| -STARTING_SHARE * Vec3::from(pull_n[new as usize]);
        let starts = split_nodes.iter().map(|&(new, from)| ([new, from], start_n(new)));
        let force_n: f64 = starts.clone().map(|(_, f)| f.norm()).sum();
        let length_m = 2.0 * self.owed_j / force_n;
        if force_n <= 0.0 || length_m > body.lattice_edge_m() {
            return;
        }
        self.springs.extend(starts.filter(|(_, f)| f.norm() > 0.0).map(|(nodes, start_n)| CohesiveSpring {
            nodes,
            start_n,
            length_m,
            opening_m: 0.0,
            widest_m: 0.0,
        }));
        self.owed_j = 0.0;
    }

    /// How many there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.springs.len()
    }

    /// Sets up the step's springs.
    pub fn detect(&mut self, body: &Body, dt_s: f64) {
        self.contacts.clear();
        self.contacts.extend(self.springs.iter().map(|spring| spring.contact(body, dt_s)));
    }

    /// Books the step and lets go of what has opened.
    pub fn conclude(&mut self, body: &Body) -> CohesiveBook {
        let mut book = CohesiveBook::default();
        for (spring, contact) in self.springs.iter_mut().zip(&self.contacts) {
            spring.conclude(body, contact.force_n, &mut book);
        }
        self.springs.retain(|spring| spring.widest_m < spring.length_m);
        book
    }
}

impl CohesiveSpring {
    fn direction(&self) -> Vec3 {
        self.start_n.normalize()
    }

    /// Force at the largest opening, N.
    fn full_n(&self) -> f64 {
        self.start_n.norm() * (1.0 - self.widest_m / self.length_m)
    }

    /// What counts as open when it is closed, m.
    fn offset_m(&self) -> f64 {
        (LEAST_OPENING * self.length_m - self.widest_m).max(0.0)
    }

    fn stiffness_n_per_m(&self) -> f64 {
        self.full_n() / (self.widest_m + self.offset_m())
    }

    fn contact(&self, body: &Body, dt_s: f64) -> Contact {
        let mut weights = ContactWeights::default();
        weights.add(self.nodes[0], 1.0);
        weights.add(self.nodes[1], -1.0);
        let gap_before_m = self.opening_m + self.offset_m();
        let parting = weights.sum(&body.state.velocity_m_per_s).dot(&self.direction());
        let gap_predicted_m = gap_before_m - dt_s * parting;
        let mut contact = Contact {
            ends: ToolEnds { weights, ..ToolEnds::default() },
            direction: self.direction(),
            stiffness_n_per_m: self.stiffness_n_per_m(),
            gap_before_m,
            gap_predicted_m,
            limit_n: self.full_n(),
            yield_n: self.full_n(),
            ..Contact::default()
        };
        contact.mode = if gap_predicted_m < 0.0 {
            Mode::Off
        } else if gap_before_m >= self.widest_m + self.offset_m() && parting <= 0.0 {
            Mode::Yield
        } else {
            Mode::Spring
        };
        contact
    }

    fn stored_j(&self) -> f64 {
        let offset_m = self.offset_m();
        let gap_m = (self.opening_m + offset_m).max(0.0);
        0.5 * self.stiffness_n_per_m() * (gap_m * gap_m - offset_m * offset_m)
    }

    fn conclude(&mut self, body: &Body, force_n: f64, book: &mut CohesiveBook) {
        let before_j = self.stored_j();
        let [a, b] = self.nodes.map(|n| Vec3::from(body.state.position_m[n as usize]));
        let opening_m = -(a - b).dot(&self.direction());
        let work_j = force_n * (opening_m - self.opening_m);
        let wider_m = opening_m.min(self.length_m).max(self.widest_m) - self.widest_m;
        (self.opening_m, self.widest_m) = (opening_m.min(self.length_m), self.widest_m + wider_m);
        let dissipated_j = 0.5 * self.start_n.norm() * wider_m;
        let gone = self.widest_m >= self.length_m;
        let stored_j = if gone { 0.0 } else { self.stored_j() };
        book.dissipated_j += dissipated_j;
        book.stored_j += stored_j;
        book.lost_j += work_j - dissipated_j - (stored_j - before_j);
    }
}
