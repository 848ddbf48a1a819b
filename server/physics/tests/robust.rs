//! Whatever a hand does to the tissue: no fault, numbers that are finite, energy that was put in and is
//! accounted for, no piece of a few voxels.

use super::support::{Lcg, object, scene, world_of};
use kerf_physics::scene::{BladeDesc, EdgeDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{LEAST_PIECE_VOXELS, NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};

const SEMI_AXES_M: [f64; 3] = [0.03, 0.022, 0.025];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Held {
    Nothing,
    Base,
    Everything,
}

fn blob(held: Held, blade: &BladeDesc, tools: usize, rate_hz: f64) -> World {
    let mut desc = object([0.0; 3], [0.06; 3], 0.004, 2);
    desc.shape = ShapeDesc::Ellipsoid { center_m: [0.0; 3], semi_axes_m: SEMI_AXES_M };
    desc.material.young_modulus_pa = 2e4;
    desc.material.fracture_energy_j_per_m2 = Some(20.0);
    desc.material.strain_stiffening = 10.0;
    desc.material.rayleigh_alpha_per_s = 2.0;
    desc.material.rayleigh_beta_s = 1e-3;
    desc.fixed = match held {
        Held::Nothing => Vec::new(),
        Held::Base => vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, -0.014, 1.0] }],
        Held::Everything => vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0; 3] }],
    };
    let mut scene = scene(vec![desc]);
    scene.desc.rate_hz = rate_hz;
    scene.desc.solver.relative_tolerance = Some(1e-3);
    scene.desc.tools = (0..tools).map(|i| ToolDesc::blade(&format!("blade {i}"), blade.clone())).collect();
    world_of(&scene)
}

fn random_vector(rng: &mut Lcg) -> Vec3 {
    Vec3::from_fn(|_, _| 2.0 * rng.unit() - 1.0)
}

fn random_pose(rng: &mut Lcg, reach_m: f64) -> Pose {
    let turn = random_vector(rng) * std::f64::consts::PI;
    Pose { position_m: random_vector(rng) * reach_m, orientation: Quat::from_scaled_axis(turn) }
}

/// What a tool is doing: its pose and its motion per step.
struct Hand {
    pose: Pose,
    velocity_m_per_s: Vec3,
    spin_per_s: Vec3,
    left: u32,
}

impl Hand {
    /// A new stroke of 1 to 10 m/s: from outside through the blob, or put down anywhere.
    fn start(rng: &mut Lcg) -> (Self, ToolMotion) {
        let pose = random_pose(rng, 0.05);
        let speed = 1.0 + 9.0 * rng.unit();
        let toward = if rng.unit() < 0.7 { -pose.position_m.normalize() } else { random_vector(rng).normalize() };
        let hand = Self {
            pose,
            velocity_m_per_s: toward * speed,
            spin_per_s: random_vector(rng) * 20.0,
            left: 5 + (rng.unit() * 20.0) as u32,
        };
        (hand, ToolMotion::enter_at(pose))
    }

    fn go_on(&mut self, dt_s: f64) -> ToolMotion {
        self.left -= 1;
        self.pose.position_m += self.velocity_m_per_s * dt_s;
        self.pose.orientation = Quat::from_scaled_axis(self.spin_per_s * dt_s) * self.pose.orientation;
        ToolMotion::move_to(self.pose)
    }
}

/// Runs random hands; the highest stored energy over what tools put in up to then, J over J.
fn rampage(held: Held, tools: usize, seed: u64, steps: u32) {
    rampage_of(&straight(), held, tools, seed, steps);
}

fn straight() -> BladeDesc {
    BladeDesc { thickness_m: 1e-3, ..BladeDesc::straight(0.03, 0.04) }
}

fn rampage_of(blade: &BladeDesc, held: Held, tools: usize, seed: u64, steps: u32) {
    let mut world = blob(held, blade, tools, 1000.0);
    let mut rng = Lcg(seed);
    let mut hands: Vec<Option<Hand>> = (0..tools).map(|_| None).collect();
    let (mut put_in, mut worst, mut parted, mut spared) = (0.0, 0.0f64, 0, 0);
    let (mut residual, mut booked, mut made) = (0.0, 0.0, 0.0);
    for step in 0..steps {
        let mut inputs = Vec::new();
        for (tool, hand) in hands.iter_mut().enumerate() {
            let motion = match hand {
                Some(h) if h.left > 0 => h.go_on(1e-3),
                Some(_) if rng.unit() < 0.3 => {
                    *hand = None;
                    ToolMotion::Lift
                }
                _ => {
                    let (new, motion) = Hand::start(&mut rng);
                    *hand = Some(new);
                    motion
                }
            };
            inputs.push(ToolInput { tool, motion });
        }
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
        let at = format!("{held:?}, {tools} tools, seed {seed}, step {step}");
        assert!(output.fault.is_none(), "{at}: {:?}", output.fault);
        let e = &output.energy;
        let finite = output
            .tools
            .iter()
            .all(|t| t.wrench.force_n.iter().chain(t.wrench.torque_nm.iter()).all(|x| x.is_finite()));
        assert!(finite && e.elastic_j.is_finite() && e.kinetic_j.is_finite(), "{at}: not finite");
        put_in += e.tool_work_j.abs() + e.contact_j;
        booked += e.tool_work_j.abs();
        residual += e.residual_j.abs();
        made += (-e.contact_loss_j).max(0.0);
        parted += output.fracture.parted_links;
        spared += output.fracture.spared_links;
        worst = worst.max((e.elastic_j + e.kinetic_j) / (put_in + 1e-4));
    }
    let body = world.bodies()[0];
    assert!(body.state.position_m.iter().flatten().all(|x| x.is_finite()));
    let sizes = super::support::cutting::pieces(body, |_| true);
    assert_eq!(sizes.iter().sum::<usize>(), body.state.grid.voxels().len());
    let least = sizes.iter().copied().min().unwrap_or(0);
    assert!(least >= LEAST_PIECE_VOXELS, "{held:?}, seed {seed}: a piece of {least} voxels");
    println!(
        "{held:?}, {tools} tools, seed {seed}: {parted} links parted, {spared} spared, {} pieces, the least of {least} \
         voxels, energy at most {worst:.2} of what was put in, residual {:.1e} of the work, made {:.1e} of it",
        sizes.len(),
        residual / booked,
        made / booked
    );
    assert!(residual < 1e-3 * booked, "{held:?}, seed {seed}: {residual} J of {booked} J are not accounted for");
    assert!(made < 3e-2 * booked, "{held:?}, seed {seed}: contacts made {made} J of nothing, {booked} J were done");
    assert!(worst < 1.5, "{held:?}, seed {seed}: {worst} of the energy that was put in");
}

fn rampage_of_one(seed: u64) {
    rampage(Held::Base, 1, seed, 300);
    rampage(Held::Nothing, 1, seed, 300);
}

#[test]
fn random_strokes_and_teleports_leave_the_state_finite_and_the_energy_bounded() {
    (1..=2).for_each(rampage_of_one);
}

#[test]
#[ignore = "slow: two more seeds of the test above"]
fn random_strokes_leave_the_energy_bounded_whatever_the_seed() {
    (3..=4).for_each(rampage_of_one);
}

fn rampage_of_two(seed: u64) {
    rampage(Held::Base, 2, seed, 250);
    rampage(Held::Nothing, 2, seed, 250);
    rampage(Held::Everything, 2, seed, 100);
}

#[test]
fn two_tools_and_tissue_that_is_held_everywhere_do_no_harm_either() {
    rampage_of_two(11);
}

#[test]
#[ignore = "slow: two more seeds of the test above"]
fn two_tools_do_no_harm_whatever_the_seed() {
    for seed in 12..=13 {
        rampage_of_two(seed);
    }
}

#[test]
fn bent_edges_and_rubbing_wedges_do_no_harm_either() {
    let tooth = |i: i32| [f64::from(i) * 5e-3, -2e-3 * f64::from(i.rem_euclid(2)), 3e-3 * f64::from(i.rem_euclid(3))];
    for (seed, edge) in [
        (21, EdgeDesc::Sine { amplitude_m: 4e-3, wavelength_m: 12e-3 }),
        (22, EdgeDesc::Polyline { points_m: (-3..=3).map(tooth).collect() }),
        (23, EdgeDesc::Arc { sagitta_m: 8e-3 }),
    ] {
        let blade = BladeDesc { edge, wedge_angle_rad: Some(0.2), flank_friction: Some(0.5), ..straight() };
        rampage_of(&blade, Held::Base, 1, seed, 250);
        rampage_of(&blade, Held::Nothing, 1, seed, 250);
    }
}

/// A stroke of up to 1 m/s from outside, edge ahead, slicing by up to half of its way, to any depth: its steps' motions.
fn stroke(rng: &mut Lcg, dt_s: f64) -> Vec<ToolMotion> {
    let aim = Vec3::from(SEMI_AXES_M).map(|a| 0.7 * a * (2.0 * rng.unit() - 1.0));
    let orientation = random_pose(rng, 0.0).orientation;
    let along = orientation * (-Vec3::y() + Vec3::x() * (rng.unit() - 0.5));
    let (from, way_m) = (aim - along * 0.045, 0.045 * (0.6 + 1.4 * rng.unit()));
    let steps = (way_m / ((0.05 + 0.95 * rng.unit()) * dt_s)).ceil() as u32;
    let at = |step: u32| from + along * (way_m * f64::from(step) / f64::from(steps));
    let poses = (0..=steps).map(|step| Pose { position_m: at(step), orientation });
    let mut motions: Vec<_> = poses.map(ToolMotion::move_to).collect();
    motions[0] = ToolMotion::enter_at(Pose { position_m: from, orientation });
    motions.push(ToolMotion::Lift);
    motions
}

/// A front's spring finds another gap as it comes from element to element, deeper or less deep, so that steps make and lose
/// energy in turns. What counts is what a stroke has made of nothing by any time in it.
fn forty_strokes_make_little_energy(rate_hz: f64, seed: u64) {
    let mut rng = Lcg(seed);
    let (mut made_j, mut made_by_steps_j, mut work_j) = (0.0, 0.0, 0.0);
    for stroke_of_forty in 0..40 {
        let mut world = blob(Held::Base, &straight(), 1, rate_hz);
        let (mut lost_j, mut least_j) = (0.0f64, 0.0f64);
        for motion in stroke(&mut rng, 1.0 / rate_hz) {
            let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[ToolInput { tool: 0, motion }]));
            let energy = &output.energy;
            lost_j += energy.contact_loss_j + energy.initiation_j;
            least_j = least_j.min(lost_j);
            made_by_steps_j += (-energy.contact_loss_j).max(0.0) + (-energy.initiation_j).max(0.0);
            work_j += energy.tool_work_j.abs();
        }
        assert!(lost_j >= 0.0, "stroke {stroke_of_forty}: its contacts made {} J", -lost_j);
        made_j -= least_j;
    }
    let [made, by_steps] = [made_j, made_by_steps_j].map(|j| j / work_j);
    println!(
        "{rate_hz} Hz, seed {seed}: of {work_j:.2} J of work strokes made {made:.1e}, single steps {by_steps:.1e}"
    );
    assert!(made < 1e-4, "strokes made {made_j} J of nothing, {work_j} J were done");
    assert!(by_steps < 9e-3, "steps made {made_by_steps_j} J of nothing, {work_j} J were done");
}

#[test]
fn contacts_of_strokes_from_outside_make_little_energy() {
    forty_strokes_make_little_energy(1000.0, 40);
    forty_strokes_make_little_energy(250.0, 40);
}

#[test]
#[ignore = "slow: another seed of the test above"]
fn contacts_of_other_strokes_make_little_energy() {
    forty_strokes_make_little_energy(1000.0, 41);
}
