//! The variables of a processor's monitor, and watching some of them.
//!
//! A monitor has one selection for all who watch. A [`Watch`] therefore asks for its own variables
//! beside those that all others watch who live, at a rate of which all theirs are multiples, and at its
//! end for those of the others alone. What a killed one watched is selected until the next begins or ends.

use std::time::Duration;

use condor_hand::monitor::{
    Kind, MonitorClient, MonitorClientError, MonitorPlaces, MonitorReader, MonitorReaderError, Row,
    Selection, SelectionError, Variable,
};
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{AccessError, MemoryWindow, Places, Processor, Region};
use serde::Serialize;

use super::wishes::{Wishes, life, together};
use super::{Post, View, ViewError};
use condor_rt::directory::{self, Entry};
use condor_rt::numbers::PROCESSORS;

/// How long a monitor may take to answer.
const ANSWER: Duration = Duration::from_secs(2);
/// How often others may begin or end while one does.
const TRIES: usize = 8;

/// Why variables cannot be listed or watched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WatchError {
    /// The system.
    #[error(transparent)]
    View(#[from] ViewError),
    /// Its directory names a place for a monitor where none can be.
    #[error("{processor} says that its monitor `{}` has {} bytes from {:#x} on, where none can be", .entry.name.as_str(), .entry.len, .entry.offset)]
    NoPlace {
        /// The processor.
        processor: Processor,
        /// What its directory says.
        entry: Entry,
    },
    /// The monitor.
    #[error("the monitor of {processor}: {source}")]
    Monitor {
        /// The processor.
        processor: Processor,
        /// What is wrong with it.
        source: MonitorReaderError,
    },
    /// It does not take the selection.
    #[error("the monitor of {processor}: {source}")]
    Selection {
        /// The processor.
        processor: Processor,
        /// Why not.
        source: MonitorClientError,
    },
    /// No selection has these variables.
    #[error(transparent)]
    Variables(#[from] SelectionError),
}

/// The value of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A number in the variable's unit.
    Real(f32),
    /// An unsigned number, or bits.
    Bits(u32),
}

impl core::fmt::Display for Value {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Real(value) => f.pad(&format!("{value:.5}")),
            Self::Bits(value) => f.pad(&value.to_string()),
        }
    }
}

/// The monitor of a processor.
#[derive(Debug)]
pub struct Monitor {
    processor: Processor,
    places: MonitorPlaces,
    region: Region<LinuxWindow>,
    reader: MonitorReader<LinuxWindow>,
    wishes: Wishes,
}

impl View {
    /// The first monitor of `processor`; `None` if it has none, or none yet.
    ///
    /// # Errors
    /// [`WatchError`].
    pub fn monitor(&self, processor: Processor) -> Result<Option<Monitor>, WatchError> {
        let entries = self.entries(processor, directory::Kind::Monitor)?;
        let Some(entry) = entries.first() else {
            return Ok(None);
        };
        let region = self.region(processor)?;
        let no_place = || WatchError::NoPlace {
            processor,
            entry: *entry,
        };
        let places = places(&region, entry).ok_or_else(no_place)?;
        let ring = places.ring(&region).map_err(|_| no_place())?;
        match MonitorReader::open(ring) {
            Ok(reader) => Ok(Some(Monitor {
                processor,
                places,
                region,
                reader,
                wishes: self.wishes.clone(),
            })),
            Err(MonitorReaderError::NoMonitor { .. }) => Ok(None),
            Err(source) => Err(WatchError::Monitor { processor, source }),
        }
    }
}

/// The places of a monitor whose blocks begin where its entry does, and whose ring has the rest.
fn places(region: &Region<LinuxWindow>, entry: &Entry) -> Option<MonitorPlaces> {
    let laid_out = |ring_bytes| -> Result<MonitorPlaces, AccessError> {
        let mut places = Places::new(region.size());
        places.bytes(entry.offset as usize)?;
        MonitorPlaces::new(&mut places, PROCESSORS as u8, ring_bytes)
    };
    let empty = laid_out(0).ok()?;
    let [first, second] = [0, 1].map(|number| empty.block(Processor(number)));
    let blocks = (second? - first?) * PROCESSORS as u32;
    let places = laid_out(entry.len.checked_sub(blocks)?).ok()?;
    (places.block(Processor(0)) == Some(entry.offset)).then_some(places)
}

impl Monitor {
    /// Its variables; a number without a variable is left out.
    ///
    /// # Errors
    /// [`WatchError::Monitor`].
    pub fn variables(&self) -> Result<Vec<(usize, Variable)>, WatchError> {
        let mut variables = Vec::new();
        for number in 0..self.reader.variable_count() {
            let variable = self.reader.variable(number);
            let variable = variable.map_err(|source| self.error(source))?;
            variables.extend(variable.map(|variable| (number, variable)));
        }
        Ok(variables)
    }

    /// Servo ticks in a second, Hz.
    #[must_use]
    pub const fn servo_hz(&self) -> u32 {
        self.reader.servo_hz()
    }

    /// What is watched now, by all together; `None` while it changes.
    ///
    /// # Errors
    /// [`WatchError::Monitor`].
    pub fn selection(&self) -> Result<Option<Selection>, WatchError> {
        let selection = self.reader.selection();
        selection.map_err(|source| self.error(source))
    }

    const fn error(&self, source: MonitorReaderError) -> WatchError {
        WatchError::Monitor {
            processor: self.processor,
            source,
        }
    }

    /// Watches variables, a row every `every` ticks; `post` must have joined.
    ///
    /// # Errors
    /// [`WatchError`].
    pub fn watch<'p>(
        self,
        post: &'p Post,
        variables: &[usize],
        every: u32,
    ) -> Result<Watch<'p>, WatchError> {
        let processor = self.processor;
        let wanted = Selection::new(variables.iter().copied(), every)?;
        let client = MonitorClient::new(post, processor, &self.region, self.places);
        let memory = |source| ViewError::Memory { processor, source };
        let client = client.map_err(memory)?;
        let told = self
            .wishes
            .tell(processor, life(post).map_err(ViewError::Mailbox)?, &wanted);
        told.map_err(memory)?;
        let mut watch = Watch {
            monitor: self,
            post,
            client,
            wanted,
            begun: false,
            last: None,
            lost: 0,
        };
        match watch.ask(&[wanted]) {
            // Too many for a row: those who watched before have had their turn.
            Err(WatchError::Selection {
                source: MonitorClientError::Selection(SelectionError::Columns { .. }),
                ..
            }) => watch.select(&wanted)?,
            other => other?,
        }
        Ok(watch)
    }
}

/// Variables that are watched.
pub struct Watch<'p> {
    monitor: Monitor,
    post: &'p Post,
    client: MonitorClient<'p, Post, LinuxWindow>,
    wanted: Selection,
    /// Whether that selection has been seen in force.
    begun: bool,
    last: Option<u32>,
    lost: u64,
}

/// What the variables were in one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// The number of the servo tick; wraps.
    pub tick: u32,
    /// The row of the monitor.
    row: Row,
}

impl Sample {
    /// The value of a variable; `None` if somebody has taken it out of the selection.
    #[must_use]
    pub fn value(&self, number: usize, variable: &Variable) -> Option<Value> {
        let word = self.row.word(number)?;
        Some(match variable.kind {
            Kind::Real => Value::Real(f32::from_bits(word)),
            Kind::Bits => Value::Bits(word),
        })
    }
}

impl Watch<'_> {
    /// The next sample, if there is one; it does not wait.
    ///
    /// # Errors
    /// [`WatchError::Monitor`], also if the program has been started anew.
    pub fn sample(&mut self) -> Result<Option<Sample>, WatchError> {
        loop {
            let row = self.monitor.reader.read();
            let Some(row) = row.map_err(|source| self.monitor.error(source))? else {
                return Ok(None);
            };
            if self.begun {
                self.lost += u64::from(row.lost);
            } else {
                // Rows of before the selection was in force.
                self.begun = self
                    .wanted
                    .variables()
                    .all(|variable| row.selection.contains(variable));
                if !self.begun {
                    continue;
                }
            }
            // Who watches beside may have rows in between, or have them begin anew.
            let is_due = |last: u32| row.tick.wrapping_sub(last) >= self.wanted.every();
            if self.last.is_none_or(is_due) {
                self.last = Some(row.tick);
                return Ok(Some(Sample {
                    tick: row.tick,
                    row,
                }));
            }
        }
    }

    /// Rows that were overwritten before they could be read.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// Leaves what the others watch.
    ///
    /// # Errors
    /// [`WatchError`].
    pub fn end(mut self) -> Result<(), WatchError> {
        let processor = self.monitor.processor;
        let withdrawn = self.monitor.wishes.withdraw(processor);
        withdrawn.map_err(|source| ViewError::Memory { processor, source })?;
        match self.ask(&[]) {
            // They have been too many before.
            Err(WatchError::Selection {
                source: MonitorClientError::Selection(SelectionError::Columns { .. }),
                ..
            }) => Ok(()),
            other => other,
        }
    }

    /// Asks for what the others watch, and for `own`.
    fn ask(&mut self, own: &[Selection]) -> Result<(), WatchError> {
        let mut wishes = self.wishes(own)?;
        for _ in 0..TRIES {
            self.select(&wishes)?;
            // Who began or ended meanwhile said so before it asked; what it asked for may be lost.
            let before = core::mem::replace(&mut wishes, self.wishes(own)?);
            if wishes == before {
                break;
            }
        }
        Ok(())
    }

    fn wishes(&self, own: &[Selection]) -> Result<Selection, WatchError> {
        let Monitor {
            processor,
            places,
            region,
            wishes,
            ..
        } = &self.monitor;
        let all = wishes.of_others(self.post, *processor, region, *places);
        let mut all = all.map_err(ViewError::Mailbox)?;
        all.extend(own);
        Ok(together(&all))
    }

    fn select(&mut self, selection: &Selection) -> Result<(), WatchError> {
        let processor = self.monitor.processor;
        let selected = self.client.select(selection, ANSWER);
        selected.map_err(|source| WatchError::Selection { processor, source })?;
        Ok(())
    }
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        // Memory that is gone has no wishes.
        let _ = self.monitor.wishes.withdraw(self.monitor.processor);
    }
}
