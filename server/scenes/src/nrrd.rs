//! Label maps from NRRD files (`.nrrd`, `.seg.nrrd`), as Slicer and ITK save them.
//!
//! Source: "Definition of NRRD File Format" (teem.sourceforge.net/nrrd/format.html). Deliberately absent: data in a file
//! beside the header, text data, bzip2, and segmentations of more than one layer.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};

use flate2::read::GzDecoder;
use nalgebra::{Matrix3, Vector3};

use crate::kind::Kind;
use crate::label_map::{LabelMap, checked_dims, to_scene_m};

/// Most bytes of a header: that of a segmentation has some lines for each segment.
const MAX_HEADER_BYTES: u64 = 1 << 20;
const MM: f64 = 1e-3;

/// Reads a file whose magic has not been read yet.
pub(crate) fn read(source: impl Read, max_voxels: u64) -> Result<LabelMap, String> {
    let mut source = BufReader::new(source);
    let header = Header::read(&mut source)?;
    let dims = header.dims(max_voxels)?;
    let kind = header.kind()?;
    let is_big_endian = match (kind.bytes(), header.get("endian")) {
        (1, _) | (_, Some("little")) => false,
        (_, Some("big")) => true,
        (_, other) => return Err(format!("endian = {}: is little or big", other.unwrap_or("nothing"))),
    };
    for skip in ["line skip", "byte skip"] {
        if header.get(skip).is_some_and(|value| value != "0") {
            return Err(format!("{skip}: data that begin elsewhere than after the header are not read"));
        }
    }
    let mut data = vec![0; dims.iter().product::<usize>() * kind.bytes()];
    let read = match header.get("encoding") {
        Some("raw") => source.read_exact(&mut data),
        Some("gzip" | "gz") => GzDecoder::new(source).read_exact(&mut data),
        other => return Err(format!("encoding = {}: is raw or gzip", other.unwrap_or("nothing"))),
    };
    read.map_err(|_| format!("the file is cut off: it ends before its {dims:?} voxels"))?;
    LabelMap::of_data(dims, (kind, is_big_endian), &data, header.placement_m()?)
}

/// Fields and their values.
struct Header {
    fields: BTreeMap<String, String>,
}

impl Header {
    /// Up to the empty line.
    fn read(source: &mut impl BufRead) -> Result<Self, String> {
        let mut fields = BTreeMap::new();
        let mut limited = source.by_ref().take(MAX_HEADER_BYTES);
        loop {
            let mut line = Vec::new();
            let ended = limited.read_until(b'\n', &mut line).map_err(|_| "the header is cut off")? == 0;
            if ended {
                return Err("the header does not end: an empty line is missing".into());
            }
            let line = String::from_utf8_lossy(&line);
            let line = line.trim_end();
            if line.is_empty() {
                return Ok(Self { fields });
            }
            // `key:=value` is a remark of a program's own.
            if let Some((field, value)) = line.split_once(": ").filter(|_| !line.starts_with('#')) {
                fields.insert(field.to_ascii_lowercase(), value.trim().to_owned());
            }
        }
    }

    fn get(&self, field: &str) -> Option<&str> {
        self.fields.get(field).map(String::as_str)
    }

    fn dims(&self, max_voxels: u64) -> Result<[usize; 3], String> {
        if self.get("data file").or(self.get("datafile")).is_some() {
            return Err("data file: the voxels are in another file; save header and data as one".into());
        }
        let sizes = self.get("sizes").ok_or("sizes: is missing")?;
        let parsed: Option<Vec<i64>> = sizes.split_whitespace().map(|size| size.parse().ok()).collect();
        let three = parsed.and_then(|sizes| <[i64; 3]>::try_from(sizes).ok());
        let three = three.ok_or_else(|| {
            format!("sizes = {sizes}: a label map has three dimensions; save segments that overlap one by one")
        })?;
        checked_dims("sizes", three, max_voxels)
    }

    fn kind(&self) -> Result<Kind, String> {
        Ok(match self.get("type").unwrap_or_default() {
            "signed char" | "int8" | "int8_t" => Kind::I8,
            "uchar" | "unsigned char" | "uint8" | "uint8_t" => Kind::U8,
            "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Kind::I16,
            "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Kind::U16,
            "int" | "signed int" | "int32" | "int32_t" => Kind::I32,
            "uint" | "unsigned int" | "uint32" | "uint32_t" => Kind::U32,
            "longlong"
            | "long long"
            | "long long int"
            | "signed long long"
            | "signed long long int"
            | "int64"
            | "int64_t" => Kind::I64,
            "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Kind::U64,
            "float" => Kind::F32,
            "double" => Kind::F64,
            other => return Err(format!("type = {other}: labels are integers of 8 to 64 bits, or whole floats")),
        })
    }

    /// Edges of a voxel as columns and centre of the first one, m, scene axes.
    fn placement_m(&self) -> Result<(Matrix3<f64>, Vector3<f64>), String> {
        let edges = match (self.get("space directions"), self.get("spacings")) {
            (Some(directions), _) => {
                let columns: Vec<_> = vectors("space directions", directions)?;
                let [i, j, k] = columns[..] else {
                    return Err(format!("space directions = {directions}: one vector for each of three axes"));
                };
                Matrix3::from_columns(&[i, j, k])
            }
            (None, Some(spacings)) => {
                let parsed: Option<Vec<f64>> = spacings.split_whitespace().map(|word| word.parse().ok()).collect();
                let three = parsed.filter(|spacings| spacings.len() == 3);
                let three = three.ok_or_else(|| format!("spacings = {spacings}: three numbers"))?;
                Matrix3::from_diagonal(&Vector3::from_column_slice(&three))
            }
            (None, None) => Matrix3::identity(),
        };
        let origin = self.get("space origin").map(|origin| vectors("space origin", origin)).transpose()?;
        let first = origin.and_then(|origin| origin.first().copied()).unwrap_or_default();
        // Of the file's axes to right, anterior, superior.
        let signs = match self.get("space").unwrap_or("right-anterior-superior").to_ascii_lowercase().as_str() {
            "right-anterior-superior" | "ras" | "scanner-xyz" | "3d-right-handed" => [1.0, 1.0, 1.0],
            "left-anterior-superior" | "las" => [-1.0, 1.0, 1.0],
            "left-posterior-superior" | "lps" => [-1.0, -1.0, 1.0],
            other => return Err(format!("space = {other}: is right- or left-anterior- or left-posterior-superior")),
        };
        let to_ras = Matrix3::from_diagonal(&Vector3::from(signs));
        let unit_m = match self.get("space units").and_then(|units| units.split('"').nth(1)) {
            Some("m") => 1.0,
            Some("um" | "micron") => 1e-6,
            None | Some("mm" | "") => MM,
            Some(other) => return Err(format!("space units = {other}: lengths are in m, mm or um")),
        };
        to_scene_m(unit_m, (to_ras * edges, to_ras * first))
    }
}

/// `(1,0,0) (0,1,0) none`: axes without a direction are left out.
fn vectors(field: &str, text: &str) -> Result<Vec<Vector3<f64>>, String> {
    let wrong = || format!("{field} = {text}: vectors as (x,y,z)");
    let inner = text.split(')').map(|part| part.trim().trim_start_matches("none").trim());
    let inner = inner.filter(|part| !part.is_empty());
    inner
        .map(|part| {
            let numbers: Option<Vec<f64>> =
                part.strip_prefix('(').ok_or_else(wrong)?.split(',').map(|word| word.trim().parse().ok()).collect();
            let three = numbers.filter(|numbers| numbers.len() == 3).ok_or_else(wrong)?;
            Ok(Vector3::from_column_slice(&three))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;
    use crate::label_map::MAX_VOXELS;
    use crate::label_map_file;

    fn label(map: &LabelMap, voxel: [i64; 3]) -> u16 {
        map.index(voxel).map_or(0, |index| map.labels[index])
    }

    fn file(kind: &str, encoding: &str, extra: &str, data: &[u8]) -> Vec<u8> {
        let header = format!(
            "NRRD0004\n# made by a test\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: 2 3 4\n\
             space directions: (1,0,0) (0,2,0) (0,0,3)\nkinds: domain domain domain\nendian: little\n\
             encoding: {encoding}\nspace origin: (5,6,7)\n{extra}Segment0_Name:=liver: left\n\n"
        );
        let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
        gzip.write_all(data).unwrap();
        let packed = gzip.finish().unwrap();
        [header.as_bytes(), if encoding == "gzip" { &packed } else { data }].concat()
    }

    fn labels(width: usize) -> Vec<u8> {
        (0..24u8).flat_map(|label| std::iter::once(label).chain(std::iter::repeat_n(0, width - 1))).collect()
    }

    #[test]
    fn every_type_and_encoding_gives_the_same_map() {
        let read = |kind, encoding, width| {
            label_map_file::parse(&file(kind, encoding, "", &labels(width)), MAX_VOXELS).unwrap()
        };
        let map = read("unsigned char", "raw", 1);
        for (kind, width) in [("short", 2), ("uint32", 4), ("int64", 8), ("unsigned long long", 8)] {
            for encoding in ["raw", "gzip"] {
                assert_eq!(read(kind, encoding, width), map, "{kind} {encoding}");
            }
        }
        assert_eq!((map.dims, label(&map, [1, 2, 3]), label(&map, [1, 0, 0])), ([2, 3, 4], 23, 1));
        // Left is the scene's x, posterior down, superior away.
        assert!((map.edges_m - Matrix3::from_diagonal(&Vector3::new(1e-3, -2e-3, -3e-3))).norm() < 1e-12);
        assert!((map.first_m - Vector3::new(5e-3, -6e-3, -7e-3)).norm() < 1e-12);
    }

    #[test]
    fn what_cannot_be_read_is_told_by_its_field() {
        let refused = |from: &str, to: &str| {
            let text = String::from_utf8(file("unsigned char", "raw", "", &labels(1))).unwrap().replacen(from, to, 1);
            label_map_file::parse(text.as_bytes(), MAX_VOXELS).unwrap_err()
        };
        for (from, to, field) in [
            ("sizes: 2 3 4", "sizes: 2 2 3 4", "sizes = 2 2 3 4"),
            ("sizes: 2 3 4", "sizes: 2 3 5", "cut off"),
            ("sizes: 2 3 4", "sizes: 2 3 4000000000", "sizes = [2, 3, 4000000000]"),
            ("type: unsigned char", "type: block", "type = block"),
            ("encoding: raw", "encoding: bzip2", "encoding = bzip2"),
            ("(0,2,0)", "(0,0,0)", "orientation"),
            ("(5,6,7)", "(5,6)", "space origin"),
            ("space: left-posterior-superior", "space: right-up", "space = right-up"),
            ("endian: little", "data file: x.raw", "data file"),
            ("\n\n", "\n", "empty line"),
        ] {
            let message = refused(from, to);
            assert!(message.contains(field), "{field}: {message}");
        }
    }
}
