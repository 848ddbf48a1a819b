//! Integers in `bytes` fields, as `kerf/v1/view.proto` says: zigzag and LEB128, zeros counted.

/// Why bytes are no integers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Malformed {
    /// They end within an integer.
    Truncated,
    /// An integer has more than 64 bits, or zeros are counted beyond what is wanted.
    TooLarge,
    /// There are more or fewer integers than are wanted.
    Count {
        /// How many there are; one more than wanted stands for any more.
        got: usize,
    },
}

/// Writes integers.
#[must_use]
pub fn encode(values: impl IntoIterator<Item = i64>) -> Vec<u8> {
    let values = values.into_iter();
    // Most take a byte.
    let mut bytes = Vec::with_capacity(values.size_hint().0);
    let mut zeros = 0_u64;
    for value in values {
        if value == 0 {
            zeros += 1;
            continue;
        }
        if zeros > 0 {
            put_zeros(&mut bytes, &mut zeros);
        }
        put(&mut bytes, (value << 1 ^ value >> 63) as u64);
    }
    put_zeros(&mut bytes, &mut zeros);
    bytes
}

fn put_zeros(bytes: &mut Vec<u8>, zeros: &mut u64) {
    if *zeros > 0 {
        bytes.push(0);
        put(bytes, *zeros - 1);
        *zeros = 0;
    }
}

#[inline]
fn put(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// Reads as many integers as are written, at most `max`.
///
/// # Errors
/// See [`Malformed`].
pub fn decode(bytes: &[u8], max: usize) -> Result<Vec<i64>, Malformed> {
    let mut values = Vec::new();
    let mut rest = bytes;
    while !rest.is_empty() {
        let value = take(&mut rest)?;
        let count = if value == 0 { take(&mut rest)?.saturating_add(1) } else { 1 };
        if count > (max - values.len()) as u64 {
            return Err(Malformed::Count { got: max + 1 });
        }
        values.resize(values.len() + count as usize, (value >> 1) as i64 ^ -((value & 1) as i64));
    }
    Ok(values)
}

/// Reads exactly `count` integers.
///
/// # Errors
/// See [`Malformed`].
pub fn decode_exactly(bytes: &[u8], count: usize) -> Result<Vec<i64>, Malformed> {
    let values = decode(bytes, count)?;
    if values.len() == count { Ok(values) } else { Err(Malformed::Count { got: values.len() }) }
}

fn take(bytes: &mut &[u8]) -> Result<u64, Malformed> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first().ok_or(Malformed::Truncated)?;
        *bytes = rest;
        let group = u64::from(byte & 0x7f);
        if group << shift >> shift != group {
            return Err(Malformed::TooLarge);
        }
        value |= group << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err(Malformed::TooLarge)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_written_as_the_protocol_s_example_has_them() {
        // docs/reference/protocol.md, worked out by hand there.
        let bytes = [0x00, 0x02, 0x01, 0x06, 0xac, 0x02, 0x00, 0x00];
        let values = [0, 0, 0, -1, 3, 150, 0];
        assert_eq!(encode(values), bytes);
        assert_eq!(decode(&bytes, 7), Ok(values.to_vec()));
    }

    #[test]
    fn every_integer_comes_back() {
        let values: Vec<i64> =
            (0..64).flat_map(|bit| [1_i64 << bit, !(1_i64 << bit), 0]).chain([0, 0, i64::MAX]).collect();
        assert_eq!(decode_exactly(&encode(values.iter().copied()), values.len()), Ok(values));
    }

    #[test]
    fn bytes_that_are_no_integers_are_refused() {
        assert_eq!(decode(&[0x80], 9), Err(Malformed::Truncated));
        assert_eq!(decode(&[0x00], 9), Err(Malformed::Truncated));
        assert_eq!(decode(&[0xff; 10], 9), Err(Malformed::TooLarge));
        assert_eq!(decode(&[0x02, 0x02], 1), Err(Malformed::Count { got: 2 }));
        assert_eq!(
            decode(&[0, 0xff, 0xff, 0xff, 0xff, 0x7f], 9),
            Err(Malformed::Count { got: 10 }),
            "no memory for it"
        );
        assert_eq!(decode_exactly(&[0x02], 2), Err(Malformed::Count { got: 1 }));
    }
}
