//! What is done to an input.

use proptest::prelude::*;
use proptest::sample::Index;

/// What numbers are replaced by, and what is put anywhere.
const WORDS: [&[u8]; 20] = [
    b"0",
    b"-1",
    b"nan",
    b"inf",
    b"-1e308",
    b"1e-320",
    b"4294967296",
    b"18446744073709551615",
    b"99999999999999999999999",
    b"\"",
    b"\n",
    b" ",
    b"[[",
    "\u{202e}".as_bytes(),
    &[0; 8],
    &[0xff; 4],
    &[0xff; 8],
    &[0xff, 0xff, 0xff, 0x7f],
    &[0, 0, 0, 0x80],
    &[0, 0, 0, 0, 0, 0, 0xf0, 0x7f],
];
/// Bytes that are taken out, or put in once more.
const MAX_RUN: usize = 64;
/// Inputs grow no further.
const MAX_BYTES: usize = 1 << 20;

/// A change of an input.
#[derive(Clone, Debug)]
pub enum Change {
    Flip(Index, u8),
    Set(Index, u8),
    Word(Index, Index),
    Number(Index, Index),
    Remove(Index, u8),
    Repeat(Index, u8, u8),
    Cut(Index),
    Splice(Index, Index, Index),
}

/// Any of them.
pub fn changes() -> impl Strategy<Value = Change> {
    let (at, byte) = (any::<Index>, any::<u8>);
    prop_oneof![
        (at(), byte()).prop_map(|(at, bit)| Change::Flip(at, bit)),
        (at(), byte()).prop_map(|(at, value)| Change::Set(at, value)),
        (at(), at()).prop_map(|(at, word)| Change::Word(at, word)),
        (at(), at()).prop_map(|(at, word)| Change::Number(at, word)),
        (at(), byte()).prop_map(|(at, length)| Change::Remove(at, length)),
        (at(), byte(), byte()).prop_map(|(at, length, times)| Change::Repeat(at, length, times)),
        at().prop_map(Change::Cut),
        (at(), at(), at()).prop_map(|(other, from, to)| Change::Splice(other, from, to)),
    ]
}

/// The input after a change.
pub fn change(mut input: Vec<u8>, change: &Change, corpus: &[Vec<u8>]) -> Vec<u8> {
    // One more than there are: at the end, too.
    let at = |index: &Index, input: &[u8]| index.index(input.len() + 1);
    match change {
        Change::Flip(index, bit) => {
            let at = at(index, &input);
            input.get_mut(at).into_iter().for_each(|byte| *byte ^= 1 << (bit % 8));
        }
        Change::Set(index, value) => {
            let at = at(index, &input);
            input.get_mut(at).into_iter().for_each(|byte| *byte = *value);
        }
        Change::Word(index, word) => {
            let at = at(index, &input);
            input.splice(at..at, word.get(&WORDS).iter().copied());
        }
        Change::Number(index, word) => {
            let numbers = numbers(&input);
            if !numbers.is_empty() {
                let range = index.get(&numbers).clone();
                input.splice(range, word.get(&WORDS).iter().copied());
            }
        }
        Change::Remove(index, length) => {
            let from = at(index, &input);
            let to = input.len().min(from + *length as usize % MAX_RUN);
            input.drain(from..to);
        }
        Change::Repeat(index, length, times) => {
            let from = at(index, &input);
            let to = input.len().min(from + *length as usize % MAX_RUN);
            let run = input[from..to].repeat(*times as usize);
            input.splice(to..to, run);
        }
        Change::Cut(index) => input.truncate(at(index, &input)),
        Change::Splice(other, from, to) => {
            let other = other.get(corpus);
            input.truncate(at(from, &input));
            input.extend_from_slice(&other[at(to, other)..]);
        }
    }
    input.truncate(MAX_BYTES);
    input
}

/// Where numbers stand in a text.
fn numbers(text: &[u8]) -> Vec<std::ops::Range<usize>> {
    let is_of_number = |byte: &u8| byte.is_ascii_digit() || b".-+e".contains(byte);
    let mut ranges = Vec::new();
    let mut at = 0;
    for run in text.chunk_by(|a, b| is_of_number(a) == is_of_number(b)) {
        if is_of_number(&run[0]) && run.iter().any(u8::is_ascii_digit) {
            ranges.push(at..at + run.len());
        }
        at += run.len();
    }
    ranges
}
