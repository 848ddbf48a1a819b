//! Runs the published experiment and writes `docs/explanation/experiment.md` with its plot.

use std::path::Path;

fn main() -> anyhow::Result<()> {
    kerf_system_tests::experiment::write(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/explanation"))
}
