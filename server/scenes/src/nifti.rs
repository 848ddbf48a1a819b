//! Label maps from NIfTI-1 files (`.nii`, `.nii.gz`): the header's fields that place and type the voxels.
//!
//! Source: the header as nifti1.h of the NIfTI Data Format Working Group defines it; byte offsets stand at
//! the reads. Deliberately absent: `.hdr`/`.img` pairs, NIfTI-2, extensions, colours and real-valued maps.

use std::io::Read;

use flate2::read::GzDecoder;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Most voxels of a map: 512 slices of 512 x 512.
pub const MAX_VOXELS: u64 = 1 << 27;
const HEADER_BYTES: usize = 348;
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
    /// Reads a file's bytes, which a gzip header says to be compressed.
    ///
    /// # Errors
    /// The field of the header that cannot be used and its value, or how the data do not fit it.
    pub fn parse(bytes: &[u8], max_voxels: u64) -> Result<Self, String> {
        if bytes.starts_with(&[0x1f, 0x8b]) {
            Self::read(GzDecoder::new(bytes), max_voxels).map_err(|message| format!("{message} (gzip)"))
        } else {
            Self::read(bytes, max_voxels)
        }
    }

    fn read(mut source: impl Read, max_voxels: u64) -> Result<Self, String> {
        let header = Header::read(&mut source)?;
        let dims = header.dims(max_voxels)?;
        let kind = header.kind()?;
        let start = header.float(108);
        if !(HEADER_BYTES as f32..=1e6).contains(&start) {
            return Err(format!("vox_offset = {start}: the data begin after the header, at 348 to 1e6"));
        }
        let short = |_| format!("the file is cut off: it ends before its {dims:?} voxels");
        std::io::copy(&mut source.by_ref().take(start as u64 - HEADER_BYTES as u64), &mut std::io::sink())
            .map_err(short)?;
        let count = dims.iter().product::<usize>();
        let mut data = vec![0; count * kind.bytes()];
        source.read_exact(&mut data).map_err(short)?;
        let labels = data.chunks_exact(kind.bytes()).map(|voxel| kind.label(header.array(voxel)));
        let labels = labels.collect::<Option<Vec<u16>>>().ok_or("a voxel is no whole number from 0 to 65535")?;
        let (edges_m, first_m) = header.placement_m()?;
        let lengths: f64 = edges_m.column_iter().map(|edge| edge.norm()).product();
        if edges_m.determinant().abs() <= FLAT * lengths {
            return Err("the orientation (sform, qform or pixdim) gives voxels without a volume".into());
        }
        Ok(Self { dims, labels, edges_m, first_m })
    }

    /// Label of a voxel; 0 beyond the map.
    pub fn label(&self, voxel: [i64; 3]) -> u16 {
        let inside = (0..3).all(|a| (0..self.dims[a] as i64).contains(&voxel[a]));
        let [i, j, k] = voxel.map(|index| index as usize);
        if inside { self.labels[(k * self.dims[1] + j) * self.dims[0] + i] } else { 0 }
    }
}

/// Type of a voxel's number.
#[derive(Clone, Copy)]
enum Kind {
    U8,
    I8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The label that little-endian bytes are, padded with zeros.
    fn label(self, bytes: [u8; 8]) -> Option<u16> {
        let [a, b, c, d, ..] = bytes;
        let whole = |value: f64| (value.fract() == 0.0 && (0.0..=65535.0).contains(&value)).then_some(value as u16);
        match self {
            Self::U8 => Some(u16::from(a)),
            Self::I8 => u16::try_from(a as i8).ok(),
            Self::I16 => u16::try_from(i16::from_le_bytes([a, b])).ok(),
            Self::U16 => Some(u16::from_le_bytes([a, b])),
            Self::I32 => u16::try_from(i32::from_le_bytes([a, b, c, d])).ok(),
            Self::U32 => u16::try_from(u32::from_le_bytes([a, b, c, d])).ok(),
            Self::F32 => whole(f32::from_le_bytes([a, b, c, d]).into()),
            Self::F64 => whole(f64::from_le_bytes(bytes)),
        }
    }
}

/// The header's bytes and their order.
struct Header {
    bytes: [u8; HEADER_BYTES],
    is_big_endian: bool,
}

impl Header {
    fn read(source: &mut impl Read) -> Result<Self, String> {
        let mut bytes = [0; HEADER_BYTES];
        source.read_exact(&mut bytes).map_err(|_| "the file is cut off: a NIfTI-1 header has 348 bytes".to_owned())?;
        // sizeof_hdr says which way round the numbers are.
        let size = [bytes[0], bytes[1], bytes[2], bytes[3]];
        let is_big_endian = match (i32::from_le_bytes(size), i32::from_be_bytes(size)) {
            (348, _) => false,
            (_, 348) => true,
            (540, _) | (_, 540) => return Err("NIfTI-2 is not read; convert it to NIfTI-1".into()),
            (found, _) => return Err(format!("sizeof_hdr = {found}: a NIfTI-1 file begins with 348")),
        };
        match &bytes[344..348] {
            b"n+1\0" => Ok(Self { bytes, is_big_endian }),
            b"ni1\0" => Err("magic = ni1: the voxels are in an .img file; convert it to one .nii file".into()),
            magic => Err(format!("magic = {:?}: a NIfTI-1 file has n+1", String::from_utf8_lossy(magic))),
        }
    }

    /// Up to eight bytes as little-endian ones, zeros behind them.
    fn array(&self, bytes: &[u8]) -> [u8; 8] {
        let mut array = [0; 8];
        array[..bytes.len()].copy_from_slice(bytes);
        if self.is_big_endian {
            array[..bytes.len()].reverse();
        }
        array
    }

    fn short(&self, at: usize) -> i16 {
        let [low, high, ..] = self.array(&self.bytes[at..at + 2]);
        i16::from_le_bytes([low, high])
    }

    fn float(&self, at: usize) -> f32 {
        let [a, b, c, d, ..] = self.array(&self.bytes[at..at + 4]);
        f32::from_le_bytes([a, b, c, d])
    }

    fn floats<const N: usize>(&self, at: usize) -> [f64; N] {
        std::array::from_fn(|i| f64::from(self.float(at + 4 * i)))
    }

    /// `dim`, offset 40: the number of dimensions, then their sizes.
    fn dims(&self, max_voxels: u64) -> Result<[usize; 3], String> {
        let dim: [i16; 8] = std::array::from_fn(|i| self.short(40 + 2 * i));
        let is_volume = (3..=7).contains(&dim[0]) && dim[4..=dim[0].clamp(3, 7) as usize].iter().all(|n| *n == 1);
        let sizes = [dim[1], dim[2], dim[3]];
        if !is_volume || sizes.iter().any(|n| *n < 1) {
            return Err(format!("dim = {dim:?}: a label map has three dimensions of at least one voxel"));
        }
        let voxels: u64 = sizes.iter().map(|n| *n as u64).product();
        if voxels > max_voxels {
            return Err(format!("dim = {dim:?}: {voxels} voxels are more than the limit of {max_voxels}"));
        }
        Ok(sizes.map(|n| n as usize))
    }

    /// `datatype`, offset 70, and the scaling that labels must not have, offset 112.
    fn kind(&self) -> Result<Kind, String> {
        let [slope, shift] = self.floats(112);
        if slope != 0.0 && (slope != 1.0 || shift != 0.0) {
            return Err(format!("scl_slope = {slope}, scl_inter = {shift}: labels are not scaled"));
        }
        Ok(match self.short(70) {
            2 => Kind::U8,
            4 => Kind::I16,
            8 => Kind::I32,
            16 => Kind::F32,
            64 => Kind::F64,
            256 => Kind::I8,
            512 => Kind::U16,
            768 => Kind::U32,
            other => return Err(format!("datatype = {other}: labels are integers of 8 to 32 bits, or whole floats")),
        })
    }

    /// Edges of a voxel as columns and centre of the first one, m, scene axes. Of the orientations that a
    /// file may state the first that it does holds: sform, qform, none (axes along the patient's).
    fn placement_m(&self) -> Result<(Matrix3<f64>, Vector3<f64>), String> {
        // xyzt_units, offset 123; files without a unit are in millimetres by custom.
        let unit_m = match self.bytes[123] & 7 {
            1 => 1.0,
            0 | 2 => 1e-3,
            3 => 1e-6,
            other => return Err(format!("xyzt_units = {other}: lengths are in m, mm or um")),
        };
        let [handedness, dx, dy, dz] = self.floats(76);
        let spacing = Matrix3::from_diagonal(&Vector3::new(dx, dy, dz));
        let (edges, first) = if self.short(254) > 0 {
            let [x, y, z]: [[f64; 4]; 3] = [self.floats(280), self.floats(296), self.floats(312)];
            let edges = Matrix3::new(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]);
            (edges, Vector3::new(x[3], y[3], z[3]))
        } else if self.short(252) > 0 {
            let [b, c, d, x, y, z]: [f64; 6] = self.floats(256);
            let a = (1.0 - b * b - c * c - d * d).max(0.0).sqrt();
            let turn = UnitQuaternion::new_normalize(Quaternion::new(a, b, c, d)).to_rotation_matrix();
            // pixdim[0] is -1 where the third axis is mirrored.
            let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, if handedness < 0.0 { -1.0 } else { 1.0 }));
            (turn.matrix() * mirror * spacing, Vector3::new(x, y, z))
        } else {
            (spacing, Vector3::zeros())
        };
        if !edges.iter().chain(first.iter()).all(|value| value.is_finite()) {
            return Err("the orientation (sform, qform or pixdim) is not finite".into());
        }
        // Right, anterior, superior to the scene's x, y, z: half a turn about the anterior axis. The
        // patient lies on the back, seen from the feet.
        let to_scene_m = Matrix3::from_diagonal(&Vector3::new(-unit_m, unit_m, -unit_m));
        Ok((to_scene_m * edges, to_scene_m * first))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMS: [i16; 8] = [3, 2, 3, 4, 1, 1, 1, 1];

    /// A file of labels 0 to 23 whose orientation is what `orient` writes, big-endian where wanted.
    fn file(is_big_endian: bool, orient: &[(usize, f32)], forms: [i16; 2]) -> Vec<u8> {
        let mut bytes = vec![0; HEADER_BYTES];
        let mut put = |at: usize, little: &[u8]| {
            bytes[at..at + little.len()].copy_from_slice(little);
            if is_big_endian {
                bytes[at..at + little.len()].reverse();
            }
        };
        put(0, &348i32.to_le_bytes());
        DIMS.iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, &n.to_le_bytes()));
        put(70, &512i16.to_le_bytes());
        put(108, &348.0f32.to_le_bytes());
        put(252, &forms[0].to_le_bytes());
        put(254, &forms[1].to_le_bytes());
        orient.iter().for_each(|(at, value)| put(*at, &value.to_le_bytes()));
        bytes[344..348].copy_from_slice(b"n+1\0");
        bytes
            .extend((0..24u16).flat_map(|label| if is_big_endian { label.to_be_bytes() } else { label.to_le_bytes() }));
        bytes
    }

    #[test]
    fn a_qform_says_what_the_sform_of_the_same_orientation_says() {
        // A quarter turn about the superior axis, the third axis mirrored, spacings 1, 2 and 3 mm.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let pixdim = [(76, -1.0), (80, 1.0), (84, 2.0), (88, 3.0)];
        let quaternion = [(264, half), (268, 5.0), (272, 6.0), (276, 7.0)];
        let by_qform = LabelMap::parse(&file(false, &[&pixdim[..], &quaternion].concat(), [1, 0]), MAX_VOXELS).unwrap();
        let rows = [(284, -2.0), (292, 5.0), (296, 1.0), (308, 6.0), (320, -3.0), (324, 7.0)];
        let by_sform = LabelMap::parse(&file(false, &rows, [0, 1]), MAX_VOXELS).unwrap();
        assert!((by_qform.edges_m - by_sform.edges_m).norm() < 1e-9, "{} {}", by_qform.edges_m, by_sform.edges_m);
        assert_eq!((by_qform.first_m, &by_qform.labels), (by_sform.first_m, &by_sform.labels));
        // The file's first axis is anterior, which is up.
        assert!((by_sform.edges_m.column(0) - Vector3::new(0.0, 1e-3, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn either_order_of_bytes_is_read() {
        let pixdim = [(80, 1.0), (84, 2.0), (88, 3.0)];
        let [little, big] =
            [false, true].map(|is_big| LabelMap::parse(&file(is_big, &pixdim, [0, 0]), MAX_VOXELS).unwrap());
        assert_eq!(little, big);
        assert_eq!((little.label([1, 2, 3]), little.label([1, 0, 0]), little.label([2, 0, 0])), (23, 1, 0));
    }
}
