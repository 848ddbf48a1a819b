//! What an element contributes to the energy release rate of a crack: Eshelby's energy-momentum (1975).

use super::Body;
use crate::fem::corotation::LANES;
use crate::{Mat3, Vec3};

/// Bilinear functions of a cell: the pair of axes along which their gradient is linear, and the third.
const BILINEAR: [[usize; 3]; 3] = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];

/// An element as its nodes see it.
struct Corners {
    /// Positions, m, scene frame.
    position_m: [Vec3; 8],
    /// Forces that deform the element, N, scene frame.
    force_n: [Vec3; 8],
    /// Shape gradients averaged over the filled volume, 1/m.
    mean_gradient: [Vec3; 8],
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
        let hold_n = self.hold_forces_n(element);
        let push_n = |a: usize| corners.force_n[a] - Vec3::from(self.element_loads_n[element][a]) - hold_n[a];
        let push_n: Vec3 = (0..8).map(|a| push_n(a) * phi[a]).sum();
        let slope: Vec3 = corners.mean_gradient.iter().zip(phi).map(|(g, p)| g * *p).sum();
        let direction = corners.position_m.iter().zip(&corners.mean_gradient).map(|(x, g)| x * g.dot(d)).sum::<Vec3>();
        let bent_j = corners.bilinear_work_j().component_mul(&slope).dot(d);
        let elastic_j = self.elastic_energy_j(element);
        let released_j = push_n.dot(&direction) + bent_j - elastic_j * slope.dot(d);
        Moved { released_j, push_n, direction, slope, elastic_j }
    }

    /// Elastic energy of an element, J; of relaxing materials, what does not relax.
    pub(crate) fn elastic_energy_j(&self, element: usize) -> f64 {
        self.states[element / LANES].elastic_j.as_array()[element % LANES]
    }

    /// Filled volume of an element, m^3.
    pub(crate) fn filled_volume_m3(&self, element: usize) -> f64 {
        self.blocks[element / LANES].shapes.volume_m3.as_array()[element % LANES]
    }

    /// Shape gradients averaged over the filled volume of an element, 1/m.
    pub(super) fn mean_gradient_per_m(&self, element: usize) -> [Vec3; 8] {
        let gradient = &self.blocks[element / LANES].shapes.mean_gradient;
        gradient.each_ref().map(|g| Vec3::from(g.each_ref().map(|v| v.as_array()[element % LANES])))
    }

    /// `V sigma` of an element, in the frame that turns with it, J.
    pub(super) fn element_stress_j(&self, element: usize) -> Mat3 {
        let Corners { position_m, force_n, rotation, .. } = self.corners(element);
        let virial: Mat3 = force_n.iter().zip(&position_m).map(|(f, x)| f * x.transpose()).sum();
        rotation.transpose() * ((virial + virial.transpose()) * 0.5) * rotation
    }

    fn corners(&self, element: usize) -> Corners {
        let (block, state, lane) = (&self.blocks[element / LANES], &self.states[element / LANES], element % LANES);
        let at = |v: &wide::f64x4| v.as_array()[lane];
        let [x, y, z, w] = state.rotation.each_ref().map(at);
        Corners {
            position_m: self.base().elements[element].nodes.map(|n| Vec3::from(self.position_m[n as usize])),
            force_n: std::array::from_fn(|a| -Vec3::from_fn(|i, _| at(&state.force_n[3 * a + i]))),
            mean_gradient: self.mean_gradient_per_m(element),
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
        let mut along_j = Vec3::zeros();
        for [j, k, other] in BILINEAR {
            let side = |a: usize, axis: usize| (a >> axis & 1) as f64 * 2.0 - 1.0;
            let sign = |a: usize| side(a, j) * side(a, k);
            // Less the linear part with the same mean gradient: a constant stress does no work on the rest.
            let slope: Vec3 = (0..8).map(|a| self.mean_gradient[a] * sign(a)).sum::<Vec3>() * (0.5 * self.edge_m);
            let rest = |a: usize| sign(a) - slope.x * side(a, 0) - slope.y * side(a, 1) - slope.z * side(a, 2);
            let amplitude_m: Vec3 = (0..8).map(|a| self.position_m[a] * (sign(a) / 8.0)).sum();
            let moment_n: Vec3 = (0..8).map(|a| self.force_n[a] * rest(a)).sum();
            let work_j = self.rotation.tr_mul(&amplitude_m).component_mul(&self.rotation.tr_mul(&moment_n));
            along_j[j] += work_j[j] + 0.5 * work_j[other];
            along_j[k] += work_j[k] + 0.5 * work_j[other];
        }
        along_j
    }
}
