//! What acts on a body from outside: gravity, forces and tractions, spread over the corners of its elements.

use super::Body;
use crate::Vec3;
use crate::grid::{Grid, Ijk, MaterialPoint, VoxelId, voxelize};
use crate::scene::{Face, LoadDesc, Meshes, ObjectDesc, SceneError};

/// What acts on a voxel besides its elasticity.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct VoxelLoad {
    /// Whether it is held where it was built.
    pub(super) held: bool,
    /// Whether it or one that it touches is held.
    pub(super) is_beside_held: bool,
    /// Force at the voxel's centre other than gravity, N.
    force_n: Vec3,
}

/// A traction's resultant on one face of a voxel. It acts at the face: half a voxel inside, a bar of
/// n voxels would stretch by (n - 1) / n of what it should.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaceLoad {
    voxel: VoxelId,
    face: Face,
    force_n: Vec3,
}

impl Body {
    /// Loads at the corners of an element, from gravity and its voxels' own forces.
    pub(super) fn element_loads(&self, voxels: &[VoxelId]) -> [[f64; 3]; 8] {
        let mut loads = [[0.0; 3]; 8];
        for &voxel in voxels {
            let weight = self.description.gravity_m_per_s2 * self.voxel_mass_kg(voxel);
            let force = weight + self.description.voxel_loads[voxel.index()].force_n;
            if force == Vec3::zeros() {
                continue;
            }
            // N at the centre is the mean of N over the voxel: trilinear along each axis.
            let position_m = self.state.grid.centre_m(self.state.grid.voxels()[voxel.index()].ijk);
            self.distribute(&mut loads, &MaterialPoint { position_m, voxel }, &force);
        }
        for &voxel in voxels {
            let first = self.description.face_loads.partition_point(|l| l.voxel < voxel);
            for load in self.description.face_loads[first..].iter().take_while(|l| l.voxel == voxel) {
                let (axis, step) = load.face.axis_and_step();
                let mut at = self.state.grid.centre_m(self.state.grid.voxels()[voxel.index()].ijk);
                at[axis] += 0.5 * f64::from(step) * self.state.grid.voxel_size_m();
                self.distribute(&mut loads, &MaterialPoint { position_m: at, voxel }, &load.force_n);
            }
        }
        loads
    }

    /// Sums the elements' loads at the nodes; what was put away bears none.
    pub(super) fn rebuild_external_forces(&mut self) {
        self.solver.external_n.clear();
        self.solver.external_n.resize(self.state.levels[0].nodes.len(), [0.0; 3]);
        let parts = &self.state.rigid;
        let elements = self.state.levels[0].elements.iter().zip(&self.solver.element_loads_n).enumerate();
        for (_, (element, loads)) in elements.filter(|(element, _)| !parts.is_away(*element)) {
            for (&node, load) in element.nodes.iter().zip(loads) {
                (0..3).for_each(|i| self.solver.external_n[node as usize][i] += load[i]);
            }
        }
    }

    /// Distributes a force at a material point over the corners of its element; what is held bears the rest.
    fn distribute(&self, loads: &mut [[f64; 3]; 8], point: &MaterialPoint, force_n: &Vec3) {
        for (load, n) in loads.iter_mut().zip(self.weights(point).weights) {
            (0..3).for_each(|i| load[i] += n * force_n[i]);
        }
    }
}

/// What the object's `fixed` and `loads` say of each voxel, and of faces of voxels.
pub(super) fn loads_of(
    grid: &Grid,
    object: &ObjectDesc,
    meshes: &Meshes,
) -> Result<(Vec<VoxelLoad>, Vec<FaceLoad>), SceneError> {
    let mut loads = vec![VoxelLoad::default(); grid.voxels().len()];
    let mut face_loads = Vec::new();
    for shape in &object.fixed {
        for voxel in voxelize::region_voxels(grid, shape, meshes)? {
            loads[voxel.index()].held = true;
        }
    }
    for index in 0..grid.voxels().len() {
        let cell = grid.voxels()[index].ijk;
        let mut around = (0..27).map(|n| [cell[0] - 1 + n % 3, cell[1] - 1 + n / 3 % 3, cell[2] - 1 + n / 9]);
        let is_held = |cell: Ijk| grid.voxel_at(cell).is_some_and(|voxel| loads[voxel.index()].held);
        loads[index].is_beside_held = around.any(is_held);
    }
    let h = grid.voxel_size_m();
    for load in &object.loads {
        match load {
            LoadDesc::BodyForce { region, force_n_per_m3 } => {
                for voxel in voxelize::region_voxels(grid, region, meshes)? {
                    loads[voxel.index()].force_n +=
                        Vec3::from(*force_n_per_m3) * (h.powi(3) * grid.filled_share(voxel));
                }
            }
            LoadDesc::Traction { region, face, traction_pa } => {
                let (axis, step) = face.axis_and_step();
                for voxel in voxelize::region_voxels(grid, region, meshes)? {
                    let mut beyond = grid.voxels()[voxel.index()].ijk;
                    beyond[axis] += step;
                    if grid.voxel_at(beyond).is_none() {
                        let filled = grid.filled_extents(voxel);
                        let across = filled[(axis + 1) % 3] * filled[(axis + 2) % 3];
                        face_loads.push(FaceLoad {
                            voxel,
                            face: *face,
                            force_n: Vec3::from(*traction_pa) * (h * h * across),
                        });
                    }
                }
            }
        }
    }
    face_loads.sort_by_key(|load: &FaceLoad| load.voxel);
    Ok((loads, face_loads))
}
