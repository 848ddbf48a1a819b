//! Ligaments: what is left of an element between cuts that face each other or meet.
//!
//! The release rate of a front ([`super::release`]) is that of one cut whose surroundings are tissue. Between two cuts it
//! is that of the ligament which is left, torn all around (Tada, Paris and Irwin 2000, external circular crack):
//!
//! `G = pi/2 a w`,
//!
//! w the energy density in the ligament and a its radius, here that of a circle of its area. A slab between two straight
//! fronts has 4/pi times its width times w, which is 1.4 times less than this for a slab four times as long as wide.

use super::anchor::fracture_energy;
use crate::Vec3;
use crate::body::Body;
use crate::grid::{Crossing, LinkId};
use std::f64::consts::PI;

/// Distance between the planes at which an element may be narrowest, over the voxel's edge. Ours: each cuts other links,
/// oblique planes too.
const APART_VOXELS: f64 = 0.5;
/// The middle one lies so far from the element's, over the voxel's edge: not through the middles of voxels.
const ASIDE_VOXELS: f64 = 0.26;

/// Whether an element may be a ligament that tears, by its energy alone: one of a single link would.
pub(super) fn may_tear(body: &Body, element: usize, gc_j_per_m2: f64) -> bool {
    let one_link_m2 = body.state.grid.voxel_size_m().powi(2);
    release_rate_j_per_m2(body, element, one_link_m2) >= gc_j_per_m2
}

/// Release rate where so much area is left of an element, J/m^2.
fn release_rate_j_per_m2(body: &Body, element: usize, area_m2: f64) -> f64 {
    let volume_m3 = body.filled_volume_m3(element);
    // What the element bears on the whole of it, the ligament bears on less.
    let across = volume_m3 / (body.element_edge_m(element) * area_m2);
    let energy_j_per_m3 = body.elastic_energy_j(element) / volume_m3 * across * across;
    0.5 * PI * (area_m2 / PI).sqrt() * energy_j_per_m3
}

/// Adds the links across the narrowest place of an element, at right angles to its largest tension, if it tears.
pub(super) fn tear(body: &Body, element: usize, links: &mut Vec<(LinkId, Crossing)>) {
    let axes = body.element_stress_j(element).symmetric_eigen();
    let most = axes.eigenvalues.imax();
    if axes.eigenvalues[most] < axes.eigenvalues.amax() {
        return;
    }
    let normal: Vec3 = axes.eigenvectors.column(most).into();
    let h = body.state.grid.voxel_size_m();
    let middle = body.rest_centre_m(element).dot(&normal);
    let most_apart = (body.element_edge_m(element) / (2.0 * APART_VOXELS * h)).round() as i32;
    let planes = (-most_apart..=most_apart).map(|i| middle + (APART_VOXELS * f64::from(i) + ASIDE_VOXELS) * h);
    let measured = planes.map(|plane| {
        let (mut area_m2, mut gc_j_per_m2) = (0.0, f64::INFINITY);
        for_each_link_across(body, element, &normal, plane, |link, crossing| {
            area_m2 += h * h * f64::from(crossing.normal[link.axis as usize]).abs();
            gc_j_per_m2 = gc_j_per_m2.min(fracture_energy(body, link));
        });
        (area_m2, gc_j_per_m2, plane)
    });
    let narrowest = measured.filter(|(area_m2, ..)| *area_m2 > 0.0).min_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((area_m2, gc_j_per_m2, plane)) = narrowest
        && release_rate_j_per_m2(body, element, area_m2) >= gc_j_per_m2
    {
        for_each_link_across(body, element, &normal, plane, |link, crossing| links.push((link, crossing)));
    }
}

/// Visits the intact links within an element across the plane `normal . x = plane`.
fn for_each_link_across(
    body: &Body,
    element: usize,
    normal: &Vec3,
    plane: f64,
    mut visit: impl FnMut(LinkId, Crossing),
) {
    let grid = body.grid();
    body.for_each_voxel_of(element, |voxel| {
        let cell = grid.voxels()[voxel.index()].ijk;
        for axis in 0..3u8 {
            let link = LinkId { cell, axis };
            let is_own = grid.voxel_at(link.upper()).is_some_and(|upper| body.element_of(upper) == element);
            if !is_own || !grid.is_intact(link) {
                continue;
            }
            let along = normal[axis as usize] * grid.voxel_size_m();
            let t = (plane - grid.centre_m(cell).dot(normal)) / along;
            if (0.0..1.0).contains(&t) {
                let toward_upper = if along > 0.0 { *normal } else { -normal };
                let t = (t as f32).clamp(1e-3, 1.0 - 1e-3);
                visit(link, Crossing { t, normal: toward_upper.map(|c| c as f32).into() });
            }
        }
    });
}
