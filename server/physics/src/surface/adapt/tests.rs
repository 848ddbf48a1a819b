//! What the adaptation looks at.

use super::{Adaptation, Dent};
use crate::body::Body;
use crate::likeness::{Likeness, Placed, Placement};
use crate::params::StepParams;
use crate::scene::{BladeDesc, MaterialDesc, ObjectDesc, Scene, SceneDesc, ShapeDesc};
use crate::surface::Surface;
use crate::surface::delta::{BodyStructure, BoundQuad, BoundVertex};
use crate::tool::Pose;
use crate::tool::blade::Blade;
use crate::{Vec3, Workers};

const VOXEL_M: f64 = 0.0025;
const TOP_M: f64 = 0.02;

/// A block of this length and width, 20 mm high.
fn block(side_m: f64) -> Body {
    let material = MaterialDesc {
        young_modulus_pa: 1e6,
        poisson_ratio: 0.45,
        density_kg_per_m3: 1000.0,
        rayleigh_alpha_per_s: 0.0,
        rayleigh_beta_s: 0.0,
        fracture_energy_j_per_m2: Some(500.0),
        initiation_ratio: 2.0,
        strain_stiffening: 0.0,
        viscosity: None,
        prestrain: None,
        rate: None,
        friction_coefficient: 0.0,
        color: None,
    };
    let half = 0.5 * side_m;
    let object = ObjectDesc {
        name: "block".into(),
        shape: ShapeDesc::Box { min_m: [-half, 0.0, -half], max_m: [half, TOP_M, half] },
        voxel_size_m: Some(VOXEL_M),
        resolution: None,
        level: 2,
        element: Default::default(),
        fracture_rule: Default::default(),
        material,
        regions: Vec::new(),
        finer: Vec::new(),
        min_elements_across: None,
        fixed: Vec::new(),
        loads: Vec::new(),
    };
    let scene = Scene { desc: SceneDesc::of("test", vec![object]), meshes: Default::default() };
    let params = StepParams { dt_s: 1e-3, relative_tolerance: 1e-3, max_iterations: 100 };
    Body::new(&scene, 0, params, &Workers::serial()).expect("a valid object")
}

/// The surface as a keyframe names it; the coordinates in the elements are not asked for.
fn whole(body: &Likeness, surface: &Surface) -> BodyStructure {
    let bind = |(id, vertex): (u32, &crate::surface::SurfaceVertex)| BoundVertex {
        id,
        element: body.element_of(vertex.voxel) as u32,
        local: [0.0; 3],
        material: 0,
    };
    BodyStructure {
        vertices: surface.vertices().map(bind).collect(),
        quads: surface.quads().map(|(id, quad)| BoundQuad { id, vertices: *quad }).collect(),
        ..BodyStructure::default()
    }
}

/// A blade whose edge stands `depth_m` below the top of the block.
fn dent(depth_m: f64) -> Dent {
    let mut dent = Dent { depth_m, ..Dent::default() };
    let blade = Blade::new(&BladeDesc::straight(0.02, 0.05)).unwrap();
    let position_m = Vec3::new(0.0, TOP_M - depth_m, 0.0004);
    dent.blade.place(&blade, &Pose { position_m, ..Pose::default() });
    dent
}

/// Adapts a block; vertices of its surface, those looked at, those moved.
fn adapted(side_m: f64, depth_m: f64) -> [usize; 3] {
    let body = block(side_m);
    let (likeness, mut at) = (Likeness::of(&body), Placement::default());
    at.write(&body);
    let surface = Surface::build(likeness.grid());
    let mut adaptation = Adaptation::default();
    adaptation.follow(&surface, &whole(&likeness, &surface));
    adaptation.adapt(Placed { likeness: &likeness, at: &at }, &[dent(depth_m)]);
    [surface.vertices().len(), adaptation.store.seen(), adaptation.offsets().len()]
}

#[test]
fn what_is_looked_at_depends_on_the_blade_not_on_the_body() {
    let [vertices, looked_at, moved] = adapted(0.08, 0.002);
    let [more_vertices, same, as_many] = adapted(0.24, 0.002);
    println!("{looked_at} of {vertices} and {same} of {more_vertices} looked at, {moved} moved");
    assert!(more_vertices > 6 * vertices);
    assert_eq!((same, as_many), (looked_at, moved));
    assert!(looked_at < 4 * moved, "{looked_at} for {moved}");
}

#[test]
fn a_blade_that_touches_nothing_moves_nothing() {
    assert_eq!(adapted(0.08, -0.001)[2], 0);
}
