//! Material points: where a point of the reference configuration is now.

use super::Body;
use crate::fem::composite::{shape_functions, shape_gradients};
use crate::grid::{LinkId, VoxelId};
use crate::{Mat3, Vec3};

/// A point of the reference configuration, followed through the element of one of its voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialPoint {
    /// Reference position, m.
    pub position_m: Vec3,
    /// Voxel whose element it moves with.
    pub voxel: VoxelId,
}

impl Body {
    /// Element of a voxel.
    #[must_use]
    pub fn element_of(&self, voxel: VoxelId) -> usize {
        self.base().owner[voxel.index()] as usize
    }

    /// The elements at both ends of links; one comes again for each end in it.
    pub(crate) fn elements_at<'a>(&'a self, links: &'a [LinkId]) -> impl Iterator<Item = u32> + 'a {
        let ends = links.iter().flat_map(|link| [link.cell, link.upper()]);
        ends.filter_map(|cell| self.grid.voxel_at(cell)).map(|voxel| self.element_of(voxel) as u32)
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
            x += Vec3::from(self.position_m[*node as usize]) * n;
        }
        x
    }

    /// Deformation gradient at a material point.
    #[must_use]
    pub fn deformation_gradient(&self, point: &MaterialPoint) -> Mat3 {
        let element = self.element_of(point.voxel);
        let local = self.local_coordinates(element, &point.position_m);
        let gradients = shape_gradients(local);
        let mut f = Mat3::zeros();
        for (node, g) in self.base().elements[element].nodes.iter().zip(gradients) {
            let x = Vec3::from(self.position_m[*node as usize]);
            f += x * Vec3::from(g).transpose();
        }
        f / self.element_edge_m(element)
    }

    /// The reference position that an element's trilinear map takes to a scene position, by Newton's
    /// method; `None` where it does not converge (a collapsed element).
    #[must_use]
    pub fn invert_map(&self, element: usize, scene_m: &Vec3) -> Option<Vec3> {
        self.invert_map_from(element, scene_m, &self.rest_centre_m(element))
    }

    /// The same from a guess at that reference position, which saves steps where it is near.
    #[must_use]
    pub fn invert_map_from(&self, element: usize, scene_m: &Vec3, guess_m: &Vec3) -> Option<Vec3> {
        let nodes = self.base().elements[element].nodes.map(|n| Vec3::from(self.position_m[n as usize]));
        let mut local = self.local_coordinates(element, guess_m);
        for _ in 0..12 {
            let n = shape_functions(local);
            let g = shape_gradients(local);
            let mut x = Vec3::zeros();
            let mut jacobian = Mat3::zeros();
            for a in 0..8 {
                x += nodes[a] * n[a];
                jacobian += nodes[a] * Vec3::from(g[a]).transpose();
            }
            let step = jacobian.lu().solve(&(scene_m - x))?;
            let size = step.amax();
            if !size.is_finite() {
                return None;
            }
            // Far outside the element the trilinear map folds; such points are not in it anyway.
            let damping = (0.5 / size).min(1.0);
            (0..3).for_each(|i| local[i] = (local[i] + damping * step[i]).clamp(-1.0, 2.0));
            if size < 1e-9 {
                let data = &self.base().elements[element];
                let at = Vec3::from([0, 1, 2].map(|a| f64::from(data.cell[a]) + f64::from(data.size) * local[a]));
                return Some(self.grid.origin_m() + at * self.lattice_edge_m());
            }
        }
        None
    }
}
