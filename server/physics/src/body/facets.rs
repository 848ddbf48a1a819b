//! Where an element ends: the faces of its voxels on the body's own surface and at cuts.

use std::sync::OnceLock;

use super::Body;
use crate::Vec3;
use crate::fem::composite::shape_functions;
use crate::grid::{Grid, Ijk, Link, LinkId, VoxelId};

/// A voxel's face on the surface or at a cut, reference configuration.
pub(crate) struct Facet {
    /// Voxel that it belongs to.
    pub(crate) voxel: VoxelId,
    /// The voxel's cell.
    pub(crate) cell: Ijk,
    /// Its side, as in [`Grid::links_of`].
    pub(crate) side: usize,
    /// The element on the other side of the cut; `None` on the object's own surface.
    pub(crate) across: Option<u32>,
    /// Where the surface crosses the link, m.
    pub(crate) at_m: Vec3,
    /// Unit normal out of the element.
    pub(crate) outward: Vec3,
    /// Area of the surface within the face's column, m^2.
    pub(crate) area_m2: f64,
}

/// `int N_a n dA` over an element's facets, by corner a, m^2: made when first asked for.
pub(super) type FacetMoments = OnceLock<[Vec3; 8]>;

impl Body {
    /// The facets of an element. A wall whose two sides belong to the element is left out: it is still in one
    /// piece.
    pub(crate) fn facets_of(&self, element: usize) -> impl Iterator<Item = Facet> + '_ {
        self.voxels_of(element).into_iter().flat_map(move |voxel| {
            let cell = self.grid.voxels()[voxel.index()].ijk;
            let faces = Grid::links_of(cell).enumerate();
            faces.filter_map(move |(side, (link, other))| self.facet(element, (voxel, cell), side, (link, other)))
        })
    }

    fn facet(
        &self,
        element: usize,
        (voxel, cell): (VoxelId, Ijk),
        side: usize,
        (link, other): (LinkId, Ijk),
    ) -> Option<Facet> {
        let grid = &self.grid;
        let (crossing, across, sign) = match grid.link(link) {
            Link::Boundary(crossing) => (crossing, None, 1.0),
            Link::Parted(crossing) => {
                let across = grid.voxel_at(other).map(|voxel| self.element_of(voxel));
                if across == Some(element) {
                    return None;
                }
                (crossing, across, if side % 2 == 1 { 1.0 } else { -1.0 })
            }
            Link::Intact | Link::Outside => return None,
        };
        let (axis, h) = (link.axis as usize, grid.voxel_size_m());
        let mut at_m = grid.centre_m(link.cell);
        at_m[axis] += f64::from(crossing.t) * h;
        let outward = Vec3::from(crossing.normal.map(f64::from)) * sign;
        let area_m2 = h * h * outward[axis].abs();
        let across = across.map(|element| element as u32);
        (area_m2 > 0.0).then_some(Facet { voxel, cell, side, across, at_m, outward, area_m2 })
    }

    /// `int phi n dA` over the facets of an element, n out of it, m^2; phi by its corners, trilinear between.
    pub(crate) fn facet_area_m2(&self, element: usize, phi: &[f64; 8]) -> Vec3 {
        let moments = self.facet_moments[element].get_or_init(|| self.sum_facets(element));
        moments.iter().zip(phi).map(|(moment, phi)| moment * *phi).sum()
    }

    fn sum_facets(&self, element: usize) -> [Vec3; 8] {
        let mut moments = [Vec3::zeros(); 8];
        for facet in self.facets_of(element) {
            let n = shape_functions(self.local_coordinates(element, &facet.at_m));
            moments.iter_mut().zip(n).for_each(|(moment, n)| *moment += facet.outward * (facet.area_m2 * n));
        }
        moments
    }

    /// Forgets the facets of elements that changed, and of those that `parted` links end in.
    pub(super) fn forget_facets(&mut self, changed: &[u32], parted: &[LinkId]) {
        self.facet_moments.resize_with(self.base().elements.len(), OnceLock::new);
        for element in self.elements_at(parted).chain(changed.iter().copied()).collect::<Vec<_>>() {
            self.facet_moments[element as usize] = OnceLock::new();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Crossing;
    use crate::params::StepParams;
    use crate::scene::{Meshes, Scene, SceneDesc};
    use crate::workers::Workers;

    const SCENE: &str = r#"
version = 1
name = "ball"
[[objects]]
name = "ball"
shape = { sphere = { center_m = [0.0, 0.0, 0.0], radius_m = 0.02 } }
voxel_size_m = 0.0025
level = 2
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
"#;

    fn moments(body: &Body) -> Vec<[Vec3; 8]> {
        let corner = |c: usize| std::array::from_fn(|a| f64::from(u8::from(a == c)));
        let of = |element| std::array::from_fn(|c| body.facet_area_m2(element, &corner(c)));
        (0..body.base().elements.len()).map(of).collect()
    }

    #[test]
    fn facets_close_the_surface_and_follow_cuts() {
        let scene = Scene { desc: SceneDesc::from_toml("ball.toml", SCENE).unwrap(), meshes: Meshes::new() };
        let params = StepParams { dt_s: 1e-3, relative_tolerance: 1e-3, max_iterations: 200 };
        let mut body = Body::new(&scene, 0, params, &Workers::serial()).unwrap();
        let before = moments(&body);
        let area_m2: f64 = (0..before.len()).flat_map(|e| body.facets_of(e)).map(|facet| facet.area_m2).sum();
        let sphere_m2 = 4.0 * std::f64::consts::PI * 0.02_f64.powi(2);
        assert!((area_m2 / sphere_m2 - 1.0).abs() < 0.05, "{area_m2} of {sphere_m2}");
        let [nx, ny, nz] = body.grid.dims();
        // Half through the middle; the rest in a second step.
        for columns in [nx / 2, nx] {
            let cells = (0..nz).flat_map(|z| (0..columns).map(move |x| [x, ny / 2, z]));
            let crossing = Crossing { t: 0.5, normal: [0.0, 1.0, 0.0] };
            let links: Vec<_> = cells.map(|cell| (LinkId { cell, axis: 1 }, crossing)).collect();
            let parted = body.part_links(&links).parted;
            assert!(parted.len() > 20);
            body.update_topology(&Workers::serial(), &parted);
            let followed = moments(&body);
            assert!(followed[..before.len()] != before[..], "a wall came up");
            body.facet_moments.fill(OnceLock::new());
            assert_eq!(followed, moments(&body));
            let open_m2: Vec3 = followed.iter().flatten().sum();
            assert!(open_m2.norm() < 1e-9 * area_m2, "{open_m2:?}: both walls count");
        }
    }
}
