//! Matrices of a composite element, built from the fine voxels that fill it.
//!
//! Element kind IM9+SRI: trilinear displacement plus nine incompatible modes
//! `P_j = 1 - xi_j^2` per direction, the shear part of the energy integrated fully, the volumetric
//! part at the voxel centres. From each mode the linear part with the same mean gradient over the
//! filled voxels is removed, so that a constant strain excites none of them (patch test); then the
//! 9x9 block is condensed out.

use super::material::Elastic;

/// Stiffness of the hourglass modes of an empty cell over `mu H`. A few voxels in a corner of a cell
/// hardly feel how its far corners are warped; without this the element's matrix is singular in `f32`
/// and its far nodes shoot away. A cell half filled by a plate gets about 1 % stiffer in bending.
const HOURGLASS_STIFFNESS: f64 = 1e-3;

/// Local degrees of freedom: 8 corners x 3.
pub const DOFS: usize = 24;
pub(super) const MODES: usize = 9;

/// A symmetric 24x24 matrix by 3x3 node blocks; row and column are `3 * corner + axis`.
pub type Matrix24 = [[f64; DOFS]; DOFS];

/// Matrices of one element in its rest frame.
#[derive(Clone, Debug)]
pub struct ElementMatrices {
    /// Stiffness with the incompatible modes condensed, N/m.
    pub stiffness: Box<Matrix24>,
    /// Stiffness of the trilinear field alone, N/m: what the strain-stiffening law measures.
    pub stiffness_galerkin: Box<Matrix24>,
    /// Consistent mass between corners, kg; the same for each axis.
    pub mass_kg: [[f64; 8]; 8],
    /// Shape gradients averaged over the filled volume, 1/m: F = sum_a x_a d_a^T.
    pub mean_gradient: [[f64; 3]; 8],
    /// Filled volume, m^3.
    pub volume_m3: f64,
}

/// Displacements that an element is capable of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Field {
    /// Trilinear between the corners.
    Trilinear,
    /// The same and the nine incompatible modes.
    IncompatibleModes,
}

/// Integrals over one voxel of a cell for unit moduli and density.
#[derive(Clone)]
struct VoxelTable {
    shear: Box<Matrix24>,
    /// `int dN_a/dx_b s_j` over the voxel, and the same by its centre point.
    gradient_mode: [[[f64; 3]; 3]; 8],
    gradient_mode_centre: [[[f64; 3]; 3]; 8],
    gradient: [[f64; 3]; 8],
    gradient_centre: [[f64; 3]; 8],
    /// `int s_j s_l`, by full and by centre-point integration; `int s_j` is the same in both.
    mode_mode: [[f64; 3]; 3],
    mode: [f64; 3],
    mass: [[f64; 8]; 8],
}

/// Integrals for each voxel position of a cell of one level.
pub struct CompositeTables {
    exponent: u8,
    voxel_volume_m3: f64,
    voxels: Vec<VoxelTable>,
}

/// Coordinates of corner `c` in -1..=1.
fn corner_sign(c: usize, axis: usize) -> f64 {
    if c >> axis & 1 == 1 { 1.0 } else { -1.0 }
}

/// Index of the pair (a, b) of corners in a packed symmetric 8x8 matrix: lower triangle by rows.
#[must_use]
pub fn corner_pair(a: usize, b: usize) -> usize {
    if b <= a { a * (a + 1) / 2 + b } else { b * (b + 1) / 2 + a }
}

/// Trilinear shape functions at local coordinates in 0..=1.
#[must_use]
pub fn shape_functions(local: [f64; 3]) -> [f64; 8] {
    std::array::from_fn(|c| (0..3).map(|a| if c >> a & 1 == 1 { local[a] } else { 1.0 - local[a] }).product())
}

/// Gradients of the shape functions with respect to local coordinates in 0..=1.
#[must_use]
pub fn shape_gradients(local: [f64; 3]) -> [[f64; 3]; 8] {
    std::array::from_fn(|c| {
        std::array::from_fn(|d| {
            (0..3)
                .map(|a| match (a == d, c >> a & 1 == 1) {
                    (true, up) => {
                        if up {
                            1.0
                        } else {
                            -1.0
                        }
                    }
                    (false, true) => local[a],
                    (false, false) => 1.0 - local[a],
                })
                .product()
        })
    })
}

impl CompositeTables {
    /// Tables for cells of 2^exponent voxels of edge `voxel_size_m` a side.
    #[must_use]
    pub fn new(exponent: u8, voxel_size_m: f64) -> Self {
        let k = 1usize << exponent;
        let voxels = (0..k * k * k).map(|v| voxel_table([v % k, v / k % k, v / k / k], k, voxel_size_m)).collect();
        Self { exponent, voxel_volume_m3: voxel_size_m.powi(3), voxels }
    }

    /// Position of a voxel in its cell's tables.
    #[must_use]
    pub fn position(&self, ijk: [i32; 3]) -> usize {
        let (e, mask) = (self.exponent, (1 << self.exponent) - 1);
        ((ijk[2] & mask) << (2 * e) | (ijk[1] & mask) << e | (ijk[0] & mask)) as usize
    }

    /// Matrices of an element filled by `voxels`, given as table positions with their materials.
    #[must_use]
    pub fn assemble(&self, voxels: &[(usize, Elastic)], field: Field) -> ElementMatrices {
        let shear_modulus = voxels.iter().map(|v| v.1.mu_pa).sum::<f64>() / voxels.len() as f64;
        self.matrices(Sums::over(self, voxels), field, shear_modulus)
    }

    /// Eliminates the modes of `field` and stiffens what the voxels hardly feel.
    pub(super) fn matrices(&self, sums: Sums, field: Field, shear_modulus_pa: f64) -> ElementMatrices {
        let stiffness_galerkin = sums.galerkin;
        let mut stiffness = match field {
            Field::Trilinear => stiffness_galerkin.clone(),
            Field::IncompatibleModes => condense(&stiffness_galerkin, &sums.coupling, sums.modes),
        };
        let fill = sums.voxels as f64 / self.voxels.len() as f64;
        let edge = self.voxel_volume_m3.cbrt() * f64::from(1u32 << self.exponent);
        stiffen_hourglass(&mut stiffness, HOURGLASS_STIFFNESS * (1.0 - fill) * shear_modulus_pa * edge);
        ElementMatrices {
            stiffness,
            stiffness_galerkin,
            mass_kg: sums.mass,
            mean_gradient: sums.gradient.map(|g| g.map(|x| x / sums.volume)),
            volume_m3: sums.volume,
        }
    }
}

fn voxel_table(at: [usize; 3], k: usize, h: f64) -> VoxelTable {
    let edge = h * k as f64;
    let mut table = VoxelTable {
        shear: Box::new([[0.0; DOFS]; DOFS]),
        gradient_mode: [[[0.0; 3]; 3]; 8],
        gradient_mode_centre: [[[0.0; 3]; 3]; 8],
        gradient: [[0.0; 3]; 8],
        gradient_centre: [[0.0; 3]; 8],
        mode_mode: [[0.0; 3]; 3],
        mode: [0.0; 3],
        mass: [[0.0; 8]; 8],
    };
    let point = |offset: [f64; 3]| std::array::from_fn(|a| (at[a] as f64 + offset[a]) / k as f64);
    // dP_j/dx_j at local coordinate t in 0..=1: xi = 2t - 1, dP/dx = -2 xi * 2 / edge.
    let mode = |t: f64| -4.0 * (2.0 * t - 1.0) / edge;
    let gauss = 0.5 / 3f64.sqrt();
    for g in 0..8 {
        let local = point([0, 1, 2].map(|a| 0.5 + gauss * corner_sign(g, a)));
        accumulate(&mut table, local, h.powi(3) / 8.0, edge, local.map(mode));
    }
    let centre = point([0.5; 3]);
    let gradient = shape_gradients(centre).map(|g| g.map(|x| x / edge));
    for a in 0..8 {
        table.gradient_centre[a] = gradient[a];
        for b in 0..3 {
            table.gradient_mode_centre[a][b] = centre.map(|t| gradient[a][b] * mode(t));
        }
    }
    table
}

fn accumulate(table: &mut VoxelTable, local: [f64; 3], weight: f64, edge: f64, s: [f64; 3]) {
    let n = shape_functions(local);
    let grad = shape_gradients(local).map(|g| g.map(|x| x / edge));
    for a in 0..8 {
        for b in 0..8 {
            table.mass[a][b] += weight * n[a] * n[b];
            let dot: f64 = (0..3).map(|i| grad[a][i] * grad[b][i]).sum();
            for i in 0..3 {
                table.shear[3 * a + i][3 * b + i] += weight * dot;
                for j in 0..3 {
                    table.shear[3 * a + i][3 * b + j] += weight * grad[a][j] * grad[b][i];
                }
            }
        }
        for b in 0..3 {
            table.gradient[a][b] += weight * grad[a][b];
            for j in 0..3 {
                table.gradient_mode[a][b][j] += weight * grad[a][b] * s[j];
            }
        }
    }
    for j in 0..3 {
        table.mode[j] += weight * s[j];
        for l in 0..3 {
            table.mode_mode[j][l] += weight * s[j] * s[l];
        }
    }
}

/// Sums over the voxels of one element.
pub(super) struct Sums {
    pub(super) galerkin: Box<Matrix24>,
    /// Between corners and modes; mode (j, c), `P_j` in direction c, is `3 j + c`.
    pub(super) coupling: Box<[[f64; MODES]; DOFS]>,
    pub(super) modes: [[f64; MODES]; MODES],
    mass: [[f64; 8]; 8],
    gradient: [[f64; 3]; 8],
    voxels: usize,
    volume: f64,
}

impl Sums {
    pub(super) fn over(tables: &CompositeTables, voxels: &[(usize, Elastic)]) -> Self {
        let mut sums = Self {
            galerkin: Box::new([[0.0; DOFS]; DOFS]),
            coupling: Box::new([[0.0; MODES]; DOFS]),
            modes: [[0.0; MODES]; MODES],
            mass: [[0.0; 8]; 8],
            gradient: [[0.0; 3]; 8],
            voxels: voxels.len(),
            volume: 0.0,
        };
        let voxel_volume = tables.voxel_volume_m3;
        let mut mean_mode = [0.0; 3];
        for &(position, _) in voxels {
            sums.volume += voxel_volume;
            let table = &tables.voxels[position];
            (0..3).for_each(|j| mean_mode[j] += table.mode[j]);
        }
        mean_mode = mean_mode.map(|m| m / sums.volume);
        for &(position, material) in voxels {
            sums.add(&tables.voxels[position], &material, mean_mode, voxel_volume);
        }
        sums
    }

    fn add(&mut self, table: &VoxelTable, material: &Elastic, mean: [f64; 3], volume: f64) {
        let (mu, lambda_v) = (material.mu_pa, material.lambda_pa * volume);
        for row in 0..DOFS {
            let divergence = table.gradient_centre[row / 3][row % 3];
            for column in 0..DOFS {
                self.galerkin[row][column] += mu * table.shear[row][column]
                    + lambda_v * divergence * table.gradient_centre[column / 3][column % 3];
            }
        }
        for a in 0..8 {
            for b in 0..8 {
                self.mass[a][b] += material.density_kg_per_m3 * table.mass[a][b];
            }
            for i in 0..3 {
                self.gradient[a][i] += table.gradient[a][i];
                self.add_coupling(table, a, i, mu, lambda_v, mean);
            }
        }
        self.add_modes(table, mu, lambda_v, mean, volume);
    }

    /// Couples the trilinear dof (a, i), gradient `e_i (x) grad N_a`, with mode (j, c), gradient
    /// `e_c (x) e_j (s_j - mean_j)`: 2 mu sym:sym = mu (A:B + A:B^T), and lambda div div.
    fn add_coupling(&mut self, table: &VoxelTable, a: usize, i: usize, mu: f64, lambda_v: f64, mean: [f64; 3]) {
        for j in 0..3 {
            let full = |b: usize| table.gradient_mode[a][b][j] - mean[j] * table.gradient[a][b];
            let centre = table.gradient_mode_centre[a][i][j] - mean[j] * table.gradient_centre[a][i];
            for c in 0..3 {
                let mut value = 0.0;
                if i == c {
                    value += mu * full(j);
                }
                if i == j {
                    value += mu * full(c);
                }
                if j == c {
                    value += lambda_v * centre;
                }
                self.coupling[3 * a + i][3 * j + c] += value;
            }
        }
    }

    fn add_modes(&mut self, table: &VoxelTable, mu: f64, lambda_v: f64, mean: [f64; 3], volume: f64) {
        // s_j is linear, so its value at the voxel's centre is its mean over the voxel.
        let centre: [f64; 3] = std::array::from_fn(|j| table.mode[j] / volume - mean[j]);
        for j in 0..3 {
            for l in 0..3 {
                let full = table.mode_mode[j][l] - mean[j] * table.mode[l] - mean[l] * table.mode[j]
                    + mean[j] * mean[l] * volume;
                for c in 0..3 {
                    for d in 0..3 {
                        let mut value = 0.0;
                        if c == d && j == l {
                            value += mu * full;
                        }
                        if c == l && j == d {
                            value += mu * full;
                        }
                        if j == c && l == d {
                            value += lambda_v * centre[j] * centre[l];
                        }
                        self.modes[3 * j + c][3 * l + d] += value;
                    }
                }
            }
        }
    }
}

/// `K - C M^-1 C^T`, the modes eliminated one by one; a mode without stiffness is left out.
fn condense(galerkin: &Matrix24, coupling: &[[f64; MODES]; DOFS], mut modes: [[f64; MODES]; MODES]) -> Box<Matrix24> {
    let mut k = Box::new(*galerkin);
    let mut c = *coupling;
    let largest = (0..MODES).map(|m| modes[m][m]).fold(0.0, f64::max);
    for m in 0..MODES {
        let pivot = modes[m][m];
        if pivot <= 1e-10 * largest {
            continue;
        }
        for row in 0..DOFS {
            let factor = c[row][m] / pivot;
            for column in 0..DOFS {
                k[row][column] -= factor * c[column][m];
            }
            for other in m + 1..MODES {
                c[row][other] -= factor * modes[m][other];
            }
        }
        for row in m + 1..MODES {
            let factor = modes[row][m] / pivot;
            for column in m + 1..MODES {
                modes[row][column] -= factor * modes[m][column];
            }
        }
    }
    symmetrize(&mut k);
    k
}

/// Adds `stiffness sum_g g g^T / 8` over the four hourglass modes of the corners (xy, yz, zx, xyz) for
/// each axis: orthogonal to every affine displacement, so constant strains and rigid motion are as
/// they were.
fn stiffen_hourglass(k: &mut Matrix24, stiffness: f64) {
    for mode in [0b011, 0b110, 0b101, 0b111] {
        let sign = |corner: usize| if (corner & mode).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 };
        for a in 0..8 {
            for b in 0..8 {
                for i in 0..3 {
                    k[3 * a + i][3 * b + i] += 0.125 * stiffness * sign(a) * sign(b);
                }
            }
        }
    }
}

fn symmetrize(k: &mut Matrix24) {
    for row in 0..DOFS {
        for column in 0..row {
            let mean = 0.5 * (k[row][column] + k[column][row]);
            k[row][column] = mean;
            k[column][row] = mean;
        }
    }
}
