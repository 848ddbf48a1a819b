//! Matrices of a composite element of one anisotropic material, whatever its voxels are.
//!
//! The volumetric part of the moduli is integrated at the voxels' centres and the rest fully, and the
//! incompatible modes are the same: for an isotropic material this is the element of
//! [`super::composite`].

use super::composite::{CompositeTables, Field, FilledVoxel, MODES, Sums, measured_share};
use super::material::Elastic;
use super::matrices::{DOFS, ElementMatrices, Matrix24};
use nalgebra::{Matrix6, Vector6};

/// Stiffness of a material, Pa, by xx, yy, zz, yz, zx, xy; shears are engineering strains.
pub type Moduli = Matrix6<f64>;

/// Row of [`Moduli`] by the two axes of a strain.
const VOIGT: [[usize; 3]; 3] = [[0, 5, 4], [5, 1, 3], [4, 3, 2]];

/// The part `lambda` of the moduli that is volumetric, `C = rest + lambda m m^T`, m the identity: the mean
/// of the axial couplings, which is Lame's for an isotropic material, and no more than leaves the rest
/// definite: up to `1 / m^T C^-1 m` it is positive (by the determinant of a rank-one change), and Lame's
/// parameter is two thirds of the shear modulus below that.
fn volumetric_share_pa(moduli: &Moduli) -> f64 {
    let mean = (moduli[(0, 1)] + moduli[(0, 2)] + moduli[(1, 2)]) / 3.0;
    let trace = Vector6::new(1.0, 1.0, 1.0, 0.0, 0.0, 0.0);
    let bulk = moduli.cholesky().map_or(0.0, |c| 1.0 / trace.dot(&c.solve(&trace)));
    let least = moduli.symmetric_eigenvalues().min();
    mean.min(bulk - 2.0 / 3.0 * least).max(0.0)
}

impl CompositeTables {
    /// Matrices of an element whose `voxels` all have the stiffness
    /// `moduli`; their own materials say how heavy they are.
    #[must_use]
    pub fn assemble_uniform(&self, voxels: &[FilledVoxel], moduli: &Moduli) -> ElementMatrices {
        let lambda_pa = volumetric_share_pa(moduli);
        let unit: Vec<_> = voxels
            .iter()
            .map(|v| FilledVoxel { elastic: Elastic { mu_pa: 1.0, lambda_pa, ..v.elastic }, ..*v })
            .collect();
        let shear_pa = (3..6).map(|i| moduli[(i, i)]).sum::<f64>() / 3.0;
        let mut sums = Sums::over(self, &unit);
        // The sums took the unit modulus for the material's.
        let measured = measured_share(shear_pa, lambda_pa) / measured_share(1.0, lambda_pa);
        sums.volumetric_measured.as_flattened_mut().iter_mut().for_each(|k| *k *= measured);
        let mut rest = *moduli;
        rest.fixed_view_mut::<3, 3>(0, 0).add_scalar_mut(-lambda_pa);
        contract(&mut sums, &rest);
        self.matrices(sums, Field::IncompatibleModes, shear_pa)
    }
}

/// Replaces the shear's sums, for a modulus of 1, by those for `moduli`: `sum_pq c_ipkq int A_p B_q` for gradients
/// `e_i (x) A` and `e_k (x) B`.
fn contract(sums: &mut Sums, moduli: &Moduli) {
    let c = |i: usize, p: usize, k: usize, q: usize| moduli[(VOIGT[i][p], VOIGT[k][q])];
    let unit_shear = std::mem::replace(&mut sums.shear, Box::new([[0.0; DOFS]; DOFS]));
    for a in 0..8 {
        for b in 0..8 {
            let product = gradient_product(&unit_shear, a, b);
            for (i, k) in pairs() {
                sums.shear[3 * a + i][3 * b + k] = pairs().map(|(p, q)| c(i, p, k, q) * product[p][q]).sum();
            }
        }
        // A shear modulus of 1 couples the corner's component i with mode (j, i') by delta_ii' int A_j s_j
        // + delta_ij int A_i' s_j.
        let unit: [[f64; MODES]; 3] = [0, 1, 2].map(|i| sums.coupling[3 * a + i]);
        let with_mode = |p: usize, j: usize| unit[j][3 * j + p] / if p == j { 2.0 } else { 1.0 };
        for i in 0..3 {
            for (j, k) in pairs() {
                sums.coupling[3 * a + i][3 * j + k] = (0..3).map(|p| c(i, p, k, j) * with_mode(p, j)).sum();
            }
        }
    }
    let unit = sums.modes;
    for (j, k) in pairs() {
        for (l, m) in pairs() {
            let product = unit[3 * j + l][3 * l + j] / if j == l { 2.0 } else { 1.0 };
            sums.modes[3 * j + k][3 * l + m] = c(k, j, m, l) * product;
        }
    }
}

/// `int dN_a/dx_p dN_b/dx_q` from the stiffness for a shear modulus of 1, whose block (a, b) is
/// `delta_ik tr(product) + product_ki`: its trace is four times the product's.
fn gradient_product(unit: &Matrix24, a: usize, b: usize) -> [[f64; 3]; 3] {
    let block = |i: usize, k: usize| unit[3 * a + i][3 * b + k];
    let trace = 0.25 * (block(0, 0) + block(1, 1) + block(2, 2));
    std::array::from_fn(|p| std::array::from_fn(|q| block(q, p) - if p == q { trace } else { 0.0 }))
}

fn pairs() -> impl Iterator<Item = (usize, usize)> {
    (0..9).map(|n| (n / 3, n % 3))
}

/// Moduli of an isotropic material.
#[cfg(test)]
pub(super) fn isotropic(elastic: &Elastic) -> Moduli {
    let mut moduli = Moduli::from_diagonal_element(elastic.mu_pa);
    moduli.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(2.0 * elastic.mu_pa);
    moduli.fixed_view_mut::<3, 3>(0, 0).add_scalar_mut(elastic.lambda_pa);
    moduli
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_laminate_with_soft_layers_has_no_soft_direction_of_its_own() {
        // Layers across y: stiff along, 1e-6 across, nu 0.45 in both.
        let (mut moduli, soft) = (isotropic(&Elastic::new(1.0, 0.45, 1.0)), isotropic(&Elastic::new(1e-6, 0.45, 1.0)));
        for axis in [1, 3, 5] {
            moduli.set_row(axis, &soft.row(axis));
            moduli.set_column(axis, &soft.column(axis));
        }
        let tables = CompositeTables::new(2, 0.01);
        let voxels: Vec<_> = (0..64).map(|v| FilledVoxel::whole(v, Elastic::new(1.0, 0.45, 1.0))).collect();
        let stiffness = tables.assemble_uniform(&voxels, &moduli).stiffness;
        let matrix = nalgebra::SMatrix::<f64, DOFS, DOFS>::from_fn(|row, column| stiffness[row][column]);
        let mut eigenvalues: Vec<f64> = matrix.symmetric_eigenvalues().iter().copied().collect();
        eigenvalues.sort_by(f64::total_cmp);
        // After the six of rigid motion none is below what the soft material gives an edge of 4 cm.
        assert!(eigenvalues[5].abs() < 1e-12 && eigenvalues[6] > 1e-2 * 1e-6 * 0.04, "{eigenvalues:?} N/m");
    }

    #[test]
    fn an_isotropic_material_gives_the_element_of_its_voxels() {
        for (exponent, poisson) in [(1, 0.3), (2, 0.49)] {
            let tables = CompositeTables::new(exponent, 0.01);
            let elastic = Elastic::new(1e6, poisson, 1000.0);
            for step in [1, 3] {
                let voxels: Vec<_> =
                    (0..1 << (3 * exponent)).step_by(step).map(|v| FilledVoxel::whole(v, elastic)).collect();
                let expected = tables.assemble(&voxels, Field::IncompatibleModes);
                let found = tables.assemble_uniform(&voxels, &isotropic(&elastic));
                let largest = expected.stiffness.as_flattened().iter().fold(0.0, |m: f64, k| m.max(k.abs()));
                for (found, expected) in
                    [(&found.stiffness, &expected.stiffness), (&found.stiffness_measured, &expected.stiffness_measured)]
                {
                    for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
                        assert!((found - expected).abs() < 1e-11 * largest, "{found} against {expected} N/m");
                    }
                }
                assert_eq!(found.mass_kg, expected.mass_kg);
            }
        }
    }
}
