//! The families as a Markdown document. It holds no times and no machine: the same code gives the same
//! bytes.

use std::fmt::Write;

use kerf_plot::Figure;

use super::{Check, Family, Reference, Row, Study, Table};

const HEADER: &str = "# Verification

Written by `make verify`, which runs every case anew; figures are deterministic, so a re-run gives this file.
Each cell holds our figure and, in brackets, its error relative to the reference; where the reference is
zero, an upper bound by decades; where it is a limit, the figure alone, in bold if it exceeds the limit. Clamps, sides
off the lattice, the probe, cuts and scissors have a row to a figure, with the largest error it may have (none where
the figure is there to be read) and, where a tool works, what its run's energy ledger leaves unexplained.
`k` is the number of voxels along the edge of a composite element, `h` the edge of a voxel, `H = k h` that of
an element. Static cases are solved to a correction of 1e-7 of the displacement. Observed orders are those
of the three finest meshes; \"not asymptotic\" says that the error changes its sign there or is no power of
the size. The coarse part runs in `make test` (`tests/tests/verification.rs`).
";

/// The document; plots are expected beside it as `verification-<file>.png`.
#[must_use]
pub fn markdown(families: &[Family]) -> String {
    let mut text = String::from(HEADER);
    for family in families {
        write_family(&mut text, family);
    }
    text
}

fn write_family(text: &mut String, family: &Family) {
    // Writing to a string does not fail.
    let _ = writeln!(text, "\n## {}\n\n{}", family.title, family.text);
    for table in &family.tables {
        write_table(text, table);
    }
    write_checks(text, &family.checks);
    for study in &family.studies {
        write_study(text, study);
    }
    family.figures.iter().for_each(|figure| write_figure(text, figure));
}

fn write_checks(text: &mut String, checks: &[Check]) {
    if checks.is_empty() {
        return;
    }
    let held = || checks.iter().filter(|check| check.limit.is_some());
    let met = held().filter(|check| check.is_met()).count();
    let _ = writeln!(text, "\n{met} of {} are met.", held().count());
    let _ = writeln!(text, "\n| case | reference | ours | error | limit | ledger residual | met | source |");
    let _ = writeln!(text, "|---|---|---|---|---|---|---|---|");
    for check in checks {
        let Check { case, reference, ours, limit, residual, source } = check;
        let met = if check.is_met() { "yes" } else { "**no**" };
        let _ = writeln!(
            text,
            "| {case} | {} | {} | {} | {} | {} | {} | {source} |",
            significant(*reference),
            significant(*ours),
            percent(check.error()),
            limit.map_or("-".into(), |limit| format!("{} %", 100.0 * limit)),
            residual.map_or("-".into(), decade),
            if limit.is_some() { met } else { "-" },
        );
    }
}

fn write_figure(text: &mut String, figure: &Figure) {
    let _ = writeln!(text, "\n![{}]({}.png)", figure.title, figure.file);
}

fn write_table(text: &mut String, table: &Table) {
    let _ = writeln!(text, "\n| case | reference | {} | source |", table.columns.join(" | "));
    let _ = writeln!(text, "|---|---|{}---|", "---|".repeat(table.columns.len()));
    for row in &table.rows {
        let _ = writeln!(text, "| {} | {} | {} | {} |", row.case, reference(row), cells(row).join(" | "), row.source);
    }
}

fn reference(row: &Row) -> String {
    match row.reference {
        Reference::Value(value, unit) => format!("{} {unit}", significant(value)).trim_end().to_owned(),
        Reference::Zero => "0".into(),
        Reference::AtMost(limit) => format!("at most {limit}"),
    }
}

/// A row's figures with their errors.
fn cells(row: &Row) -> Vec<String> {
    row.ours
        .iter()
        .zip(row.errors())
        .map(|(ours, error)| match row.reference {
            Reference::Value(..) => format!("{} ({})", significant(*ours), percent(error)),
            Reference::Zero => decade(*ours),
            Reference::AtMost(_) if error > 0.0 => format!("**{ours:.4}, exceeded**"),
            Reference::AtMost(_) => format!("{ours:.4}"),
        })
        .collect()
}

/// Five significant digits.
fn significant(value: f64) -> String {
    // The exponent of the rounded value: 0.999999 is written as 1.0000.
    let scientific = format!("{value:.4e}");
    let exponent = scientific.split_once('e').and_then(|(_, exponent)| exponent.parse::<i32>().ok()).unwrap_or(0);
    format!("{value:.*}", (4 - exponent).clamp(0, 12) as usize)
}

fn percent(error: f64) -> String {
    if error.abs() < 5e-6 {
        "within 0.001 %".into()
    } else if error.abs() < 1e-3 {
        format!("{:+.3} %", 100.0 * error)
    } else {
        format!("{:+.2} %", 100.0 * error)
    }
}

/// The least power of ten that is not exceeded: figures of round-off have no digits to show.
fn decade(error: f64) -> String {
    if error == 0.0 { "0".into() } else { format!("< 1e{}", error.abs().log10().ceil() as i32) }
}

fn write_study(text: &mut String, study: &Study) {
    let orders: Vec<String> = study.series.iter().map(super::Series::summary).collect();
    let _ = writeln!(text, "\n{}. Error of the {}; {}.", study.title, study.error_of, orders.join(", "));
    let _ = writeln!(text, "\n![{}](verification-{}.png)", study.title, study.file);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_written_with_five_digits_and_errors_in_percent() {
        assert_eq!(
            [significant(32.748_526), significant(0.301_72), significant(-3444.04)],
            ["32.749", "0.30172", "-3444.0"]
        );
        assert_eq!([percent(-0.0123), percent(2e-4), percent(1e-7)], ["-1.23 %", "+0.020 %", "within 0.001 %"]);
        assert_eq!([decade(3e-13), decade(0.0)], ["< 1e-12", "0"]);
    }
}
