//! The same inputs give the same bits, whatever the number of threads; `make same-bits` asks it of profiles
//! and of the widths of the machine's vectors.

use super::support::press::{LAWS, hashes};
use kerf_physics::Workers;

#[test]
fn one_and_two_threads_give_the_same_bits() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    // At level 0 the block has 16,384 elements: enough work to be shared out.
    for (level, law) in [(2, LAWS[0]), (0, LAWS[0]), (0, LAWS[2])] {
        let serial = hashes(&Workers::serial(), level, law);
        assert_eq!(serial, hashes(&Workers::of(&pool), level, law), "level {level}");
    }
}
