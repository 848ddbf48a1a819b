//! What acts on a body from outside: gravity, forces and tractions, spread over the corners of its elements.

use super::Body;
use crate::Vec3;
use crate::grid::{Grid, MaterialPoint, VoxelId, voxelize};
use crate::grow::grow;
use crate::scene::{Face, LoadDesc, Meshes, ObjectDesc, SceneError};
use std::collections::BTreeMap;

/// Whether a voxel is held where it was built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Hold {
    /// Neither it nor one that it touches.
    Free,
    /// One that it touches is.
    Beside,
    /// It is.
    Held,
}

/// A force at a voxel's centre other than gravity.
#[derive(Clone, Copy, Debug)]
pub(super) struct VoxelLoad {
    voxel: VoxelId,
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

/// What the object's `fixed` and `loads` say.
pub(super) struct Loads {
    /// By voxel.
    pub(super) holds: Vec<Hold>,
    /// By voxel, ascending.
    pub(super) of_voxels: Vec<VoxelLoad>,
    /// By voxel, ascending.
    pub(super) of_faces: Vec<FaceLoad>,
}

impl Body {
    /// Loads at the corners of an element, from gravity and its voxels' own forces.
    pub(super) fn element_loads(&self, voxels: &[VoxelId]) -> [[f64; 3]; 8] {
        let mut loads = [[0.0; 3]; 8];
        for &voxel in voxels {
            let weight = self.description.gravity_m_per_s2 * self.voxel_mass_kg(voxel);
            let own = self.description.voxel_loads.binary_search_by_key(&voxel, |load| load.voxel);
            let force = weight + own.map_or(Vec3::zeros(), |found| self.description.voxel_loads[found].force_n);
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
        grow(&mut self.solver.external_n, self.state.levels[0].nodes.len(), [0.0; 3]);
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
pub(super) fn loads_of(grid: &Grid, object: &ObjectDesc, meshes: &Meshes) -> Result<Loads, SceneError> {
    let mut holds = vec![Hold::Free; grid.voxels().len()];
    for shape in &object.fixed {
        for voxel in voxelize::region_voxels(grid, shape, meshes)? {
            holds[voxel.index()] = Hold::Held;
        }
    }
    for (index, voxel) in grid.voxels().iter().enumerate() {
        let is_held = |beside: VoxelId| holds[beside.index()] == Hold::Held;
        if holds[index] == Hold::Free && grid.voxels_around(voxel.ijk).any(is_held) {
            holds[index] = Hold::Beside;
        }
    }
    let mut forces_n = BTreeMap::<VoxelId, Vec3>::new();
    let mut of_faces = Vec::new();
    let h = grid.voxel_size_m();
    for load in &object.loads {
        match load {
            LoadDesc::BodyForce { region, force_n_per_m3 } => {
                for voxel in voxelize::region_voxels(grid, region, meshes)? {
                    *forces_n.entry(voxel).or_default() +=
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
                        of_faces.push(FaceLoad {
                            voxel,
                            face: *face,
                            force_n: Vec3::from(*traction_pa) * (h * h * across),
                        });
                    }
                }
            }
        }
    }
    of_faces.sort_by_key(|load: &FaceLoad| load.voxel);
    let of_voxels = forces_n.into_iter().map(|(voxel, force_n)| VoxelLoad { voxel, force_n }).collect();
    Ok(Loads { holds, of_voxels, of_faces })
}
