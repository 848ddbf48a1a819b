//! The same inputs give the same bits, whatever the number of threads, the profile and the width of
//! the machine's vectors.

mod support;

use std::path::Path;
use std::process::Command;

use kerf_physics::Workers;
use support::press::{LAWS, hashes, hashes_of_all_laws};

#[test]
fn one_and_two_threads_give_the_same_bits() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    // At level 0 the block has 16,384 elements: enough work to be shared out.
    for (level, law) in [(2, LAWS[0]), (0, LAWS[0]), (0, LAWS[2])] {
        let serial = hashes(&Workers::serial(), level, law);
        assert_eq!(serial, hashes(&Workers::of(&pool), level, law), "level {level}");
    }
}

/// What the example `state_hashes` prints when it is built in release for `target_cpu`.
fn hashes_of_a_release_build(target_cpu: &str) -> String {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join(target_cpu);
    let output = Command::new(env!("CARGO"))
        .args(["run", "--quiet", "--release", "--offline", "--package", "kerf-physics", "--example", "state_hashes"])
        .env("CARGO_TARGET_DIR", &target)
        .env("CARGO_PROFILE_RELEASE_DEBUG", "false")
        .env("RUSTFLAGS", format!("-C target-cpu={target_cpu}"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{target_cpu}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("hashes in hexadecimal").trim().to_owned()
}

#[test]
#[cfg(target_arch = "x86_64")]
fn release_and_debug_and_avx2_and_avx512_give_the_same_bits() {
    let debug = hashes_of_all_laws();
    assert_eq!(debug, hashes_of_a_release_build("x86-64-v3"), "release differs from this profile");
    if is_x86_feature_detected!("avx512f") {
        assert_eq!(debug, hashes_of_a_release_build("x86-64-v4"), "AVX-512 differs from AVX2");
    } else {
        println!("skipped: this machine has no AVX-512");
    }
}
