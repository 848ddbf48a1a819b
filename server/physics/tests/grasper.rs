//! A grasper holds, pulls and lets go.

use super::support::{Lcg, object, scene, world_of};
use kerf_physics::scene::{BladeDesc, GrasperDesc, Scene, ShapeDesc, ToolDesc};
use kerf_physics::step_io::{EnergyStep, Grasp, StepOutput, ToolMotion};
use kerf_physics::{NoClock, OPEN, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};

const YOUNG_PA: f64 = 1e5;
/// Half of the side of the strip, m.
const HALF_M: f64 = 0.005;
const LENGTH_M: f64 = 0.06;

/// A strip along x, held at x = 0, and a grasper whose ball covers its other end.
fn strip(h: f64, level: u8, max_force_n: Option<f64>) -> Scene {
    let mut strip = object([0.0, -HALF_M, -HALF_M], [LENGTH_M, HALF_M, HALF_M], h, level);
    strip.material.young_modulus_pa = YOUNG_PA;
    strip.material.poisson_ratio = 0.3;
    strip.material.rayleigh_beta_s = 5e-3;
    strip.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.01 * h, 1.0, 1.0] }];
    let mut scene = scene(vec![strip]);
    scene.desc.tools = vec![ToolDesc::grasper("grasper", GrasperDesc { max_force_n, ..GrasperDesc::new(0.008) })];
    scene
}

/// A grasper and what it met so far.
struct Hand {
    world: World,
    pose: Pose,
    opening: f64,
    booked: EnergyStep,
    /// Tools whose contact model is wanted.
    models: &'static [usize],
}

impl Hand {
    fn new(scene: &Scene, position_m: Vec3) -> Self {
        let pose = Pose { position_m, orientation: Quat::identity() };
        let world = world_of(scene);
        let mut hand = Self { world, pose, opening: OPEN, booked: EnergyStep::default(), models: &[] };
        hand.enter_at(pose, OPEN);
        hand
    }

    fn enter_at(&mut self, pose: Pose, opening: f64) -> &StepOutput {
        (self.pose, self.opening) = (pose, opening);
        self.act(&[ToolInput { tool: 0, motion: ToolMotion::EnterAt { pose, opening } }])
    }

    fn move_to(&mut self, pose: Pose) -> &StepOutput {
        self.pose = pose;
        self.act(&[ToolInput { tool: 0, motion: ToolMotion::MoveTo { pose, opening: self.opening } }])
    }

    fn act(&mut self, inputs: &[ToolInput]) -> &StepOutput {
        let inputs = StepInputs { models: self.models, ..StepInputs::of(inputs) };
        let output = self.world.step(&Workers::serial(), &NoClock, &inputs);
        assert!(output.fault.is_none(), "{:?}", output.fault);
        self.booked.tool_work_j += output.energy.tool_work_j;
        self.booked.residual_j += output.energy.residual_j.abs();
        self.booked.numerical_j += output.energy.numerical_j;
        self.booked.contact_loss_j += output.energy.contact_loss_j;
        self.booked.damping_j += output.energy.damping_j;
        output
    }

    fn close(&mut self) -> &StepOutput {
        self.opening = 0.0;
        self.move_to(self.pose)
    }

    fn open(&mut self) -> &StepOutput {
        self.opening = OPEN;
        self.move_to(self.pose)
    }

    fn move_by(&mut self, by_m: Vec3, turn: Quat, steps: u32) {
        let (from, to) = (self.pose, turn * self.pose.orientation);
        for i in 1..=steps {
            let share = f64::from(i) / f64::from(steps);
            let orientation = from.orientation.slerp(&to, share);
            self.move_to(Pose { position_m: from.position_m + by_m * share, orientation });
        }
    }

    fn rest(&mut self, steps: u32) -> &StepOutput {
        (0..steps).for_each(|_| _ = self.act(&[]));
        self.world.output()
    }

    fn force_n(&self) -> Vec3 {
        self.world.output().tools[0].wrench.force_n
    }

    /// Mean strain along x between two cross-sections, from the nodes nearest to them.
    fn strain(&self, from_m: f64, to_m: f64) -> f64 {
        let body = self.world.bodies()[0];
        let section = |at_m: f64| {
            let distance = |n: usize| (body.rest_position_m(n).x - at_m).abs();
            let nearest = (0..body.node_count()).map(distance).fold(f64::INFINITY, f64::min);
            let nodes: Vec<usize> = (0..body.node_count()).filter(|n| distance(*n) < nearest + 1e-9).collect();
            let mean = |x: &dyn Fn(usize) -> f64| nodes.iter().map(|n| x(*n)).sum::<f64>() / nodes.len() as f64;
            (mean(&|n| body.rest_position_m(n).x), mean(&|n| body.state.position_m[n][0]))
        };
        let ((rest_a, a), (rest_b, b)) = (section(from_m), section(to_m));
        (b - a) / (rest_b - rest_a) - 1.0
    }
}

#[test]
fn a_pulled_strip_pulls_back_with_e_a_eps() {
    for (h, level) in [(0.0025, 1), (0.00125, 1), (0.00125, 2)] {
        let mut hand = Hand::new(&strip(h, level, None), Vec3::new(LENGTH_M, 0.0, 0.0));
        assert_eq!(hand.close().tools[0].grasp, Grasp::Holding);
        hand.move_by(Vec3::new(0.002, 0.0, 0.0), Quat::identity(), 200);
        hand.rest(400);
        let eps = hand.strain(0.02, 0.04);
        let area = (2.0 * HALF_M).powi(2);
        let force = hand.force_n();
        let ratio = -force.x / (YOUNG_PA * area * eps);
        println!("h {h} level {level}: strain {eps:.4}, F/(E A eps) {ratio:.4}");
        assert!((ratio - 1.0).abs() < 0.02, "h {h} level {level}: {ratio}");
        assert!(force.y.abs().max(force.z.abs()) < 1e-3 * force.x.abs(), "{force:?}");
        // Held from x = 54 mm on: what is stretched is no longer than that and no shorter than to where
        // the ball ends.
        assert!(eps > 0.002 / LENGTH_M && eps < 0.002 / 0.044, "{eps}");
    }
}

#[test]
fn what_hangs_from_a_grasper_weighs_on_it_force_and_torque() {
    // A free block held beside its middle, at an attitude of the tool that is none of the axes.
    let mut block = object([-0.01, -0.01, -0.01], [0.03, 0.01, 0.01], 0.0025, 1);
    block.material.rayleigh_alpha_per_s = 30.0;
    block.material.rayleigh_beta_s = 2e-3;
    let mut scene = scene(vec![block]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    scene.desc.tools = vec![ToolDesc::grasper("grasper", GrasperDesc::new(0.008))];
    let at = Vec3::new(-0.002, 0.001, 0.003);
    let mut hand = Hand::new(&scene, at);
    hand.close();
    hand.move_by(Vec3::zeros(), Quat::from_euler_angles(0.3, 0.5, 0.2), 200);
    let output = hand.rest(600).clone();
    let body = hand.world.bodies()[0];
    let grid = &body.state.grid;
    let centre = (0..grid.voxels().len() as u32).map(kerf_physics::VoxelId).map(|voxel| {
        let position_m = grid.centre_m(grid.voxels()[voxel.index()].ijk);
        body.current_m(&kerf_physics::MaterialPoint { position_m, voxel })
    });
    let centre = centre.sum::<Vec3>() / grid.voxels().len() as f64;
    let weight = Vec3::new(0.0, -9.81 * body.mass_kg(), 0.0);
    let torque = (centre - at).cross(&weight);
    let wrench = output.tools[0].wrench;
    println!("force {:?} torque {:?}, weight {weight:?} {torque:?}", wrench.force_n, wrench.torque_nm);
    assert!((wrench.force_n - weight).norm() < 2e-3 * weight.norm(), "{:?} {weight:?}", wrench.force_n);
    assert!((wrench.torque_nm - torque).norm() < 5e-3 * torque.norm(), "{:?} {torque:?}", wrench.torque_nm);
}

#[test]
fn letting_go_books_what_the_springs_held() {
    let mut hand = Hand::new(&strip(0.0025, 1, None), Vec3::new(LENGTH_M, 0.0, 0.0));
    hand.close();
    hand.move_by(Vec3::new(0.003, 0.002, 0.0), Quat::from_euler_angles(0.4, 0.0, 0.1), 150);
    hand.rest(50);
    let lost = |hand: &Hand| hand.booked.contact_loss_j + hand.booked.numerical_j;
    let (stored, before) = (hand.world.output().energy.contact_j, lost(&hand));
    let opened = hand.open().clone();
    assert_eq!(opened.tools[0].grasp, Grasp::Nothing);
    assert_eq!(opened.tools[0].wrench.force_n, Vec3::zeros());
    let dropped = stored - opened.energy.contact_j;
    assert!(dropped > 0.0 && lost(&hand) - before >= dropped, "{dropped}");
    let output = hand.rest(1500).clone();
    let share = hand.booked.residual_j / hand.booked.tool_work_j;
    println!("residual over work {share:.1e}");
    assert!(share < 1e-3, "{share}");
    // Back at rest: all that was put in is gone.
    assert!(output.energy.elastic_j + output.energy.kinetic_j < 1e-3 * hand.booked.tool_work_j);
}

#[test]
fn what_takes_more_than_the_most_force_slips_out_and_is_taken_again_only_by_jaws_that_opened() {
    let most = 0.2;
    let mut hand = Hand::new(&strip(0.0025, 1, Some(most)), Vec3::new(LENGTH_M, 0.0, 0.0));
    hand.close();
    let mut highest: f64 = 0.0;
    let slipped = (0..400).position(|_| {
        hand.pose.position_m.x += 2e-5;
        let output = hand.move_to(hand.pose);
        let tool = &output.tools[0];
        highest = highest.max(tool.wrench.force_n.norm());
        tool.grasp == Grasp::Slipped
    });
    assert!(slipped.is_some(), "{highest}");
    assert!(highest > most && highest < 1.1 * most, "{highest}");
    assert_eq!(hand.rest(1).tools[0].grasp, Grasp::Nothing);
    assert_eq!(hand.close().tools[0].grasp, Grasp::Nothing, "they are closed already");
    hand.rest(500);
    hand.open();
    hand.pose.position_m.x = LENGTH_M;
    hand.move_to(hand.pose);
    assert_eq!(hand.close().tools[0].grasp, Grasp::Holding);
    assert!(hand.booked.residual_j < 1e-2 * hand.booked.tool_work_j);
}

#[test]
fn jaws_of_no_named_force_hold_250_kpa_or_half_of_youngs_modulus_over_their_area() {
    let grasper = GrasperDesc::new(0.004);
    let area_m2 = std::f64::consts::PI * 0.004_f64.powi(2);
    assert_eq!(grasper.slips_above_n(5e3), 250e3 * area_m2);
    assert_eq!(GrasperDesc { max_force_n: Some(2.0), ..grasper.clone() }.slips_above_n(5e3), 2.0);

    let mut scene = strip(0.0025, 1, None);
    scene.desc.objects[0].material.young_modulus_pa = 1e6;
    scene.desc.tools = vec![ToolDesc::grasper("grasper", grasper)];
    let mut hand = Hand::new(&scene, Vec3::new(LENGTH_M, 0.0, 0.0));
    hand.close();
    let mut highest: f64 = 0.0;
    let slipped = (0..3000).any(|_| {
        hand.pose.position_m.x += 1e-5;
        let tool = &hand.move_to(hand.pose).tools[0];
        highest = highest.max(tool.wrench.force_n.norm());
        tool.grasp == Grasp::Slipped
    });
    let most = 0.5e6 * area_m2;
    assert!(slipped && highest > most && highest < 1.1 * most, "{highest} of {most} N");
}

#[test]
fn jaws_that_come_in_closed_or_close_in_the_air_hold_nothing() {
    let mut hand = Hand::new(&strip(0.0025, 1, None), Vec3::new(LENGTH_M + 0.02, 0.0, 0.0));
    assert_eq!(hand.close().tools[0].grasp, Grasp::Nothing);
    hand.move_by(Vec3::new(-0.02, 0.0, 0.0), Quat::identity(), 20);
    assert_eq!(hand.world.output().tools[0].grasp, Grasp::Nothing);
    let entered = hand.enter_at(hand.pose, 0.0);
    assert_eq!(entered.tools[0].grasp, Grasp::Nothing);
}

#[test]
fn the_contact_model_is_as_stiff_as_what_is_held() {
    // A ball in the middle of a block whose faces are held: the springs of the grasp alone are thirty times
    // as stiff.
    let mut block = object([-0.03; 3], [0.03; 3], 0.0025, 1);
    block.material.young_modulus_pa = YOUNG_PA;
    block.material.rayleigh_beta_s = 5e-3;
    let held = |min_m, max_m| ShapeDesc::Box { min_m, max_m };
    block.fixed = vec![held([-1.0, -1.0, -1.0], [-0.027, 1.0, 1.0]), held([0.027, -1.0, -1.0], [1.0, 1.0, 1.0])];
    let mut scene = scene(vec![block]);
    scene.desc.tools = vec![ToolDesc::grasper("grasper", GrasperDesc::new(0.006))];
    let mut hand = Hand::new(&scene, Vec3::zeros());
    hand.models = &[0];
    hand.close();
    let model = hand.rest(8).tools[0].contact.expect("it holds");
    hand.models = &[];
    let by = Vec3::new(3e-4, 0.0, 0.0);
    hand.move_by(by, Quat::identity(), 100);
    hand.rest(200);
    let felt = -hand.force_n().x / by.x;
    println!("model {:.1} N/m, felt {felt:.1} N/m", model.stiffness[0][0]);
    assert!((0.95..1.05).contains(&(model.stiffness[0][0] / felt)), "{} {felt}", model.stiffness[0][0]);
    hand.move_by(-by, Quat::from_euler_angles(0.0, 0.05, 0.0), 100);
    hand.rest(200);
    let felt = -hand.world.output().tools[0].wrench.torque_nm.y / 0.05;
    println!("model {:.2e} N m, felt {felt:.2e} N m", model.stiffness[4][4]);
    assert!((0.95..1.05).contains(&(model.stiffness[4][4] / felt)), "{} {felt}", model.stiffness[4][4]);
    for i in 0..6 {
        for j in 0..6 {
            assert!((model.stiffness[i][j] - model.stiffness[j][i]).abs() <= 1e-12 * model.stiffness[0][0]);
        }
    }
}

#[test]
fn a_grasp_holds_on_through_a_cut_of_what_it_holds() {
    let h = 0.0025;
    let mut scene = strip(h, 1, None);
    scene.desc.objects[0].material.fracture_energy_j_per_m2 = Some(10.0);
    scene.desc.tools.push(ToolDesc::blade("blade", BladeDesc::straight(0.03, 0.05)));
    scene.desc.solver.relative_tolerance = Some(1e-3);
    let mut hand = Hand::new(&scene, Vec3::new(LENGTH_M, 0.0, 0.0));
    hand.close();
    hand.move_by(Vec3::new(0.001, 0.0, 0.0), Quat::identity(), 50);
    // Down across the strip, 3 mm from the end of the held part.
    let (mut parted, mut step) = (0, 0);
    while hand.world.bodies()[0].part_count() == 1 && step < 1000 {
        let height = 0.006 - 4e-5 * f64::from(step);
        let orientation = Quat::from_axis_angle(&Vec3::y_axis(), std::f64::consts::FRAC_PI_2);
        let pose = Pose { position_m: Vec3::new(LENGTH_M - 0.0029, height, 0.0), orientation };
        let input = ToolInput { tool: 1, motion: ToolMotion::move_to(pose) };
        let output = hand.world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[input]));
        assert!(output.fault.is_none());
        assert_eq!(output.tools[0].grasp, Grasp::Holding);
        parted += output.fracture.parted_links;
        hand.booked.residual_j += output.energy.residual_j.abs();
        hand.booked.tool_work_j += output.energy.tool_work_j.abs();
        step += 1;
    }
    assert!(hand.world.bodies()[0].part_count() > 1 && parted > 10, "{parted}");
    assert!(hand.booked.residual_j < 1e-2 * hand.booked.tool_work_j, "{:?}", hand.booked);
    // The end comes away with the grasper.
    let lift = ToolInput { tool: 1, motion: ToolMotion::Lift };
    hand.world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[lift]));
    hand.move_by(Vec3::new(0.02, 0.0, 0.0), Quat::identity(), 400);
    hand.rest(200);
    let body = hand.world.bodies()[0];
    let end = body.state.position_m.iter().map(|x| x[0]).fold(0.0, f64::max);
    assert!((end - LENGTH_M - 0.021).abs() < 1e-3, "{end}");
}

#[test]
fn random_pulls_stay_finite_and_book_every_joule() {
    let mut random = Lcg(3);
    let mut scene = strip(0.0025, 1, None);
    scene.desc.objects[0].material.strain_stiffening = 3.0;
    let mut hand = Hand::new(&scene, Vec3::new(0.05, 0.004, 0.0));
    let mut work = 0.0;
    for _ in 0..12 {
        hand.close();
        let mut unit = || 2.0 * random.unit() - 1.0;
        let by = Vec3::new(unit(), unit(), unit()) * 0.01;
        let turn = Quat::from_euler_angles(unit(), unit(), unit());
        let before = hand.booked.tool_work_j;
        hand.move_by(by, turn, 30);
        work += (hand.booked.tool_work_j - before).abs();
        hand.open();
        hand.rest(20);
        hand.enter_at(Pose { position_m: Vec3::new(0.05, 0.004, 0.0), orientation: Quat::identity() }, OPEN);
    }
    println!("residual over work {:.1e}", hand.booked.residual_j / work);
    assert!(hand.booked.residual_j < 1e-2 * work, "{} of {work}", hand.booked.residual_j);
}
