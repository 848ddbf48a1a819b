//! Surfaces as plain vertices: for clients that cannot skin, and the same surface.

use kerf_proto::v1::{self, view_response};
use kerf_replica::{Body, Replica};
use tonic::Code;

use super::cut::{ABOVE_M, FOOT_M, MIDDLE_M, Stroke, Watcher};
use super::harness::{Harness, next, no_expiry, view_request};

fn request(session: &str) -> v1::ViewRequest {
    v1::ViewRequest { encoding: v1::SurfaceEncoding::Vertices.into(), ..view_request(session) }
}

/// Corners of each quad, m. A link has the same number for everybody, its corners need not.
fn corners(body: &Body) -> impl Iterator<Item = (u32, [[f32; 3]; 4])> {
    let of = |id: u32| body.position_m(id, &body.vertices()[&id]);
    body.quads().iter().map(move |(quad, corners)| (*quad, corners.map(of)))
}

fn check_alike(plain: &Replica, lattice: &Replica, bound_m: f32) {
    assert_eq!(plain.moment().map(|moment| moment.step), lattice.moment().map(|moment| moment.step));
    for (plain, lattice) in plain.bodies().iter().zip(lattice.bodies()) {
        assert_eq!(plain.vertices().len(), lattice.vertices().len());
        assert_eq!(plain.quads().len(), lattice.quads().len());
        for ((plain_quad, plain_m), (quad, lattice_m)) in corners(plain).zip(corners(lattice)) {
            assert_eq!(plain_quad, quad);
            for (plain_m, lattice_m) in plain_m.as_flattened().iter().zip(lattice_m.as_flattened()) {
                assert!((plain_m - lattice_m).abs() < bound_m, "quad {quad}: {plain_m} and {lattice_m}");
            }
        }
    }
}

#[tokio::test]
async fn plain_vertices_show_the_surface_of_the_lattice_through_a_cut_whenever_one_joined() {
    let mut harness = Harness::with(no_expiry).await;
    let session = harness.create().await.unwrap();
    let voxel_m = harness.server.registry().get(&session).unwrap().object_stats()[0].voxel_size_m as f32;
    let channel = || harness.channel.clone();
    let mut lattice = Watcher::join(&harness, channel(), &session).await;
    let mut early = Watcher::join_as(&harness, channel(), request(&session)).await;
    let mut stroke = Stroke::begin(&harness, &session).await;
    early.during(lattice.during(stroke.press(ABOVE_M, MIDDLE_M))).await;
    let mut late = Watcher::join_as(&harness, channel(), request(&session)).await;
    // It reads nothing of the second half before that is over.
    let mut slow = Watcher::join_as(&harness, channel(), request(&session)).await;
    late.during(early.during(lattice.during(stroke.press(MIDDLE_M, FOOT_M)))).await;
    harness.pause(&session).await;
    let described = harness.describe(&session).await;
    let is_last = |replica: &Replica| {
        replica.topology_version() == Some(described.topology_version)
            && replica.moment().is_some_and(|moment| moment.step == described.step)
    };
    for watcher in [&mut lattice, &mut early, &mut late, &mut slow] {
        watcher.until(is_last).await;
    }
    assert!(lattice.replica.bodies().iter().any(|body| !body.adapted_offsets_m().is_empty()), "beside a blade");
    // Both are off by the default bound, twice where they are adapted.
    for plain in [&early, &late, &slow] {
        check_alike(&plain.replica, &lattice.replica, 3.0 / 128.0 * voxel_m);
    }

    // Everything starts over.
    drop(stroke);
    harness.reset(&session).await;
    let is_at_rest = |replica: &Replica| replica.topology_version() == Some(0) && replica.moment().is_some();
    for watcher in [&mut lattice, &mut early] {
        watcher.until(is_at_rest).await;
    }
    check_alike(&early.replica, &lattice.replica, 3.0 / 128.0 * voxel_m);
}

/// As docs/reference/protocol.md says.
fn normal([x, y]: [u8; 2]) -> [f32; 3] {
    let coordinate = |byte: u8| f32::from(byte as i8) / 127.0;
    let (x, y) = (coordinate(x), coordinate(y));
    let z = 1.0 - x.abs() - y.abs();
    let sign = |value: f32| if value < 0.0 { -1.0 } else { 1.0 };
    let [x, y] = if z < 0.0 { [(1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)] } else { [x, y] };
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

#[tokio::test]
async fn normals_come_to_who_asks_for_them_and_point_outwards() {
    let mut harness = Harness::with(no_expiry).await;
    let session = harness.create().await.unwrap();
    let with_normals = v1::ViewRequest { wants_normals: true, ..request(&session) };
    let mut view = harness.view_as(harness.channel.clone(), with_normals.clone()).await.unwrap();
    let mut replica = Replica::default();
    let normals = loop {
        let message = next(&mut view).await;
        replica.apply(&message).unwrap();
        if let view_response::Message::State(state) = message {
            break state.bodies[0].normals.clone();
        }
    };
    let body = &replica.bodies()[0];
    assert_eq!(normals.len(), 2 * body.node_slots());
    let positions_m: Vec<[f32; 3]> = body.vertices().iter().map(|(id, vertex)| body.position_m(*id, vertex)).collect();
    let middle_m = [0, 1, 2].map(|axis| positions_m.iter().map(|at| at[axis]).sum::<f32>() / positions_m.len() as f32);
    // Of a block: the largest distance from the middle is along the normal, but at edges, where two or three are.
    let reach_m =
        [0, 1, 2].map(|axis| positions_m.iter().map(|at| (at[axis] - middle_m[axis]).abs()).fold(0.0, f32::max));
    for (at_m, bytes) in positions_m.iter().zip(normals.as_chunks::<2>().0) {
        let faces = [0, 1, 2].map(|axis| (at_m[axis] - middle_m[axis]) / reach_m[axis]);
        let on: Vec<usize> = (0..3).filter(|axis| faces[*axis].abs() > 0.99).collect();
        let normal = normal(*bytes);
        for axis in &on {
            let expected = faces[*axis].signum() / (on.len() as f32).sqrt();
            assert!((normal[*axis] - expected).abs() < 0.4, "{normal:?} at {at_m:?}");
        }
        if let [axis] = on[..] {
            assert!(normal[axis] * faces[axis] > 0.98, "{normal:?} at {at_m:?}");
        }
    }

    let of_lattice = v1::ViewRequest { wants_normals: true, ..view_request(&session) };
    let unknown = v1::ViewRequest { encoding: 77, ..view_request(&session) };
    for (refused, field) in [(of_lattice, "wants_normals"), (unknown, "encoding")] {
        let error = harness.view_as(harness.channel.clone(), refused).await.err().expect("a refusal");
        assert_eq!(error.code(), Code::InvalidArgument);
        assert!(error.message().starts_with(field), "{}", error.message());
    }
}
