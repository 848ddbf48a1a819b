//! Files that the server writes and reads again: states, recordings, journals.

use kerf_system_tests::readers::states::{JOURNAL, RECORDING, STATE};

use super::fuzz;

#[test]
fn state() {
    fuzz(&STATE);
}

#[test]
fn recording() {
    fuzz(&RECORDING);
}

#[test]
fn journal() {
    fuzz(&JOURNAL);
}
