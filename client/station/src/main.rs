//! `kerf-station`: connects a haptic device to a session.

fn main() {}
