//! Material points: where a point of the reference configuration is now.

use super::Body;
use crate::fem::composite::{shape_functions, shape_gradients};
use crate::grid::{MaterialPoint, VoxelId};
use crate::{Mat3, Vec3};

/// Newton's method has arrived where its last step is below this, in edges of the element: what is left of the
/// error is about its square, 1e-12. Ten times less costs an iteration, ten times more leaves 1e-10.
const CONVERGED: f64 = 1e-6;

impl Body {
    /// Element of a voxel.
    #[must_use]
    pub(crate) fn element_of(&self, voxel: VoxelId) -> usize {
        self.base().owner[voxel.index()] as usize
    }

    /// Nodes and trilinear weights of a material point.
    #[must_use]
    pub fn weights(&self, point: &MaterialPoint) -> ([u32; 8], [f64; 8]) {
        let element = self.element_of(point.voxel);
        let n = shape_functions(self.local_coordinates(element, &point.position_m));
        (self.base().elements[element].nodes, n)
    }

    /// Scene position of a material point, m.
    #[must_use]
    pub fn current_m(&self, point: &MaterialPoint) -> Vec3 {
        let (nodes, n) = self.weights(point);
        let mut x = Vec3::zeros();
        for (node, n) in nodes.iter().zip(n) {
            x += Vec3::from(self.state.position_m[*node as usize]) * n;
        }
        x
    }

    /// Deformation gradient at a material point.
    #[must_use]
    pub(crate) fn deformation_gradient(&self, point: &MaterialPoint) -> Mat3 {
        let element = self.element_of(point.voxel);
        let local = self.local_coordinates(element, &point.position_m);
        let gradients = shape_gradients(local);
        let mut f = Mat3::zeros();
        for (node, g) in self.base().elements[element].nodes.iter().zip(gradients) {
            let x = Vec3::from(self.state.position_m[*node as usize]);
            f += x * Vec3::from(g).transpose();
        }
        f / self.element_edge_m(element)
    }

    /// The reference position that an element's trilinear map takes to a scene position, by Newton's
    /// method; `None` where it does not converge (a collapsed element).
    #[must_use]
    pub(crate) fn invert_map(&self, element: usize, scene_m: &Vec3) -> Option<Vec3> {
        self.invert_map_from(element, scene_m, &self.rest_centre_m(element))
    }

    /// The same from a guess at that reference position, which saves steps where it is near.
    #[must_use]
    pub(crate) fn invert_map_from(&self, element: usize, scene_m: &Vec3, guess_m: &Vec3) -> Option<Vec3> {
        let map =
            TrilinearMap::of(&self.base().elements[element].nodes.map(|n| self.state.position_m[n as usize].into()));
        let mut local = Vec3::from(self.local_coordinates(element, guess_m));
        for _ in 0..12 {
            let (x, [a, b, c]) = map.at(&local);
            let miss = scene_m - x;
            let step = Vec3::new(miss.dot(&b.cross(&c)), miss.dot(&c.cross(&a)), miss.dot(&a.cross(&b)));
            let step = step / a.dot(&b.cross(&c));
            let size = step.amax();
            if !size.is_finite() {
                return None;
            }
            // Far outside the element the trilinear map folds; such points are not in it anyway.
            let damping = (0.5 / size).min(1.0);
            local = (local + step * damping).map(|l| l.clamp(-1.0, 2.0));
            if size < CONVERGED {
                let data = &self.base().elements[element];
                let at = Vec3::from(data.cell.map(f64::from)) + local * f64::from(data.size);
                return Some(self.state.grid.origin_m() + at * self.lattice_edge_m());
            }
        }
        None
    }
}

/// Positions in a cell as a polynomial of the local coordinates.
struct TrilinearMap {
    /// Of 1, x, y, xy, z, xz, yz, xyz.
    coefficients_m: [Vec3; 8],
}

impl TrilinearMap {
    /// From the corners' positions.
    fn of(corners_m: &[Vec3; 8]) -> Self {
        let mut coefficients_m = *corners_m;
        for bit in [1, 2, 4] {
            for upper in (0..8).filter(|corner| corner & bit != 0) {
                coefficients_m[upper] -= coefficients_m[upper - bit];
            }
        }
        Self { coefficients_m }
    }

    /// The position, m, and its derivatives along the local coordinates.
    fn at(&self, local: &Vec3) -> (Vec3, [Vec3; 3]) {
        let c = &self.coefficients_m;
        let (x, y, z) = (local.x, local.y, local.z);
        // On the lines along x, then on the plane across it.
        let line = [0, 2, 4, 6].map(|at| c[at] + c[at + 1] * x);
        let along_x = (c[1] + c[3] * y) + (c[5] + c[7] * y) * z;
        let along_y = line[1] + line[3] * z;
        let along_z = line[2] + line[3] * y;
        (line[0] + line[1] * y + along_z * z, [along_x, along_y, along_z])
    }
}
