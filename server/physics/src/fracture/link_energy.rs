//! The link-energy rule: the link ahead of the edge parts where its elastic energy per area reaches Gc.
//!
//! After He et al. (2022), section 2.2. Griffith's energy of what a blade may part is a sum over its links, of Psi
//! where they hold and of kappa where they are parted (Eq. 2, 3); descent along its gradient (Eq. 5, 6) moves the
//! signed distance of a link at the tip of the cut (Eq. 4), and parts it, where `Psi > kappa`. Psi is an
//! energy per volume (Eq. 8), kappa one per area. Here a link stands for a layer of one voxel, which holds `Psi h` per area:
//!
//! `Psi h >= Gc`.
//!
//! Psi is the elastic energy of the composite element that the link lies in over its volume, so that it counts what
//! elements have beyond Eq. 8. The paper interpolates between the nodes' densities; as means of the elements around a
//! node these fall with every element beside it that is cut and at rest, and lone links were left standing. The edge
//! presses by springs that are not capped. Once a link gives, the front stands beyond it, and the next is asked
//! when the edge has caught up with the front: there is no pseudo-time (Eq. 4) that would set a speed.
//!
//! An edge that presses on elements of edge H with a load q per length makes `Psi ~ (q / H)^2 / (2 E)`, so that
//!
//! `q ~ H sqrt(2 E Gc / h)`,
//!
//! which Griffith's `q = Gc` is not: it falls with the voxels, and rises with the level. What the springs let go when
//! the front moves on is booked as slip, less Gc times the area of the links.

use super::anchor::{Ahead, Anchor, LinkAhead};
use super::book::FrontBook;
use crate::Vec3;
use crate::body::Body;
use crate::contact::{Contact, Mode};
use crate::tool::frame::BladeFrame;

/// How far beyond a parted link the front stands, in voxels: where it sees the next. Ours. By this rule a blade
/// starts and stops, and its peaks depend on when: half or twice lowers the highest of them by 12 and 8 %, the work
/// by 5 and 2 %.
const PAST_VOXELS: f64 = 0.05;

/// Force at which the springs of a marker give, and the force they go on at: never where a link holds, at none where
/// none does, as in the half voxel between the last link and the surface.
pub(super) fn limits_n(body: &Body, anchor: &Anchor, frame: &BladeFrame) -> (f64, f64) {
    let is_inside = matches!(anchor.ahead, Ahead::Intact { .. });
    let holds = is_inside && body.state.grid.is_intact(anchor.next_link(body, frame).link);
    let limit_n = if holds { f64::INFINITY } else { 0.0 };
    (limit_n, limit_n)
}

/// Where a marker's edge presses and the link ahead of it gives, books what its spring lets go, and returns how far
/// the front moves on, reference configuration.
pub(super) fn give_way(
    body: &Body,
    anchor: &mut Anchor,
    frame: &BladeFrame,
    forward: &Contact,
    book: &mut FrontBook,
) -> Vec3 {
    let Ahead::Intact { fracture_energy_j_per_m2, .. } = anchor.ahead else { return Vec3::zeros() };
    if forward.mode != Mode::Spring {
        return Vec3::zeros();
    }
    let next = anchor.next_link(body, frame);
    if per_area_j_per_m2(body, &next) < fracture_energy_j_per_m2 {
        return Vec3::zeros();
    }
    let past_m = PAST_VOXELS * body.state.grid.voxel_size_m();
    let step = next.ahead * ((next.crossing_m - anchor.position_m).dot(&next.ahead).max(0.0) + past_m);
    let mut moved = *anchor;
    moved.go_on(body, step);
    let advance_m = anchor.advance_m(&moved, body, frame);
    let stored_j = |gap_m: f64| 0.5 * forward.stiffness_n_per_m * gap_m.max(0.0).powi(2);
    let let_go_j = stored_j(forward.gap_m) - stored_j(forward.gap_m - advance_m);
    anchor.stored_j -= let_go_j;
    book.stored_j -= let_go_j;
    book.slip_j += let_go_j;
    anchor.yielded = true;
    step
}

/// Elastic energy that a link holds per area, J/m^2; none where the blade's plane meets no voxel.
fn per_area_j_per_m2(body: &Body, next: &LinkAhead) -> f64 {
    let at_crossing = body.state.grid.voxel_at(body.state.grid.cell_of(&next.crossing_m));
    let voxel = at_crossing.or_else(|| body.state.grid.voxel_at(next.link.cell));
    let Some(element) = voxel.map(|voxel| body.element_of(voxel)) else { return 0.0 };
    body.state.grid.voxel_size_m() * body.elastic_energy_j(element) / body.filled_volume_m3(element)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::material::Elastic;
    use crate::grid::LinkId;
    use crate::params::StepParams;
    use crate::scene::{Scene, SceneDesc};
    use crate::{Mat3, Workers};

    const SCENE: &str = r#"
version = 1
name = "block"
[[objects]]
name = "block"
shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.012, 0.02, 0.016] } }
voxel_size_m = 0.002
[objects.material]
young_modulus_pa = 2e5
poisson_ratio = 0.4
"#;

    #[test]
    fn a_link_of_strained_tissue_holds_the_density_of_eq_8_times_a_voxel() {
        let scene = Scene { desc: SceneDesc::from_toml("block.toml", SCENE).unwrap(), meshes: Default::default() };
        let params = StepParams { dt_s: 1e-3, relative_tolerance: 1e-6, max_iterations: 100 };
        let mut body = Body::new(&scene, 0, params, &Workers::serial()).unwrap();
        let stretch = Mat3::new(1.1, 0.02, 0.0, 0.02, 0.95, 0.01, 0.0, 0.01, 1.03);
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 0.5);
        for node in 0..body.node_count() {
            body.state.position_m[node] = (turn * stretch * body.rest_position_m(node)).into();
        }
        body.evaluate(&Workers::serial(), 60);
        let strain = stretch - Mat3::identity();
        let Elastic { mu_pa, lambda_pa, .. } = Elastic::new(2e5, 0.4, 1000.0);
        let density = mu_pa * strain.norm_squared() + 0.5 * lambda_pa * strain.trace().powi(2);
        for cell in [[0, 0, 0], [2, 5, 4], [4, 9, 7]] {
            let link = LinkId { cell, axis: 0 };
            let crossing_m = body.state.grid.centre_m(cell) + Vec3::x() * 4e-4;
            let next = LinkAhead { link, crossing_m, ahead: -Vec3::y(), near_m: crossing_m };
            let held = per_area_j_per_m2(&body, &next);
            assert!((held / (density * 0.002) - 1.0).abs() < 1e-9, "{held} against {}", density * 0.002);
        }
    }
}
