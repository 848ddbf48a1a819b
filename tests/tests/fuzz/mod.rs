//! Bytes that nobody meant to send: what reads files and messages refuses them in words. It neither panics, nor hangs, nor
//! takes memory without bounds.
//!
//! Inputs are those of `tests/corpus` and of a session, changed at random. Each target is fuzzed for a moment here, and by
//! `make fuzz` for as long as one likes; `make fuzz-guided` gives the same readers to libFuzzer.

mod changes;
mod control;
mod files;
mod messages;
mod states;

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

use changes::{Change, change, changes};
use kerf_system_tests::readers::Reader;

/// Longest that an input may take, on a busy machine. Files take milliseconds.
const PATIENCE: Duration = Duration::from_secs(20);
/// Changes of one input.
const MAX_CHANGES: usize = 6;
/// Inputs of one seed, after which the clock is looked at.
const INPUTS_PER_SEED: u32 = 16;

/// How long each target is fuzzed, s: `FUZZ_SECONDS`.
fn seconds() -> f64 {
    std::env::var("FUZZ_SECONDS").map_or(2.0, |text| text.parse().expect("FUZZ_SECONDS is a number"))
}

/// Gives a reader the inputs that it has, and then changed ones until the time is over.
fn fuzz(reader: &Reader) {
    fuzz_from(reader.name, &(reader.seeds)(), reader.read);
}

/// Reads inputs of a corpus, and then changed ones until the time is over.
fn fuzz_from(target: &str, corpus: &[Vec<u8>], read: impl Fn(&[u8])) {
    corpus.iter().for_each(|input| read(input));
    let strategy = (any::<prop::sample::Index>(), prop::collection::vec(changes(), 1..=MAX_CHANGES));
    fuzz_made(target, &strategy, |(input, changes)| changed(input.get(corpus).clone(), &changes, corpus), read);
}

fn changed(input: Vec<u8>, changes: &[Change], corpus: &[Vec<u8>]) -> Vec<u8> {
    changes.iter().fold(input, |input, next| change(input, next, corpus))
}

/// Reads inputs that are made of what a strategy gives until the time is over. One that fails is made as simple as can
/// be, and kept.
fn fuzz_made<S: Strategy>(target: &str, strategy: &S, make: impl Fn(S::Value) -> Vec<u8>, read: impl Fn(&[u8])) {
    let (began, inputs) = (Instant::now(), Cell::new(0));
    let first_seed: u64 =
        std::env::var("FUZZ_SEED").map_or(1, |text| text.parse().expect("FUZZ_SEED is a whole number"));
    for seed in first_seed.. {
        if began.elapsed().as_secs_f64() > seconds() {
            break;
        }
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&seed.to_le_bytes());
        let config = Config { cases: INPUTS_PER_SEED, failure_persistence: None, ..Config::default() };
        let mut runner = TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &bytes));
        let outcome = runner.run(strategy, |made| {
            let input = make(made);
            // Of a process that is ended for its memory this is all that is left.
            std::fs::write(kept(target), &input).expect("a place for inputs");
            let began = Instant::now();
            read(&input);
            prop_assert!(began.elapsed() < PATIENCE, "{:?}", began.elapsed());
            inputs.set(inputs.get() + 1);
            Ok(())
        });
        outcome.unwrap_or_else(|failure| panic!("{target}, FUZZ_SEED={seed}, {}: {failure}", kept(target).display()));
    }
    println!("{target}: {} inputs in {:.0} s", inputs.get(), began.elapsed().as_secs_f64());
}

/// Where the input is that was read last.
fn kept(target: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
    std::fs::create_dir_all(&folder).expect("a folder for inputs");
    folder.join(target)
}
