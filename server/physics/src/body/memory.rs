//! What a body remembers of its strain: the branches of its elements that relax in time.

use super::Body;
use crate::fem::block::LANES;
use crate::fem::viscosity::{Viscosity, ViscosityBlock};
use crate::grid::VoxelId;
use crate::workers::Workers;

impl Body {
    /// Whether any material relaxes in time.
    pub(super) fn is_viscous(&self) -> bool {
        self.description.materials.iter().any(|m| m.law.viscosity.is_some())
    }

    /// Fraction of the relaxing modulus that an element still shows: 1 at its first strain, 0 after a long hold.
    #[must_use]
    pub(crate) fn unrelaxed_share(&self, element: usize) -> f64 {
        let branch = self.state.elements[element / LANES].branch.as_ref();
        branch.map_or(0.0, |branch| branch.unrelaxed.as_array()[element % LANES])
    }

    /// The branch of an element's voxels side by side: under one strain the moduli of their branches add
    /// up, and so do their viscosities, modulus times relaxation time. So the element is as stiff
    /// against a jolt and dissipates as much under slow strain as they do; between the two a mixture has
    /// a spectrum that one branch cannot have.
    pub(super) fn mean_viscosity(&self, voxels: &[VoxelId]) -> Option<Viscosity> {
        let (mut elastic, mut relaxing, mut viscous) = (0.0, 0.0, 0.0);
        for material in voxels.iter().map(|v| self.material_of(*v)) {
            elastic += material.young_modulus_pa;
            if let Some(viscosity) = &material.law.viscosity {
                let modulus_pa = viscosity.modulus_ratio * material.young_modulus_pa;
                relaxing += modulus_pa;
                viscous += modulus_pa * viscosity.relaxation_time_s;
            }
        }
        (relaxing > 0.0).then(|| Viscosity { modulus_ratio: relaxing / elastic, relaxation_time_s: viscous / relaxing })
    }

    /// Hands an element's memory to one that split from it.
    pub(super) fn copy_memory(&mut self, from: usize, to: usize) {
        if let Some(source) = self.state.elements[from / LANES].branch.clone() {
            let target = self.state.elements[to / LANES].branch.get_or_insert_default();
            target.copy_lane(to % LANES, &source, from % LANES);
        }
    }

    /// Takes the branches out of the elements: without them these are as at the end of all relaxation.
    pub(super) fn set_viscosity_aside(&mut self) -> Vec<Option<Box<ViscosityBlock>>> {
        let blocks = if self.is_viscous() { &mut self.solver.blocks[..] } else { &mut [] };
        blocks.iter_mut().map(|block| block.viscosity.take()).collect()
    }

    /// Puts them back, relaxed at the current state.
    pub(super) fn take_relaxed(&mut self, workers: &Workers<'_>, viscosity: Vec<Option<Box<ViscosityBlock>>>) {
        if viscosity.is_empty() {
            return;
        }
        for (block, viscosity) in self.solver.blocks.iter_mut().zip(viscosity) {
            block.viscosity = viscosity;
        }
        self.evaluate(workers, 20);
        self.state.elements.iter_mut().filter_map(|state| state.branch.as_mut()).for_each(|branch| branch.relax());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = r#"
version = 1
name = "block"
[[objects]]
name = "block"
shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.08, 0.04, 0.04] } }
voxel_size_m = 0.01
level = 0
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
[[objects.regions]]
name = "far half"
shape = { box = { min_m = [0.04, -1.0, -1.0], max_m = [1.0, 1.0, 1.0] } }
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
"#;

    #[test]
    fn only_elements_that_relax_store_anything() {
        let viscous = "poisson_ratio = 0.4, viscosity = { relaxation_time_s = 0.1, relaxing_modulus_ratio = 0.5 } }";
        let (start, end) = SCENE.rsplit_once("poisson_ratio = 0.4 }").unwrap();
        for (text, is_viscous) in [(SCENE.to_owned(), false), (format!("{start}{viscous}{end}"), true)] {
            let body = Body::of_text(&text);
            for (block, data) in body.solver.blocks.iter().enumerate() {
                let elements = block * LANES..body.base().elements.len().min((block + 1) * LANES);
                let relaxes = is_viscous && elements.clone().any(|e| body.rest_centre_m(e).x > 0.04);
                assert_eq!(data.viscosity.is_some(), relaxes, "block {block}");
                assert_eq!(body.state.elements[block].branch.is_some(), relaxes, "block {block}");
            }
            let with = body.state.elements.iter().filter(|s| s.branch.is_some()).count();
            assert_eq!(with > 0, is_viscous, "{with} blocks have a branch");
            assert!(with < body.state.elements.len(), "all {with} blocks have one");
        }
    }
}
