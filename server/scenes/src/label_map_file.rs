//! Label maps from the bytes of NIfTI and NRRD files.

use std::io::Read;

use flate2::read::GzDecoder;

use crate::label_map::LabelMap;
use crate::{nifti, nrrd};

/// Reads a file's bytes, which a gzip header says to be compressed.
///
/// # Errors
/// The field of the header that cannot be used and its value, or how the data do not fit it.
pub(crate) fn parse(bytes: &[u8], max_voxels: u64) -> Result<LabelMap, String> {
    if bytes.starts_with(&[0x1f, 0x8b]) {
        read(GzDecoder::new(bytes), max_voxels).map_err(|message| format!("{message} (gzip)"))
    } else {
        read(bytes, max_voxels)
    }
}

fn read(mut source: impl Read, max_voxels: u64) -> Result<LabelMap, String> {
    let mut magic = [0; 4];
    source.read_exact(&mut magic).map_err(|_| "the file is empty, or cut off")?;
    let source = magic.chain(source);
    if &magic == b"NRRD" { nrrd::read(source, max_voxels) } else { nifti::read(source, max_voxels) }
}
