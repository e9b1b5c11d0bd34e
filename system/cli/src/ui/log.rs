//! The log, as lines that fit a width.

use std::collections::VecDeque;

/// Columns of the time of day, and of the blank behind it.
const TIME: usize = 13;

/// The lines of the log, with the time of day to the millisecond; long ones go on below, beside the
/// time.
pub(super) fn rows(log: &VecDeque<String>, width: u16) -> Vec<String> {
    let width = usize::from(width);
    let mut rows = Vec::new();
    for line in log {
        let mut room = width;
        let mut row = String::new();
        for word in brief(line).split_inclusive(' ') {
            let mut word = word;
            loop {
                let len = word.trim_end().chars().count();
                if len <= room {
                    row += word;
                    room = room.saturating_sub(word.chars().count());
                    break;
                }
                let is_begun = row.len() > TIME;
                if !is_begun {
                    // No line is long enough for this word.
                    let at = word
                        .char_indices()
                        .nth(room.max(1))
                        .map_or(word.len(), |it| it.0);
                    let (part, rest) = word.split_at(at);
                    row += part;
                    word = rest;
                }
                rows.push(core::mem::replace(&mut row, " ".repeat(TIME)));
                room = width.saturating_sub(TIME);
            }
        }
        rows.push(row);
    }
    rows
}

/// A line of the log with the time of day to the millisecond in place of its first word.
fn brief(line: &str) -> String {
    let Some((time, text)) = line.split_once(' ') else {
        return line.into();
    };
    match time.split_once('T').and_then(|(_, time)| time.get(..12)) {
        Some(time) => format!("{time} {text}"),
        None => line.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows_of(text: &str, width: u16) -> Vec<String> {
        let line = format!("2026-11-21T15:28:52.078621Z {text}");
        let rows = rows(&VecDeque::from([line]), width);
        rows.iter().map(|row| row.trim_end().to_owned()).collect()
    }

    #[test]
    fn a_long_line_goes_on_between_words() {
        assert_eq!(rows_of("a: joined", 80), ["15:28:52.078 a: joined"]);
        let rows = rows_of("a: joined after 0.1 s", 25);
        assert_eq!(rows, ["15:28:52.078 a: joined", "             after 0.1 s"]);
    }

    #[test]
    fn a_word_that_is_longer_than_a_line_is_cut() {
        let rows = rows_of("in /dev/shm/condor-0/hand now", 23);
        assert_eq!(
            rows,
            [
                "15:28:52.078 in",
                "             /dev/shm/c",
                "             ondor-0/ha",
                "             nd now"
            ]
        );
        // However narrow, it ends.
        assert!(rows_of("in /dev/shm", 3).len() > 3);
    }
}
