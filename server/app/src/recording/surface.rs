//! Poses and surfaces by the schemas that viewers of MCAP files know.

use std::collections::BTreeSet;

use kerf_physics::Pose;
use kerf_physics::surface::delta::{BodyStructure, BoundQuad, BoundVertex, Keyframe};
use kerf_proto::foxglove;
use kerf_proto::foxglove::line_primitive::LineType;
use kerf_session::ViewState;
use prost_types::Timestamp;

/// What the scene frame is called.
const FRAME: &str = "scene";
const NS_PER_S: u64 = 1_000_000_000;
/// Of tissue, to the eye.
const TISSUE: foxglove::Color = foxglove::Color { r: 0.72, g: 0.30, b: 0.27, a: 1.0 };

/// Of where a cut comes through the skin.
const SEAM: foxglove::Color = foxglove::Color { r: 0.12, g: 0.01, b: 0.01, a: 1.0 };
/// How thick seams are drawn.
const SEAM_PX: f64 = 3.0;

fn timestamp(time_ns: u64) -> Option<Timestamp> {
    Some(Timestamp { seconds: (time_ns / NS_PER_S) as i64, nanos: (time_ns % NS_PER_S) as i32 })
}

/// A tool's pose.
pub fn pose_in_frame(time_ns: u64, pose: &Pose) -> foxglove::PoseInFrame {
    let (p, q) = (&pose.position_m, &pose.orientation);
    let pose = foxglove::Pose {
        position: Some(foxglove::Vector3 { x: p.x, y: p.y, z: p.z }),
        orientation: Some(foxglove::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }),
    };
    foxglove::PoseInFrame { timestamp: timestamp(time_ns), frame_id: FRAME.into(), pose: Some(pose) }
}

/// Every object's surface as it is now.
pub fn scene_update(
    time_ns: u64,
    objects: &[String],
    structure: &Keyframe,
    state: &ViewState,
) -> foxglove::SceneUpdate {
    let bodies = structure.bodies.iter().zip(&state.node_displacements_m);
    let entity = |(name, (body, displacements_m)): (&String, (&BodyStructure, &Vec<f32>))| foxglove::SceneEntity {
        timestamp: timestamp(time_ns),
        frame_id: FRAME.into(),
        id: name.clone(),
        lines: seams(body, displacements_m).into_iter().collect(),
        triangles: vec![triangles(body, displacements_m)],
    };
    foxglove::SceneUpdate { entities: objects.iter().zip(bodies).map(entity).collect() }
}

fn triangles(body: &BodyStructure, displacements_m: &[f32]) -> foxglove::TriangleListPrimitive {
    let point = |vertex: &BoundVertex| {
        let [x, y, z] = position_m(body, displacements_m, vertex);
        foxglove::Point3 { x, y, z }
    };
    let index = |id: u32| body.vertices.binary_search_by_key(&id, |vertex| vertex.id).unwrap_or_default() as u32;
    let halves = body.quads.iter().flat_map(|quad| {
        let [a, b, c, d] = quad.vertices.map(index);
        [a, b, c, a, c, d]
    });
    foxglove::TriangleListPrimitive {
        pose: None,
        points: body.vertices.iter().map(point).collect(),
        color: Some(TISSUE),
        indices: halves.collect(),
    }
}

/// Edges where skin and the walls of cuts meet, so that a cut is seen while it is closed; `None` where nothing is cut.
fn seams(body: &BodyStructure, displacements_m: &[f32]) -> Option<foxglove::LinePrimitive> {
    // The two sides of a link that was parted have quads whose ids differ in the lowest bit.
    let is_wall = |quad: &&BoundQuad| body.quads.binary_search_by_key(&(quad.id ^ 1), |other| other.id).is_ok();
    let edges = |quad: &BoundQuad| {
        let [a, b, c, d] = quad.vertices;
        [[a, b], [b, c], [c, d], [d, a]].map(|[from, to]| [from.min(to), from.max(to)])
    };
    let of_walls: BTreeSet<[u32; 2]> = body.quads.iter().filter(is_wall).flat_map(edges).collect();
    if of_walls.is_empty() {
        return None;
    }
    let skin = body.quads.iter().filter(|quad| !is_wall(quad));
    let of_both: BTreeSet<[u32; 2]> = skin.flat_map(edges).filter(|edge| of_walls.contains(edge)).collect();
    let point = |id: u32| {
        let found = body.vertices.binary_search_by_key(&id, |vertex| vertex.id).ok()?;
        let [x, y, z] = position_m(body, displacements_m, &body.vertices[found]);
        Some(foxglove::Point3 { x, y, z })
    };
    Some(foxglove::LinePrimitive {
        r#type: LineType::LineList.into(),
        pose: None,
        thickness: SEAM_PX,
        scale_invariant: true,
        points: of_both.into_iter().flatten().filter_map(point).collect(),
        color: Some(SEAM),
    })
}

/// Where a vertex is: trilinear in the corners of its element, its displacement by weights of its own beside what is held.
/// What is missing counts as nothing.
fn position_m(body: &BodyStructure, displacements_m: &[f32], vertex: &BoundVertex) -> [f64; 3] {
    let mut position_m = [0.0; 3];
    let Ok(element) = body.elements.binary_search_by_key(&vertex.element, |element| element.id) else {
        return position_m;
    };
    let held = body.held.binary_search_by_key(&vertex.id, |held| held.id).ok().map(|found| body.held[found].weights);
    for (corner, &id) in body.elements[element].nodes.iter().enumerate() {
        let along = |axis: usize| f64::from(vertex.local[axis]);
        let of_axis = |axis: usize| if corner >> axis & 1 == 1 { along(axis) } else { 1.0 - along(axis) };
        let weight: f64 = (0..3).map(of_axis).product();
        let moved_weight = held.map_or(weight, |weights| f64::from(weights[corner]));
        let Ok(node) = body.nodes.binary_search_by_key(&id, |node| node.id) else { continue };
        for axis in 0..3 {
            let moved_m = displacements_m.get(3 * id as usize + axis).copied().unwrap_or_default();
            position_m[axis] += weight * f64::from(body.nodes[node].rest_m[axis]) + moved_weight * f64::from(moved_m);
        }
    }
    position_m
}

#[cfg(test)]
mod tests {
    use kerf_physics::surface::delta::{LatticeElement, LatticeNode};

    use super::*;

    #[test]
    fn a_vertex_moves_with_the_corners_of_its_element() {
        let corner = |id: u32| [id & 1, id >> 1 & 1, id >> 2].map(|bit| bit as f32);
        let body = BodyStructure {
            nodes: (0..8).map(|id| LatticeNode { id, rest_m: corner(id) }).collect(),
            elements: vec![LatticeElement { id: 4, nodes: [0, 1, 2, 3, 4, 5, 6, 7] }],
            ..BodyStructure::default()
        };
        let vertex = BoundVertex { id: 0, element: 4, local: [0.5, 0.25, 1.0], material: 0 };
        assert_eq!(position_m(&body, &[0.0; 24], &vertex), [0.5, 0.25, 1.0]);
        // The upper four corners move up by a half: only they count at the top.
        let mut up = [0.0; 24];
        (4..8).for_each(|id| up[3 * id + 2] = 0.5);
        assert_eq!(position_m(&body, &up, &vertex), [0.5, 0.25, 1.5]);
    }

    #[test]
    fn the_seam_of_a_cut_is_where_skin_meets_a_wall() {
        let vertex = |id: u32| BoundVertex { id, element: 4, local: [id as f32 / 8.0, 0.0, 0.0], material: 0 };
        let quad = |id: u32, vertices: [u32; 4]| BoundQuad { id, vertices };
        let body = BodyStructure {
            nodes: (0..8).map(|id| LatticeNode { id, rest_m: [(id & 1) as f32, 0.0, 0.0] }).collect(),
            elements: vec![LatticeElement { id: 4, nodes: [0, 1, 2, 3, 4, 5, 6, 7] }],
            vertices: (0..8).map(vertex).collect(),
            // A skin, and beside it both walls of a link.
            quads: vec![quad(2, [0, 1, 2, 3]), quad(6, [2, 1, 4, 5]), quad(7, [5, 4, 6, 7])],
            ..BodyStructure::default()
        };
        let whole = BodyStructure { quads: vec![quad(2, [0, 1, 2, 3])], ..body.clone() };
        assert_eq!(seams(&whole, &[0.0; 24]), None);
        let points: Vec<f64> = seams(&body, &[0.0; 24]).unwrap().points.iter().map(|point| point.x).collect();
        assert_eq!(points, [0.125, 0.25]);
    }
}
