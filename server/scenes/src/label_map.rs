//! Label maps: integers on a lattice that is placed in the patient's axes.

use nalgebra::{Matrix3, Vector3};

use crate::kind::{Kind, little_endian};

/// Most voxels of a map: 512 slices of 512 x 512.
pub const MAX_VOXELS: u64 = 1 << 27;
/// Determinant of the voxel's edges over the product of their lengths below which they have no volume.
const FLAT: f64 = 1e-6;

/// Integer labels on a lattice, placed in the scene's axes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LabelMap {
    /// Voxels along the file's three axes.
    pub dims: [usize; 3],
    /// First axis fastest; 0 is outside.
    pub labels: Vec<u16>,
    /// Edges of a voxel along the file's axes, as columns, m, in the scene's axes.
    pub edges_m: Matrix3<f64>,
    /// Centre of the first voxel, m, in the scene's axes, from the file's origin.
    pub first_m: Vector3<f64>,
}

impl LabelMap {
    /// A map of data of one kind in an order of bytes.
    pub fn of_data(
        dims: [usize; 3],
        (kind, is_big_endian): (Kind, bool),
        data: &[u8],
        (edges_m, first_m): (Matrix3<f64>, Vector3<f64>),
    ) -> Result<Self, String> {
        let labels = data.chunks_exact(kind.bytes()).map(|voxel| kind.label(little_endian(voxel, is_big_endian)));
        let labels = labels.collect::<Option<Vec<u16>>>().ok_or("a voxel is no whole number from 0 to 65535")?;
        let lengths: f64 = edges_m.column_iter().map(|edge| edge.norm()).product();
        if edges_m.determinant().abs() <= FLAT * lengths {
            return Err("the orientation gives voxels without a volume".into());
        }
        Ok(Self { dims, labels, edges_m, first_m })
    }

    /// Place of a voxel among the labels; `None` beyond the map.
    pub fn index(&self, voxel: [i64; 3]) -> Option<usize> {
        let inside = (0..3).all(|a| (0..self.dims[a] as i64).contains(&voxel[a]));
        let [i, j, k] = voxel.map(|index| index as usize);
        inside.then(|| (k * self.dims[1] + j) * self.dims[0] + i)
    }
}

/// The number of voxels along three axes, which a header says.
pub(crate) fn checked_dims(field: &str, sizes: [i64; 3], max_voxels: u64) -> Result<[usize; 3], String> {
    if sizes.iter().any(|n| *n < 1) {
        return Err(format!("{field} = {sizes:?}: a label map has three dimensions of at least one voxel"));
    }
    let voxels = sizes.iter().try_fold(1u64, |product, n| product.checked_mul(*n as u64)).unwrap_or(u64::MAX);
    if voxels > max_voxels {
        return Err(format!("{field} = {sizes:?}: {voxels} voxels are more than the limit of {max_voxels}"));
    }
    Ok(sizes.map(|n| n as usize))
}

/// From millimetres (or what `unit_m` is) right, anterior, superior to the scene's x, y, z: half a turn about the
/// anterior axis. The patient lies on the back, seen from the feet.
pub(crate) fn to_scene_m(
    unit_m: f64,
    (edges, first): (Matrix3<f64>, Vector3<f64>),
) -> Result<(Matrix3<f64>, Vector3<f64>), String> {
    if !edges.iter().chain(first.iter()).all(|value| value.is_finite()) {
        return Err("the orientation is not finite".into());
    }
    let to_scene_m = Matrix3::from_diagonal(&Vector3::new(-unit_m, unit_m, -unit_m));
    Ok((to_scene_m * edges, to_scene_m * first))
}
