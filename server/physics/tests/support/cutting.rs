//! A block and a blade that is driven through it.

use super::world_of;
use super::{object, scene};
use kerf_physics::scene::{BladeDesc, ObjectDesc, Scene, ShapeDesc, ToolDesc};
use kerf_physics::step_io::{EnergyStep, SolveReport, ToolMotion};
use kerf_physics::{Body, NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};

pub const BLOCK_SIDE_M: f64 = 0.04;
pub const BLOCK_HEIGHT_M: f64 = 0.03;
pub const YOUNG_PA: f64 = 1e6;
/// 2 % of E times the edge of a composite of 1 cm: what the linear law carries on every mesh here.
pub const GC_J_PER_M2: f64 = 200.0;

/// The block, x and z in +-20 mm, y in 0..30 mm, its lowest layer of voxels held.
pub fn block(h: f64, level: u8) -> ObjectDesc {
    let half = 0.5 * BLOCK_SIDE_M;
    let mut desc = object([-half, 0.0, -half], [half, BLOCK_HEIGHT_M, half], h, level);
    desc.material.young_modulus_pa = YOUNG_PA;
    desc.material.rayleigh_beta_s = 2e-4;
    desc.material.fracture_energy_j_per_m2 = Some(GC_J_PER_M2);
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.01 * h, 1.0] }];
    desc
}

pub fn cutting_scene(object: ObjectDesc, blade_width_m: f64, rate_hz: f64) -> Scene {
    let mut scene = scene(vec![object]);
    scene.desc.rate_hz = rate_hz;
    scene.desc.solver.relative_tolerance = Some(1e-3);
    let blade = BladeDesc::straight(blade_width_m, 0.06);
    scene.desc.tools = vec![ToolDesc::blade("blade", blade)];
    scene
}

/// A blade's attitude: yaw about the vertical, then roll about its own edge's horizontal normal.
pub fn attitude(yaw_deg: f64, roll_deg: f64, pitch_deg: f64) -> Quat {
    let turn = |axis: nalgebra::UnitVector3<f64>, deg: f64| Quat::from_axis_angle(&axis, deg.to_radians());
    turn(Vec3::y_axis(), yaw_deg) * turn(Vec3::x_axis(), pitch_deg) * turn(Vec3::z_axis(), roll_deg)
}

/// One step of a stroke.
#[derive(Clone, Copy)]
pub struct Sample {
    /// Travel of the edge along the cutting direction, m.
    pub travel_m: f64,
    /// Force against the blade's motion, N.
    pub force_n: f64,
    pub area_m2: f64,
    pub parted_links: u32,
    pub energy: EnergyStep,
    pub solve: SolveReport,
}

/// A blade in a scene, and what it met so far.
pub struct Rig {
    pub world: World,
    pub tool: usize,
    pub position_m: Vec3,
    pub orientation: Quat,
    pub speed_m_per_s: f64,
    pub dt_s: f64,
    pub travel_m: f64,
    pub samples: Vec<Sample>,
    /// Force on the tool at each step, scene frame, N.
    pub wrenches_n: Vec<Vec3>,
}

impl Rig {
    pub fn new(scene: &Scene, position_m: Vec3, orientation: Quat, speed_m_per_s: f64) -> Self {
        Self::of_world(world_of(scene), scene.desc.rate_hz, position_m, orientation, speed_m_per_s)
    }

    /// The same in a scene that has values beyond their limits.
    pub fn beyond_limits(scene: &Scene, position_m: Vec3, orientation: Quat, speed_m_per_s: f64) -> Self {
        let world = super::world_beyond_limits(scene);
        Self::of_world(world, scene.desc.rate_hz, position_m, orientation, speed_m_per_s)
    }

    fn of_world(world: World, rate_hz: f64, position_m: Vec3, orientation: Quat, speed_m_per_s: f64) -> Self {
        Self {
            world,
            tool: 0,
            position_m,
            orientation,
            speed_m_per_s,
            dt_s: 1.0 / rate_hz,
            travel_m: 0.0,
            samples: Vec::new(),
            wrenches_n: Vec::new(),
        }
    }

    pub fn forward(&self) -> Vec3 {
        self.orientation * -Vec3::y()
    }

    fn motion(&mut self, motion: ToolMotion) {
        let inputs = [ToolInput { tool: self.tool, motion }];
        let output = self.world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
        assert!(output.fault.is_none(), "{:?}", output.fault);
        self.wrenches_n.push(output.tools[self.tool].wrench.force_n);
        let forward = self.orientation * -Vec3::y();
        self.samples.push(Sample {
            travel_m: self.travel_m,
            force_n: -output.tools[self.tool].wrench.force_n.dot(&forward),
            area_m2: output.fracture.cut_area_m2,
            parted_links: output.fracture.parted_links,
            energy: output.energy,
            solve: output.solve,
        });
    }

    fn pose(&self) -> Pose {
        Pose { position_m: self.position_m, orientation: self.orientation }
    }

    /// Drives the edge on by `travel_m` along the cutting direction (backward where negative).
    pub fn drive(&mut self, travel_m: f64) {
        self.drive_along(self.forward() * travel_m);
    }

    pub fn drive_along(&mut self, by_m: Vec3) {
        let steps = (by_m.norm() / (self.speed_m_per_s * self.dt_s)).round().max(1.0) as usize;
        let forward = self.forward();
        for _ in 0..steps {
            self.position_m += by_m / steps as f64;
            self.travel_m += by_m.dot(&forward) / steps as f64;
            let pose = self.pose();
            self.motion(ToolMotion::move_to(pose));
        }
    }

    /// Takes the blade from pose to pose, one a step.
    pub fn drive_through(&mut self, poses: impl Iterator<Item = Pose>) {
        for pose in poses {
            (self.position_m, self.orientation) = (pose.position_m, pose.orientation);
            self.motion(ToolMotion::move_to(pose));
        }
    }

    /// Holds the edge where it is.
    pub fn rest(&mut self, steps: usize) {
        for _ in 0..steps {
            let pose = self.pose();
            self.motion(ToolMotion::move_to(pose));
        }
    }

    pub fn lift(&mut self) {
        self.motion(ToolMotion::Lift);
    }

    pub fn enter_at(&mut self, position_m: Vec3) {
        self.position_m = position_m;
        let pose = self.pose();
        self.motion(ToolMotion::enter_at(pose));
    }

    pub fn body(&self) -> &Body {
        self.world.bodies()[0]
    }

    /// Mean force over the samples with travel in `from..to`.
    pub fn mean_force_n(&self, from_m: f64, to_m: f64) -> f64 {
        let force: Vec<f64> =
            self.samples.iter().filter(|s| (from_m..to_m).contains(&s.travel_m)).map(|s| s.force_n).collect();
        force.iter().sum::<f64>() / force.len() as f64
    }

    pub fn highest_force_n(&self) -> f64 {
        self.samples.iter().map(|s| s.force_n).fold(0.0, f64::max)
    }

    pub fn sum(&self, term: impl Fn(&Sample) -> f64) -> f64 {
        self.samples.iter().map(term).sum()
    }

    /// Swept area, m^2, and the work spent in it over Gc times the area.
    pub fn area_and_work_ratio(&self, gc: f64) -> (f64, f64) {
        let area = self.sum(|s| s.area_m2);
        (area, self.sum(|s| s.energy.fracture_j + s.energy.front_slip_j) / (gc * area))
    }

    /// Energy that steps made at contacts, and the magnitude of the tool's work, J.
    pub fn made_and_work_j(&self) -> (f64, f64) {
        (self.sum(|s| (-s.energy.contact_loss_j).max(0.0)), self.sum(|s| s.energy.tool_work_j.abs()))
    }

    /// Sum of the steps' energy residuals over the tool's work, and of their magnitudes.
    pub fn residual_ratios(&self) -> (f64, f64) {
        let work = self.sum(|s| s.energy.tool_work_j);
        (self.sum(|s| s.energy.residual_j) / work, self.sum(|s| s.energy.residual_j.abs()) / work)
    }
}

/// Sizes, in voxels, of the connected pieces among the voxels that `keep` accepts by their centre.
pub fn pieces(body: &Body, keep: impl Fn(Vec3) -> bool) -> Vec<usize> {
    use kerf_physics::Grid;
    let grid = body.grid();
    let kept: Vec<bool> = grid.voxels().iter().map(|v| keep(grid.centre_m(v.ijk))).collect();
    let mut seen = vec![false; kept.len()];
    let mut sizes = Vec::new();
    for start in 0..kept.len() {
        if !kept[start] || seen[start] {
            continue;
        }
        seen[start] = true;
        let (mut stack, mut size) = (vec![start], 0);
        while let Some(voxel) = stack.pop() {
            size += 1;
            for (link, other) in Grid::links_of(grid.voxels()[voxel].ijk) {
                let Some(next) = grid.voxel_at(other).filter(|_| grid.is_intact(link)) else { continue };
                if kept[next.index()] && !seen[next.index()] {
                    seen[next.index()] = true;
                    stack.push(next.index());
                }
            }
        }
        sizes.push(size);
    }
    sizes.sort_unstable();
    sizes
}

/// Area of the part of a plane that lies in a box: the polygon of the plane's crossings with the edges.
pub fn plane_area_in_box(point: Vec3, normal: Vec3, min: Vec3, max: Vec3) -> f64 {
    let corner = |c: usize| Vec3::from_fn(|a, _| if c >> a & 1 == 1 { max[a] } else { min[a] });
    let height = |c: usize| (corner(c) - point).dot(&normal);
    let mut crossings: Vec<Vec3> = Vec::new();
    for c in 0..8usize {
        for d in [1, 2, 4].map(|bit| c | bit).into_iter().filter(|d| *d != c) {
            let (a, b) = (height(c), height(d));
            if (a < 0.0) != (b < 0.0) {
                crossings.push(corner(c) + (corner(d) - corner(c)) * (a / (a - b)));
            }
        }
    }
    let Some(first) = crossings.first().copied() else { return 0.0 };
    let centre = crossings.iter().sum::<Vec3>() / crossings.len() as f64;
    let u = (first - centre).normalize();
    let v = normal.normalize().cross(&u);
    let angle = |p: &Vec3| (p - centre).dot(&v).atan2((p - centre).dot(&u));
    crossings.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    let next = |i: usize| crossings[(i + 1) % crossings.len()];
    (0..crossings.len()).map(|i| 0.5 * (crossings[i] - centre).cross(&(next(i) - centre)).norm()).sum()
}
