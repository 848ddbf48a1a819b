//! The walk over a value of every shape there is.

use super::{Kept, decode, difference, encode, hash};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Shape {
    Unit,
    One(u16),
    Two(i8, i64),
    Named { a: f32, b: Option<Box<Shape>> },
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Everything {
    flag: bool,
    numbers: Vec<[f64; 3]>,
    shapes: Vec<Shape>,
    map: BTreeMap<[i32; 3], String>,
    kept: Kept<Vec<u32>>,
    lanes: wide::f64x4,
    place: crate::Vec3,
    turn: crate::Quat,
    #[serde(skip)]
    scratch: u32,
}

fn everything() -> Everything {
    Everything {
        flag: true,
        numbers: vec![[0.0, -0.0, f64::NAN], [1.0, f64::INFINITY, f64::MIN_POSITIVE]],
        shapes: vec![
            Shape::Unit,
            Shape::One(7),
            Shape::Two(-3, i64::MIN),
            Shape::Named { a: 0.5, b: Some(Box::new(Shape::Unit)) },
        ],
        map: BTreeMap::from([([1, -2, 3], "a".into()), ([4, 5, 6], "bc".into())]),
        kept: Kept::from(vec![1, 2, 3]),
        lanes: wide::f64x4::new([1.0, 2.0, 3.0, 4.0]),
        place: crate::Vec3::new(1.0, 2.0, 3.0),
        turn: crate::Quat::from_scaled_axis(crate::Vec3::new(0.1, 0.2, 0.3)),
        scratch: 9,
    }
}

#[test]
fn what_is_read_is_what_was_written() {
    let value = everything();
    let mut bytes = Vec::new();
    encode(&value, &mut bytes);
    let mut rest = &bytes[..];
    let read: Everything = decode(&mut rest).expect("what was written");
    assert_eq!((rest.len(), read.scratch), (0, 0));
    assert_eq!(difference(&read, &value), None);
    assert_eq!(hash(&read), hash(&value));
}

#[test]
fn bytes_that_end_early_are_refused_wherever_they_end() {
    let mut bytes = Vec::new();
    encode(&everything(), &mut bytes);
    for end in 0..bytes.len() {
        assert!(decode::<Everything>(&mut &bytes[..end]).is_err(), "{end} of {} bytes", bytes.len());
    }
}

#[test]
fn a_length_that_is_beyond_the_bytes_takes_no_memory() {
    let mut bytes = vec![1];
    bytes.extend(u64::MAX.to_le_bytes());
    let error = decode::<Everything>(&mut &bytes[..]).expect_err("there are no so many");
    assert_eq!(error.to_string(), "a sequence of 18446744073709551615 is to follow in 0 bytes");
}

#[test]
fn the_first_difference_is_told_by_its_path() {
    let value = everything();
    let told = |change: &dyn Fn(&mut Everything)| {
        let mut other = value.clone();
        change(&mut other);
        assert_ne!(hash(&other), hash(&value));
        difference(&value, &other).expect("they differ")
    };
    assert_eq!(told(&|v| v.numbers[1][2] = 0.0), "numbers[1][2]");
    assert_eq!(told(&|v| v.shapes[3] = Shape::Named { a: 0.25, b: None }), "shapes[3].a");
    assert_eq!(told(&|v| v.kept[1] = 9), "kept[1][1]");
    assert_eq!(told(&|v| v.lanes.as_mut_array()[2] = 9.0), "lanes[2]");
}

#[test]
fn a_kept_hash_is_made_once_and_anew_after_a_change() {
    let mut value = everything();
    let before = hash(&value);
    assert_eq!(hash(&value), before);
    value.kept.push(4);
    let changed = hash(&value);
    assert_ne!(changed, before);
    value.kept.pop();
    assert_eq!(hash(&value), before);
}
