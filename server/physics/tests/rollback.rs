//! What a step has lost goes back, piece by piece.

use super::support::{body, object, params};
use kerf_physics::fault::FaultKind;
use kerf_physics::{Body, Crossing, LinkId, Workers};

/// A bar along x, cut through its middle: E 1 MPa and 16 ml a piece.
pub fn two_pieces() -> Body {
    let mut body = body(&object([0.0; 3], [0.08, 0.02, 0.02], 0.005, 0), params(1e-3));
    let crossing = Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] };
    let cells = (0..4).flat_map(|y| (0..4).map(move |z| [7, y, z]));
    let links: Vec<_> = cells.map(|cell| (LinkId { cell, axis: 0 }, crossing)).collect();
    let parted = body.part_links(&links).parted;
    body.update_topology(&Workers::serial(), &parted);
    assert_eq!(body.part_count(), 2);
    body
}

/// Whether a node is of the piece at the bar's upper end.
pub fn is_upper(body: &Body, node: usize) -> bool {
    let rest_m = |node: usize| body.rest_position_m(node).x;
    let end = (0..body.node_count()).max_by(|a, b| rest_m(*a).total_cmp(&rest_m(*b))).expect("nodes");
    body.part_of_node(node as u32) == body.part_of_node(end as u32)
}

#[test]
fn a_piece_with_energy_from_nowhere_goes_back_alone() {
    let (workers, mut body) = (Workers::serial(), two_pieces());
    body.save_state(&workers);
    let saved = body.state.position_m.clone();
    // 80 J of kinetic energy in a piece of E V = 16 J, 8 mJ in the other.
    for node in 0..body.node_count() {
        let speed = if is_upper(&body, node) { 100.0 } else { 1.0 };
        body.state.velocity_m_per_s[node] = [0.0, speed, 0.0];
        body.state.position_m[node][1] += 1e-3 * speed;
    }
    body.evaluate(&workers, 2);
    assert!(body.find_lost(10.0).is_none(), "so much was worked");
    let lost = body.find_lost(1.0).expect("80 J of 1 J");
    assert_eq!(lost.what, FaultKind::Energy);
    body.restore_lost(&workers, &lost);
    for (node, saved) in saved.iter().enumerate() {
        let (at, v) = (body.state.position_m[node], body.state.velocity_m_per_s[node]);
        let expected = if is_upper(&body, node) { (saved[1], 0.0) } else { (saved[1] + 1e-3, 1.0) };
        assert_eq!((at[1], v[1]), expected, "node {node}");
    }
    assert!(body.find_lost(1.0).is_none());
}

#[test]
fn a_piece_that_is_no_number_goes_back_alone() {
    let (workers, mut body) = (Workers::serial(), two_pieces());
    body.save_state(&workers);
    let node = (0..body.node_count()).find(|node| is_upper(&body, *node)).expect("a node");
    body.state.position_m[node][2] = f64::NAN;
    let lower = (0..body.node_count()).find(|node| !is_upper(&body, *node)).expect("a node");
    body.state.velocity_m_per_s[lower] = [0.5, 0.0, 0.0];
    body.evaluate(&workers, 2);
    let lost = body.find_lost(f64::INFINITY).expect("not a number");
    assert_eq!(lost.what, FaultKind::NodeState);
    body.restore_lost(&workers, &lost);
    assert!(body.is_finite());
    assert_eq!(body.state.velocity_m_per_s[lower], [0.5, 0.0, 0.0]);
}
