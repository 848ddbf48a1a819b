//! How a number stands in a binary file.

/// How a number stands in a binary file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Kind {
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The number in as many bytes, little-endian, zeros behind them. Beyond 2^53 the nearest that there is: no mesh has
    /// as many vertices.
    pub(crate) fn value(self, bytes: [u8; 8]) -> f64 {
        let [a, b, c, d, ..] = bytes;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::I64 => i64::from_le_bytes(bytes) as f64,
            Self::U64 => u64::from_le_bytes(bytes) as f64,
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(bytes),
        }
    }

    /// The label of a voxel that the same bytes are; `None`: no whole number from 0 to 65535.
    pub(crate) fn label(self, bytes: [u8; 8]) -> Option<u16> {
        let value = self.value(bytes);
        (value.fract() == 0.0 && (0.0..=65535.0).contains(&value)).then_some(value as u16)
    }

    /// The number that some bytes begin with, and the bytes behind it; `None` where they are too few.
    pub(crate) fn take(self, bytes: &[u8], is_big: bool) -> Option<(f64, &[u8])> {
        let (found, rest) = bytes.split_at_checked(self.bytes())?;
        Some((self.value(little_endian(found, is_big)), rest))
    }
}

/// Up to eight bytes as little-endian ones, zeros behind them.
pub(crate) fn little_endian(bytes: &[u8], is_big: bool) -> [u8; 8] {
    let mut little = [0; 8];
    little[..bytes.len()].copy_from_slice(bytes);
    if is_big {
        little[..bytes.len()].reverse();
    }
    little
}
