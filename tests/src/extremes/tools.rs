//! What hands do that no hand should: 10 m/s and more, teleports, starts inside, two blades at once.

use kerf_physics::scene::{ObjectDesc, ShapeDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{Pose, Quat, SceneProblems, Vec3};

use super::cuts::check_body;
use super::materials::parameters;
use super::scenes::{Specimen, SplitMix64, below, everywhere, level_at, line};
use super::trial::{Return, Trial};
use super::{Budget, Case, Family, Outcome};

/// Semi-axes of the blob, in voxels.
const SEMI_AXES: [f64; 3] = [7.5, 5.5, 6.25];
const GC_J_PER_M2: f64 = 20.0;

/// What a tool, or two, do: the motions of each step.
type Motions = Vec<Vec<ToolMotion>>;

/// Where the blob is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Held {
    /// Nowhere.
    Nothing,
    /// In its lowest fifth.
    Base,
    /// Everywhere.
    Everything,
}

/// The tissue that tools are tried on.
pub(super) fn specimen(dt_s: f64) -> Specimen {
    Specimen {
        young_modulus_pa: 2e4,
        strain_stiffening: 10.0,
        dt_s,
        voxel_size_m: 4e-3,
        voxels: [15, 11, 13],
        level: 2,
        ..Specimen::default()
    }
}

/// An ellipsoid about the origin.
pub(super) fn blob(specimen: &Specimen, held: Held) -> ObjectDesc {
    let mut blob = specimen.block();
    let semi_axes_m = SEMI_AXES.map(|n| n * specimen.voxel_size_m);
    blob.shape = ShapeDesc::Ellipsoid { center_m: [0.0; 3], semi_axes_m };
    blob.material.fracture_energy_j_per_m2 = Some(GC_J_PER_M2);
    match held {
        Held::Nothing => (),
        Held::Base => blob.fixed.push(below(-3.5 * specimen.voxel_size_m)),
        Held::Everything => blob.fixed.push(everywhere()),
    }
    blob
}

/// From a place in a straight line at a speed, until `way_m` is done.
fn stroke(from: Pose, direction: Vec3, speed_m_per_s: f64, way_m: f64, dt_s: f64) -> Motions {
    let steps = (way_m / (speed_m_per_s * dt_s)).ceil().max(1.0) as u32;
    let by_m = direction.normalize() * speed_m_per_s * dt_s * f64::from(steps);
    std::iter::once(ToolMotion::enter_at(from)).chain(line(from, by_m, steps)).map(|m| vec![m]).collect()
}

fn turned(position_m: Vec3, about: Vec3) -> Pose {
    Pose { position_m, orientation: Quat::from_scaled_axis(about) }
}

fn down_and_out(from: Pose, speed_m_per_s: f64, dt_s: f64) -> Motions {
    let mut motions = stroke(from, from.orientation * -Vec3::y(), speed_m_per_s, 0.06, dt_s);
    let Some(ToolMotion::MoveTo { pose: end, .. }) = motions.last().map(|m| m[0]) else { return motions };
    motions.extend(stroke(end, from.orientation * Vec3::y(), speed_m_per_s, 0.08, dt_s).into_iter().skip(1));
    motions
}

/// Above the blob.
fn above() -> Pose {
    level_at(Vec3::new(0.001, 0.03, 0.0007))
}

/// A stroke down through the blob and out again.
pub(super) fn down_and_out_case(family: Family, name: String, speed_m_per_s: f64, dt_s: f64, held: Held) -> Case {
    case_of(family, name, dt_s, held, down_and_out(above(), speed_m_per_s, dt_s))
}

fn case(name: String, dt_s: f64, held: Held, motions: Motions) -> Case {
    case_of(Family::Tools, name, dt_s, held, motions)
}

fn case_of(family: Family, name: String, dt_s: f64, held: Held, motions: Motions) -> Case {
    let tools = motions.iter().map(Vec::len).max().unwrap_or(1);
    let specimen = specimen(dt_s);
    Case::new(family, name, parameters(&specimen), move |budget| run(&specimen, held, tools, &motions, budget))
}

fn run(
    specimen: &Specimen,
    held: Held,
    tools: usize,
    motions: &Motions,
    budget: Budget,
) -> Result<Outcome, SceneProblems> {
    let mut trial = Trial::new(specimen.scene(blob(specimen, held), tools))?;
    let voxels = trial.world.bodies()[0].grid().voxels().len();
    motions.iter().for_each(|motions| _ = trial.step(motions));
    trial.let_go(specimen.period_s(), 12.0, budget.most_steps, Return::Anywhere);
    let wrong = check_body(trial.world.bodies()[0], voxels);
    Ok(Outcome { seen: trial.finish(), wrong })
}

pub(super) fn cases(seed: u64) -> Vec<Case> {
    let mut cases = Vec::new();
    for (held, how) in [(Held::Base, "held"), (Held::Nothing, "free")] {
        // What nothing holds takes no longer steps.
        let longest_s = if held == Held::Nothing { 0.03 } else { 0.1 };
        for (speed, dt_s) in [(0.1, 1e-3), (1.0, 1e-3), (10.0, 1e-3), (100.0, 1e-3), (10.0, 1e-4), (10.0, longest_s)] {
            let name = format!("{speed} m/s down and out, dt {dt_s} s, {how}");
            cases.push(down_and_out_case(Family::Tools, name, speed, dt_s, held));
        }
        let flat = turned(Vec3::new(0.0, 0.0, -0.06), Vec3::zeros());
        cases.push(case(
            format!("10 m/s flat side first, {how}"),
            1e-3,
            held,
            stroke(flat, Vec3::z(), 10.0, 0.12, 1e-3),
        ));
        let askew = turned(Vec3::new(-0.05, 0.04, 0.01), Vec3::new(0.4, 0.3, 0.7));
        let way = -askew.position_m;
        cases.push(case(format!("10 m/s askew, {how}"), 1e-3, held, stroke(askew, way, 10.0, 0.15, 1e-3)));
        cases.extend(teleports(seed, held, how));
        cases.extend(inside(held, how));
        cases.extend(two(held, how));
        for number in 1..=3 {
            let name = format!("random strokes of 1 to 10 m/s, {number}, {how}");
            cases.push(case(name, 1e-3, held, random(&mut SplitMix64(seed + number), 1, 300, 1e-3)));
        }
    }
    cases
}

/// Put down elsewhere in each step, or moved there as if it had swept what lies between.
fn teleports(seed: u64, held: Held, how: &str) -> Vec<Case> {
    let places = |seed: u64, far_m: f64| -> Vec<Pose> {
        let mut rng = SplitMix64(seed);
        (0..200).map(|_| turned(far_m * rng.vector(), std::f64::consts::PI * rng.vector())).collect()
    };
    let put = |pose: Pose| vec![ToolMotion::enter_at(pose)];
    let moved = |pose: Pose| vec![ToolMotion::move_to(pose)];
    let stay = |seed: u64| places(seed, 0.03).into_iter().flat_map(|p| vec![put(p), moved(p), moved(p)]).collect();
    vec![
        case(
            format!("put down elsewhere each step, {how}"),
            1e-3,
            held,
            places(seed, 0.03).into_iter().map(put).collect(),
        ),
        case(format!("put down elsewhere, stays for 3 steps, {how}"), 1e-3, held, stay(seed + 1)),
        case(
            format!("jumps through the blob each step, {how}"),
            1e-3,
            held,
            places(seed, 0.05).into_iter().map(moved).collect(),
        ),
        case(format!("jumps by up to 500 m, {how}"), 1e-3, held, places(seed, 500.0).into_iter().map(moved).collect()),
    ]
}

/// Put down in the middle of the tissue, then moved on.
fn inside(held: Held, how: &str) -> Vec<Case> {
    let middle = level_at(Vec3::new(0.0, 0.001, 0.0007));
    let ways = [
        ("stays", Vec3::zeros()),
        ("down", -Vec3::y()),
        ("up", Vec3::y()),
        ("sideways", Vec3::z()),
        ("along", Vec3::x()),
    ];
    let go = |(name, way): (&str, Vec3)| {
        let motions = if way == Vec3::zeros() {
            vec![vec![ToolMotion::enter_at(middle)]; 100]
        } else {
            stroke(middle, way, 1.0, 0.06, 1e-3)
        };
        case(format!("starts inside, {name}, {how}"), 1e-3, held, motions)
    };
    ways.into_iter().map(go).collect()
}

/// Two blades that cross, meet head-on, or are one and the same.
fn two(held: Held, how: &str) -> Vec<Case> {
    let both = |a: Motions, b: Motions| -> Motions { a.into_iter().zip(b).map(|(a, b)| vec![a[0], b[0]]).collect() };
    let at = |x: f64, y: f64, about: Vec3| turned(Vec3::new(x, y, 0.0007), about);
    let down = |about: Vec3, speed: f64| stroke(at(0.0, 0.03, about), -Vec3::y(), speed, 0.06, 1e-3);
    let quarter = Vec3::y() * std::f64::consts::FRAC_PI_2;
    let toward = |side: f64| {
        let about = Vec3::z() * (-side * std::f64::consts::FRAC_PI_2);
        stroke(at(side * 0.04, 0.0, about), -Vec3::x() * side, 1.0, 0.08, 1e-3)
    };
    vec![
        case(
            format!("two blades cross at right angles, 1 m/s, {how}"),
            1e-3,
            held,
            both(down(Vec3::zeros(), 1.0), down(quarter, 1.0)),
        ),
        case(
            format!("two blades cross at right angles, 10 m/s, {how}"),
            1e-3,
            held,
            both(down(Vec3::zeros(), 10.0), down(quarter, 10.0)),
        ),
        case(format!("two blades meet head-on, {how}"), 1e-3, held, both(toward(1.0), toward(-1.0))),
        case(
            format!("two blades in one place, {how}"),
            1e-3,
            held,
            both(down(Vec3::zeros(), 1.0), down(Vec3::zeros(), 1.0)),
        ),
        case(format!("two blades, random strokes, {how}"), 1e-3, held, random(&mut SplitMix64(77), 2, 300, 1e-3)),
    ]
}

/// Strokes of 1 to 10 m/s that turn as they go, from anywhere, with lifts and teleports between.
pub(super) fn random(rng: &mut SplitMix64, tools: usize, steps: usize, dt_s: f64) -> Motions {
    let mut hands: Vec<Option<(Pose, Vec3, Vec3, u32)>> = vec![None; tools];
    let mut motions = Vec::with_capacity(steps);
    for _ in 0..steps {
        let step = hands.iter_mut().map(|hand| match hand {
            Some((pose, velocity_m_per_s, spin_per_s, left)) if *left > 0 => {
                *left -= 1;
                pose.position_m += *velocity_m_per_s * dt_s;
                pose.orientation = Quat::from_scaled_axis(*spin_per_s * dt_s) * pose.orientation;
                ToolMotion::move_to(*pose)
            }
            Some(_) if rng.unit() < 0.3 => {
                *hand = None;
                ToolMotion::Lift
            }
            _ => {
                let pose = turned(0.05 * rng.vector(), std::f64::consts::PI * rng.vector());
                let toward = if rng.unit() < 0.7 { -pose.position_m } else { rng.vector() };
                let speed_m_per_s = 1.0 + 9.0 * rng.unit();
                let velocity = toward.try_normalize(1e-9).unwrap_or(Vec3::x()) * speed_m_per_s;
                *hand = Some((pose, velocity, 20.0 * rng.vector(), 5 + rng.index(20) as u32));
                ToolMotion::enter_at(pose)
            }
        });
        motions.push(step.collect());
    }
    motions
}
