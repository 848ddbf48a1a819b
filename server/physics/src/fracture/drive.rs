//! What drives a front: the blade's force and, in a body that is strained, the energy the body sets free.
//!
//! A front goes on where the energy that is set free at a held blade makes up for Gc,
//!
//! `q lambda + G_el = Gc`,
//!
//! q the blade's force per length, lambda what the tissue around the front is stretched along the cut (the force
//! goes on by lambda in the scene where the front goes on by 1 in the material), G_el what the body sets free beside
//! that (`release`): more where it is pulled, less than nothing where it closes in. In a body that is large beside
//! Gc/E lambda is 1, G_el is 0 and q is Gc.
//!
//! A rigid edge takes its front along as a whole: what counts is the mean over the front. It is sampled at places
//! an element apart, one at a time in turn.

use super::release::{Tip, released};
use crate::Vec3;
use crate::body::Body;
use serde::{Deserialize, Serialize};

/// A blade bends and squeezes a body that is less than so many times Gc/E across, too much for q = Gc: a bar's force
/// is then off by half of the inverse, 1 %. Halved, by 2 %; doubled, by half of one, and more bodies pay for the
/// sampling.
const LARGE: f64 = 50.0;
/// Material around a front counts as squeezed to no less than a fifth, as `Anchor::pull_back` has it. Ours: what
/// elements show beyond is no strain of tissue. Half or twice changes no bit of strokes at moderate strain.
const LEAST_STRETCH: f64 = 0.2;
/// A body closes in on a front by less than half of Gc; what is found beyond is of a tube that takes in where the
/// body is held. It grows with the square of the force: without a limit the front would never go on. Ours, from 1
/// (not held back at all) upwards; at 3 no bit of a liver's or a block's stroke changes.
const MOST_HELD_BACK: f64 = 1.5;
/// How often what a body sets free is sampled at one place ahead of blades, s: not every one of shorter steps does.
/// Ours: two steps of 1 kHz, in which a front of 0.1 m/s goes on by a tenth of a voxel. Half or twice of it moves the
/// force by 0.2 %, rms.
const SAMPLE_EVERY_S: f64 = 2e-3;

/// Whether the step of this number samples the drive at one place of each front.
#[must_use]
pub fn is_due(step: u64, dt_s: f64) -> bool {
    step.is_multiple_of((SAMPLE_EVERY_S / dt_s).round().max(1.0) as u64)
}

/// A piece of a front that has begun to cut, reference configuration but for `forward`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Where the front stands, m.
    pub(super) position_m: Vec3,
    /// Unit vector into the material that holds.
    pub(super) ahead: Vec3,
    /// Along the front, as long as the piece, m.
    pub(super) along_m: Vec3,
    /// Unit vector in which the blade pushes, scene frame.
    pub(super) forward: Vec3,
}

/// What the body does to the drive of a front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Strained {
    /// G_el, J/m^2.
    pub(super) release_j_per_m2: f64,
    /// lambda.
    pub(super) stretch: f64,
}

impl Strained {
    /// A body at rest.
    pub(super) const NOT: Self = Self { release_j_per_m2: 0.0, stretch: 1.0 };

    /// Force per length of front at which it goes on against a toughness, N/m.
    pub(super) fn push_n_per_m(&self, toughness_j_per_m2: f64) -> f64 {
        let drive_j_per_m2 = toughness_j_per_m2 - self.release_j_per_m2;
        drive_j_per_m2.clamp(0.0, MOST_HELD_BACK * toughness_j_per_m2) / self.stretch
    }
}

/// What was found at one place: sums over the length of front around it.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Sample {
    released_j_per_m: f64,
    stretch_m: f64,
    length_m: f64,
}

/// The drive of one front.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Drive {
    samples: Vec<Sample>,
    next: usize,
    /// The front: scratch, kept between steps.
    #[serde(skip)]
    pieces: Vec<Piece>,
}

/// Whether a body is so small beside Gc/E of what it is of that cutting strains all of it.
pub(super) fn is_small(body: &Body) -> bool {
    let across_m = body.state.grid.dims().into_iter().min().map_or(0.0, f64::from) * body.state.grid.voxel_size_m();
    let lengths_m =
        body.description.materials.iter().filter_map(|m| Some(m.fracture_energy_j_per_m2? / m.young_modulus_pa));
    lengths_m.fold(0.0, f64::max) * LARGE > across_m
}

impl Drive {
    /// Forgets what was found.
    pub(super) fn clear(&mut self) {
        self.samples.clear();
        self.next = 0;
    }

    /// Samples the next place of a front that consists of `pieces`.
    pub(super) fn sample(&mut self, body: &Body, pieces: impl Iterator<Item = Piece>) {
        self.pieces.clear();
        self.pieces.extend(pieces);
        let Some(first) = self.pieces.first() else { return self.clear() };
        let every = (body.lattice_edge_m() / first.along_m.norm()).ceil().max(1.0) as usize;
        let count = self.pieces.len().div_ceil(every);
        if self.samples.len() != count {
            self.clear();
            self.samples.resize(count, Sample::default());
        }
        // In the middle of its part of the front.
        let place = (self.next * self.pieces.len() + self.pieces.len() / 2) / count;
        self.samples[self.next] = sample(body, &self.pieces[place], &self.pieces);
        self.next = (self.next + 1) % count;
    }

    /// The mean over what was found.
    pub(super) fn strained(&self) -> Strained {
        let sum = |of: fn(&Sample) -> f64| self.samples.iter().map(of).sum::<f64>();
        let length_m = sum(|s| s.length_m);
        if length_m <= 0.0 {
            return Strained::NOT;
        }
        let release_j_per_m2 = sum(|s| s.released_j_per_m) / length_m;
        Strained { release_j_per_m2, stretch: (sum(|s| s.stretch_m) / length_m).max(LEAST_STRETCH) }
    }
}

fn sample(body: &Body, piece: &Piece, pieces: &[Piece]) -> Sample {
    let along = piece.along_m - piece.ahead * piece.along_m.dot(&piece.ahead);
    let tip = Tip {
        position_m: piece.position_m,
        ahead: piece.ahead,
        along: along.normalize(),
        element_edge_m: body.lattice_edge_m(),
    };
    let length_m: f64 = pieces.iter().map(|p| p.along_m.norm() * tip.weight_at(body, &p.position_m)).sum();
    let found = released(body, &tip);
    Sample { released_j_per_m: found.j_per_m, stretch_m: found.carried.dot(&piece.forward) * length_m, length_m }
}
