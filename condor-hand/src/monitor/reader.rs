use condor_mbox::{AccessError, MemoryWindow, Region};
use thiserror::Error;

use super::layout::{COLUMNS, Layout, MAGIC, VERSION, entry, header, row};
use super::selection::Selection;
use super::variable::Variable;

/// Reads the rows of a monitor from wherever its window is mapped, each at most once.
///
/// It writes nothing, so that a window that is mapped read-only will do.
#[derive(Debug)]
pub struct MonitorReader<W> {
    region: Region<W>,
    layout: Layout,
    life: u32,
    servo_hz: u32,
    /// The next row that it has not read.
    next: u32,
    lost: u64,
    /// How many of them no row has told of yet.
    untold: u32,
}

/// A row: what the selected variables were in one tick.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// The number of the servo tick; wraps.
    pub tick: u32,
    /// How many rows were lost between the one that was read before and this one.
    pub lost: u32,
    /// Which variables; [`every`](Selection::every) is 1 whatever the writer's was.
    pub selection: Selection,
    /// Their words, lowest variable first.
    pub words: heapless::Vec<u32, COLUMNS>,
}

/// Why there is no row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum MonitorReaderError {
    /// Nothing of this layout is there, or not yet.
    #[error("there is no monitor: magic {magic:#x}, version {version}")]
    NoMonitor {
        /// The first word.
        magic: u32,
        /// The version that is there.
        version: u32,
    },
    /// A header whose numbers do not fit the region.
    #[error("{variables} variables, {columns} columns and {rows} rows are not in {size} bytes")]
    Layout {
        /// How many variables.
        variables: u32,
        /// How many columns of a row.
        columns: u32,
        /// How many rows.
        rows: u32,
        /// Bytes of the region.
        size: u32,
    },
    /// The monitor has started anew: open it again.
    #[error("the monitor has started anew: life {found}, not {expected}")]
    Restarted {
        /// The life of the writer.
        found: u32,
        /// The life in which the reader was opened.
        expected: u32,
    },
    /// The region refused an access.
    #[error(transparent)]
    Access(#[from] AccessError),
}

impl<W: MemoryWindow> MonitorReader<W> {
    /// A reader of the rows from now on.
    ///
    /// # Errors
    /// See [`MonitorReaderError`].
    pub fn open(region: Region<W>) -> Result<Self, MonitorReaderError> {
        let life = region.word(header::LIFE)?;
        let (magic, version) = (region.word(header::MAGIC)?, region.word(header::VERSION)?);
        if magic != MAGIC || version != VERSION {
            return Err(MonitorReaderError::NoMonitor { magic, version });
        }
        let size = region.size();
        let numbers = Layout {
            variables: region.word(header::VARIABLES)?,
            columns: region.word(header::COLUMNS)?,
            rows: region.word(header::ROWS)?,
        };
        let layout = numbers.checked(size).ok_or(MonitorReaderError::Layout {
            variables: numbers.variables,
            columns: numbers.columns,
            rows: numbers.rows,
            size,
        })?;
        let reader = Self {
            servo_hz: region.word(header::SERVO_HZ)?,
            next: region.word(header::NEWEST)?.wrapping_add(1),
            region,
            layout,
            life,
            lost: 0,
            untold: 0,
        };
        reader.check_life()?;
        Ok(reader)
    }

    /// Servo ticks in a second, Hz.
    #[must_use]
    pub const fn servo_hz(&self) -> u32 {
        self.servo_hz
    }

    /// How many rows the ring keeps.
    #[must_use]
    pub const fn rows(&self) -> u32 {
        self.layout.rows
    }

    /// How many rows were lost since the reader was opened.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// How many variables there are.
    #[must_use]
    pub const fn variable_count(&self) -> usize {
        self.layout.variables as usize
    }

    /// What a variable is called; `None` if there is none of this number, or no text there.
    ///
    /// # Errors
    /// [`MonitorReaderError::Restarted`], [`MonitorReaderError::Access`].
    pub fn variable(&self, number: usize) -> Result<Option<Variable>, MonitorReaderError> {
        match u32::try_from(number) {
            Ok(number) if number < self.layout.variables => {
                let variable = Variable::read(&self.region, entry(number))?;
                self.check_life()?;
                Ok(variable)
            }
            _ => Ok(None),
        }
    }

    /// The number of the variable of this name.
    ///
    /// # Errors
    /// As [`variable`](Self::variable).
    pub fn find(&self, name: &str) -> Result<Option<usize>, MonitorReaderError> {
        for number in 0..self.variable_count() {
            if self.variable(number)?.is_some_and(|it| it.name == name) {
                return Ok(Some(number));
            }
        }
        Ok(None)
    }

    /// The number of the selection that is in force, 0 before the first.
    ///
    /// # Errors
    /// [`MonitorReaderError::Restarted`], [`MonitorReaderError::Access`].
    pub fn selection_number(&self) -> Result<u32, MonitorReaderError> {
        let number = self.region.word(header::SELECTION_NUMBER)?;
        self.check_life()?;
        Ok(number)
    }

    /// The selection in force, of which the next rows are; `None` while it changes.
    ///
    /// # Errors
    /// [`MonitorReaderError::Restarted`], [`MonitorReaderError::Access`].
    pub fn selection(&self) -> Result<Option<Selection>, MonitorReaderError> {
        let before = self.selection_number()?;
        let mut selection = Selection {
            every: self.region.word(header::EVERY)?,
            ..Selection::NOTHING
        };
        for (offset, word) in (header::MASK..).step_by(4).zip(&mut selection.mask) {
            *word = self.region.word(offset)?;
        }
        Ok((self.selection_number()? == before).then_some(selection))
    }

    /// The next row, if there is one that has not been read.
    ///
    /// # Errors
    /// [`MonitorReaderError::Restarted`], [`MonitorReaderError::Access`].
    pub fn read(&mut self) -> Result<Option<Row>, MonitorReaderError> {
        // Pairs with the writer's store after a complete row.
        let newest = self.region.word(header::NEWEST)?;
        self.check_life()?;
        let mut left = newest.wrapping_sub(self.next).wrapping_add(1);
        let mut lost = 0;
        if left.cast_signed() < 0 {
            // No writer goes backwards: somebody else wrote there.
            self.next = newest.wrapping_add(1);
            return Ok(None);
        }
        if let Some(more) = left.checked_sub(self.layout.rows) {
            lost = more;
            left = self.layout.rows;
        }
        let mut row = None;
        self.next = self.next.wrapping_add(lost);
        for _ in 0..left {
            let sequence = self.next;
            row = self.copy(sequence)?;
            self.next = sequence.wrapping_add(1);
            if row.is_some() {
                break;
            }
            // It was complete, and is not there any more.
            lost += 1;
        }
        self.lost = self.lost.wrapping_add(u64::from(lost));
        self.untold = self.untold.wrapping_add(lost);
        if let Some(row) = &mut row {
            row.lost = core::mem::take(&mut self.untold);
        }
        Ok(row)
    }

    /// A row, if it is still there when it has been copied.
    fn copy(&self, sequence: u32) -> Result<Option<Row>, MonitorReaderError> {
        let at = self.layout.row(sequence);
        if self.region.word(at + row::COMPLETE)? != sequence {
            return Ok(None);
        }
        let mut selection = Selection::NOTHING;
        for (offset, word) in (at + row::MASK..).step_by(4).zip(&mut selection.mask) {
            *word = self.region.word(offset)?;
        }
        let mut copy = Row {
            tick: self.region.word(at + row::TICK)?,
            lost: 0,
            selection,
            words: heapless::Vec::new(),
        };
        let count = selection.count();
        if count > self.layout.columns as usize {
            return Ok(None);
        }
        for offset in (at + row::VALUES..).step_by(4).take(count) {
            // There is room: there are no more columns than that.
            let _ = copy.words.push(self.region.word(offset)?);
        }
        // If any word above was of a later row, this one is too.
        if self.region.word(at + row::BEGUN)? != sequence {
            return Ok(None);
        }
        self.check_life()?;
        Ok(Some(copy))
    }

    fn check_life(&self) -> Result<(), MonitorReaderError> {
        let found = self.region.word(header::LIFE)?;
        if found == self.life {
            Ok(())
        } else {
            Err(MonitorReaderError::Restarted {
                found,
                expected: self.life,
            })
        }
    }
}

/// The rows that there are now.
impl<W: MemoryWindow> Iterator for MonitorReader<W> {
    type Item = Result<Row, MonitorReaderError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.read().transpose()
    }
}

impl Row {
    /// The word of a variable, if it was selected.
    #[must_use]
    pub fn word(&self, variable: usize) -> Option<u32> {
        self.words.get(self.selection.column(variable)?).copied()
    }

    /// The value of a variable of [`Kind::Real`](super::Kind::Real), if it was selected.
    #[must_use]
    pub fn real(&self, variable: usize) -> Option<f32> {
        self.word(variable).map(f32::from_bits)
    }
}
