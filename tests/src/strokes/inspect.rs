//! What the surface and the pieces of a cut body are like.

use kerf_physics::surface::{Surface, VertexId};
use kerf_physics::{Grid, Link};

/// One passage of a quad along an edge.
struct HalfEdge {
    ends: (VertexId, VertexId),
    /// +1 from the lower id to the higher, else -1.
    sign: i32,
    /// Index of its quad.
    quad: usize,
}

/// How the quads of a surface hang together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Seams {
    /// Edges that are not passed equally often in both directions, or whose ends are one vertex.
    pub open: usize,
    /// Parted links whose faces share an edge with no face of another link: cracks that hang together with
    /// nothing.
    pub lone: usize,
}

pub(super) fn seams(grid: &Grid, surface: &Surface) -> Seams {
    let links: Vec<_> = surface.quads().map(|(id, _)| surface.link_of(id)).collect();
    let half_edges = |(quad, (_, corners)): (usize, (u32, &[VertexId; 4]))| {
        let corners = *corners;
        (0..4).map(move |i| {
            let (from, to) = (corners[i], corners[(i + 1) % 4]);
            HalfEdge { ends: (from.min(to), from.max(to)), sign: if from < to { 1 } else { -1 }, quad }
        })
    };
    let mut edges: Vec<HalfEdge> = surface.quads().enumerate().flat_map(half_edges).collect();
    edges.sort_unstable_by_key(|edge| edge.ends);
    let mut joined = vec![false; links.len()];
    let mut open = 0;
    for edge in edges.chunk_by(|a, b| a.ends == b.ends) {
        let balance: i32 = edge.iter().map(|e| e.sign).sum();
        open += usize::from(balance != 0 || edge[0].ends.0 == edge[0].ends.1);
        if edge.iter().any(|e| links[e.quad] != links[edge[0].quad]) {
            edge.iter().for_each(|e| joined[e.quad] = true);
        }
    }
    let alone = |(link, joined): (_, &bool)| !joined && matches!(grid.link(link), Link::Parted(_));
    // Both faces of a crack are alone.
    let lone = links.into_iter().zip(&joined).filter(|pair| alone(*pair)).count() / 2;
    Seams { open, lone }
}
