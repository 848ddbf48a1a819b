//! What `kerf-server` is made of: one module per subcommand, and what they share.

pub mod check;
pub mod scenes;
pub mod simulate;
