//! What an element contributes to the energy release rate of a crack: Eshelby's energy-momentum (1975).

use super::Body;
use crate::fem::block::LANES;
use crate::{Mat3, Vec3};
use wide::f64x4;

/// Bilinear functions of a cell: the pair of axes along which their gradient is linear, and the third.
const BILINEAR: [[usize; 3]; 3] = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];

/// An element as its nodes see it; vectors are xyz0.
struct Corners {
    /// Positions, m, scene frame.
    position_m: [f64x4; 8],
    /// Forces that deform the element, N, scene frame.
    force_n: [f64x4; 8],
    /// Shape gradients averaged over the filled volume, 1/m.
    mean_gradient: [f64x4; 8],
    /// Edge of the cell, m.
    edge_m: f64,
    /// From the rest frame to the scene.
    rotation: Mat3,
}

/// What moving the material of an element by `phi d` does, its nodes staying where they are.
pub(crate) struct Moved {
    /// What it takes off the element's elastic energy, loads' work included, J.
    pub(crate) released_j: f64,
    /// Force that the surroundings have on the element beyond its loads, weighted with phi, N, scene frame.
    pub(crate) push_n: Vec3,
    /// Where d is now, scene frame.
    pub(crate) direction: Vec3,
    /// Mean gradient of phi, 1/m.
    pub(crate) slope: Vec3,
    /// The element's elastic energy, J; of relaxing materials, what does not relax.
    pub(crate) elastic_j: f64,
}

impl Body {
    /// Moves the material of an element by `phi d`: `phi` at its corners, `d` in the reference configuration.
    /// `int (F^T P - W I) : grad q dV - int (F^T b) . q dV`.
    ///
    /// From the nodal forces, which hold whatever the element adds inside. A field whose gradient is constant is
    /// moved exactly, so that nothing is released where there is no crack; of what varies inside, each bilinear
    /// displacement counts along the axis that it strains. (Sampled at the voxels, the trilinear field would count
    /// shear that the element does not have in bending.)
    pub(crate) fn move_material(&self, element: usize, phi: &[f64; 8], d: &Vec3) -> Moved {
        let corners = self.corners(element);
        if self.is_held(element) {
            return self.move_held_material(element, &corners, phi, d);
        }
        let (mut push_n, mut slope, mut direction) = (f64x4::ZERO, f64x4::ZERO, f64x4::ZERO);
        for a in 0..8 {
            let load = packed(self.solver.element_loads_n[element][a]);
            let weight = f64x4::splat(phi[a]);
            push_n = weight.mul_add(corners.force_n[a] - load, push_n);
            slope = weight.mul_add(corners.mean_gradient[a], slope);
            let along = f64x4::splat(unpacked(corners.mean_gradient[a]).dot(d));
            direction = along.mul_add(corners.position_m[a], direction);
        }
        let [push_n, slope, direction] = [push_n, slope, direction].map(unpacked);
        let bent_j = corners.bilinear_work_j().component_mul(&slope).dot(d);
        let elastic_j = self.elastic_energy_j(element);
        let released_j = push_n.dot(&direction) + bent_j - elastic_j * slope.dot(d);
        Moved { released_j, push_n, direction, slope, elastic_j }
    }

    /// The same of an element that is held: `phi` is interpolated as displacements are, so that what is held stays.
    fn move_held_material(&self, element: usize, corners: &Corners, phi: &[f64; 8], d: &Vec3) -> Moved {
        let (mut push_n, mut slope, mut direction) = (Vec3::zeros(), Vec3::zeros(), *d);
        let at_rest_m = self.cell_corners_m(element);
        for a in 0..8 {
            let force_n = unpacked(corners.force_n[a]);
            push_n += (force_n - Vec3::from(self.solver.element_loads_n[element][a])) * phi[a];
            slope += unpacked(corners.mean_gradient[a]) * phi[a];
            let moved_m = unpacked(corners.position_m[a]) - at_rest_m[a];
            direction += moved_m * unpacked(corners.mean_gradient[a]).dot(d);
        }
        let elastic_j = self.elastic_energy_j(element);
        let released_j = push_n.dot(&direction) - elastic_j * slope.dot(d);
        Moved { released_j, push_n, direction, slope, elastic_j }
    }

    /// Elastic energy of an element, J; of relaxing materials, what does not relax.
    pub(crate) fn elastic_energy_j(&self, element: usize) -> f64 {
        self.state.elements[element / LANES].elastic_j.as_array()[element % LANES]
    }

    /// Filled volume of an element, m^3.
    pub(crate) fn filled_volume_m3(&self, element: usize) -> f64 {
        self.solver.blocks[element / LANES].shapes.volume_m3.as_array()[element % LANES]
    }

    /// Shape gradients averaged over the filled volume of an element, 1/m.
    pub(super) fn mean_gradient_per_m(&self, element: usize) -> [Vec3; 8] {
        let gradient = &self.solver.blocks[element / LANES].shapes.mean_gradient;
        gradient.each_ref().map(|g| Vec3::from(g.each_ref().map(|v| v.as_array()[element % LANES])))
    }

    /// `V sigma` of an element, in the frame that turns with it, J.
    pub(crate) fn element_stress_j(&self, element: usize) -> Mat3 {
        let Corners { position_m, force_n, rotation, edge_m, .. } = self.corners(element);
        // The forces add up to zero, or with those on the ground points about the lower corner of the cell.
        let [low_m, ..] = self.cell_corners_m(element);
        let pairs = force_n.iter().zip(&position_m);
        let virial: Mat3 = pairs.map(|(f, x)| unpacked(*f) * (unpacked(*x) - low_m).transpose()).sum();
        let mut virial = rotation.transpose() * virial * rotation;
        if let Some(on_ground_n) = &self.state.elements[element / LANES].ground_force_n {
            let at = |i: usize| on_ground_n[i].as_array()[element % LANES];
            for point in 0..3 {
                let force_n = Vec3::from_fn(|axis, _| at(3 * point + axis));
                virial += force_n * (rotation.row(point) * edge_m);
            }
        }
        (virial + virial.transpose()) * 0.5
    }

    fn corners(&self, element: usize) -> Corners {
        let (block, state, lane) =
            (&self.solver.blocks[element / LANES], &self.state.elements[element / LANES], element % LANES);
        let at = |v: &wide::f64x4| v.as_array()[lane];
        let [x, y, z, w] = state.rotation.each_ref().map(at);
        Corners {
            position_m: self.base().elements[element].nodes.map(|n| packed(self.state.position_m[n as usize])),
            force_n: std::array::from_fn(|a| -packed([0, 1, 2].map(|i| at(&state.force_n[3 * a + i])))),
            mean_gradient: block.shapes.mean_gradient.each_ref().map(|g| packed(g.each_ref().map(at))),
            edge_m: at(&block.shapes.edge_m),
            rotation: nalgebra::UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(w, x, y, z))
                .to_rotation_matrix()
                .into_inner(),
        }
    }
}

impl Corners {
    /// Work of the stress on what the bilinear displacements strain along each axis, J.
    fn bilinear_work_j(&self) -> Vec3 {
        let [position_m, force_n, gradient] = [&self.position_m, &self.force_n, &self.mean_gradient].map(modes);
        let mut along_j = Vec3::zeros();
        for [j, k, other] in BILINEAR {
            let mode = 1 << j | 1 << k;
            // Less the linear part with the same mean gradient: a constant stress does no work on the rest.
            let slope = unpacked(gradient[mode]) * (0.5 * self.edge_m);
            let linear = |axis: usize| f64x4::splat(slope[axis]) * force_n[1 << axis];
            let moment_n = force_n[mode] - linear(0) - linear(1) - linear(2);
            let [amplitude_m, moment_n] =
                [position_m[mode] * f64x4::splat(0.125), moment_n].map(|v| self.rotation.tr_mul(&unpacked(v)));
            let work_j = amplitude_m.component_mul(&moment_n);
            along_j[j] += work_j[j] + 0.5 * work_j[other];
            along_j[k] += work_j[k] + 0.5 * work_j[other];
        }
        along_j
    }
}

/// Sums over the corners, each with the product of the corner's signs along the axes that are bits of the index.
fn modes(corners: &[f64x4; 8]) -> [f64x4; 8] {
    let mut modes = *corners;
    for bit in [1, 2, 4] {
        for corner in (0..8).filter(|corner| corner & bit == 0) {
            let (low, high) = (modes[corner], modes[corner | bit]);
            (modes[corner], modes[corner | bit]) = (low + high, high - low);
        }
    }
    modes
}

fn packed([x, y, z]: [f64; 3]) -> f64x4 {
    f64x4::new([x, y, z, 0.0])
}

fn unpacked(v: f64x4) -> Vec3 {
    let [x, y, z, _] = v.to_array();
    Vec3::new(x, y, z)
}
