//! [`TextTable`]: rows in aligned columns.

use core::fmt;

use condor_host::plain::plain;

/// The side of a column at which its text is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    Left,
    Right,
}
pub(crate) use Side::{Left, Right};

/// Rows under titles, each column as wide as its widest cell.
#[derive(Debug)]
pub(crate) struct TextTable<const C: usize> {
    titles: [(&'static str, Side); C],
    rows: Vec<[String; C]>,
    gap: usize,
}

impl<const C: usize> TextTable<C> {
    pub(crate) const fn new(titles: [(&'static str, Side); C]) -> Self {
        Self {
            titles,
            rows: Vec::new(),
            gap: 2,
        }
    }

    /// With so many blanks between columns.
    pub(crate) fn with_gap(self, gap: usize) -> Self {
        Self { gap, ..self }
    }

    /// Names in cells are those that programs have chosen.
    pub(crate) fn row(&mut self, cells: [String; C]) {
        self.rows.push(cells.map(|cell| plain(&cell).into_owned()));
    }
}

impl<const C: usize> fmt::Display for TextTable<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut widths = self.titles.map(|(title, _)| title.chars().count());
        for row in &self.rows {
            for (width, cell) in widths.iter_mut().zip(row) {
                *width = (*width).max(cell.chars().count());
            }
        }
        let titles = self.titles.map(|(title, _)| title.to_owned());
        for row in core::iter::once(&titles).chain(&self.rows) {
            let mut line = String::new();
            for ((cell, width), (_, side)) in row.iter().zip(widths).zip(self.titles) {
                if !line.is_empty() {
                    line.push_str(&" ".repeat(self.gap));
                }
                let pad = " ".repeat(width.saturating_sub(cell.chars().count()));
                match side {
                    Left => line.extend([cell.as_str(), &pad]),
                    Right => line.extend([pad.as_str(), cell]),
                }
            }
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

/// A number, or a dash.
pub(crate) fn or_dash<T: fmt::Display>(value: Option<T>) -> String {
    value.map_or_else(|| "-".into(), |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let mut table = TextTable::new([("name", Left), ("n", Right)]);
        table.row(["é".into(), "1000".into()]);
        table.row(["finger".into(), "7".into()]);
        let text = "name       n\né       1000\nfinger     7\n";
        assert_eq!(table.to_string(), text);
    }

    #[test]
    fn names_do_not_command_the_terminal() {
        let mut table = TextTable::new([("name", Left), ("n", Right)]);
        table.row(["a\x1b]0;b\x07\nc".into(), "1".into()]);
        let text = "name                 n\na\\u{1b}]0;b\\u{7}\\nc  1\n";
        assert_eq!(table.to_string(), text);
    }
}
