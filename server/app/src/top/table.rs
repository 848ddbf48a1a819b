//! The table of sessions, as plain text and on a terminal.

use std::fmt::Write as _;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::Line;
use ratatui::widgets::{Row, Table};

use super::sample::{Seen, SessionSeen};

const MIB: f64 = 1048576.0;

/// Heads of the columns; the first four are words, the others numbers.
const HEADS: [&str; 13] = [
    "SESSION",
    "SCENE",
    "STATE",
    "JOURNAL",
    "KEPT",
    "LATE",
    "STEP",
    "LONGEST",
    "VIEWERS",
    "DRIVERS",
    "FAULTS",
    "LINKS CUT",
    "MEMORY",
];
const WORDS: usize = 4;

/// Late steps that a hand notices: as of the events that say so.
const MANY_LATE: f64 = 0.02;

fn cells(session: &SessionSeen) -> [String; 13] {
    let percent = |share: Option<f64>| share.map_or("-".into(), |share| format!("{:.1} %", 100.0 * share));
    let ms = |ms: Option<f64>| ms.map_or("-".into(), |ms| format!("{ms:.2} ms"));
    let vitals = &session.vitals;
    let journal =
        session.journal.as_ref().map_or("-", |journal| if journal.error.is_empty() { "kept" } else { "ENDED" });
    [
        session.id.clone(),
        session.scene.clone(),
        session.state.clone(),
        journal.into(),
        percent(session.kept),
        percent(session.late),
        ms(session.step_ms),
        ms((vitals.longest_step_s > 0.0).then_some(1e3 * vitals.longest_step_s)),
        vitals.viewers.to_string(),
        vitals.drivers.to_string(),
        vitals.faults.to_string(),
        vitals.parted_links.to_string(),
        format!("{:.0} MiB", vitals.memory_bytes as f64 / MIB),
    ]
}

fn title(seen: &Seen) -> String {
    let server = &seen.server;
    let memory_mib = server.resident_memory_bytes as f64 / MIB;
    let (sessions, most) = (seen.sessions.len(), server.max_sessions);
    let expected = match server.expected_sessions {
        0 => String::new(),
        expected => format!(", {expected} not back yet"),
    };
    format!("kerf-server {}: {sessions} of {most} sessions{expected}, {memory_mib:.0} MiB", server.version)
}

fn widths(rows: &[[String; 13]]) -> [usize; 13] {
    std::array::from_fn(|column| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([HEADS[column].len()]).max().unwrap_or_default()
    })
}

fn aligned(column: usize, text: &str, width: usize) -> String {
    if column < WORDS { format!("{text:<width$}") } else { format!("{text:>width$}") }
}

/// As text, a line a session.
pub fn plain(seen: &Seen) -> String {
    let rows: Vec<_> = seen.sessions.iter().map(cells).collect();
    let widths = widths(&rows);
    let mut text = title(seen) + "\n";
    for row in std::iter::once(&HEADS.map(str::to_owned)).chain(&rows) {
        let cells: Vec<_> = (0..HEADS.len()).map(|column| aligned(column, &row[column], widths[column])).collect();
        writeln!(text, "{}", cells.join("  ").trim_end()).expect("text grows");
    }
    text
}

/// On a terminal; `trouble` is why it is out of date.
pub fn draw(frame: &mut Frame<'_>, seen: &Seen, trouble: Option<&str>) {
    let [top, middle, bottom] =
        Layout::vertical([Constraint::Length(1), Constraint::Fill(1), Constraint::Length(1)]).areas(frame.area());
    frame.render_widget(Line::styled(title(seen), Modifier::BOLD), top);
    let rows: Vec<_> = seen.sessions.iter().map(cells).collect();
    let widths = widths(&rows);
    let line = |row: &[String; 13]| {
        Row::new((0..HEADS.len()).map(|column| aligned(column, &row[column], widths[column])).collect::<Vec<_>>())
    };
    let heads = line(&HEADS.map(str::to_owned)).style(Modifier::REVERSED);
    let lines = rows.iter().zip(&seen.sessions).map(|(row, session)| line(row).style(style(session)));
    let table = Table::new(lines, widths.map(|width| Constraint::Length(width as u16))).header(heads).column_spacing(2);
    frame.render_widget(table, middle);
    let last = match trouble {
        Some(trouble) => Line::styled(format!("out of date: {trouble}"), Color::Red),
        None => Line::from("q leaves"),
    };
    frame.render_widget(last, bottom);
}

/// Red is what wants help, yellow what is too slow for a hand.
fn style(session: &SessionSeen) -> Style {
    match session {
        _ if session.vitals.hangs || session.state == "failed" => Color::Red.into(),
        _ if session.journal.as_ref().is_some_and(|journal| !journal.error.is_empty()) => Color::Red.into(),
        _ if session.late.is_some_and(|late| late > MANY_LATE) => Color::Yellow.into(),
        _ => Style::new(),
    }
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::super::sample::tests::sampled;
    use super::*;

    #[test]
    fn a_table_has_a_line_a_session_with_words_to_the_left_and_numbers_to_the_right() {
        let text = plain(&sampled());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "kerf-server 0.1.0: 2 of 8 sessions, 200 MiB");
        assert_eq!(
            lines[2],
            "session-1a2b-1  liver  running  kept     50.0 %  20.0 %  15.00 ms  31.00 ms        3        0       1       1234  \
             41 MiB"
        );
        assert!(
            lines[3].starts_with("session-1a2b-2  liver  running  ENDED         -       -         -  31.00 ms"),
            "{text}"
        );
        assert!(
            lines[1].starts_with("SESSION         SCENE  STATE    JOURNAL    KEPT    LATE      STEP   LONGEST"),
            "{text}"
        );
    }

    #[test]
    fn a_terminal_shows_the_same_and_why_it_is_out_of_date() {
        let mut terminal = Terminal::new(TestBackend::new(140, 6)).unwrap();
        let seen = sampled();
        terminal.draw(|frame| draw(frame, &seen, Some("no server"))).unwrap();
        let buffer = terminal.backend().buffer().clone();
        let line = |y| (0..140).map(|x| buffer[(x, y)].symbol()).collect::<String>().trim_end().to_owned();
        let plain = plain(&seen);
        let shown: Vec<String> = (0..4).map(line).collect();
        assert_eq!(shown, plain.lines().collect::<Vec<_>>());
        assert_eq!(line(5), "out of date: no server");
        assert_eq!((buffer[(0, 2)].fg, buffer[(0, 3)].fg), (Color::Yellow, Color::Red));
    }
}
