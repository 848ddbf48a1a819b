//! A blade pressed lightly on a block: by the simulation, and by a fine mesh under a resolved edge.

use super::super::support::world_beyond_limits;
use std::f64::consts::PI;

use kerf_physics::contact::ends::point_springs;
use kerf_physics::contact::{Contact, ContactWeights, Mode, ToolEnds};
use kerf_physics::scene::{
    BladeDesc, ElementKind, MaterialDesc, ObjectDesc, Scene, SceneDesc, ShapeDesc, SolverDesc, ToolDesc,
};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::verification::StepParams;
use kerf_physics::{Body, MaterialPoint, NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};

/// Side of the block along x and z, m.
pub const SIDE_M: f64 = 0.04;
/// Height of the block where its cells are whole, m.
pub const HEIGHT_M: f64 = 0.03;
/// Thickness of the layer below it that is held, m.
const FOOT_M: f64 = 0.01;
/// For a slide: the edge must not outrun in a step what it presses in.
const SLIDE_DENT_M: f64 = 5e-5;
const SLIDE_STEP_M: f64 = 1.5e-5;
const YOUNG_PA: f64 = 1e6;
/// Small enough for the linear law, large enough for single precision.
const DENT_M: f64 = 1e-5;
/// Places across a cell.
const PLACES: usize = 8;
/// Half-width over which the edge is resolved, in fine voxels, and points across it.
const RESOLVED_VOXELS: f64 = 2.5;
const POINTS_ACROSS: usize = 6;

/// A block and a blade on it.
#[derive(Clone, Copy, Debug)]
pub struct Press {
    pub poisson_ratio: f64,
    pub height_m: f64,
    pub half_width_m: f64,
    /// Length of the edge, m.
    pub width_m: f64,
    /// About the vertical axis, from along x.
    pub turn_deg: f64,
    /// Of the blade's plane out of the vertical, about its edge.
    pub tilt_deg: f64,
    /// Of the edge's middle from the block's middle, across the edge, m.
    pub offset_m: f64,
    /// The same along the edge, m.
    pub along_m: f64,
}

impl Press {
    /// An edge of half the block's side on the block's middle.
    pub fn new(poisson_ratio: f64, half_width_m: f64, turn_deg: f64) -> Self {
        Self {
            poisson_ratio,
            height_m: HEIGHT_M,
            half_width_m,
            width_m: 0.5 * SIDE_M,
            turn_deg,
            tilt_deg: 0.0,
            offset_m: 0.0,
            along_m: 0.0,
        }
    }

    /// The edge at one of eight places across a cell of edge `cell_m`, and as many along it.
    pub fn at_place(&self, place: usize, cell_m: f64) -> Self {
        let share = |i: usize| (i as f64 + 0.5) / PLACES as f64 - 0.5;
        Self { offset_m: cell_m * share(place), along_m: cell_m * share(3 * place % PLACES), ..*self }
    }

    /// Error of the simulated stiffness against `reference_n_per_m` at every so many of the places.
    pub fn errors(&self, h: f64, level: u8, reference_n_per_m: f64, every: usize) -> Vec<f64> {
        let cell = h * f64::from(1u32 << level);
        (0..PLACES)
            .step_by(every)
            .map(|i| self.at_place(i, cell).simulated_n_per_m(h, level) / reference_n_per_m - 1.0)
            .collect()
    }

    fn turn(&self) -> Quat {
        Quat::from_axis_angle(&Vec3::y_axis(), self.turn_deg.to_radians())
    }

    pub fn orientation(&self) -> Quat {
        self.turn() * Quat::from_axis_angle(&Vec3::x_axis(), self.tilt_deg.to_radians())
    }

    /// Middle of the edge as it touches the block, m.
    fn touch_m(&self) -> Vec3 {
        self.turn() * Vec3::new(self.along_m, 0.0, self.offset_m) + Vec3::new(0.0, self.height_m, 0.0)
    }

    fn block(&self, h: f64, level: u8) -> ObjectDesc {
        let half = 0.5 * SIDE_M;
        ObjectDesc {
            name: "block".into(),
            shape: ShapeDesc::Box { min_m: [-half, -FOOT_M, -half], max_m: [half, self.height_m, half] },
            voxel_size_m: Some(h),
            resolution: None,
            level,
            element: ElementKind::default(),
            fracture_rule: Default::default(),
            material: MaterialDesc {
                young_modulus_pa: YOUNG_PA,
                poisson_ratio: self.poisson_ratio,
                // Next to no inertia: a step is a static solve.
                density_kg_per_m3: 1.0,
                rayleigh_alpha_per_s: 0.0,
                rayleigh_beta_s: 0.0,
                fracture_energy_j_per_m2: Some(1e6),
                initiation_ratio: 2.0,
                rate: None,
                strain_stiffening: 0.0,
                viscosity: None,
                prestrain: None,
                friction_coefficient: 0.0,
                color: None,
            },
            regions: Vec::new(),
            finer: Vec::new(),
            min_elements_across: None,
            // Whole cells of every level: a cell that is held in part is held altogether.
            fixed: vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 0.0, 1.0] }],
            loads: Vec::new(),
        }
    }

    fn scene(&self, h: f64, level: u8) -> Scene {
        let blade = BladeDesc { edge_half_width_m: self.half_width_m, ..BladeDesc::straight(self.width_m, 0.06) };
        Scene {
            desc: SceneDesc {
                rate_hz: 10.0,
                solver: SolverDesc { relative_tolerance: Some(1e-5), max_iterations: 2000 },
                tools: vec![ToolDesc::blade("blade", blade)],
                ..SceneDesc::of("press", vec![self.block(h, level)])
            },
            meshes: Default::default(),
        }
    }

    /// Force along the cutting direction over the dent that the simulation gives, N/m.
    pub fn simulated_n_per_m(&self, h: f64, level: u8) -> f64 {
        let mut hand = Hand::touching(self, h, level);
        let dented_m = self.touch_m() + hand.forward() * DENT_M;
        (0..3).for_each(|_| _ = hand.force_at_n(dented_m));
        hand.force_at_n(dented_m) / DENT_M
    }

    /// An edge slides sideways at a depth, by `length_m` over the block's middle: the ripple of the force, as
    /// the half of its range over its middle, and the largest change from one step of 15 um to the next,
    /// over the same. The edge drags on the block and rocks it, which by symmetry goes out of the mean of
    /// the force at a place and at its mirror image: the ripple is that mean's.
    pub fn slide(&self, h: f64, level: u8, length_m: f64) -> (f64, f64) {
        let mut hand = Hand::touching(self, h, level);
        let normal = self.orientation() * Vec3::z();
        let dented_m = self.touch_m() + hand.forward() * SLIDE_DENT_M - normal * (0.5 * length_m);
        // A run-up until the edge, which holds the tissue beside it, slides all along: one that goes all across the
        // block tilts it by some dents before that, and the force rises on the way.
        let run_up = (8.0 * SLIDE_DENT_M / SLIDE_STEP_M).ceil() as i32;
        let steps = (length_m / SLIDE_STEP_M).round() as i32;
        let force: Vec<f64> = (-run_up..=steps)
            .map(|step| hand.force_at_n(dented_m + normal * (SLIDE_STEP_M * f64::from(step))))
            .skip(run_up as usize)
            .collect();
        let means = force.iter().zip(force.iter().rev()).map(|(f, mirrored)| 0.5 * (f + mirrored));
        let (low, high) = means.fold((f64::MAX, 0.0f64), |(low, high), f| (low.min(f), high.max(f)));
        let jump = force.windows(2).map(|f| (f[1] - f[0]).abs()).fold(0.0, f64::max);
        ((high - low) / (high + low), 2.0 * jump / (high + low))
    }

    /// Stiffness that the continuum would have, N/m: full FEM on voxels of 2.5 and 1.25 mm, extrapolated. The
    /// edge's ends are sharper than a resolved edge shows, so that it comes near as `h^0.76` (by voxels of
    /// 2.5, 1.25 and 0.625 mm: at nu 0.3 5529, 5641, 5707 N/m, 5803 in the limit).
    pub fn reference_n_per_m(&self) -> f64 {
        let [coarse, fine] = [2.5e-3, 1.25e-3].map(|h| self.resolved_n_per_m(h));
        fine + (fine - coarse) / (2f64.powf(0.76) - 1.0)
    }

    /// Force over dent by full FEM on voxels of edge `h` under an edge that the mesh resolves, N/m.
    ///
    /// The edge is a strip of half-width b = 2.5 h whose springs stand at Chebyshev's points, where equal
    /// forces are the pressure `1 / sqrt(b^2 - x^2)` of a rigid flat edge; their compliance per length,
    /// `2 (1 - nu^2) / (pi E) ln(b / a)`, is what an edge of half-width a adds to one of half-width b.
    pub fn resolved_n_per_m(&self, h: f64) -> f64 {
        let params = StepParams { dt_s: 0.1, relative_tolerance: 1e-6, max_iterations: 2000 };
        let mut body = Body::new(&self.scene(h, 0), 0, params, &Workers::serial()).expect("a valid block");
        let orientation = self.orientation();
        let (forward, normal) = (orientation * -Vec3::y(), orientation * Vec3::z());
        let resolved = RESOLVED_VOXELS * h;
        let along = self.turn() * Vec3::x();
        let across = self.turn() * Vec3::z();
        let compliance =
            2.0 * (1.0 - self.poisson_ratio.powi(2)) / (PI * YOUNG_PA) * (resolved / self.half_width_m).ln();
        assert!(compliance > 0.0, "the reference's voxels are too coarse for this edge");
        let (from, to) = self.covered_m();
        let count = ((to - from) / (0.5 * h)).round() as usize;
        let share = (to - from) / count as f64;
        let mut springs = Vec::new();
        for i in 0..count {
            let middle = self.touch_m() + along * (from + (i as f64 + 0.5) * share);
            let mut spring = |across_m: f64, direction: Vec3, share: f64| {
                let at = middle + across * across_m;
                let inside = at - Vec3::y() * (0.5 * h);
                let Some(voxel) = body.state.grid.voxel_at(body.state.grid.cell_of(&inside)) else { return };
                let weights = ContactWeights::of(&body, &MaterialPoint { position_m: at, voxel }, 1.0);
                springs.push(Contact {
                    ends: ToolEnds { weights, ..ToolEnds::default() },
                    direction,
                    stiffness_n_per_m: share / compliance,
                    gap_predicted_m: DENT_M * direction.dot(&forward),
                    mode: Mode::Spring,
                    ..Contact::default()
                });
            };
            for j in 0..POINTS_ACROSS {
                let x = resolved * ((2 * j + 1) as f64 * PI / (2 * POINTS_ACROSS) as f64).cos();
                spring(x, forward, share / POINTS_ACROSS as f64);
            }
            // Without friction under the edge, but it does not slide.
            spring(0.0, normal, share);
        }
        let mut impulses = Vec::new();
        springs.iter().for_each(|contact| contact.add_impulses(params.dt_s, &mut impulses));
        body.reserve(springs.len());
        body.refresh_operator(&Workers::serial());
        body.set_springs(point_springs(springs.iter(), params.dt_s));
        body.assemble_right_side(&Workers::serial());
        let mut change = vec![[0.0; 3]; body.node_count()];
        body.solve_velocity_change(&Workers::serial(), &impulses, 0.0, &mut change);
        let mut force = Vec3::zeros();
        for spring in &mut springs {
            let change_m_per_s = spring.ends.weights.sum(&change);
            spring.take_solution(params.dt_s, &change_m_per_s);
            force += spring.direction * spring.force_n;
        }
        force.dot(&forward) / DENT_M
    }

    /// From where to where the edge stands over the block, along the edge from its middle, m.
    fn covered_m(&self) -> (f64, f64) {
        let along = self.turn() * Vec3::x();
        let middle = self.touch_m();
        let (mut from, mut to) = (-0.5 * self.width_m, 0.5 * self.width_m);
        for axis in [0, 2] {
            if along[axis].abs() > 1e-9 {
                let ends = [-0.5, 0.5].map(|side| (side * SIDE_M - middle[axis]) / along[axis]);
                from = from.max(ends[0].min(ends[1]));
                to = to.min(ends[0].max(ends[1]));
            }
        }
        (from, to)
    }
}

/// A blade held over the block.
struct Hand {
    world: World,
    orientation: Quat,
}

impl Hand {
    fn touching(press: &Press, h: f64, level: u8) -> Self {
        let world = world_beyond_limits(&press.scene(h, level));
        let mut hand = Self { world, orientation: press.orientation() };
        hand.force_at_n(press.touch_m() - hand.forward() * DENT_M);
        hand
    }

    fn forward(&self) -> Vec3 {
        self.orientation * -Vec3::y()
    }

    /// Moves the edge in one step; the force against its cutting direction, N.
    fn force_at_n(&mut self, position_m: Vec3) -> f64 {
        let motion = ToolMotion::move_to(Pose { position_m, orientation: self.orientation });
        let inputs = [ToolInput { tool: 0, motion }];
        let forward = self.forward();
        let output = self.world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
        -output.tools[0].wrench.force_n.dot(&forward)
    }
}
