//! What happened: for the log, for those who follow, and for who looks on.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use jiff::Timestamp;

use crate::control::{Event, State};

/// The log of a running system.
pub(super) struct Journal {
    file: File,
    echo: bool,
    /// What followers have not been told yet.
    news: Vec<Event>,
}

/// How the supervisor calls itself.
pub(super) const CONDOR: &str = "condor";

impl Journal {
    /// A log in `path`; that of the run before is kept beside it.
    pub(super) fn new(path: &Path, echo: bool) -> std::io::Result<Self> {
        match std::fs::rename(path, path.with_extension("old")) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        Ok(Self {
            file: File::options().append(true).create(true).open(path)?,
            echo,
            news: Vec::new(),
        })
    }

    pub(super) fn tell(&mut self, source: &str, text: impl Into<String>, state: Option<State>) {
        let event = Event {
            time: format!("{:.6}", Timestamp::now()),
            source: source.into(),
            text: text.into(),
            state,
        };
        // A log that cannot be written is no reason to stop a robot.
        let _ = writeln!(self.file, "{event}");
        if self.echo {
            let _ = writeln!(std::io::stderr(), "{event}");
        }
        self.news.push(event);
    }

    pub(super) fn news(&mut self) -> Vec<Event> {
        core::mem::take(&mut self.news)
    }
}

/// The last lines of the log at `path`.
pub(super) fn last_lines(path: &Path, count: usize) -> std::io::Result<Vec<String>> {
    let text = std::fs::read(path)?;
    let text = String::from_utf8_lossy(&text);
    let lines: Vec<_> = text.lines().collect();
    let from = lines.len().saturating_sub(count);
    let last = lines.get(from..).unwrap_or_default();
    Ok(last.iter().map(|&line| line.into()).collect())
}
