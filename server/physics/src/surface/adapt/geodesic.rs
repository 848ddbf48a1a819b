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
    /// Starts anew.
    pub fn clear(&mut self) {
        self.queue.clear();
        self.end_m = 0.0;
    }

    /// Starts from a vertex, if there is no nearer beginning there. What moves by less than `negligible_m` need not
    /// be reached.
    pub fn start(&mut self, field: &mut Field<'_>, slot: Slot, distance_m: f64, carried: Carried, negligible_m: f64) {
        let place = field.place(slot);
        let known = field.at(place).reached.as_ref();
        if known.is_none_or(|reached| distance_m < reached.distance_m) {
            self.end_m = self.end_m.max(carried.profile.end_m(carried.by_m.norm(), negligible_m));
            self.reach(field, (slot, place), distance_m, carried);
        }
    }

    /// Takes a vertex up, or nearer than it was.
    fn reach(&mut self, field: &mut Field<'_>, (slot, place): (Slot, usize), distance_m: f64, carried: Carried) {
        field.at_mut(place).reached = Some(Reached { distance_m, carried, settled: false });
        self.queue.push(Reverse((distance_m.to_bits(), field.mesh.id(slot), slot)));
    }

    /// Marches on until everything within reach is settled; `order` gets the vertices as they settle.
    pub fn run(&mut self, field: &mut Field<'_>, order: &mut Vec<Slot>) {
        while let Some(Reverse((.., slot))) = self.queue.pop() {
            let place = field.place(slot);
            let vertex = field.at_mut(place);
            let from_m = vertex.base_m;
            let Some(here) = vertex.reached.as_mut().filter(|here| !here.settled) else { continue };
            here.settled = true;
            let from = (*here, from_m);
            order.push(slot);
            let mesh = field.mesh;
            for others in mesh.triangles_at(slot) {
                let [left, right] = others.map(|other| (other, field.place(other)));
                self.cross(field, &from, left, right.1);
                self.cross(field, &from, right, left.1);
            }
        }
    }

    /// Reaches `next` over the triangle that a vertex which has just settled forms with it and the vertex at the place
    /// `other`.
    fn cross(&mut self, field: &mut Field<'_>, (near, from_m): &(Reached, Vec3), next: (Slot, usize), other: usize) {
        let [to, beside] = [next.1, other].map(|place| field.at(place));
        if to.reached.as_ref().is_some_and(|known| known.settled) {
            return;
        }
        let a = from_m - to.base_m;
        let across = beside.reached.as_ref().filter(|far| far.settled).and_then(|far| {
            let b = beside.base_m - to.base_m;
            planar(a, b, near.distance_m, far.distance_m).map(|(distance_m, share)| (distance_m, share, far))
        });
        let distance_m = across.map_or_else(|| near.distance_m + a.norm(), |(distance_m, ..)| distance_m);
        if distance_m >= self.end_m || to.reached.as_ref().is_some_and(|known| distance_m >= known.distance_m) {
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
