//! Which element a composite cell gets, and its matrices.

use super::Body;
use crate::fem::anisotropic::Moduli;
use crate::fem::composite::{CompositeTables, Field, FilledVoxel};
use crate::fem::homogenise::{apparent_moduli, periodic_moduli};
use crate::fem::material::Elastic;
use crate::fem::matrices::ElementMatrices;
use crate::grid::VoxelId;
use crate::scene::ElementKind;
use std::collections::BTreeMap;

/// Ratio of shear moduli within a cell below which its own voxels' element always serves. Layers at this
/// ratio leave that element three times too stiff across them.
const CONTRAST: f64 = 10.0;
/// How many times as stiff as the softest material of a cell the others count at most. Ours: where one sheet or fibre of a
/// cell is a million times as stiff as the rest, what its turning adds to the forces makes energy (`make extremes`).
pub const MOST_CONTRAST: f64 = 1e3;
/// How much stiffer than the periodic material a cell's element may be under any uniform strain. The bars of layers and
/// inclusions of `elements::`, at a contrast of 100, are the same from 1.2 to 2.5: their cells exceed all of these.
const MOST_EXCESS_STIFFNESS: f64 = 1.5;

/// Moduli of the patterns of materials met so far; `None` where the voxels' own element serves. Layered
/// cells repeat a few patterns; there are never more than the body's cells.
#[derive(Clone, Default)]
pub(super) struct Homogenised(BTreeMap<Vec<u16>, Option<Moduli>>);

impl Body {
    pub(super) fn element_matrices(&mut self, element: usize, voxels: &[VoxelId]) -> ElementMatrices {
        let moduli = match self.description.element_kind {
            ElementKind::Galerkin | ElementKind::IncompatibleModes => None,
            ElementKind::ByContent | ElementKind::Homogenised => self.homogenised_moduli(element),
        };
        let tables = &self.description.tables[self.base().elements[element].size.ilog2() as usize];
        let most_pa = self.most_shear_modulus_pa(voxels.iter().map(|v| self.state.grid.voxels()[v.index()].material));
        let position = |v: VoxelId| tables.position(self.state.grid.voxels()[v.index()].ijk);
        let filled: Vec<_> = voxels
            .iter()
            .map(|&v| FilledVoxel {
                position: position(v),
                elastic: self.material_of(v).elastic.at_most(most_pa),
                share: self.state.grid.filled_share(v),
            })
            .collect();
        match (moduli, self.description.element_kind) {
            (Some(moduli), _) => tables.assemble_uniform(&filled, &moduli),
            (None, ElementKind::Galerkin) => tables.assemble(&filled, Field::Trilinear),
            (None, _) => tables.assemble(&filled, Field::IncompatibleModes),
        }
    }

    /// Moduli of an element's cell, where they are to replace its voxels' own.
    fn homogenised_moduli(&mut self, element: usize) -> Option<Moduli> {
        if self.description.materials.len() == 1 {
            return None;
        }
        let pattern = self.whole_cell(element)?;
        let alike = pattern.iter().all(|m| *m == pattern[0]);
        if alike {
            return None;
        }
        if let Some(known) = self.solver.homogenised.0.get(&pattern) {
            return *known;
        }
        let tables = &self.description.tables[self.base().elements[element].size.ilog2() as usize];
        let most_pa = self.most_shear_modulus_pa(pattern.iter().copied());
        let elastic: Vec<Elastic> = self.description.materials.iter().map(|m| m.elastic.at_most(most_pa)).collect();
        let moduli = match self.description.element_kind {
            ElementKind::Homogenised => Some(periodic_moduli(self.element_level(element), &pattern, &elastic)),
            _ => chosen_moduli(tables, self.element_level(element), &pattern, &elastic),
        };
        self.solver.homogenised.0.insert(pattern, moduli);
        moduli
    }

    /// What voxels of a cell count with at most, if these are its materials.
    pub(super) fn most_shear_modulus_pa(&self, materials: impl Iterator<Item = u16>) -> f64 {
        let moduli = materials.map(|m| self.description.materials[m as usize].elastic.mu_pa);
        MOST_CONTRAST * moduli.fold(f64::INFINITY, f64::min)
    }

    /// Materials of all voxels of an element's cell, parted or not, by table position; `None` where the body
    /// does not fill the cell.
    fn whole_cell(&self, element: usize) -> Option<Vec<u16>> {
        let (base, edge) = (self.base(), 1 << self.element_level(element));
        let low = base.elements[element].cell.map(|c| c << base.exponent);
        let at = |n: i32| [low[0] + n % edge, low[1] + n / edge % edge, low[2] + n / edge / edge];
        (0..edge * edge * edge)
            .map(|n| Some(self.state.grid.voxels()[self.state.grid.voxel_at(at(n))?.index()].material))
            .collect()
    }
}

/// The periodic material's moduli where the voxels' element is too stiff for it.
fn chosen_moduli(tables: &CompositeTables, exponent: u8, pattern: &[u16], elastic: &[Elastic]) -> Option<Moduli> {
    let shear = || pattern.iter().map(|m| elastic[*m as usize].mu_pa);
    let (least, most) = shear().fold((f64::MAX, 0.0f64), |(least, most), mu| (least.min(mu), most.max(mu)));
    if most < CONTRAST * least {
        return None;
    }
    let voxels: Vec<_> =
        pattern.iter().enumerate().map(|(at, m)| FilledVoxel::whole(at, elastic[*m as usize])).collect();
    let element = tables.assemble(&voxels, Field::IncompatibleModes);
    let apparent = apparent_moduli(&element.stiffness, element.volume_m3.cbrt());
    let moduli = periodic_moduli(exponent, pattern, elastic);
    // The largest ratio of the energies over all strains: the largest eigenvalue of L^-1 C L^-T.
    let lower = moduli.cholesky()?.l().try_inverse()?;
    let excess = (lower * apparent * lower.transpose()).symmetric_eigenvalues().max();
    (excess > MOST_EXCESS_STIFFNESS).then_some(moduli)
}
