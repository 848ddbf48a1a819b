//! What an element contributes to the energy release rate of a crack: Eshelby's energy-momentum (1975).

use super::Body;
use crate::fem::corotation::LANES;
use crate::{Mat3, Vec3};

/// Bilinear functions of a cell: the pair of axes along which their gradient is linear, and the third.
const BILINEAR: [[usize; 3]; 3] = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];

/// An element as its nodes see it, in the frame that turns with it.
pub(super) struct Corners {
    /// Positions, m.
    pub(super) position_m: [Vec3; 8],
    /// Positions at rest from the cell's middle, m.
    rest_m: [Vec3; 8],
    /// Shape gradients averaged over the filled volume, 1/m.
    mean_gradient: [Vec3; 8],
    /// Forces that deform the element, N.
    pub(super) force_n: [Vec3; 8],
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
        let push_n =
            |a: usize| corners.rotation * corners.force_n[a] - Vec3::from(self.element_loads_n[element][a]) - hold_n[a];
        let push_n: Vec3 = (0..8).map(|a| push_n(a) * phi[a]).sum();
        let slope: Vec3 = corners.mean_gradient.iter().zip(phi).map(|(g, p)| g * *p).sum();
        let direction = corners.rotation * (corners.gradient() * d);
        let bent_j = corners.bilinear_work_j().component_mul(&slope).dot(d);
        let elastic_j = corners.half_work_j() - self.stiffening_surplus_j(element);
        let released_j = push_n.dot(&direction) + bent_j - elastic_j * slope.dot(d);
        Moved { released_j, push_n, direction, slope, elastic_j }
    }

    /// Elastic energy of an element, J; of relaxing materials, what does not relax.
    pub(crate) fn elastic_energy_j(&self, element: usize) -> f64 {
        self.corners(element).half_work_j() - self.stiffening_surplus_j(element)
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

    pub(super) fn corners(&self, element: usize) -> Corners {
        let (block, state, lane) = (&self.blocks[element / LANES], &self.states[element / LANES], element % LANES);
        let at = |v: &wide::f64x4| v.as_array()[lane];
        let [x, y, z, w] = state.rotation.each_ref().map(at);
        let rotation: Mat3 = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
            .to_rotation_matrix()
            .into_inner();
        let nodes = self.base().elements[element].nodes.map(|n| Vec3::from(self.position_m[n as usize]));
        let middle_m = nodes.iter().sum::<Vec3>() / 8.0;
        let edge_m = at(&block.shapes.edge_m);
        Corners {
            position_m: nodes.map(|x| rotation.tr_mul(&(x - middle_m))),
            rest_m: std::array::from_fn(|a| Vec3::from_fn(|i, _| ((a >> i & 1) as f64 - 0.5) * edge_m)),
            mean_gradient: self.mean_gradient_per_m(element),
            force_n: std::array::from_fn(|a| -rotation.tr_mul(&Vec3::from_fn(|i, _| at(&state.force_n[3 * a + i])))),
            rotation,
        }
    }

    /// What `f . u / 2` counts too much of the energy of an element that stiffens: `V (psi' w - psi)`.
    fn stiffening_surplus_j(&self, element: usize) -> f64 {
        let (block, state, lane) = (&self.blocks[element / LANES], &self.states[element / LANES], element % LANES);
        let rate = block.stiffening.as_ref().map_or(0.0, |s| s.rate_per_pa.as_array()[lane]);
        if rate == 0.0 {
            return 0.0;
        }
        let (z, slope) = (state.stiffening.ln().as_array()[lane], state.stiffening.as_array()[lane]);
        self.filled_volume_m3(element) * (slope * z - slope + 1.0) / rate
    }
}

impl Corners {
    /// Mean deformation gradient in the element's frame.
    fn gradient(&self) -> Mat3 {
        self.position_m.iter().zip(&self.mean_gradient).map(|(x, g)| x * g.transpose()).sum()
    }

    /// Half of the forces' work from rest, J.
    fn half_work_j(&self) -> f64 {
        0.5 * (0..8).map(|a| self.force_n[a].dot(&(self.position_m[a] - self.rest_m[a]))).sum::<f64>()
    }

    /// Work of the stress on what the bilinear displacements strain along each axis, J.
    fn bilinear_work_j(&self) -> Vec3 {
        let mut along_j = Vec3::zeros();
        for [j, k, other] in BILINEAR {
            let sign = |a: usize| ((a >> j & 1) as f64 * 2.0 - 1.0) * ((a >> k & 1) as f64 * 2.0 - 1.0);
            // Less the linear part with the same mean gradient: a constant stress does no work on the rest.
            let slope: Vec3 = (0..8).map(|a| self.mean_gradient[a] * sign(a)).sum();
            let amplitude: Vec3 = (0..8).map(|a| self.position_m[a] * (sign(a) / 8.0)).sum();
            let moment: Vec3 = (0..8).map(|a| self.force_n[a] * (sign(a) - slope.dot(&self.rest_m[a]))).sum();
            let work_j = amplitude.component_mul(&moment);
            along_j[j] += work_j[j] + 0.5 * work_j[other];
            along_j[k] += work_j[k] + 0.5 * work_j[other];
        }
        along_j
    }
}
