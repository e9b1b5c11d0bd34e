use super::selection::MASK_WORDS;

/// The most variables of a monitor.
pub const VARIABLES: usize = 32 * MASK_WORDS;
/// The most variables of a row.
pub const COLUMNS: usize = VARIABLES;

pub(super) const MAGIC: u32 = u32::from_le_bytes(*b"CMON");
pub(super) const VERSION: u32 = 1;

/// Byte offsets of the header's words.
pub(super) mod header {
    pub(in super::super) const MAGIC: u32 = 0;
    pub(in super::super) const VERSION: u32 = 4;
    pub(in super::super) const LIFE: u32 = 8;
    pub(in super::super) const VARIABLES: u32 = 12;
    pub(in super::super) const COLUMNS: u32 = 16;
    pub(in super::super) const ROWS: u32 = 20;
    pub(in super::super) const SERVO_HZ: u32 = 24;
    pub(in super::super) const NEWEST: u32 = 64;
    pub(in super::super) const SELECTION_NUMBER: u32 = 68;
    pub(in super::super) const EVERY: u32 = 72;
    pub(in super::super) const MASK: u32 = 76;
}

const TABLE: u32 = 128;
pub(super) const ENTRY_BYTES: u32 = 64;
/// Words of a row besides the values.
const ROW_HEADER_WORDS: u32 = 3 + MASK_WORDS as u32;

/// Byte offsets in a row.
pub(super) mod row {
    pub(in super::super) const BEGUN: u32 = 0;
    pub(in super::super) const COMPLETE: u32 = 4;
    pub(in super::super) const TICK: u32 = 8;
    pub(in super::super) const MASK: u32 = 12;
    pub(in super::super) const VALUES: u32 = 4 * super::ROW_HEADER_WORDS;
}

/// Bytes of the region of a ring.
///
/// `rows` should be a power of two; of any other number, only the next lower one is used.
#[must_use]
pub const fn ring_bytes(variables: u32, columns: u32, rows: u32) -> u32 {
    rows_at(variables).saturating_add(rows.saturating_mul(row_bytes(columns)))
}

/// Where a variable is described.
pub(super) const fn entry(variable: u32) -> u32 {
    TABLE.saturating_add(variable.saturating_mul(ENTRY_BYTES))
}

const fn rows_at(variables: u32) -> u32 {
    // A table that reaches past the end of every window is refused at its first access.
    TABLE.saturating_add(variables.saturating_mul(ENTRY_BYTES))
}

const fn row_bytes(columns: u32) -> u32 {
    4 * ROW_HEADER_WORDS.saturating_add(columns)
}

/// The numbers that say where everything is, once they have been checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) variables: u32,
    pub(super) columns: u32,
    /// A power of two, at least 2.
    pub(super) rows: u32,
}

impl Layout {
    /// The most rows that so many bytes have room for.
    pub(super) fn filling(size: u32, variables: u32, columns: u32) -> Option<Self> {
        let fit = size.checked_sub(rows_at(variables))? / row_bytes(columns);
        let rows = 1 << fit.checked_ilog2()?;
        Self {
            variables,
            columns,
            rows,
        }
        .checked(size)
    }

    /// It, if it can be in so many bytes.
    pub(super) fn checked(self, size: u32) -> Option<Self> {
        let possible = (1..=VARIABLES as u32).contains(&self.variables)
            && (1..=COLUMNS as u32).contains(&self.columns)
            && self.rows.is_power_of_two()
            && self.rows >= 2
            && ring_bytes(self.variables, self.columns, self.rows) <= size;
        possible.then_some(self)
    }

    /// Where a row is.
    pub(super) const fn row(&self, sequence: u32) -> u32 {
        let place = sequence & self.rows.wrapping_sub(1);
        rows_at(self.variables).saturating_add(place.saturating_mul(row_bytes(self.columns)))
    }
}
