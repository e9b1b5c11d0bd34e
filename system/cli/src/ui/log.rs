//! The log, as lines that fit a width, with their levels.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::screen::wrapped;

/// Columns of the time of day, and of the blank behind it.
const TIME: usize = 13;
/// Words of the supervisor and of programs by which a line tells of a failure.
const FAILURES: [&str; 6] = [
    "failed",
    "cannot ",
    "is killed",
    "ended before it joined",
    "error:",
    "panicked",
];
/// Words by which a line is a warning.
const WARNINGS: [&str; 7] = [
    "warning",
    "refuses",
    "stalled",
    "is held",
    "left out",
    "all programs but",
    "does not wait any longer",
];

/// The importance of a line of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Level {
    Information,
    Warning,
    Failure,
}

impl Level {
    fn of(line: &str) -> Self {
        let line = line.to_lowercase();
        let has = |words: &[&str]| words.iter().any(|word| line.contains(word));
        if has(&FAILURES) {
            Self::Failure
        } else if has(&WARNINGS) {
            Self::Warning
        } else {
            Self::Information
        }
    }

    /// The level that follows; the first follows the last.
    pub(super) const fn next(self) -> Self {
        match self {
            Self::Information => Self::Warning,
            Self::Warning => Self::Failure,
            Self::Failure => Self::Information,
        }
    }

    /// The mark in front of a line, which does not need colours.
    const fn mark(self) -> &'static str {
        match self {
            Self::Information => "",
            Self::Warning => "! ",
            Self::Failure => "✗ ",
        }
    }
}

/// The lines of the log from a level on, with the time of day to the millisecond; long ones go on below, beside the
/// time.
pub(super) fn rows(log: &VecDeque<String>, least: Level, width: u16) -> Vec<(Level, String)> {
    let lines = log.iter().map(|line| (Level::of(line), line));
    let lines = lines.filter(|(level, _)| *level >= least);
    let rows = lines.flat_map(|(level, line)| {
        let rows = wrapped(&brief(line, level.mark()), width, TIME);
        rows.into_iter().map(move |row| (level, row))
    });
    rows.collect()
}

/// A line of the log with the time of day to the millisecond, and a mark, in place of its first word.
fn brief(line: &str, mark: &str) -> String {
    let (time, text) = line.split_once(' ').unwrap_or_default();
    match time.split_once('T').and_then(|(_, time)| time.get(..12)) {
        Some(time) => format!("{time} {mark}{text}"),
        None => format!("{mark}{line}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows_of(text: &str, width: u16) -> Vec<String> {
        let line = format!("2026-11-21T15:28:52.078621Z {text}");
        let rows = rows(&VecDeque::from([line]), Level::Information, width);
        rows.iter()
            .map(|(_, row)| row.trim_end().to_owned())
            .collect()
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
