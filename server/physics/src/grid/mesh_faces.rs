//! The faces of a mesh as found: which are there twice, and which hang together as one body.

use std::cmp::Ordering;

use crate::Vec3;

/// Corners are one point where they are equal to the last bit, whatever their numbers in the file.
fn compare(a: &Vec3, b: &Vec3) -> Ordering {
    let by = |axis: usize| (a[axis] + 0.0).total_cmp(&(b[axis] + 0.0));
    by(0).then(by(1)).then(by(2))
}

/// The triangle with its lowest corner first, the same way round.
fn rotated(triangle: &[Vec3; 3]) -> [Vec3; 3] {
    let [a, b, c] = *triangle;
    let is_lowest = |x: &Vec3, y: &Vec3, z: &Vec3| compare(x, y).is_le() && compare(x, z).is_le();
    match () {
        () if is_lowest(&a, &b, &c) => [a, b, c],
        () if is_lowest(&b, &c, &a) => [b, c, a],
        () => [c, a, b],
    }
}

/// The triangles without repetitions, in their order. Those the other way round stay: where two bodies
/// touch, each has a wall of its own.
pub(super) fn distinct(triangles: Vec<[Vec3; 3]>) -> Vec<[Vec3; 3]> {
    let same = |i: &u32, j: &u32| {
        let (a, b) = (rotated(&triangles[*i as usize]), rotated(&triangles[*j as usize]));
        compare(&a[0], &b[0]).then_with(|| compare(&a[1], &b[1])).then_with(|| compare(&a[2], &b[2]))
    };
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    order.sort_by(same);
    order.dedup_by(|i, j| same(i, j).is_eq());
    order.sort_unstable();
    order.into_iter().map(|i| triangles[i as usize]).collect()
}

/// The body of each triangle: those that share a corner are of one body. Named by their lowest point.
pub(super) fn bodies(triangles: &[[Vec3; 3]]) -> Vec<u32> {
    let corner = |i: u32| &triangles[i as usize / 3][i as usize % 3];
    let mut order: Vec<u32> = (0..3 * triangles.len() as u32).collect();
    order.sort_by(|i, j| compare(corner(*i), corner(*j)));
    let mut point = vec![0u32; order.len()];
    let mut count = 0;
    for same in order.chunk_by(|i, j| compare(corner(*i), corner(*j)).is_eq()) {
        same.iter().for_each(|i| point[*i as usize] = count);
        count += 1;
    }
    let mut parent: Vec<u32> = (0..count).collect();
    let (triples, _) = point.as_chunks::<3>();
    for [a, b, c] in triples {
        for other in [b, c] {
            let (x, y) = (root(&mut parent, *a), root(&mut parent, *other));
            parent[x.max(y) as usize] = x.min(y);
        }
    }
    triples.iter().map(|[a, ..]| root(&mut parent, *a)).collect()
}

fn root(parent: &mut [u32], mut id: u32) -> u32 {
    while parent[id as usize] != id {
        parent[id as usize] = parent[parent[id as usize] as usize];
        id = parent[id as usize];
    }
    id
}
