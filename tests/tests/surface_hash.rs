//! The surface hash of the core and the one that replicas compute from the wire are the same.

use kerf_physics::scene::{Scene, SceneDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::surface::delta::{BodyStructure, BoundQuad, BoundVertex, HeldVertex};
use kerf_physics::surface::hash::{ObjectHash, surface_hash};
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};
use kerf_proto::v1;
use kerf_replica::{Body, Replica, ReplicaError, Vertex};
use kerf_server::wire;

fn vertices() -> Vec<BoundVertex> {
    [
        (3, 0, [0.0, -0.0, 1.0], 0),
        (900, 1, [0.1, 0.25, 0.7], 1),
        (4_000_000_000, 1, [1.0, 0.5, 1e-30], 65535),
        (4_294_967_295, 0, [0.5; 3], 0),
    ]
    .map(|(id, element, local, material)| BoundVertex { id, element, local, material })
    .to_vec()
}

fn held() -> Vec<HeldVertex> {
    vec![
        HeldVertex { id: 900, weights: [0.1, 0.0, 0.7, 1e-30, 0.0, 0.025, 0.0, 0.25] },
        HeldVertex { id: 4_294_967_295, weights: [0.0; 8] },
    ]
}

fn quads() -> Vec<BoundQuad> {
    vec![
        BoundQuad { id: 1, vertices: [3, 900, 4_000_000_000, 4_294_967_295] },
        BoundQuad { id: 4_294_967_294, vertices: [4_294_967_295, 4_000_000_000, 900, 3] },
    ]
}

fn body_on_the_wire() -> v1::BodyStructure {
    v1::BodyStructure {
        node_count: 8,
        node_ids: (0..8).collect(),
        node_rest_m: vec![0.0; 24],
        element_ids: vec![0, 1],
        element_nodes: (0..8).chain(0..8).collect(),
        vertex_ids: vertices().iter().map(|vertex| vertex.id).collect(),
        vertex_elements: vertices().iter().map(|vertex| vertex.element).collect(),
        vertex_local: vertices().iter().flat_map(|vertex| vertex.local).collect(),
        vertex_materials: vertices().iter().map(|vertex| u32::from(vertex.material)).collect(),
        held_vertex_ids: held().iter().map(|vertex| vertex.id).collect(),
        held_vertex_weights: held().iter().flat_map(|vertex| vertex.weights).collect(),
        quad_ids: quads().iter().map(|quad| quad.id).collect(),
        quad_vertices: quads().iter().flat_map(|quad| quad.vertices).collect(),
        quantum_m: 1.0,
    }
}

#[test]
fn replica_and_core_compute_the_hash_that_the_specification_gives() {
    let mut object = ObjectHash::default();
    object.follow(&BodyStructure { vertices: vertices(), held: held(), quads: quads(), ..BodyStructure::default() });
    let hash = surface_hash([&object, &object].into_iter());
    // Computed from the words in view.proto by a program that shares no line with either.
    assert_eq!(hash, 0x316d_de23_ada7_5291);
    let bodies = vec![body_on_the_wire(); 2];
    let mut keyframe = v1::Keyframe { bodies, surface_hash: hash, ..v1::Keyframe::default() };
    assert_eq!(Replica::default().apply_keyframe(&keyframe), Ok(()));

    keyframe.surface_hash ^= 1;
    let refused = Replica::default().apply_keyframe(&keyframe);
    assert!(matches!(refused, Err(ReplicaError::HashMismatch { .. })));
}

/// Two blocks under a blade that reaches over both.
const TWO_BLOCKS: &str = r#"
version = 1
name = "two blocks"
rate_hz = 1000.0

[[objects]]
name = "left"
shape = { box = { min_m = [-0.032, 0.0, -0.015], max_m = [-0.002, 0.03, 0.015] } }
voxel_size_m = 0.005
level = 1
material = { young_modulus_pa = 20000.0, poisson_ratio = 0.4, fracture_energy_j_per_m2 = 20.0 }
fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 0.0051, 1.0] } }]

[[objects]]
name = "right"
shape = { box = { min_m = [0.002, 0.0, -0.015], max_m = [0.032, 0.03, 0.015] } }
voxel_size_m = 0.005
level = 1
material = { young_modulus_pa = 20000.0, poisson_ratio = 0.4, fracture_energy_j_per_m2 = 20.0 }
fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 0.0051, 1.0] } }]

[[tools]]
name = "blade"
shape = { blade = { width_m = 0.06, height_m = 0.06 } }
"#;

/// The hash of what a replica has, computed anew rather than from the patches.
pub fn recomputed(replica: &Replica) -> u64 {
    kerf_replica::surface_hash(&replica.bodies().iter().map(structure).collect::<Vec<_>>())
}

fn structure(body: &Body) -> v1::BodyStructure {
    let (vertices, held, quads) = (body.vertices(), body.held_weights(), body.quads());
    let mut structure = v1::BodyStructure {
        held_vertex_ids: held.keys().copied().collect(),
        held_vertex_weights: held.values().copied().flatten().collect(),
        quad_ids: quads.keys().copied().collect(),
        quad_vertices: quads.values().copied().flatten().collect(),
        ..Default::default()
    };
    for (id, vertex) in vertices {
        let Vertex::Bound { element, local, material } = *vertex else { continue };
        structure.vertex_ids.push(*id);
        structure.vertex_elements.push(element);
        structure.vertex_local.extend(local);
        structure.vertex_materials.push(material);
    }
    structure
}

/// A stroke down through the blocks, numbered so that each goes another way; `after` sees the world
/// after every step.
fn stroke(world: &mut World, number: usize, mut after: impl FnMut(&mut World)) {
    let turn = |axis: f64| (number as f64 * axis).sin();
    let orientation = Quat::from_euler_angles(0.3 * turn(1.3), 0.7 * turn(2.1), 0.15 * turn(0.7));
    for step in 0..60 {
        let position_m = Vec3::new(0.01 * turn(1.9), 0.033 - 5e-4 * f64::from(step), 0.01 * turn(2.7));
        let pose = Pose { position_m, orientation };
        let motion = if step == 0 { ToolMotion::enter_at(pose) } else { ToolMotion::move_to(pose) };
        world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[ToolInput { tool: 0, motion }]));
        after(world);
    }
}

#[test]
fn a_replica_that_follows_cuts_has_the_hash_of_the_surface_as_it_is() {
    let desc = SceneDesc::from_toml("two_blocks.toml", TWO_BLOCKS).expect("a sound scene");
    let mut world = World::new(&Scene { desc, meshes: Default::default() }.judge().unwrap()).expect("a valid scene");
    let mut replica = Replica::default();
    replica.apply_keyframe(&wire::keyframe(&world.keyframe(), &[1.0; 2])).expect("the first keyframe applies");
    let mut patches = 0;
    for number in 1..6 {
        stroke(&mut world, number, |world| {
            let Some(patch) = world.topology_patch() else { return };
            let hash = patch.surface_hash;
            // Compares the hash that the replica's follows the patch with to the server's.
            replica.apply_patch(&wire::patch(patch)).expect("the patch applies");
            assert_eq!(recomputed(&replica), hash);
            // Neither side has lost anything on the way to here.
            let mut afresh = Replica::default();
            afresh.apply_keyframe(&wire::keyframe(&world.keyframe(), &[1.0; 2])).expect("a keyframe applies");
            assert_eq!(afresh.bodies(), replica.bodies());
            patches += 1;
        });
    }
    assert!(patches > 20, "{patches} patches");
}
