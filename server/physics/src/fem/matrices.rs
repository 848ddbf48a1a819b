//! The matrices of an element: between its corners, and between these and the ground points of [`super::held`].

/// Local degrees of freedom: 8 corners x 3.
pub const DOFS: usize = 24;
/// Ground points' degrees of freedom; `3 * point + axis`.
pub const GROUND: usize = 9;

/// A symmetric 24x24 matrix by 3x3 node blocks; row and column are `3 * corner + axis`.
pub type Matrix24 = [[f64; DOFS]; DOFS];

/// Matrices of one element in its rest frame.
#[derive(Clone, Debug)]
pub struct ElementMatrices {
    /// Stiffness with the incompatible modes condensed, N/m.
    pub stiffness: Box<Matrix24>,
    /// Stiffness of the trilinear field alone, N/m, its bulk no stiffer than at
    /// [`super::composite::MEASURED_POISSON_RATIO`]: what the strain-stiffening law measures.
    pub stiffness_measured: Box<Matrix24>,
    /// Consistent mass between corners, kg; the same for each axis.
    pub mass_kg: [[f64; 8]; 8],
    /// Shape gradients averaged over the filled volume, 1/m: F = sum_a x_a d_a^T.
    pub mean_gradient: [[f64; 3]; 8],
    /// Filled volume, m^3; of a held element that of the voxels which are not held.
    pub volume_m3: f64,
    /// Present where voxels, or corners of voxels, are held.
    pub ground: Option<Ground>,
}

/// Stiffness between an element's corners and the ground points, N/m, beside that between its corners.
#[derive(Clone, Debug)]
pub struct GroundStiffness {
    /// Row: corner's degree of freedom.
    pub coupling: Box<[[f64; GROUND]; DOFS]>,
    /// Of the ground points.
    pub own: Box<[[f64; GROUND]; GROUND]>,
}

/// What holds an element.
#[derive(Clone, Debug)]
pub struct Ground {
    /// Goes with [`ElementMatrices::stiffness`].
    pub stiffness: GroundStiffness,
    /// Goes with [`ElementMatrices::stiffness_measured`].
    pub measured: GroundStiffness,
}
