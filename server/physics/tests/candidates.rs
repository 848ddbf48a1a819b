//! The patches that may meet: followed through cuts and folds, none that meets another is missed.

use super::support::{Lcg, body, object, params};
use kerf_physics::contact::candidates::{Candidates, Reach};
use kerf_physics::contact::press::{FACING, PlacedPatch};
use kerf_physics::{Body, Crossing, LinkId, Vec3, Workers};
use std::f64::consts::PI;

const H_M: f64 = 2.5e-3;
const REACH: Reach = Reach { still_m: 2.5e-2, most_travel_m: 0.1 };
const SEED: u64 = 11;

/// Two patches, each by body and patch.
type Pair = [[u32; 2]; 2];

/// A strip of 160 mm that is folded over, so that its ends lie on one another, and a block under it.
fn folded_strip_and_block() -> [Body; 2] {
    let mut strip = body(&object([-0.06, 0.0, -0.01], [0.1, 0.01, 0.01], H_M, 2), params(1e-3));
    let block = body(&object([-0.04, -0.031, -0.02], [0.0, -0.001, 0.02], H_M, 2), params(1e-3));
    let (middle_m, outer_m) = (0.016, 0.021);
    let flat = strip.state.position_m.clone();
    // Bit by bit, as rotations follow from one step to the next.
    for most_rad in (1..=12).map(|twelfths| PI * f64::from(twelfths) / 12.0) {
        for (at, [x, y, _]) in strip.state.position_m.iter_mut().zip(&flat) {
            let (sin, cos) = (x / middle_m).clamp(0.0, most_rad).sin_cos();
            let (past_m, inside_m) = ((x - most_rad * middle_m).max(0.0), outer_m - y);
            at[0] = x.min(0.0) + inside_m * sin + past_m * cos;
            at[1] = outer_m - inside_m * cos + past_m * sin;
        }
        strip.evaluate(&Workers::serial(), 20);
    }
    [strip, block]
}

/// Moves a body's nodes by a wave of up to a quarter of a millimetre.
fn wave(body: &mut Body, random: &mut Lcg) {
    let mut vector = |scale: f64| Vec3::from_fn(|_, _| scale * (2.0 * random.unit() - 1.0));
    let (along, by_m, phase) = (vector(60.0), vector(1.4e-4), vector(PI).x);
    for at in &mut body.state.position_m {
        let moved = Vec3::from(*at) + by_m * (along.dot(&Vec3::from(*at)) + phase).sin();
        *at = moved.into();
    }
    body.evaluate(&Workers::serial(), 20);
}

/// Parts the links of a body across a random rectangle; returns the elements that changed.
fn cut(body: &mut Body, random: &mut Lcg) -> Vec<u32> {
    let mut below = |n: i32| (random.unit() * f64::from(n)) as i32;
    let (dims, axis) = (body.state.grid.dims(), below(3) as usize);
    let from = dims.map(&mut below);
    let to = [0, 1, 2].map(|a| if a == axis { from[a] + 1 } else { (from[a] + 1 + below(dims[a])).min(dims[a]) });
    let crossing = Crossing { t: 0.5, normal: Vec3::ith(axis, 1.0).map(|c| c as f32).into() };
    let cells =
        (from[2]..to[2]).flat_map(|z| (from[1]..to[1]).flat_map(move |y| (from[0]..to[0]).map(move |x| [x, y, z])));
    let links: Vec<_> = cells.map(|cell| (LinkId { cell, axis: axis as u8 }, crossing)).collect();
    let parted = body.part_links(&links).parted;
    body.update_topology(&Workers::serial(), &parted).elements
}

fn pairs(candidates: &Candidates) -> Vec<Pair> {
    let patches: Vec<[u32; 2]> = candidates.patches().collect();
    let of = |index: usize| candidates.others(index).map(move |other| (index, other));
    (0..patches.len()).flat_map(of).map(|pair| [patches[pair.0], patches[pair.1]]).collect()
}

/// By a look at every pair: those that face each other and are within reach in a step.
fn pairs_that_meet(bodies: &[Body]) -> Vec<Pair> {
    let all = |(index, body): (usize, &Body)| -> Vec<PlacedPatch> {
        let patches = 0..body.boundary().patches().len();
        patches.map(|p| PlacedPatch::of(body, [index as u32, p as u32])).collect()
    };
    let placed: Vec<PlacedPatch> = bodies.iter().enumerate().flat_map(all).collect();
    let meet =
        |a: &PlacedPatch, b: &PlacedPatch| REACH.meets(a, b, bodies[0].dt_s()) && a.normal.dot(&b.normal) <= FACING;
    let of = |a: &PlacedPatch| -> Vec<Pair> {
        let others = placed.iter().filter(|b| meet(a, b));
        others.map(|b| [[a.body, a.patch], [b.body, b.patch]]).collect()
    };
    placed.iter().flat_map(of).collect()
}

/// Whether the candidates still hold, in which case nothing that meets may be missing among them.
fn holds(candidates: &Candidates, bodies: &[Body], round: u32) -> bool {
    let holds = candidates.hold(bodies.iter());
    let found = pairs(candidates);
    let missing = pairs_that_meet(bodies).into_iter().find(|pair| found.binary_search(pair).is_err());
    assert!(!holds || missing.is_none(), "seed {SEED}, round {round}: {missing:?} is missing");
    holds
}

#[test]
fn what_is_followed_through_cuts_and_folds_misses_no_patch_that_meets_another() {
    let mut bodies = folded_strip_and_block();
    let mut candidates = Candidates::default();
    candidates.reserve(bodies.iter(), 0);
    let mut random = Lcg(SEED);
    let (mut looked_again, mut followed) = (0, 0);
    for round in 0..80 {
        let moved = (random.unit() * 2.0) as usize;
        wave(&mut bodies[moved], &mut random);
        if !holds(&candidates, &bodies, round) {
            candidates.look_again(bodies.iter(), REACH);
            assert!(holds(&candidates, &bodies, round), "seed {SEED}, round {round}");
            looked_again += 1;
        }
        let parted = (random.unit() * 2.0) as usize;
        let mut changed = [Vec::new(), Vec::new()];
        changed[parted] = cut(&mut bodies[parted], &mut random);
        candidates.follow(bodies.iter(), |index| &changed[index]);
        followed += u32::from(holds(&candidates, &bodies, round));
    }
    println!("looked again {looked_again} times, followed through {followed} cuts");
    assert!(looked_again > 5 && followed > 50, "looked again {looked_again}, followed {followed}");
    assert!(pairs_that_meet(&bodies).iter().any(|[a, b]| a[0] != b[0]), "the two bodies meet");
}

/// Moves a body's nodes on as they fly, for a step.
fn fly(body: &mut Body) {
    let dt_s = body.dt_s();
    for (at, v) in body.state.position_m.iter_mut().zip(&body.state.velocity_m_per_s) {
        (0..3).for_each(|axis| at[axis] += dt_s * v[axis]);
    }
    body.evaluate(&Workers::serial(), 20);
}

#[test]
fn what_flies_is_looked_for_alone_and_meets_all_that_it_comes_to() {
    let mut bodies = folded_strip_and_block();
    let mut random = Lcg(SEED);
    (0..4).for_each(|_| drop(cut(&mut bodies[0], &mut random)));
    let mut candidates = Candidates::default();
    candidates.reserve(bodies.iter(), 0);
    let (mut looked_again, mut met) = (0, 0);
    for round in 0..120 {
        if round % 30 == 0 {
            // Some nodes of both bodies fly apart, each in another way, at 10 to 60 mm a step.
            for body in &mut bodies {
                let (first, count) =
                    ((random.unit() * 0.9 * body.node_count() as f64) as usize, body.node_count() / 10);
                let flying = body.state.velocity_m_per_s[first..].iter_mut().take(count);
                flying.for_each(|v| *v = std::array::from_fn(|_| 60.0 * (2.0 * random.unit() - 1.0)));
            }
        }
        if !holds(&candidates, &bodies, round) {
            candidates.look_again(bodies.iter(), REACH);
            assert!(holds(&candidates, &bodies, round), "seed {SEED}, round {round}");
            looked_again += 1;
        }
        met += pairs_that_meet(&bodies).len();
        bodies.iter_mut().for_each(fly);
    }
    println!("looked again {looked_again} times for {met} pairs that meet");
    assert!(looked_again > 30 && looked_again < 120 && met > 10_000, "looked again {looked_again}, met {met}");
}

#[test]
fn where_nothing_moved_what_is_followed_is_what_is_found_anew() {
    let mut bodies = folded_strip_and_block();
    let mut random = Lcg(SEED);
    let mut candidates = Candidates::default();
    candidates.reserve(bodies.iter(), 0);
    candidates.look_again(bodies.iter(), REACH);
    for round in 0..20 {
        let changed = cut(&mut bodies[0], &mut random);
        candidates.follow(bodies.iter(), |index| if index == 0 { &changed } else { &[] });
        let mut anew = Candidates::default();
        anew.reserve(bodies.iter(), 0);
        anew.look_again(bodies.iter(), REACH);
        assert_eq!(pairs(&candidates), pairs(&anew), "seed {SEED}, round {round}");
    }
}
