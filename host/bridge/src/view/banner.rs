//! The slip state in letters that can be read across a room, the time to slip and the faults.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};

use super::colour::{DIM, GROUND, INCIPIENT, NO_CONTACT, SLIP, STICK, TEXT};
use gripline_recording::telemetry::FrameReport;

/// Lines of the banner: letters, time to slip, faults.
pub(super) const LINES: u16 = LETTER_LINES + 2;
/// Five pixels in half lines.
const LETTER_LINES: u16 = 3;

/// The three parts, one below the other; `mark` stands beside the second.
pub(super) fn draw(report: &FrameReport, mark: &str, area: Rect, buffer: &mut Buffer) {
    let colour = state_colour(report.state);
    draw_letters(report.state, colour, area, buffer);
    let time_to_slip = match report.time_to_slip_ms {
        Some(ms) => Span::styled(
            format!("{ms} ms"),
            Style::new().fg(colour).add_modifier(Modifier::BOLD),
        ),
        None => Span::styled("–", DIM),
    };
    let line = Line::from(vec![Span::styled("time to slip ", DIM), time_to_slip]);
    buffer.set_line(area.x, area.y + LETTER_LINES, &line, area.width);
    let width = (mark.chars().count() as u16).min(area.width);
    buffer.set_stringn(
        area.right() - width,
        area.y + LETTER_LINES,
        mark,
        width.into(),
        TEXT,
    );
    let line = fault_line(&report.faults, area.width);
    buffer.set_line(area.x, area.y + LETTER_LINES + 1, &line, area.width);
}

fn state_colour(state: &str) -> Color {
    match state {
        "STICK" => STICK,
        "INCIPIENT" => INCIPIENT,
        "SLIP" => SLIP,
        _ => NO_CONTACT,
    }
}

/// As many names as fit, then how many more there are.
fn fault_line(faults: &[&str], width: u16) -> Line<'static> {
    if faults.is_empty() {
        return Line::styled("no fault", DIM);
    }
    let text = (1..=faults.len())
        .rev()
        .map(|shown| {
            let rest = faults.len() - shown;
            let more = if rest > 0 {
                format!(" +{rest}")
            } else {
                String::new()
            };
            format!(" FAULT {}{more} ", faults[..shown].join(", "))
        })
        .find(|text| text.chars().count() <= usize::from(width))
        .unwrap_or_else(|| format!(" {} FAULTS ", faults.len()));
    let style = Style::new().fg(GROUND).bg(SLIP).add_modifier(Modifier::BOLD);
    Line::styled(text, style)
}

/// Pixel letters in half blocks; a word with an unknown letter, or one that is too wide, in plain ones.
fn draw_letters(word: &str, colour: Color, area: Rect, buffer: &mut Buffer) {
    let pixels = word
        .chars()
        .map(letter)
        .collect::<Option<Vec<_>>>()
        .map(|letters| {
            let row = |row: usize| {
                letters
                    .iter()
                    .map(|letter| letter[row])
                    .collect::<Vec<_>>()
                    .join(" ")
            };
            [String::new(), row(0), row(1), row(2), row(3), row(4)]
        });
    let style = Style::new().fg(colour).add_modifier(Modifier::BOLD);
    let Some(pixels) = pixels.filter(|pixels| pixels[1].len() <= usize::from(area.width)) else {
        buffer.set_stringn(area.x, area.y + 1, word, area.width.into(), style.fg(TEXT));
        return;
    };
    for (line, pair) in (area.y..).zip(pixels.chunks_exact(2)) {
        let lit = |row: &str, column: usize| row.as_bytes().get(column) == Some(&b'#');
        let text: String = (0..pixels[1].len())
            .map(|column| match (lit(&pair[0], column), lit(&pair[1], column)) {
                (true, true) => '█',
                (true, false) => '▀',
                (false, true) => '▄',
                (false, false) => ' ',
            })
            .collect();
        buffer.set_stringn(area.x, line, text, area.width.into(), style);
    }
}

/// The letters that the four states need.
fn letter(letter: char) -> Option<[&'static str; 5]> {
    Some(match letter {
        ' ' | '_' => [" ", " ", " ", " ", " "],
        'A' => ["###", "# #", "###", "# #", "# #"],
        'C' => ["###", "#  ", "#  ", "#  ", "###"],
        'E' => ["###", "#  ", "## ", "#  ", "###"],
        'I' => ["#", "#", "#", "#", "#"],
        'K' => ["# #", "# #", "## ", "# #", "# #"],
        'L' => ["#  ", "#  ", "#  ", "#  ", "###"],
        'N' => ["#  #", "## #", "# ##", "#  #", "#  #"],
        'O' => ["###", "# #", "# #", "# #", "###"],
        'P' => ["###", "# #", "###", "#  ", "#  "],
        'S' => ["###", "#  ", "###", "  #", "###"],
        'T' => ["###", " # ", " # ", " # ", " # "],
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_state_has_its_letters_within_the_narrowest_column() {
        for state in ["NO_CONTACT", "STICK", "INCIPIENT", "SLIP"] {
            let letters: Vec<_> = state.chars().map(|c| letter(c).unwrap()).collect();
            for row in 0..5 {
                let width: usize = letters.iter().map(|letter| letter[row].len() + 1).sum();
                assert!(width - 1 <= 39, "{state} is {width} wide");
            }
            assert!(
                letters
                    .iter()
                    .all(|rows| rows.iter().all(|row| row.len() == rows[0].len()))
            );
        }
    }

    #[test]
    fn faults_that_do_not_fit_are_counted() {
        let text = |faults: &[&str], width| fault_line(faults, width).to_string();
        assert_eq!(text(&[], 39), "no fault");
        assert_eq!(text(&["LINK LOST"], 39), " FAULT LINK LOST ");
        let many = ["LINK LOST", "STALE MAPS", "LINE AT CEILING", "MAPS LOST"];
        assert_eq!(text(&many, 39), " FAULT LINK LOST, STALE MAPS +2 ");
        assert_eq!(text(&many, 12), " 4 FAULTS ");
    }
}
