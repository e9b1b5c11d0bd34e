//! [`EventCollector`]: the events of a system, for recordings and live viewers.

use std::collections::HashMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use condor_ros2::Level;

use crate::control::{ControlClientError, MemberState, SystemEvent, SystemStatus, follow};
use crate::error::AnyError;
use crate::services::terminals::keyboard;
use crate::system::SystemDirectory;
use crate::view::{VectorCounts, View};

/// The time between two looks at counts, and whether the system still runs.
const LOOK: Duration = Duration::from_secs(1);
/// The greatest length of a typed line, in bytes.
const LINE_BYTES: usize = 4096;

/// A collector of the events of a running system: lines of its log, lines that people type at its terminals, and counts
/// of messages that have changed. Call [`look`](Self::look) again and again.
///
/// The collector does not say when an event happened. Use the time of the call of `look` that hands it over.
pub struct EventCollector<'s> {
    status: &'s SystemStatus,
    log: Receiver<Result<SystemEvent, ControlClientError>>,
    keyboards: Vec<Keyboard>,
    counts: Counts,
    looked: Instant,
}

/// The counts of the vectors of processors at the last look, each with the incarnation of the program.
#[derive(Default)]
struct Counts(HashMap<(String, u8), (u32, VectorCounts)>);

/// The characters that are typed at the terminal of one processor.
struct Keyboard {
    processor: String,
    file: File,
    /// The number of bytes of the file that were read.
    offset: u64,
    /// The line that is not complete yet.
    line: Vec<u8>,
}

impl<'s> EventCollector<'s> {
    /// Begins to collect the events that happen from now on in the system in `directory`. `status` is the supervisor's
    /// report on that system, and `view` reads the counts of messages.
    ///
    /// # Errors
    /// Returns an error if the supervisor cannot be asked, if a file of typed characters cannot be opened, or
    /// if the memory of a processor cannot be read.
    pub fn of(
        directory: &SystemDirectory,
        status: &'s SystemStatus,
        view: &View,
    ) -> Result<Self, AnyError> {
        let (_, news) = follow(directory, 0)?;
        let (sender, log) = channel();
        // The thread ends with the system, or with this process.
        std::thread::spawn(move || {
            for event in news {
                if sender.send(event).is_err() {
                    break;
                }
            }
        });
        let mut keyboards = Vec::new();
        for member in &status.processors {
            let file = keyboard(directory, &member.name)?.file;
            keyboards.push(Keyboard {
                processor: member.name.clone(),
                offset: file.metadata()?.len(),
                file,
                line: Vec::new(),
            });
        }
        let mut events = Self {
            status,
            log,
            keyboards,
            counts: Counts::default(),
            looked: Instant::now(),
        };
        events.counts.look(status, view, |_, _| ())?;
        Ok(events)
    }

    /// Calls `take` for each event since the last call with its level, its source and its text. The source is the name
    /// of a processor or service, or `condor`. Changed counts of messages come once a second. Returns true if the
    /// system still runs.
    ///
    /// # Errors
    /// Returns an error if the connection to the supervisor breaks, if a file of typed characters cannot be
    /// read, or if the memory of a processor cannot be read.
    pub fn look(
        &mut self,
        view: &View,
        mut take: impl FnMut(Level, &str, &str),
    ) -> Result<bool, AnyError> {
        let mut is_alive = true;
        loop {
            match self.log.try_recv() {
                Ok(event) => {
                    let event = event?;
                    let level = level(event.state);
                    take(level, &event.source, &event.text);
                }
                Err(TryRecvError::Empty) => break,
                // The supervisor has closed the connection.
                Err(TryRecvError::Disconnected) => {
                    is_alive = false;
                    break;
                }
            }
        }
        for keyboard in &mut self.keyboards {
            for line in keyboard.lines()? {
                let text = format!("typed: {line}");
                take(Level::Info, &keyboard.processor, &text);
            }
        }
        if self.looked.elapsed() >= LOOK {
            self.looked = Instant::now();
            self.counts.look(self.status, view, |processor, text| {
                take(Level::Debug, processor, text);
            })?;
        }
        Ok(is_alive)
    }
}

impl Counts {
    /// Hands over the name of a processor and what has changed of the counts of a vector of it, for each.
    fn look(
        &mut self,
        status: &SystemStatus,
        view: &View,
        mut take: impl FnMut(&str, &str),
    ) -> Result<(), AnyError> {
        for member in status.members() {
            let processor = member.processor();
            let incarnation = view.heart(processor)?.incarnation;
            let vectors = view.vectors(processor)?;
            // Counts of a program that begins just now may mix two incarnations: the next look reads them
            // again.
            if view.heart(processor)?.incarnation != incarnation {
                continue;
            }
            for counts in vectors {
                if let Some(text) = self.news(&member.name, incarnation, &counts) {
                    take(&member.name, &text);
                }
            }
        }
        Ok(())
    }

    /// Tells what has changed of the counts of a vector since the last look. A new incarnation begins with 0.
    fn news(&mut self, processor: &str, incarnation: u32, counts: &VectorCounts) -> Option<String> {
        let key = (processor.to_owned(), counts.vector);
        let before = self.0.insert(key, (incarnation, counts.clone()));
        let before = before.filter(|(before, _)| *before == incarnation);
        let before = before.map(|(_, counts)| counts);
        let before = before.map_or([0; 3], |it| [it.sent, it.handled, it.failed]);
        let [sent, handled, failed] = before;
        let news = [
            ("sent", counts.sent, sent),
            ("handled", counts.handled, handled),
            ("failed", counts.failed, failed),
        ];
        let news = news.into_iter().filter_map(|(what, now, before)| {
            let more = now.wrapping_sub(before);
            (more > 0).then(|| format!("{more} {what}"))
        });
        let news: Vec<_> = news.collect();
        let (vector, name) = (counts.vector, &counts.name);
        (!news.is_empty())
            .then(|| format!("messages to vector {vector} ({name}): {}", news.join(", ")))
    }
}

impl Keyboard {
    /// Returns the lines that were ended since the last call.
    fn lines(&mut self) -> std::io::Result<Vec<String>> {
        let mut lines = Vec::new();
        let mut bytes = [0; 1024];
        loop {
            let count = self.file.read_at(&mut bytes, self.offset)?;
            self.offset += count as u64;
            for byte in bytes.iter().take(count) {
                let is_end = matches!(byte, b'\r' | b'\n');
                if !is_end {
                    self.line.push(*byte);
                }
                if (is_end || self.line.len() >= LINE_BYTES) && !self.line.is_empty() {
                    lines.push(String::from_utf8_lossy(&self.line).into_owned());
                    self.line.clear();
                }
            }
            if count == 0 {
                return Ok(lines);
            }
        }
    }
}

const fn level(state: Option<MemberState>) -> Level {
    match state {
        Some(MemberState::Failed) => Level::Error,
        Some(MemberState::Held | MemberState::Stalled | MemberState::Restarting) => Level::Warn,
        _ => Level::Info,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_was_restarted_counts_from_0() {
        let counts = |sent| VectorCounts {
            vector: 5,
            name: "add".into(),
            sent,
            handled: 0,
            failed: 0,
            worst_us: 0.0,
        };
        let mut all = Counts::default();
        let told = |count: &str| Some(format!("messages to vector 5 (add): {count} sent"));
        assert_eq!(all.news("a", 1, &counts(u32::MAX)), told("4294967295"));
        assert_eq!(all.news("a", 1, &counts(6)), told("7"));
        assert_eq!(all.news("a", 2, &counts(2)), told("2"));
        assert_eq!(all.news("a", 2, &counts(2)), None);
    }
}
