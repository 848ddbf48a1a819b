//! When a certificate stops being good.

use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

/// Tags of DER (X.690) that lead to it.
const SEQUENCE: u8 = 0x30;
const VERSION: u8 = 0xa0;
const UTC_TIME: u8 = 0x17;
const GENERALIZED_TIME: u8 = 0x18;

/// The end of a certificate's validity (RFC 5280, 4.1), seconds since 1970; `None` where it is not told as it has to be.
pub fn expires_s(certificate: &[u8]) -> Option<i64> {
    let (_, certificate, _) = value(certificate).filter(|(tag, ..)| *tag == SEQUENCE)?;
    let (_, mut fields, _) = value(certificate).filter(|(tag, ..)| *tag == SEQUENCE)?;
    // Before the validity: perhaps a version, then a serial number, an algorithm, an issuer.
    let before = if *fields.first()? == VERSION { 4 } else { 3 };
    for _ in 0..before {
        fields = value(fields)?.2;
    }
    let (_, validity, _) = value(fields).filter(|(tag, ..)| *tag == SEQUENCE)?;
    let (tag, not_after, _) = value(value(validity)?.2)?;
    seconds(tag, std::str::from_utf8(not_after).ok()?)
}

/// The first value: its tag, what is in it, and what comes after it.
fn value(der: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (&[tag, length], rest) = der.split_first_chunk::<2>()?;
    let (length, rest) = match length {
        0..=0x7f => (usize::from(length), rest),
        // So many bytes have the length: of what a certificate holds no more than four.
        0x81..=0x84 => {
            let (bytes, rest) = rest.split_at_checked(usize::from(length & 0x7f))?;
            (bytes.iter().fold(0, |length, byte| length << 8 | usize::from(*byte)), rest)
        }
        _ => return None,
    };
    let (content, after) = rest.split_at_checked(length)?;
    Some((tag, content, after))
}

/// `YYMMDDHHMMSSZ` of the years 1950 to 2049, or with all four digits of the year.
fn seconds(tag: u8, text: &str) -> Option<i64> {
    let text = match tag {
        UTC_TIME if text.get(..2)? < "50" => format!("20{text}"),
        UTC_TIME => format!("19{text}"),
        GENERALIZED_TIME => text.to_owned(),
        _ => return None,
    };
    if text.len() != 15 || !text.is_ascii() {
        return None;
    }
    let at = |from: usize, to: usize| &text[from..to];
    let (date, time) = ([at(0, 4), at(4, 6), at(6, 8)].join("-"), [at(8, 10), at(10, 12), at(12, 15)].join(":"));
    OffsetDateTime::parse(&format!("{date}T{time}"), &Rfc3339).ok().map(OffsetDateTime::unix_timestamp)
}

#[cfg(test)]
mod tests {
    use rcgen::{CertificateParams, KeyPair, date_time_ymd};

    use super::*;

    fn certificate(year: i32) -> Vec<u8> {
        let mut params = CertificateParams::new(["localhost".to_owned()]).unwrap();
        params.not_after = date_time_ymd(year, 2, 3);
        params.self_signed(&KeyPair::generate().unwrap()).unwrap().der().to_vec()
    }

    #[test]
    fn a_certificate_tells_when_it_ends_in_this_half_of_the_century_and_later() {
        for year in [2031, 2049, 2050, 2120] {
            assert_eq!(expires_s(&certificate(year)), Some(date_time_ymd(year, 2, 3).unix_timestamp()), "{year}");
        }
    }

    #[test]
    fn what_is_cut_off_tells_nothing() {
        let whole = certificate(2031);
        assert!((0..whole.len()).all(|length| expires_s(&whole[..length]).is_none()));
    }
}
