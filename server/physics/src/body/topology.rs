//! What happens when links part: only what changed is rebuilt.

use super::Body;
use crate::boundary::Solid;
use crate::fem::block::LANES;
use crate::grid::levels::{Level, LevelChange};
use crate::grid::units::VoxelUnits;
use crate::grid::{Crossing, Grid, Ijk, LEAST_PIECE_VOXELS, LinkId, VoxelId};
use crate::grow::grow;
use crate::solve::assembly::CHUNK_ELEMENTS;
use crate::workers::Workers;

/// What a topology update changed, for whoever follows the body from outside.
#[derive(Clone, Debug, Default)]
pub struct TopologyChange {
    /// Elements whose nodes or voxels changed, ascending; new ones included.
    pub elements: Vec<u32>,
    /// New nodes and the nodes they split from, ascending.
    pub split_nodes: Vec<(u32, u32)>,
    /// Voxels that moved to another element.
    pub rebound_voxels: Vec<VoxelId>,
}

/// What became of the links that a front crossed.
#[derive(Debug, Default)]
pub struct PartedLinks {
    /// Those that parted.
    pub parted: Vec<LinkId>,
    /// How many were spared.
    pub spared: usize,
}

/// Without repetitions, ascending.
fn sorted(mut elements: Vec<u32>) -> Vec<u32> {
    elements.sort_unstable();
    elements.dedup();
    elements
}

impl Body {
    /// Rebuilds parts, nodes, matrices and preconditioner after `parted` links were parted in the
    /// grid. New nodes start where the nodes they split from are, with their velocity, so nothing
    /// jumps.
    pub(crate) fn update_topology(&mut self, workers: &Workers<'_>, parted: &[LinkId]) -> TopologyChange {
        let changes = self.update_levels(parted);
        let base = &changes[0];
        self.state.boundary.follow(Solid { grid: &self.state.grid, level: &self.state.levels[0] }, parted, base);
        if base.touched_cells.is_empty() {
            return TopologyChange::default();
        }
        let nodes = self.base().nodes.len();
        grow(&mut self.state.position_m, nodes, [0.0; 3]);
        grow(&mut self.state.velocity_m_per_s, nodes, [0.0; 3]);
        for &(new, from) in &base.split_nodes {
            self.state.position_m[new as usize] = self.state.position_m[from as usize];
            self.state.velocity_m_per_s[new as usize] = self.state.velocity_m_per_s[from as usize];
        }
        self.resize_blocks();
        for &(new, from) in &base.split_elements {
            self.copy_state(from as usize, new as usize);
        }
        let mut about = self.held_beside(&base.touched_cells);
        about.extend(&base.changed_elements);
        let held_anew = self.find_held(&sorted(about));
        let elements = sorted([base.elements(), held_anew.clone()].concat());
        for element in sorted([base.changed_elements.clone(), held_anew.clone()].concat()) {
            self.rebuild_element(element as usize);
        }
        let renumbered = self.number_nodes(Some(&changes));
        let mut rigid = std::mem::take(&mut self.state.rigid);
        rigid.follow(self, base);
        self.state.rigid = rigid;
        self.rebuild_external_forces();
        let is_stale = |chunk: usize| {
            renumbered.binary_search(&chunk).is_ok() || held_anew.iter().any(|e| *e as usize / CHUNK_ELEMENTS == chunk)
        };
        self.evaluate_chunks(workers, is_stale, None, 2);
        for &element in &elements {
            self.write_matrix_of_changed(element as usize);
        }
        self.share_matrices_of(&elements);
        self.solver.multigrid.update_changed(&self.state.levels, &changes, &held_anew);
        self.solver.turned_rad = f64::INFINITY;
        self.save_state(workers);
        let rebound = base.split_elements.iter().map(|&(new, _)| new).chain(held_anew);
        let rebound_voxels = rebound.flat_map(|element| self.voxels_of(element as usize)).collect();
        TopologyChange { elements, split_nodes: base.split_nodes.clone(), rebound_voxels }
    }

    fn update_levels(&mut self, parted: &[LinkId]) -> Vec<LevelChange> {
        let exponent = self.state.levels[0].exponent;
        let telling = parted.iter().filter(|link| !self.is_bypassed(**link));
        let voxels: Vec<Ijk> = telling.flat_map(|link| [link.cell, link.upper()]).collect();
        let units = VoxelUnits { grid: &self.state.grid, exponent };
        let mut changes =
            vec![self.state.levels[0].update(&units, voxels.into_iter().map(|c| c.map(|x| x >> exponent)))];
        for i in 1..self.state.levels.len() {
            let touched = changes[i - 1].touched_cells.iter().map(|c| c.map(|x| x >> 1));
            let (below, above) = self.state.levels.split_at_mut(i);
            let child: &Level = &below[i - 1];
            let change = above[0].update(child, touched);
            changes.push(change);
        }
        changes
    }

    /// Whether, beside a link that was parted, intact ones go around it from element to element as it did: of what
    /// holds together nothing has changed then. Along a front that goes on by a voxel this is so nearly everywhere.
    fn is_bypassed(&self, link: LinkId) -> bool {
        let ends = [link.cell, link.upper()];
        let owner = |cell: Ijk| self.state.grid.voxel_at(cell).map(|voxel| self.element_of(voxel));
        let aside = (0..3u8).filter(|axis| *axis != link.axis).flat_map(|axis| [(axis, -1), (axis, 1)]);
        aside.into_iter().any(|(axis, step)| {
            let beside = ends.map(|mut cell| {
                cell[axis as usize] += step;
                cell
            });
            let is_joined = |end: usize| {
                let lower = if step > 0 { ends[end] } else { beside[end] };
                self.state.grid.is_intact(LinkId { cell: lower, axis }) && owner(ends[end]) == owner(beside[end])
            };
            self.state.grid.is_intact(LinkId { cell: beside[0], axis: link.axis }) && is_joined(0) && is_joined(1)
        })
    }

    fn copy_state(&mut self, from: usize, to: usize) {
        let rotation = self.state.elements[from / LANES].rotation.map(|q| q.as_array()[from % LANES]);
        for (slot, value) in self.state.elements[to / LANES].rotation.iter_mut().zip(rotation) {
            slot.as_mut_array()[to % LANES] = value;
        }
        self.copy_memory(from, to);
    }

    fn write_matrix_of_changed(&mut self, element: usize) {
        self.write_matrix(element);
        self.solver.coarse_stiffening[element] = self.solver.applied_stiffening[element];
    }

    /// Parts those of `links` that are intact, but for the ones that would set free a piece of fewer
    /// than [`LEAST_PIECE_VOXELS`]: such a piece stays with what it held on to last, so that a cut that
    /// grazes a surface goes around its outermost voxels.
    pub(crate) fn part_links(&mut self, links: &[(LinkId, Crossing)]) -> PartedLinks {
        let grid: &mut Grid = &mut self.state.grid;
        let crossed: Vec<LinkId> = links.iter().filter(|(l, c)| grid.part(*l, *c)).map(|(l, _)| *l).collect();
        let mut spared = Vec::new();
        for end in crossed.iter().flat_map(|link| [link.cell, link.upper()]) {
            let Some(piece) = grid.small_piece(end, LEAST_PIECE_VOXELS) else { continue };
            let first = spared.len();
            spared.extend(crossed.iter().filter(|l| piece.contains(&l.cell) != piece.contains(&l.upper())));
            spared[first..].iter().for_each(|link| grid.rejoin(*link));
        }
        let parted = crossed.into_iter().filter(|link| !spared.contains(link)).collect();
        PartedLinks { parted, spared: spared.len() }
    }
}
