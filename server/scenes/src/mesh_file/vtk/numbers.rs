//! The numbers of an array: words, or bytes behind a header, which may be packed and written as base64.

use std::borrow::Cow;
use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::read::ZlibDecoder;

use super::super::number;
use super::document::{Appended, Array, Packing, Place};
use crate::kind::{Kind, little_endian};

/// Reads arrays, and no more numbers in all than a file may have.
pub(super) struct Numbers<'a> {
    pub packing: Packing,
    pub appended: Option<Appended<'a>>,
    pub left: u64,
}

impl Numbers<'_> {
    pub fn of(&mut self, array: &Array<'_>) -> Result<Vec<f64>, String> {
        match &array.place {
            Place::Text(text) => text.split_ascii_whitespace().map(number).collect(),
            Place::Base64(text) => {
                let text: String = text.split_ascii_whitespace().collect();
                let mut bytes = Bytes::base64(text.as_bytes());
                let numbers = self.unpacked(array.kind, &mut bytes)?;
                match bytes.rest() {
                    0 => Ok(numbers),
                    rest => Err(format!("{rest} characters follow what its header promises")),
                }
            }
            Place::Appended(offset) => {
                let appended = self.appended.ok_or("the array is appended, and the file has no AppendedData")?;
                let from = usize::try_from(*offset).ok().and_then(|offset| appended.bytes.get(offset..));
                let from =
                    from.ok_or_else(|| format!("offset is {offset}, and {} bytes are appended", appended.bytes.len()))?;
                let mut bytes = if appended.is_base64 { Bytes::base64(from) } else { Bytes::Raw(from) };
                self.unpacked(array.kind, &mut bytes)
            }
        }
    }

    /// The numbers behind a header.
    fn unpacked(&mut self, kind: Kind, source: &mut Bytes<'_>) -> Result<Vec<f64>, String> {
        let bytes = if self.packing.is_compressed {
            Cow::Owned(self.inflated(kind, source)?)
        } else {
            let bytes = self.length(source)?;
            self.charge(kind, bytes)?;
            source.take(bytes)?
        };
        let mut numbers = Vec::new();
        let mut rest = &bytes[..];
        while let Some((number, behind)) = kind.take(rest, self.packing.is_big) {
            numbers.push(number);
            rest = behind;
        }
        if rest.is_empty() {
            Ok(numbers)
        } else {
            Err(format!("its {} bytes are no whole number of values", bytes.len()))
        }
    }

    /// The bytes of blocks that zlib packed. A header of lengths goes before them: how many blocks, what each unpacks to,
    /// what the last one unpacks to where it is shorter, and what each is packed to.
    fn inflated(&mut self, kind: Kind, source: &mut Bytes<'_>) -> Result<Vec<u8>, String> {
        let (blocks, block, last) = (self.length(source)?, self.length(source)?, self.length(source)?);
        let shorter = u64::from(last > 0 && blocks > 0);
        let total = (blocks - shorter)
            .checked_mul(block)
            .and_then(|bytes| bytes.checked_add(if shorter > 0 { last } else { 0 }));
        self.charge(kind, total.ok_or("its header promises more than there can be")?)?;
        let mut packed = Vec::new();
        for _ in 0..blocks {
            packed.push(self.length(source)?);
        }
        let mut bytes = Vec::new();
        for (number, packed) in (0..).zip(packed) {
            let promised = if number + 1 == blocks && last > 0 { last } else { block };
            let before = bytes.len() as u64;
            // One byte more than is promised, to see that there is none.
            let packed = source.take(packed)?;
            let mut inflater = ZlibDecoder::new(&*packed).take(promised + 1);
            inflater.read_to_end(&mut bytes).map_err(|error| format!("block {number}: {error} (zlib)"))?;
            let found = bytes.len() as u64 - before;
            if found != promised {
                return Err(format!("block {number} unpacks to other than the {promised} bytes that are promised"));
            }
        }
        Ok(bytes)
    }

    /// A length of a header.
    fn length(&self, source: &mut Bytes<'_>) -> Result<u64, String> {
        let kind = if self.packing.has_long_header { Kind::U64 } else { Kind::U32 };
        let bytes = source.take(kind.bytes() as u64)?;
        Ok(u64::from_le_bytes(little_endian(&bytes, self.packing.is_big)))
    }

    /// Takes what an array needs from what is left, before memory is taken for it.
    fn charge(&mut self, kind: Kind, bytes: u64) -> Result<(), String> {
        let numbers = bytes / kind.bytes() as u64;
        self.left = self.left.checked_sub(numbers).ok_or_else(|| {
            format!("its header promises {numbers} numbers; {} are left of those that a file may have", self.left)
        })?;
        Ok(())
    }
}

/// Bytes that are read one after the other.
enum Bytes<'a> {
    Raw(&'a [u8]),
    Base64 {
        text: &'a [u8],
        /// Decoded, and not taken yet.
        ahead: Vec<u8>,
    },
}

impl<'a> Bytes<'a> {
    fn base64(text: &'a [u8]) -> Self {
        Self::Base64 { text, ahead: Vec::new() }
    }

    /// Bytes, or characters of them, that are left.
    fn rest(&self) -> usize {
        match self {
            Self::Raw(bytes) => bytes.len(),
            Self::Base64 { text, ahead } => text.len() + ahead.len(),
        }
    }

    fn take(&mut self, count: u64) -> Result<Cow<'a, [u8]>, String> {
        let cut_off = || "the array is cut off: it has less than its header promises; export it again".to_owned();
        let count = usize::try_from(count).map_err(|_| cut_off())?;
        match self {
            Self::Raw(bytes) => {
                let (taken, rest) = bytes.split_at_checked(count).ok_or_else(cut_off)?;
                *bytes = rest;
                Ok(taken.into())
            }
            Self::Base64 { text, ahead } => {
                while ahead.len() < count {
                    if text.is_empty() {
                        return Err(cut_off());
                    }
                    // Headers may be encoded by themselves: then padding ends them, and more follows.
                    let wanted = (count - ahead.len()).div_ceil(3).saturating_mul(4).min(text.len());
                    let padding = text[..wanted].iter().position(|byte| *byte == b'=');
                    let end = padding.map_or(wanted, |at| (at / 4 * 4 + 4).min(text.len()));
                    let decoded = STANDARD.decode(&text[..end]).map_err(|error| format!("{error} (base64)"))?;
                    ahead.extend(decoded);
                    *text = &text[end..];
                }
                let rest = ahead.split_off(count);
                Ok(std::mem::replace(ahead, rest).into())
            }
        }
    }
}
