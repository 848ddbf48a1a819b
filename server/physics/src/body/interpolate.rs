//! Material points: where a point of the reference configuration is now.

use super::Body;
use crate::fem::composite::{shape_functions, shape_gradients};
use crate::fem::held::VoxelCorners;
use crate::grid::{Ijk, MaterialPoint, VoxelId};
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

    /// What moves a material point.
    #[must_use]
    pub(crate) fn weights(&self, point: &MaterialPoint) -> PointWeights {
        let element = self.element_of(point.voxel);
        let local = self.local_coordinates(element, &point.position_m);
        let nodes = self.base().elements[element].nodes;
        let Some(corners) = self.state.held.corners(element) else {
            return PointWeights::in_element(nodes, local);
        };
        let weights = corners.weights(self.voxel_in_cell(element, point.voxel), local);
        PointWeights::beside_held(nodes, weights, &self.cell_corners_m(element), &point.position_m)
    }

    /// Place of a voxel in the cell of its element, in voxels.
    fn voxel_in_cell(&self, element: usize, voxel: VoxelId) -> Ijk {
        super::held::from(self.state.grid.voxels()[voxel.index()].ijk, self.first_voxel_of(element))
    }

    /// Scene position of a material point, m.
    #[must_use]
    pub fn current_m(&self, point: &MaterialPoint) -> Vec3 {
        self.weights(point).place_m(&self.state.position_m)
    }

    /// Deformation gradient at a material point.
    #[must_use]
    pub(crate) fn deformation_gradient(&self, point: &MaterialPoint) -> Mat3 {
        let element = self.element_of(point.voxel);
        let local = self.local_coordinates(element, &point.position_m);
        let nodes = self.base().elements[element].nodes;
        let edge_m = self.element_edge_m(element);
        let position = |node: usize| Vec3::from(self.state.position_m[node]);
        match self.state.held.corners(element) {
            None => gradient(nodes.map(|node| position(node as usize)), shape_gradients(local)) / edge_m,
            Some(corners) => {
                let gradients = corners.weight_gradients(self.voxel_in_cell(element, point.voxel), local);
                let moved = nodes.map(|node| position(node as usize) - self.rest_position_m(node as usize));
                Mat3::identity() + gradient(moved, gradients) / edge_m
            }
        }
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
        let data = &self.base().elements[element];
        let nodes = data.nodes.map(|node| node as usize);
        let mut local = Vec3::from(self.local_coordinates(element, guess_m));
        let found = match self.state.held.corners(element) {
            None => {
                let map = TrilinearMap::of(&nodes.map(|n| self.state.position_m[n].into()));
                invert(&mut local, scene_m, |local| map.at(local))
            }
            Some(corners) => {
                let [low_m, ..] = self.cell_corners_m(element);
                let edge_m = self.element_edge_m(element);
                let moved_m = nodes.map(|n| Vec3::from(self.state.position_m[n]) - self.rest_position_m(n));
                invert(&mut local, scene_m, |local| held_at(corners, &moved_m, (low_m, edge_m), local))
            }
        };
        found.then(|| {
            let at = Vec3::from(data.cell.map(f64::from)) + local * f64::from(data.size);
            self.state.grid.origin_m() + at * self.lattice_edge_m()
        })
    }
}

/// Sum of what stands at the nodes times the gradients of their weights.
fn gradient(at: [Vec3; 8], gradients: [[f64; 3]; 8]) -> Mat3 {
    at.iter().zip(gradients).fold(Mat3::zeros(), |sum, (at, g)| sum + at * Vec3::from(g).transpose())
}

/// Brings local coordinates to where `map`, which gives the position, m, and its derivatives along them, is at
/// `scene_m`; returns whether it arrived.
fn invert(local: &mut Vec3, scene_m: &Vec3, map: impl Fn(&Vec3) -> (Vec3, [Vec3; 3])) -> bool {
    for _ in 0..12 {
        let (x, [a, b, c]) = map(local);
        let miss = scene_m - x;
        let step = Vec3::new(miss.dot(&b.cross(&c)), miss.dot(&c.cross(&a)), miss.dot(&a.cross(&b)));
        let step = step / a.dot(&b.cross(&c));
        let size = step.amax();
        if !size.is_finite() {
            return false;
        }
        // Far outside the element the trilinear map folds; such points are not in it anyway.
        let damping = (0.5 / size).min(1.0);
        *local = (*local + step * damping).map(|l| l.clamp(-1.0, 2.0));
        if size < CONVERGED {
            return true;
        }
    }
    false
}

/// The map of an element that is held, whose nodes have moved by `moved_m`, in a cell of an edge from its lower corner.
fn held_at(
    corners: &VoxelCorners,
    moved_m: &[Vec3; 8],
    (low_m, edge_m): (Vec3, f64),
    local: &Vec3,
) -> (Vec3, [Vec3; 3]) {
    let (weights, gradients) = corners.weights_anywhere((*local).into());
    let mut at_m = low_m + local * edge_m;
    let mut along = [0, 1, 2].map(|axis| Vec3::ith(axis, edge_m));
    for ((moved_m, n), gradient) in moved_m.iter().zip(weights).zip(gradients) {
        at_m += moved_m * n;
        along.iter_mut().zip(gradient).for_each(|(along, g)| *along += moved_m * g);
    }
    (at_m, along)
}

/// What moves a point: nodes, their weights, and what is held.
#[derive(Clone, Copy, Debug)]
pub struct PointWeights {
    /// The corners of the point's element.
    pub nodes: [u32; 8],
    /// How much each of them counts. They add up to one, or to less beside what is held.
    pub weights: [f64; 8],
    /// What is held contributes this to the point's position, m, scene frame.
    pub fixed_m: Vec3,
}

impl PointWeights {
    /// Of a point at these coordinates in an element of which nothing is held.
    pub(crate) fn in_element(nodes: [u32; 8], local: [f64; 3]) -> Self {
        Self { nodes, weights: shape_functions(local), fixed_m: Vec3::zeros() }
    }

    /// Of a point at `position_m` at rest beside what is held, in an element with these corners at rest.
    pub(crate) fn beside_held(nodes: [u32; 8], weights: [f64; 8], corners_m: &[Vec3; 8], position_m: &Vec3) -> Self {
        let carried: Vec3 = corners_m.iter().zip(weights).map(|(corner, n)| corner * n).sum();
        Self { nodes, weights, fixed_m: position_m - carried }
    }

    /// Nodes and weights.
    pub fn iter(&self) -> impl Iterator<Item = (u32, f64)> {
        self.nodes.into_iter().zip(self.weights)
    }

    /// Weighted sum of a nodal vector: of velocities, say.
    #[must_use]
    pub fn sum(&self, values: &[[f64; 3]]) -> Vec3 {
        self.iter().fold(Vec3::zeros(), |sum, (node, n)| sum + Vec3::from(values[node as usize]) * n)
    }

    /// Where the point is, m.
    #[must_use]
    pub fn place_m(&self, position_m: &[[f64; 3]]) -> Vec3 {
        self.sum(position_m) + self.fixed_m
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
