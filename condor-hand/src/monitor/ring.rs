use condor_mbox::{AccessError, MemoryWindow, Region};
use thiserror::Error;

use super::layout::{COLUMNS, Layout, MAGIC, VARIABLES, VERSION, entry, header, row};
use super::selection::Selection;
use super::variable::Variable;

/// The writer of rows: the half of a monitor that knows nothing of messages.
#[derive(Debug)]
pub struct Ring<W> {
    region: Region<W>,
    layout: Layout,
    newest: u32,
}

/// A monitor that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum MonitorError {
    /// A region that is too small, or too many variables or columns.
    #[error(
        "{variables} variables (1 to {VARIABLES}), {columns} columns (1 to {COLUMNS}) and two rows \
         or more in {size} bytes"
    )]
    Size {
        /// How many variables.
        variables: u32,
        /// How many columns of a row.
        columns: u32,
        /// Bytes of the region.
        size: u32,
    },
    /// The region refused an access.
    #[error(transparent)]
    Access(#[from] AccessError),
}

impl<W: MemoryWindow> Ring<W> {
    /// Makes a ring of as many rows as `region` has room for, with `columns` values each at most.
    ///
    /// Sequences go on where those of a former ring in the region ended.
    ///
    /// # Errors
    /// See [`MonitorError`].
    pub fn new(
        region: Region<W>,
        servo_hz: u32,
        variables: impl Iterator<Item = Variable> + Clone,
        columns: u32,
    ) -> Result<Self, MonitorError> {
        let count = u32::try_from(variables.clone().count()).unwrap_or(u32::MAX);
        let size = region.size();
        let layout = Layout::filling(size, count, columns).ok_or(MonitorError::Size {
            variables: count,
            columns,
            size,
        })?;
        let life = region.word(header::LIFE)?.wrapping_add(1);
        let newest = region.word(header::NEWEST)?;
        // Before anything else changes: a reader of the former life looks at it last.
        region.set_word(header::LIFE, life)?;
        region.set_word(header::MAGIC, 0)?;
        for (offset, word) in [
            (header::VERSION, VERSION),
            (header::VARIABLES, count),
            (header::COLUMNS, columns),
            (header::ROWS, layout.rows),
            (header::SERVO_HZ, servo_hz),
        ] {
            region.set_word(offset, word)?;
        }
        for (number, variable) in (0..).zip(variables) {
            variable.write(&region, entry(number))?;
        }
        for place in 0..layout.rows {
            // The sequence of another place, which no row here ever has.
            let never = place ^ 1;
            region.set_word(layout.row(place) + row::BEGUN, never)?;
            region.set_word(layout.row(place) + row::COMPLETE, never)?;
        }
        let mut this = Self {
            region,
            layout,
            newest,
        };
        this.announce(0, &Selection::NOTHING)?;
        this.region.set_word(header::MAGIC, MAGIC)?;
        Ok(this)
    }

    /// How many variables there are, and how many a row may have.
    #[must_use]
    pub const fn capacity(&self) -> (u32, u32) {
        (self.layout.variables, self.layout.columns)
    }

    /// How many rows it keeps.
    #[must_use]
    pub const fn rows(&self) -> u32 {
        self.layout.rows
    }

    /// Writes a row: the number of the tick, and a value for each variable of the selection, lowest
    /// first.
    ///
    /// Of more values than columns there are only the first; a reader takes such a row for lost.
    ///
    /// # Errors
    /// As [`MemoryWindow::store`]; then there is no new row.
    pub fn write(
        &mut self,
        tick: u32,
        selection: &Selection,
        values: impl Iterator<Item = u32>,
    ) -> Result<(), AccessError> {
        let sequence = self.newest.wrapping_add(1);
        let at = self.layout.row(sequence);
        // A reader that loads any of the words below finds this one, or a later one, afterwards.
        self.region.set_word(at + row::BEGUN, sequence)?;
        self.region.set_word(at + row::TICK, tick)?;
        for (offset, word) in (at + row::MASK..).step_by(4).zip(selection.mask) {
            self.region.set_word(offset, word)?;
        }
        let columns = self.layout.columns as usize;
        for (offset, value) in (at + row::VALUES..).step_by(4).zip(values.take(columns)) {
            self.region.set_word(offset, value)?;
        }
        // Pairs with the reader's first look at the row.
        self.region.set_word(at + row::COMPLETE, sequence)?;
        // Pairs with the reader's look for new rows.
        self.region.set_word(header::NEWEST, sequence)?;
        self.newest = sequence;
        Ok(())
    }

    /// Lets readers know which selection is in force.
    pub(super) fn announce(
        &mut self,
        number: u32,
        selection: &Selection,
    ) -> Result<(), AccessError> {
        self.region.set_word(header::EVERY, selection.every)?;
        for (offset, word) in (header::MASK..).step_by(4).zip(selection.mask) {
            self.region.set_word(offset, word)?;
        }
        self.region.set_word(header::SELECTION_NUMBER, number)
    }
}
