//! What lies beneath an object's surface: its voxels, the links between them, and the energy they hold.

use super::World;
use crate::grid::{Link, LinkId, MaterialPoint, VoxelId};

/// The inside of one object after a step. Voxels are told by their place in `voxel_positions_m`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Interior {
    /// Steps taken.
    pub step: u64,
    /// Changes of the structure since the scene was at rest.
    pub topology_version: u64,
    /// Where the middle of each voxel is now, m, scene frame.
    pub voxel_positions_m: Vec<[f32; 3]>,
    /// Composite element of each voxel, a place in `element_energies_j_per_m3`.
    pub voxel_elements: Vec<u32>,
    /// Elastic energy of each composite element over what it has of volume, J/m^3; of relaxing materials, what does not
    /// relax. A link holds the mean of its ends' times the edge of a voxel, J/m^2: it stands for a layer of that depth.
    pub element_energies_j_per_m3: Vec<f32>,
    /// Ends of each link that holds.
    pub intact_links: Vec<[u32; 2]>,
    /// Ends of each link that has parted.
    pub parted_links: Vec<[u32; 2]>,
}

impl World {
    /// The inside of an object as the last step left it: about 0.2 us a voxel.
    #[must_use]
    pub fn interior(&self, object: usize) -> Interior {
        let body = &self.state.slots[object].body;
        let grid = &body.state.grid;
        let mut interior = Interior {
            step: self.state.step,
            topology_version: self.state.topology_version,
            element_energies_j_per_m3: (0..body.base().elements.len())
                .map(|element| (body.elastic_energy_j(element) / body.filled_volume_m3(element)) as f32)
                .collect(),
            ..Interior::default()
        };
        for (index, voxel) in grid.voxels().iter().enumerate() {
            let id = VoxelId(index as u32);
            let middle = MaterialPoint { position_m: grid.centre_m(voxel.ijk), voxel: id };
            interior.voxel_positions_m.push(body.current_m(&middle).map(|x| x as f32).into());
            interior.voxel_elements.push(body.element_of(id) as u32);
            for axis in 0..3 {
                let link = LinkId { cell: voxel.ijk, axis };
                let Some(upper) = grid.voxel_at(link.upper()) else { continue };
                let links = match grid.link(link) {
                    Link::Intact => &mut interior.intact_links,
                    _ => &mut interior.parted_links,
                };
                links.push([id.0, upper.0]);
            }
        }
        interior
    }
}
