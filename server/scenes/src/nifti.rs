//! Label maps from NIfTI files, version 1 and 2 (`.nii`, `.nii.gz`): the header's fields that place and type the voxels.
//!
//! Source: the headers as nifti1.h and nifti2.h of the NIfTI Data Format Working Group define them; byte offsets
//! stand in `Layout`. Deliberately absent: `.hdr`/`.img` pairs, extensions, colours and real-valued maps.

use std::io::Read;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use crate::kind::{Kind, little_endian};
use crate::label_map::{LabelMap, checked_dims, to_scene_m};

/// Reads a file, not compressed.
pub(crate) fn read(mut source: impl Read, max_voxels: u64) -> Result<LabelMap, String> {
    let header = Header::read(&mut source)?;
    let dims = header.dims(max_voxels)?;
    let kind = header.kind()?;
    let (start, least) = (header.data_start(), header.layout.bytes as f64);
    if !(least..=1e6).contains(&start) {
        return Err(format!("vox_offset = {start}: the data begin after the header, at {least} to 1e6"));
    }
    let short = |_| format!("the file is cut off: it ends before its {dims:?} voxels");
    std::io::copy(&mut source.by_ref().take((start - least) as u64), &mut std::io::sink()).map_err(short)?;
    let mut data = vec![0; dims.iter().product::<usize>() * kind.bytes()];
    source.read_exact(&mut data).map_err(short)?;
    LabelMap::of_data(dims, (kind, header.is_big_endian), &data, header.placement_m()?)
}

/// Where the fields of a version's header stand, bytes; numbers of version 2 are twice as wide.
struct Layout {
    bytes: usize,
    /// Numbers have 64 bits where those of version 1 have 16 or 32.
    is_wide: bool,
    magic: usize,
    datatype: usize,
    dim: usize,
    pixdim: usize,
    vox_offset: usize,
    scl_slope: usize,
    xyzt_units: usize,
    qform_code: usize,
    sform_code: usize,
    /// quatern_b to qoffset_z, then srow_x to srow_z, one after the other.
    quatern_b: usize,
    srow_x: usize,
}

const VERSION_1: Layout = Layout {
    bytes: 348,
    is_wide: false,
    magic: 344,
    datatype: 70,
    dim: 40,
    pixdim: 76,
    vox_offset: 108,
    scl_slope: 112,
    xyzt_units: 123,
    qform_code: 252,
    sform_code: 254,
    quatern_b: 256,
    srow_x: 280,
};
const VERSION_2: Layout = Layout {
    bytes: 540,
    is_wide: true,
    magic: 4,
    datatype: 12,
    dim: 16,
    pixdim: 104,
    vox_offset: 168,
    scl_slope: 176,
    xyzt_units: 500,
    qform_code: 344,
    sform_code: 348,
    quatern_b: 352,
    srow_x: 400,
};

/// The header's bytes and their order.
struct Header {
    bytes: Vec<u8>,
    layout: &'static Layout,
    is_big_endian: bool,
}

impl Header {
    fn read(source: &mut impl Read) -> Result<Self, String> {
        let mut size = [0; 4];
        source.read_exact(&mut size).map_err(|_| "the file is cut off: a NIfTI header has 348 bytes or 540")?;
        // sizeof_hdr says which version it is, and which way round the numbers are.
        let (layout, is_big_endian) = match (i32::from_le_bytes(size), i32::from_be_bytes(size)) {
            (348, _) => (&VERSION_1, false),
            (_, 348) => (&VERSION_1, true),
            (540, _) => (&VERSION_2, false),
            (_, 540) => (&VERSION_2, true),
            _ => return Err("is neither a NIfTI file (.nii, .nii.gz) nor an NRRD file (.nrrd, .seg.nrrd)".into()),
        };
        let mut bytes = size.to_vec();
        let rest = layout.bytes as u64 - 4;
        let read = source.by_ref().take(rest).read_to_end(&mut bytes).unwrap_or_default();
        if read as u64 != rest {
            return Err(format!("the file is cut off: its header has {} bytes", layout.bytes));
        }
        match &bytes[layout.magic..layout.magic + 4] {
            b"n+1\0" | b"n+2\0" => Ok(Self { bytes, layout, is_big_endian }),
            b"ni1\0" | b"ni2\0" => {
                Err("magic = ni1: the voxels are in an .img file; convert it to one .nii file".into())
            }
            magic => Err(format!("magic = {:?}: a NIfTI file has n+1 or n+2", String::from_utf8_lossy(magic))),
        }
    }

    fn array(&self, at: usize, bytes: usize) -> [u8; 8] {
        little_endian(&self.bytes[at..at + bytes], self.is_big_endian)
    }

    fn short(&self, at: usize) -> i16 {
        let [low, high, ..] = self.array(at, 2);
        i16::from_le_bytes([low, high])
    }

    /// A code, of 16 bits in version 1 and of 32 in version 2.
    fn code(&self, at: usize) -> i32 {
        if self.layout.is_wide { self.int(at) } else { self.short(at).into() }
    }

    fn int(&self, at: usize) -> i32 {
        let [a, b, c, d, ..] = self.array(at, 4);
        i32::from_le_bytes([a, b, c, d])
    }

    /// Entries of `dim`.
    fn size(&self, index: usize) -> i64 {
        if self.layout.is_wide {
            i64::from_le_bytes(self.array(self.layout.dim + 8 * index, 8))
        } else {
            self.short(self.layout.dim + 2 * index).into()
        }
    }

    fn floats<const N: usize>(&self, at: usize) -> [f64; N] {
        std::array::from_fn(|i| {
            if self.layout.is_wide {
                return f64::from_le_bytes(self.array(at + 8 * i, 8));
            }
            let [a, b, c, d, ..] = self.array(at + 4 * i, 4);
            f32::from_le_bytes([a, b, c, d]).into()
        })
    }

    /// `vox_offset`.
    fn data_start(&self) -> f64 {
        let at = self.layout.vox_offset;
        if self.layout.is_wide { i64::from_le_bytes(self.array(at, 8)) as f64 } else { self.floats::<1>(at)[0] }
    }

    /// `dim`: the number of dimensions, then their sizes.
    fn dims(&self, max_voxels: u64) -> Result<[usize; 3], String> {
        let dim: [i64; 8] = std::array::from_fn(|i| self.size(i));
        let is_volume = (3..=7).contains(&dim[0]) && dim[4..=dim[0].clamp(3, 7) as usize].iter().all(|n| *n == 1);
        if !is_volume {
            return Err(format!("dim = {dim:?}: a label map has three dimensions of at least one voxel"));
        }
        checked_dims("dim", [dim[1], dim[2], dim[3]], max_voxels)
    }

    /// `datatype`, and the scaling that labels must not have.
    fn kind(&self) -> Result<Kind, String> {
        let [slope, shift] = self.floats(self.layout.scl_slope);
        if slope != 0.0 && (slope != 1.0 || shift != 0.0) {
            return Err(format!("scl_slope = {slope}, scl_inter = {shift}: labels are not scaled"));
        }
        Ok(match self.short(self.layout.datatype) {
            2 => Kind::U8,
            4 => Kind::I16,
            8 => Kind::I32,
            16 => Kind::F32,
            64 => Kind::F64,
            256 => Kind::I8,
            512 => Kind::U16,
            768 => Kind::U32,
            1024 => Kind::I64,
            1280 => Kind::U64,
            other => return Err(format!("datatype = {other}: labels are integers of 8 to 64 bits, or whole floats")),
        })
    }

    /// Edges of a voxel as columns and centre of the first one, m, scene axes. Of the orientations that a
    /// file may state the first that it does holds: sform, qform, none (axes along the patient's).
    fn placement_m(&self) -> Result<(Matrix3<f64>, Vector3<f64>), String> {
        let layout = self.layout;
        // Files without a unit are in millimetres by custom.
        let units = if layout.is_wide { self.int(layout.xyzt_units) } else { self.bytes[layout.xyzt_units].into() };
        let unit_m = match units & 7 {
            1 => 1.0,
            0 | 2 => 1e-3,
            3 => 1e-6,
            other => return Err(format!("xyzt_units = {other}: lengths are in m, mm or um")),
        };
        let [handedness, dx, dy, dz] = self.floats(layout.pixdim);
        let spacing = Matrix3::from_diagonal(&Vector3::new(dx, dy, dz));
        let (edges, first) = if self.code(layout.sform_code) > 0 {
            let row = if layout.is_wide { 32 } else { 16 };
            let [x, y, z]: [[f64; 4]; 3] = [0, 1, 2].map(|axis| self.floats(layout.srow_x + axis * row));
            let edges = Matrix3::new(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]);
            (edges, Vector3::new(x[3], y[3], z[3]))
        } else if self.code(layout.qform_code) > 0 {
            let [b, c, d, x, y, z]: [f64; 6] = self.floats(layout.quatern_b);
            let a = (1.0 - b * b - c * c - d * d).max(0.0).sqrt();
            let turn = UnitQuaternion::new_normalize(Quaternion::new(a, b, c, d)).to_rotation_matrix();
            // pixdim[0] is -1 where the third axis is mirrored.
            let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, if handedness < 0.0 { -1.0 } else { 1.0 }));
            (turn.matrix() * mirror * spacing, Vector3::new(x, y, z))
        } else {
            (spacing, Vector3::zeros())
        };
        to_scene_m(unit_m, (edges, first))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::label_map::MAX_VOXELS;
    use crate::label_map_file;

    fn label(map: &LabelMap, voxel: [i64; 3]) -> u16 {
        map.index(voxel).map_or(0, |index| map.labels[index])
    }

    const HEADER_BYTES: usize = VERSION_1.bytes;
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
        let by_qform =
            label_map_file::parse(&file(false, &[&pixdim[..], &quaternion].concat(), [1, 0]), MAX_VOXELS).unwrap();
        let rows = [(284, -2.0), (292, 5.0), (296, 1.0), (308, 6.0), (320, -3.0), (324, 7.0)];
        let by_sform = label_map_file::parse(&file(false, &rows, [0, 1]), MAX_VOXELS).unwrap();
        assert!((by_qform.edges_m - by_sform.edges_m).norm() < 1e-9, "{} {}", by_qform.edges_m, by_sform.edges_m);
        assert_eq!((by_qform.first_m, &by_qform.labels), (by_sform.first_m, &by_sform.labels));
        // The file's first axis is anterior, which is up.
        assert!((by_sform.edges_m.column(0) - Vector3::new(0.0, 1e-3, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn either_order_of_bytes_is_read() {
        let pixdim = [(80, 1.0), (84, 2.0), (88, 3.0)];
        let [little, big] =
            [false, true].map(|is_big| label_map_file::parse(&file(is_big, &pixdim, [0, 0]), MAX_VOXELS).unwrap());
        assert_eq!(little, big);
        assert_eq!((label(&little, [1, 2, 3]), label(&little, [1, 0, 0]), label(&little, [2, 0, 0])), (23, 1, 0));
    }

    #[test]
    fn version_2_says_the_same_with_wider_numbers() {
        let pixdim = [(80, 1.0), (84, 2.0), (88, 3.0)];
        let expected = label_map_file::parse(&file(false, &pixdim, [0, 0]), MAX_VOXELS).unwrap();
        for is_big_endian in [false, true] {
            let mut bytes = vec![0; VERSION_2.bytes];
            let mut put = |at: usize, little: &[u8]| {
                bytes[at..at + little.len()].copy_from_slice(little);
                if is_big_endian {
                    bytes[at..at + little.len()].reverse();
                }
            };
            put(0, &540i32.to_le_bytes());
            DIMS.iter().enumerate().for_each(|(i, n)| put(16 + 8 * i, &i64::from(*n).to_le_bytes()));
            put(12, &1024i16.to_le_bytes());
            put(168, &544i64.to_le_bytes());
            [1.0f64, 2.0, 3.0].iter().enumerate().for_each(|(i, mm)| put(112 + 8 * i, &mm.to_le_bytes()));
            bytes[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
            // Four bytes that say that no extension follows.
            bytes.extend([0; 4]);
            let number = |label: i64| if is_big_endian { label.to_be_bytes() } else { label.to_le_bytes() };
            bytes.extend((0..24i64).flat_map(number));
            assert_eq!(label_map_file::parse(&bytes, MAX_VOXELS).unwrap(), expected, "big-endian: {is_big_endian}");
        }
    }
}
