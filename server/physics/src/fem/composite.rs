//! Matrices of a composite element, built from the fine voxels that fill it.
//!
//! Element kind IM9+SRI: trilinear displacement plus nine incompatible modes
//! `P_j = 1 - xi_j^2` per direction, the shear part of the energy integrated fully, the volumetric
//! part of the linear function of position that is nearest to the divergence at the voxel centres (its
//! bilinear terms, which no mode can cancel, would lock a cell of many voxels towards incompressibility).
//! From each mode the linear part with the same mean gradient over the filled voxels is removed, so that a
//! constant strain excites none of them (patch test); then the 9x9 block is condensed out.

use super::material::Elastic;
use super::matrices::{DOFS, ElementMatrices, Matrix24};

/// Stiffness of the hourglass modes of an empty cell over `mu H`. A few voxels in a corner of a cell
/// hardly feel how its far corners are warped; without this the element's matrix is singular in `f32`
/// and its far nodes shoot away. A cell half filled by a plate gets about 1 % stiffer in bending.
const HOURGLASS_STIFFNESS: f64 = 1e-3;

/// Poisson's ratio above which strain stiffening no longer measures what little volume changes: near
/// incompressibility that energy is a thousandfold, and of numerical origin. Under uniaxial stress
/// `sigma = E eps exp(c eps^2)` holds all the same, since little volume changes.
pub const MEASURED_POISSON_RATIO: f64 = 0.45;

pub(super) const MODES: usize = 9;
/// Corners' dofs, then modes.
const ALL: usize = DOFS + MODES;
/// Functions that the divergence is projected on: 1 and the three coordinates.
const LINEAR: usize = 4;

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
    /// `int div div`.
    volumetric: Box<Matrix24>,
    /// `int dN_a/dx_b s_j` over the voxel.
    gradient_mode: [[[f64; 3]; 3]; 8],
    gradient: [[f64; 3]; 8],
    gradient_centre: [[f64; 3]; 8],
    /// `int s_j s_l`, and `int s_j`, which is its value at the centre times the volume.
    mode_mode: [[f64; 3]; 3],
    mode: [f64; 3],
    mass: [[f64; 8]; 8],
    /// The linear functions at the centre.
    linear_centre: [f64; LINEAR],
}

/// A voxel of a cell.
#[derive(Clone, Copy, Debug)]
pub struct FilledVoxel {
    /// Position in the cell's tables.
    pub position: usize,
    /// Its material.
    pub elastic: Elastic,
    /// How much of it is filled; 1: all of it.
    pub share: f64,
}

impl FilledVoxel {
    /// A voxel that is filled wholly.
    #[must_use]
    pub fn whole(position: usize, elastic: Elastic) -> Self {
        Self { position, elastic, share: 1.0 }
    }
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

    /// Matrices of an element filled by `voxels`.
    #[must_use]
    pub fn assemble(&self, voxels: &[FilledVoxel], field: Field) -> ElementMatrices {
        let shear_modulus = voxels.iter().map(|v| v.elastic.mu_pa).sum::<f64>() / voxels.len() as f64;
        self.matrices(Sums::over(self, voxels), field, shear_modulus)
    }

    /// Eliminates the modes of `field` and stiffens what the voxels hardly feel.
    pub(super) fn matrices(&self, sums: Sums, field: Field, shear_modulus_pa: f64) -> ElementMatrices {
        let mut stiffness = match field {
            Field::Trilinear => sum(&sums.shear, &sums.volumetric),
            Field::IncompatibleModes => sums.condensed(),
        };
        let fill = sums.voxels as f64 / self.voxels.len() as f64;
        let edge = self.voxel_volume_m3.cbrt() * f64::from(1u32 << self.exponent);
        stiffen_hourglass(&mut stiffness, HOURGLASS_STIFFNESS * (1.0 - fill) * shear_modulus_pa * edge);
        ElementMatrices {
            stiffness,
            stiffness_measured: sum(&sums.shear, &sums.volumetric_measured),
            mass_kg: sums.mass,
            mean_gradient: sums.gradient.map(|g| g.map(|x| x / sums.volume)),
            volume_m3: sums.volume,
            ground: None,
        }
    }
}

fn voxel_table(at: [usize; 3], k: usize, h: f64) -> VoxelTable {
    let edge = h * k as f64;
    let mut table = VoxelTable {
        shear: Box::new([[0.0; DOFS]; DOFS]),
        volumetric: Box::new([[0.0; DOFS]; DOFS]),
        gradient_mode: [[[0.0; 3]; 3]; 8],
        gradient: [[0.0; 3]; 8],
        gradient_centre: [[0.0; 3]; 8],
        mode_mode: [[0.0; 3]; 3],
        mode: [0.0; 3],
        mass: [[0.0; 8]; 8],
        linear_centre: [1.0; LINEAR],
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
    table.gradient_centre = gradient;
    (0..3).for_each(|a| table.linear_centre[1 + a] = 2.0 * centre[a] - 1.0);
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
                    table.volumetric[3 * a + i][3 * b + j] += weight * grad[a][i] * grad[b][j];
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
    /// Of the corners, without the volumetric part.
    pub(super) shear: Box<Matrix24>,
    /// Between corners and modes, likewise; mode (j, c), `P_j` in direction c, is `3 j + c`.
    pub(super) coupling: Box<[[f64; MODES]; DOFS]>,
    pub(super) modes: [[f64; MODES]; MODES],
    /// The volumetric part of the corners, voxel by voxel.
    volumetric: Box<Matrix24>,
    /// The same as far as strain stiffening measures it, integrated fully: a corner that is pushed in must
    /// not go unnoticed by the centre of a lone voxel.
    pub(super) volumetric_measured: Box<Matrix24>,
    /// `sum lambda V p div` of every dof, and `sum lambda V p p^T`, p the linear functions.
    divergence: Box<[[f64; ALL]; LINEAR]>,
    moments: [[f64; LINEAR]; LINEAR],
    mass: [[f64; 8]; 8],
    gradient: [[f64; 3]; 8],
    voxels: usize,
    volume: f64,
}

impl Sums {
    pub(super) fn over(tables: &CompositeTables, voxels: &[FilledVoxel]) -> Self {
        let mut sums = Self {
            shear: Box::new([[0.0; DOFS]; DOFS]),
            volumetric: Box::new([[0.0; DOFS]; DOFS]),
            volumetric_measured: Box::new([[0.0; DOFS]; DOFS]),
            divergence: Box::new([[0.0; ALL]; LINEAR]),
            moments: [[0.0; LINEAR]; LINEAR],
            coupling: Box::new([[0.0; MODES]; DOFS]),
            modes: [[0.0; MODES]; MODES],
            mass: [[0.0; 8]; 8],
            gradient: [[0.0; 3]; 8],
            voxels: voxels.len(),
            volume: 0.0,
        };
        let voxel_volume = tables.voxel_volume_m3;
        let mut mean_mode = [0.0; 3];
        for voxel in voxels {
            sums.volume += voxel.share * voxel_volume;
            let table = &tables.voxels[voxel.position];
            (0..3).for_each(|j| mean_mode[j] += voxel.share * table.mode[j]);
        }
        mean_mode = mean_mode.map(|m| m / sums.volume);
        for voxel in voxels {
            sums.add(&tables.voxels[voxel.position], voxel, mean_mode, voxel_volume);
        }
        sums
    }

    fn add(&mut self, table: &VoxelTable, voxel: &FilledVoxel, mean: [f64; 3], volume: f64) {
        let share = voxel.share;
        let (mu, lambda) = (share * voxel.elastic.mu_pa, share * voxel.elastic.lambda_pa);
        let measured = lambda * measured_share(mu, lambda);
        let divergence = table.gradient_centre.as_flattened();
        for row in 0..DOFS {
            for column in 0..DOFS {
                self.shear[row][column] += mu * table.shear[row][column];
                self.volumetric[row][column] += lambda * volume * divergence[row] * divergence[column];
                self.volumetric_measured[row][column] += measured * table.volumetric[row][column];
            }
        }
        for a in 0..8 {
            for b in 0..8 {
                self.mass[a][b] += share * voxel.elastic.density_kg_per_m3 * table.mass[a][b];
            }
            for i in 0..3 {
                self.gradient[a][i] += share * table.gradient[a][i];
                self.add_coupling(table, a, i, mu, mean);
            }
        }
        self.add_modes(table, mu, mean, volume);
        self.add_divergence(table, lambda * volume, mean, volume);
    }

    /// Couples the trilinear dof (a, i), gradient `e_i (x) grad N_a`, with mode (j, c), gradient
    /// `e_c (x) e_j (s_j - mean_j)`: 2 mu sym:sym = mu (A:B + A:B^T).
    fn add_coupling(&mut self, table: &VoxelTable, a: usize, i: usize, mu: f64, mean: [f64; 3]) {
        for j in 0..3 {
            let full = |b: usize| table.gradient_mode[a][b][j] - mean[j] * table.gradient[a][b];
            for c in 0..3 {
                let mut value = 0.0;
                if i == c {
                    value += mu * full(j);
                }
                if i == j {
                    value += mu * full(c);
                }
                self.coupling[3 * a + i][3 * j + c] += value;
            }
        }
    }

    fn add_modes(&mut self, table: &VoxelTable, mu: f64, mean: [f64; 3], volume: f64) {
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
                        self.modes[3 * j + c][3 * l + d] += value;
                    }
                }
            }
        }
    }
}

impl Sums {
    /// Adds a voxel to what the divergence is projected by, `lambda_v` its first Lame parameter times its
    /// volume: mode (j, c) has a divergence where j = c.
    fn add_divergence(&mut self, table: &VoxelTable, lambda_v: f64, mean: [f64; 3], volume: f64) {
        let mut divergence = [0.0; ALL];
        divergence[..DOFS].copy_from_slice(table.gradient_centre.as_flattened());
        (0..3).for_each(|j| divergence[DOFS + 4 * j] = table.mode[j] / volume - mean[j]);
        for (p, row) in table.linear_centre.iter().zip(&mut *self.divergence) {
            row.iter_mut().zip(divergence).for_each(|(sum, d)| *sum += lambda_v * p * d);
        }
        for (p, row) in table.linear_centre.iter().zip(&mut self.moments) {
            row.iter_mut().zip(table.linear_centre).for_each(|(sum, q)| *sum += lambda_v * p * q);
        }
    }

    /// Stiffness of the corners with the modes condensed, the divergence projected: `D^T M^-1 D` of the
    /// sums D and M, M eliminated function by function; one that the voxels do not tell from those before
    /// it is left out.
    fn condensed(&self) -> Box<Matrix24> {
        let (mut corners, mut coupling, mut modes) = (self.shear.clone(), self.coupling.clone(), self.modes);
        let (mut divergence, mut moments) = (self.divergence.clone(), self.moments);
        let largest = moments[0][0];
        for m in 0..LINEAR {
            let (pivot, row) = (moments[m][m], divergence[m]);
            if pivot <= 1e-10 * largest {
                continue;
            }
            for i in 0..ALL {
                let factor = row[i] / pivot;
                let (of_corners, of_modes) = row.split_at(DOFS);
                match i.checked_sub(DOFS) {
                    None => {
                        corners[i].iter_mut().zip(of_corners).for_each(|(k, d)| *k += factor * d);
                        coupling[i].iter_mut().zip(of_modes).for_each(|(k, d)| *k += factor * d);
                    }
                    Some(mode) => modes[mode].iter_mut().zip(of_modes).for_each(|(k, d)| *k += factor * d),
                }
            }
            for other in m + 1..LINEAR {
                let factor = moments[other][m] / pivot;
                (0..ALL).for_each(|i| divergence[other][i] -= factor * row[i]);
                (0..LINEAR).for_each(|n| moments[other][n] -= factor * moments[m][n]);
            }
        }
        condense(&corners, &coupling, modes)
    }
}

/// Fraction of a first Lame parameter that strain stiffening measures: `lambda = 2 mu nu / (1 - 2 nu)`.
pub(super) fn measured_share(mu_pa: f64, lambda_pa: f64) -> f64 {
    let most_pa = 2.0 * mu_pa * MEASURED_POISSON_RATIO / (1.0 - 2.0 * MEASURED_POISSON_RATIO);
    if lambda_pa > most_pa { most_pa / lambda_pa } else { 1.0 }
}

fn sum(a: &Matrix24, b: &Matrix24) -> Box<Matrix24> {
    Box::new(std::array::from_fn(|row| std::array::from_fn(|column| a[row][column] + b[row][column])))
}

/// `K - C M^-1 C^T`, the modes eliminated one by one; a mode without stiffness is left out.
fn condense(corners: &Matrix24, coupling: &[[f64; MODES]; DOFS], mut modes: [[f64; MODES]; MODES]) -> Box<Matrix24> {
    let mut k = Box::new(*corners);
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
