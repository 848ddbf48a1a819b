//! Geodesic distance from the indentation by fast marching over the triangles (Kimmel and Sethian 1998),
//! and what is carried along with it.
//!
//! Distances along edges alone would make rings around an indentation follow the grid's axes.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::field::Field;
use super::mesh::Slot;
use super::reached::{Carried, Reached};
use crate::Vec3;
use crate::surface::VertexId;

/// Vertices to settle next: the nearest first, of equally near ones that with the lowest id.
#[derive(Default)]
pub struct March {
    /// Distance by its bits, which rise with it.
    queue: BinaryHeap<Reverse<(u64, VertexId, Slot)>>,
    /// Farther from every beginning nothing moves, m.
    end_m: f64,
}

impl March {
    /// Room for a surface of so many vertices, each taken up twice, which all are seldom.
    pub(crate) fn reserve(&mut self, vertices: usize) {
        self.queue.clear();
        self.queue.reserve(2 * vertices);
    }

    /// Starts anew.
    pub fn clear(&mut self) {
        self.queue.clear();
        self.end_m = 0.0;
    }

    /// Starts from a vertex, if there is no nearer beginning there. What moves by less than `negligible_m` need not
    /// be reached.
    pub fn start(&mut self, field: &mut Field<'_>, slot: Slot, distance_m: f64, carried: Carried, negligible_m: f64) {
        if field.reached(slot).is_none_or(|reached| distance_m < reached.distance_m) {
            self.end_m = self.end_m.max(carried.profile.end_m(carried.by_m.norm(), negligible_m));
            self.reach(field, slot, distance_m, carried);
        }
    }

    /// Takes a vertex up, or nearer than it was.
    fn reach(&mut self, field: &mut Field<'_>, slot: Slot, distance_m: f64, carried: Carried) {
        field.reach(slot, Reached { distance_m, carried, settled: false });
        self.queue.push(Reverse((distance_m.to_bits(), field.mesh.id(slot), slot)));
    }

    /// Marches on until everything within reach is settled; `order` gets the vertices as they settle.
    pub fn run(&mut self, field: &mut Field<'_>, order: &mut Vec<Slot>) {
        while let Some(Reverse((.., slot))) = self.queue.pop() {
            let Some(here) = field.reached(slot).filter(|here| !here.settled) else { continue };
            field.reach(slot, Reached { settled: true, ..here });
            order.push(slot);
            let (mesh, from) = (field.mesh, (here, field.base_m(slot)));
            for [left, right] in mesh.triangles_at(slot) {
                self.cross(field, from, left, right);
                self.cross(field, from, right, left);
            }
        }
    }

    /// Reaches `next` over the triangle that a vertex which has just settled forms with it and `other`.
    fn cross(&mut self, field: &mut Field<'_>, (near, from_m): (Reached, Vec3), next: Slot, other: Slot) {
        let known = field.reached(next);
        if known.is_some_and(|known| known.settled) {
            return;
        }
        let a = from_m - field.base_m(next);
        let across = field.reached(other).filter(|far| far.settled).and_then(|far| {
            let b = field.base_m(other) - field.base_m(next);
            planar(a, b, near.distance_m, far.distance_m).map(|(distance_m, share)| (distance_m, share, far))
        });
        let distance_m = across.map_or_else(|| near.distance_m + a.norm(), |(distance_m, ..)| distance_m);
        if distance_m >= self.end_m || known.is_some_and(|known| distance_m >= known.distance_m) {
            return;
        }
        let carried = across.map_or(near.carried, |(_, share, far)| near.carried.towards(&far.carried, share));
        if distance_m < carried.profile.reach_m {
            self.reach(field, next, distance_m, carried);
        }
    }
}

/// Distance at the origin of a plane front that passes the points `a` and `b` at the distances `at_a` and
/// `at_b`, and where it comes from as a fraction of the way from `a` to `b`; `None` where it does not come
/// from between them.
fn planar(a: Vec3, b: Vec3, at_a: f64, at_b: f64) -> Option<(f64, f64)> {
    let (aa, ab, bb) = (a.norm_squared(), a.dot(&b), b.norm_squared());
    let determinant = aa * bb - ab * ab;
    // The inverse of the Gram matrix, times the determinant, is ((bb, -ab), (-ab, aa)).
    let ones = bb - 2.0 * ab + aa;
    let mixed = at_a * (bb - ab) + at_b * (aa - ab);
    let squares = at_a * at_a * bb - 2.0 * at_a * at_b * ab + at_b * at_b * aa;
    let discriminant = mixed * mixed - ones * (squares - determinant);
    if determinant <= 0.0 || discriminant < 0.0 {
        return None;
    }
    let distance = (mixed + discriminant.sqrt()) / ones;
    let (behind_a, behind_b) = (distance - at_a, distance - at_b);
    let [weight_a, weight_b] = [bb * behind_a - ab * behind_b, aa * behind_b - ab * behind_a];
    let between = weight_a >= 0.0 && weight_b >= 0.0 && weight_a + weight_b > 0.0;
    between.then(|| (distance, weight_b / (weight_a + weight_b)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_front_is_followed_exactly() {
        let (a, b) = (Vec3::new(-1.0, 0.3, 0.2), Vec3::new(-0.4, -1.1, 0.1));
        for step in 0..=10 {
            // It comes through this point between them.
            let share = 0.05 + 0.09 * f64::from(step);
            let along = -a.lerp(&b, share).normalize();
            let offset = 5.0;
            let (distance, found) =
                planar(a, b, offset + a.dot(&along), offset + b.dot(&along)).expect("from between them");
            assert!((distance - offset).abs() < 1e-12 && (found - share).abs() < 1e-9, "{step}: {distance} {found}");
        }
    }

    #[test]
    fn a_front_from_beside_the_triangle_is_left_to_the_edge() {
        let (a, b) = (Vec3::new(-1.0, 0.0, 0.0), Vec3::new(-1.0, -1.0, 0.0));
        assert_eq!(planar(a, b, 0.0, 0.0), Some((1.0, 0.0)), "along the edge itself");
        assert!(planar(a, b, 0.0, -0.3).is_some_and(|(_, share)| share > 0.1));
        assert_eq!(planar(a, b, 0.0, 0.3), None);
    }
}
