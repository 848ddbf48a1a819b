//! A replica fed with messages made by hand: one element, one quad, and what can go wrong.

use kerf_proto::{integers, v1};
use kerf_replica::{Face, Problem, Replica, ReplicaError, surface_hash};

const CORNERS: u32 = 8;
/// Every length below is a multiple of it.
const QUANTUM_M: f64 = 1.0 / 64.0;

fn quanta(lengths_m: &[f32]) -> Vec<u8> {
    integers::encode(lengths_m.iter().map(|length_m| (f64::from(*length_m) / QUANTUM_M) as i64))
}

/// The unit cube as one element, with the quad of its top face.
fn cube() -> v1::BodyStructure {
    v1::BodyStructure {
        node_count: CORNERS,
        node_ids: (0..CORNERS).collect(),
        node_rest_m: (0..CORNERS).flat_map(|c| [c & 1, c >> 1 & 1, c >> 2].map(|bit| bit as f32)).collect(),
        element_ids: vec![5],
        element_nodes: (0..CORNERS).collect(),
        vertex_ids: vec![10, 20, 30, 40],
        vertex_elements: vec![5; 4],
        vertex_local: vec![0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0],
        quad_ids: vec![7],
        quad_vertices: vec![10, 20, 30, 40],
        quantum_m: QUANTUM_M,
        ..Default::default()
    }
}

fn keyframe(body: v1::BodyStructure) -> v1::Keyframe {
    let bodies = vec![body];
    v1::Keyframe { topology_version: 3, surface_hash: surface_hash(&bodies), bodies, ..Default::default() }
}

fn state(topology_version: u64, node_displacements_m: Vec<f32>) -> v1::State {
    v1::State {
        topology_version,
        step: 42,
        sim_time_s: 0.042,
        bodies: vec![v1::BodyState { displacements: quanta(&node_displacements_m).into(), ..Default::default() }],
        has_reference: true,
        ..Default::default()
    }
}

fn cube_replica() -> Replica {
    let mut replica = Replica::default();
    replica.apply_keyframe(&keyframe(cube())).expect("the cube is valid");
    replica
}

/// Moves vertex 40 onto a second element, joins the quad to other vertices, adds another quad.
fn patch() -> v1::TopologyPatch {
    let change = v1::BodyStructure {
        node_count: CORNERS + 1,
        node_ids: vec![8],
        node_rest_m: vec![2.0, 1.0, 0.0],
        element_ids: vec![6],
        element_nodes: vec![0, 8, 2, 3, 4, 5, 6, 7],
        vertex_ids: vec![40],
        vertex_elements: vec![6],
        vertex_local: vec![1.0, 0.0, 0.0],
        quad_ids: vec![7, 8],
        quad_vertices: vec![10, 30, 40, 10, 20, 30, 40, 20],
        ..Default::default()
    };
    let after = v1::BodyStructure {
        vertex_ids: vec![10, 20, 30, 40],
        vertex_elements: vec![5, 5, 5, 6],
        vertex_local: vec![0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0],
        quad_ids: vec![7, 8],
        quad_vertices: vec![10, 30, 40, 10, 20, 30, 40, 20],
        ..Default::default()
    };
    v1::TopologyPatch { from_version: 3, to_version: 5, bodies: vec![change], surface_hash: surface_hash(&[after]) }
}

fn problem_of(body: v1::BodyStructure) -> (&'static str, Problem) {
    match Replica::default().apply_keyframe(&keyframe_unhashed(body)) {
        Err(ReplicaError::Field { source, .. }) => (source.field, source.problem),
        other => panic!("expected a field error, got {other:?}"),
    }
}

fn keyframe_unhashed(body: v1::BodyStructure) -> v1::Keyframe {
    v1::Keyframe { topology_version: 3, bodies: vec![body], ..Default::default() }
}

#[test]
fn surface_follows_the_nodes() {
    let mut replica = cube_replica();
    assert_eq!(replica.surfaces(), None, "no state yet");
    let mut displacements_m = vec![0.0; 24];
    // Node 7 is the corner (1, 1, 1), where vertex 30 sits.
    displacements_m[21..24].copy_from_slice(&[0.5, 0.25, -0.5]);
    replica.apply_state(&state(3, displacements_m)).expect("matching state");
    let surface = &replica.surfaces().expect("state came")[0];
    assert_eq!(surface.positions_m, [[0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.5, 1.25, 0.5], [1.0, 1.0, 0.0]]);
    let triangles: Vec<_> = surface.triangles.iter().map(|triangle| triangle.vertices).collect();
    assert_eq!(triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(replica.moment().map(|moment| moment.step), Some(42));
}

#[test]
fn quads_on_both_sides_of_a_link_are_cut_faces() {
    let body = v1::BodyStructure {
        quad_ids: vec![2, 6, 7],
        quad_vertices: vec![10, 20, 30, 40, 10, 20, 30, 40, 40, 30, 20, 10],
        ..cube()
    };
    let mut replica = Replica::default();
    replica.apply_keyframe(&keyframe(body)).expect("valid");
    replica.apply_state(&state(3, vec![0.0; 24])).expect("matching state");
    let surface = &replica.surfaces().expect("state came")[0];
    let faces: Vec<_> = surface.triangles.iter().map(|triangle| triangle.face).collect();
    assert_eq!(faces, [Face::Skin, Face::Skin, Face::Cut, Face::Cut, Face::Cut, Face::Cut]);
}

#[test]
fn quads_are_split_along_the_diagonal_from_their_first_vertex() {
    let mut replica = Replica::default();
    replica
        .apply_keyframe(&keyframe(v1::BodyStructure { quad_vertices: vec![20, 30, 40, 10], ..cube() }))
        .expect("valid");
    replica.apply_state(&state(3, vec![0.0; 24])).expect("matching state");
    let surface = &replica.surfaces().expect("state came")[0];
    let triangles: Vec<_> = surface.triangles.iter().map(|triangle| triangle.vertices).collect();
    assert_eq!(triangles, [[1, 2, 3], [1, 3, 0]]);
}

#[test]
fn interior_point_is_trilinear() {
    let mut body = cube();
    body.vertex_local[0..3].copy_from_slice(&[0.5, 0.25, 0.75]);
    let mut replica = Replica::default();
    replica.apply_keyframe(&keyframe(body)).expect("valid");
    let mut displacements_m = vec![0.0; 24];
    displacements_m[21] = 1.0;
    replica.apply_state(&state(3, displacements_m)).expect("matching state");
    let position_m = replica.surfaces().expect("state came")[0].positions_m[0];
    assert_eq!(position_m, [0.5 + 0.5 * 0.25 * 0.75, 0.25, 0.75]);
}

#[test]
fn patch_adds_and_changes() {
    let mut replica = cube_replica();
    replica.apply_patch(&patch()).expect("valid patch");
    assert_eq!(replica.topology_version(), Some(5));
    let body = &replica.bodies()[0];
    assert_eq!(body.vertices().keys().copied().collect::<Vec<_>>(), [10, 20, 30, 40]);
    assert_eq!(body.quads().values().copied().collect::<Vec<_>>(), [[10, 30, 40, 10], [20, 30, 40, 20]]);
    assert_eq!(body.vertices()[&40].binding().unwrap().0, 6);
    assert_eq!(replica.moment(), None, "displacements of the new node are not known");
    replica.apply_state(&state(5, vec![0.0; 27])).expect("matching state");
    assert_eq!(replica.surfaces().expect("state came")[0].positions_m[3], [2.0, 1.0, 0.0]);
}

#[test]
fn patch_of_another_version_is_refused_and_changes_nothing() {
    let mut replica = cube_replica();
    let error = replica.apply_patch(&v1::TopologyPatch { from_version: 4, ..patch() }).expect_err("gap");
    assert_eq!(error, ReplicaError::PatchOfOtherVersion { have: 3, from: 4, to: 5 });
    assert!(error.needs_keyframe());
    replica.apply_patch(&patch()).expect("the right one still applies");
}

#[test]
fn patch_that_leads_back_is_refused() {
    let error = cube_replica().apply_patch(&v1::TopologyPatch { to_version: 3, ..patch() });
    assert_eq!(error, Err(ReplicaError::PatchOfOtherVersion { have: 3, from: 3, to: 3 }));
}

#[test]
fn state_of_another_version_is_refused() {
    let mut replica = cube_replica();
    let old = replica.apply_state(&state(2, vec![0.0; 24])).expect_err("older");
    assert_eq!(old, ReplicaError::StateOfOtherVersion { have: 3, got: 2 });
    assert!(!old.needs_keyframe(), "a late state costs nothing but itself");
    let new = replica.apply_state(&state(4, vec![0.0; 24])).expect_err("newer");
    assert!(new.needs_keyframe(), "a patch was missed");
}

#[test]
fn nothing_applies_before_a_keyframe() {
    let mut replica = Replica::default();
    assert_eq!(replica.apply_patch(&patch()), Err(ReplicaError::NoKeyframe));
    assert_eq!(replica.apply_state(&state(3, vec![])), Err(ReplicaError::NoKeyframe));
}

#[test]
fn wrong_hash_of_a_keyframe_keeps_the_old_structure() {
    let mut replica = cube_replica();
    let wrong = v1::Keyframe { topology_version: 9, surface_hash: 1, ..keyframe(cube()) };
    let error = replica.apply_keyframe(&wrong).expect_err("hash");
    assert!(matches!(error, ReplicaError::HashMismatch { topology_version: 9, expected: 1, .. }));
    assert_eq!(replica.topology_version(), Some(3));
}

#[test]
fn wrong_hash_of_a_patch_drops_the_structure_until_a_keyframe() {
    let mut replica = cube_replica();
    let error = replica.apply_patch(&v1::TopologyPatch { surface_hash: 1, ..patch() }).expect_err("hash");
    assert!(error.needs_keyframe());
    assert_eq!(replica.topology_version(), None);
    assert_eq!(replica.apply_state(&state(5, vec![0.0; 27])), Err(ReplicaError::NoKeyframe));
    replica.apply_keyframe(&keyframe(cube())).expect("recovers");
}

#[test]
fn truncated_arrays_name_the_field() {
    let mut body = cube();
    body.vertex_local.pop();
    assert_eq!(problem_of(body), ("vertex_local", Problem::Length { expected: 12, got: 11 }));
    let mut body = cube();
    body.element_nodes.pop();
    assert_eq!(problem_of(body), ("element_nodes", Problem::Length { expected: 8, got: 7 }));
    let mut body = cube();
    body.vertex_elements.pop();
    assert_eq!(problem_of(body), ("vertex_elements", Problem::Length { expected: 4, got: 3 }));

    let error = cube_replica().apply_state(&state(3, vec![0.0; 23])).expect_err("short");
    assert_eq!(error.to_string(), "state.bodies[0].displacements: 23 entries, 24 expected");
}

#[test]
fn references_to_nothing_are_refused() {
    let body = v1::BodyStructure { node_count: 7, ..cube() };
    assert_eq!(problem_of(body), ("node_ids", Problem::UnknownId { id: 7 }));
    let body = v1::BodyStructure { element_nodes: vec![0, 1, 2, 3, 4, 5, 6, 99], ..cube() };
    assert_eq!(problem_of(body), ("element_nodes", Problem::UnknownId { id: 99 }));
    let body = v1::BodyStructure { vertex_elements: vec![5, 5, 5, 6], ..cube() };
    assert_eq!(problem_of(body), ("vertex_elements", Problem::UnknownId { id: 6 }));
    let body = v1::BodyStructure { quad_vertices: vec![10, 20, 30, 41], ..cube() };
    assert_eq!(problem_of(body), ("quad_vertices", Problem::UnknownId { id: 41 }));
}

#[test]
fn odd_numbers_are_refused() {
    let mut body = cube();
    body.node_rest_m[4] = f32::NAN;
    assert_eq!(problem_of(body), ("node_rest_m", Problem::NotFinite { index: 4 }));
    let body = v1::BodyStructure { vertex_ids: vec![10, 30, 30, 40], ..cube() };
    assert_eq!(problem_of(body), ("vertex_ids", Problem::NotAscending { index: 2, id: 30 }));
    let (field, problem) = problem_of(v1::BodyStructure { node_count: u32::MAX, ..cube() });
    assert_eq!(field, "node_count");
    assert!(matches!(problem, Problem::Range { got: u32::MAX, .. }));
    let body = v1::BodyStructure { quantum_m: 0.0, ..cube() };
    assert_eq!(problem_of(body), ("quantum_m", Problem::NotPositive { got: 0.0 }));
    let mut cut_off = state(3, vec![1.0; 24]);
    cut_off.bodies[0].displacements.truncate(47);
    let error = cube_replica().apply_state(&cut_off).expect_err("an integer that is not whole");
    assert_eq!(error.to_string(), "state.bodies[0].displacements: no integers as the protocol writes them");
}

/// `steps` are the ids, each less the one before.
fn adapted(steps: &[i64], offsets_m: &[f32]) -> v1::State {
    let mut state = state(3, vec![0.0; 24]);
    state.bodies[0].adapted_ids = integers::encode(steps.iter().copied()).into();
    state.bodies[0].adapted_offsets = quanta(offsets_m).into();
    state
}

#[test]
fn a_state_is_differences_to_the_reference_that_came_last() {
    let mut replica = cube_replica();
    let at = |replica: &Replica| replica.surfaces().expect("state came")[0].positions_m[0];
    let mut first = state(3, vec![0.25; 24]);
    first.reference_step = 40;
    first.bodies[0].reference = quanta(&[1.0; 24]).into();
    replica.apply_state(&first).expect("it brings its reference");
    assert_eq!(at(&replica), [1.25, 2.25, 1.25]);

    let second = v1::State { reference_step: 40, has_reference: false, ..state(3, vec![-0.5; 24]) };
    replica.apply_state(&second).expect("the reference came before");
    assert_eq!(at(&replica), [0.5, 1.5, 0.5]);

    let other = v1::State { reference_step: 41, ..second };
    let error = replica.apply_state(&other).expect_err("another reference");
    assert_eq!(error, ReplicaError::NoReference { got: 41 });
    assert!(error.needs_keyframe());

    // A slot that is newer than the reference has none.
    replica.apply_patch(&patch()).expect("valid patch");
    let third = v1::State { topology_version: 5, reference_step: 40, has_reference: false, ..state(5, vec![0.0; 27]) };
    replica.apply_state(&third).expect("the reference outlives a patch");
    let positions_m = &replica.surfaces().expect("state came")[0].positions_m;
    assert_eq!((positions_m[0], positions_m[3]), ([1.0, 2.0, 1.0], [2.0, 1.0, 0.0]));

    replica.apply_keyframe(&keyframe(cube())).expect("valid");
    let after = v1::State { reference_step: 40, has_reference: false, ..state(3, vec![0.0; 24]) };
    assert_eq!(replica.apply_state(&after), Err(ReplicaError::NoReference { got: 40 }));
}

#[test]
fn adapted_vertices_are_shown_off_their_elements_until_the_next_state() {
    let mut replica = cube_replica();
    let state = adapted(&[20, 20], &[0.0, -0.25, 0.0, 0.5, 0.0, 0.0]);
    replica.apply_state(&state).expect("matching state");
    let positions_m = replica.surfaces().expect("state came")[0].positions_m.clone();
    assert_eq!(positions_m, [[0.0, 1.0, 0.0], [0.0, 0.75, 1.0], [1.0, 1.0, 1.0], [1.5, 1.0, 0.0]]);
    replica.apply_state(&adapted(&[], &[])).expect("matching state");
    assert_eq!(replica.surfaces().expect("state came")[0].positions_m[1], [0.0, 1.0, 1.0]);
}

#[test]
fn adapted_vertices_that_make_no_sense_are_refused_and_change_nothing() {
    let mut replica = cube_replica();
    replica.apply_state(&adapted(&[20], &[0.0, -0.25, 0.0])).expect("matching state");
    let cases = [
        (adapted(&[20], &[0.25; 2]), "adapted_offsets: 2 entries, 3 expected"),
        (adapted(&[20, 0], &[0.25; 6]), "adapted_ids: entry 1, id 20, is not above the one before it"),
        (adapted(&[21], &[0.25; 3]), "adapted_ids: id 21 does not exist"),
    ];
    for (state, problem) in cases {
        let error = replica.apply_state(&state).expect_err(problem);
        assert_eq!(error.to_string(), format!("state.bodies[0].{problem}"));
        assert!(!error.needs_keyframe());
    }
    assert_eq!(replica.surfaces().expect("state came")[0].positions_m[1], [0.0, 0.75, 1.0]);
}

#[test]
fn number_of_bodies_does_not_change() {
    let mut wrong = state(3, vec![0.0; 24]);
    wrong.bodies.clear();
    let error = cube_replica().apply_state(&wrong);
    assert_eq!(error, Err(ReplicaError::BodyCount { message: "state", expected: 1, got: 0 }));
}

#[test]
fn a_vertex_beside_what_is_held_moves_by_its_own_weights_until_it_comes_anew() {
    let mut half = [0.0; 8];
    half[2] = 0.5;
    let body = v1::BodyStructure { held_vertex_ids: vec![10], held_vertex_weights: half.to_vec(), ..cube() };
    let mut replica = Replica::default();
    replica.apply_keyframe(&keyframe(body)).expect("a valid structure");
    let moved: Vec<f32> = (0..CORNERS).flat_map(|_| [0.25, 0.0, 0.0]).collect();
    let at = |replica: &Replica| {
        let body = &replica.bodies()[0];
        [10, 20].map(|id| body.position_m(id, &body.vertices()[&id]))
    };
    replica.apply_state(&state(3, moved.clone())).expect("a valid state");
    assert_eq!(at(&replica), [[0.125, 1.0, 0.0], [0.25, 1.0, 1.0]]);

    let anew = v1::BodyStructure {
        node_count: CORNERS,
        vertex_ids: vec![10],
        vertex_elements: vec![5],
        vertex_local: vec![0.0, 1.0, 0.0],
        ..Default::default()
    };
    let patch =
        v1::TopologyPatch { from_version: 3, to_version: 4, surface_hash: surface_hash(&[cube()]), bodies: vec![anew] };
    replica.apply_patch(&patch).expect("a valid patch");
    replica.apply_state(&state(4, moved)).expect("a valid state");
    assert_eq!(at(&replica), [[0.25, 1.0, 0.0], [0.25, 1.0, 1.0]]);
}

#[test]
fn the_surface_hash_is_that_of_the_protocol_s_example() {
    // docs/reference/protocol.md, worked out there by another program.
    let example = v1::BodyStructure {
        vertex_materials: vec![0, 0, 1, 0],
        held_vertex_ids: vec![10],
        held_vertex_weights: vec![0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0],
        ..cube()
    };
    assert_eq!(surface_hash(std::slice::from_ref(&example)), 0x15b3_fba2_a05d_c854);
    // A replica follows its changes to the same.
    let keyframe = v1::Keyframe { bodies: vec![example], surface_hash: 0x15b3_fba2_a05d_c854, ..keyframe(cube()) };
    Replica::default().apply_keyframe(&keyframe).expect("the example's hash");
}

#[test]
fn another_weight_or_material_is_another_surface() {
    let mut weights = [0.0; 8];
    weights[2] = 0.5;
    let body = v1::BodyStructure {
        vertex_materials: vec![1; 4],
        held_vertex_ids: vec![10],
        held_vertex_weights: weights.to_vec(),
        ..cube()
    };
    let stated = keyframe(body.clone());
    for wrong in [
        v1::BodyStructure { vertex_materials: Vec::new(), ..body.clone() },
        v1::BodyStructure { held_vertex_weights: vec![0.25; 8], ..body.clone() },
        v1::BodyStructure { held_vertex_ids: Vec::new(), held_vertex_weights: Vec::new(), ..body },
    ] {
        let refused = Replica::default().apply_keyframe(&v1::Keyframe { bodies: vec![wrong], ..stated.clone() });
        assert!(matches!(refused, Err(ReplicaError::HashMismatch { .. })), "{refused:?}");
    }
}

#[test]
fn plain_vertices_are_nodes_themselves() {
    let body = v1::BodyStructure {
        node_count: 4,
        node_ids: vec![0, 1, 2, 3],
        node_rest_m: vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0],
        quad_ids: vec![4],
        quad_vertices: vec![0, 1, 2, 3],
        quantum_m: QUANTUM_M,
        ..Default::default()
    };
    let mut replica = Replica::default();
    let encoding = v1::SurfaceEncoding::Vertices.into();
    replica.apply_keyframe(&v1::Keyframe { encoding, ..keyframe_unhashed(body) }).unwrap();
    let mut moved_m = vec![0.0; 12];
    moved_m[4] = 0.25;
    replica.apply_state(&state(3, moved_m)).unwrap();
    assert_eq!(replica.surfaces().unwrap()[0].positions_m[1], [1.0, 0.25, 0.0]);

    let another = v1::BodyStructure {
        node_count: 5,
        node_ids: vec![4],
        node_rest_m: vec![2.0, 0.0, 0.0],
        quad_ids: vec![5],
        quad_vertices: vec![1, 4, 2, 3],
        ..Default::default()
    };
    let patch = v1::TopologyPatch { from_version: 3, to_version: 4, bodies: vec![another], surface_hash: 0 };
    replica.apply_patch(&patch).unwrap();
    replica.apply_state(&state(4, vec![0.0; 15])).unwrap();
    let surface = &replica.surfaces().unwrap()[0];
    assert_eq!(surface.positions_m[4], [2.0, 0.0, 0.0]);
    assert!(surface.triangles.iter().all(|triangle| triangle.face == Face::Cut));
}
