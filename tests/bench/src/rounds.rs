//! Rounds in which everything that is compared takes its turns, and the tables that they make.

use std::fmt;
use std::io::IsTerminal as _;

use crate::Result;
use crate::measure::Estimate;

/// Plays rounds by their number, and shows on a terminal how far it is.
///
/// # Errors
/// Returns the error of the first round that fails.
pub(crate) fn play<T>(rounds: usize, mut round: impl FnMut(usize) -> Result<T>) -> Result<Vec<T>> {
    let shown = std::io::stderr().is_terminal();
    let mut played = Vec::new();
    for number in 0..rounds {
        if shown {
            eprint!("\rround {} of {rounds} ", number + 1);
        }
        played.push(round(number)?);
    }
    if shown {
        eprint!("\r{:24}\r", "");
    }
    Ok(played)
}

/// A figure that each row has.
#[derive(Debug)]
pub(crate) struct Column {
    /// Its name and its unit.
    pub(crate) head: &'static str,
    /// Digits after the point.
    pub(crate) digits: usize,
}

/// The one column of tables of times.
pub(crate) const NS: &[Column] = &[Column {
    head: "ns",
    digits: 0,
}];

/// Names a figure: the table, the row and the number of the column.
pub(crate) type Lane<'l> = (&'l str, &'l str, usize);

#[derive(Debug)]
struct Row {
    table: String,
    name: &'static str,
}

/// Tables of rows that were measured in the same rounds.
#[derive(Debug)]
pub(crate) struct Tables {
    columns: &'static [Column],
    rows: Vec<Row>,
    /// The figures of all columns of the first row, of the second, and so on.
    rounds: Vec<Vec<f64>>,
}

impl Tables {
    /// Makes tables without rows.
    pub(crate) fn new(columns: &'static [Column]) -> Self {
        Self {
            columns,
            rows: Vec::new(),
            rounds: Vec::new(),
        }
    }

    /// Adds a row; the first of a table is its baseline.
    pub(crate) fn row(&mut self, table: &str, name: &'static str) {
        let table = table.to_owned();
        self.rows.push(Row { table, name });
    }

    /// Adds rows, the first of which is their baseline.
    pub(crate) fn rows(&mut self, table: &str, names: &[&'static str]) {
        for name in names {
            self.row(table, name);
        }
    }

    /// Takes what was measured.
    pub(crate) fn fill(&mut self, rounds: Vec<Vec<f64>>) {
        self.rounds = rounds;
    }

    /// Returns the sum of figures in every round.
    fn column(&self, places: Vec<usize>) -> impl Iterator<Item = f64> {
        let sum = move |round: &Vec<f64>| places.iter().map(|place| round[*place]).sum();
        self.rounds.iter().map(sum)
    }

    fn places(&self, lanes: &[Lane<'_>]) -> Result<Vec<usize>> {
        let place = |&(table, name, column): &Lane<'_>| {
            let is_it = |row: &Row| row.table == table && row.name == name;
            let row = self.rows.iter().position(is_it);
            let row = row.ok_or_else(|| format!("no row {name} of {table}"))?;
            Ok(row * self.columns.len() + column)
        };
        lanes.iter().map(place).collect()
    }

    /// Returns the sum of figures in every round.
    ///
    /// # Errors
    /// Returns an error if there is no such row.
    pub(crate) fn values(&self, lanes: &[Lane<'_>]) -> Result<Vec<f64>> {
        Ok(self.column(self.places(lanes)?).collect())
    }

    /// Returns the ratio of the sum of `these` rows to the sum of `to`.
    ///
    /// # Errors
    /// Returns an error if there is no such row.
    pub(crate) fn ratio(&self, these: &[Lane<'_>], to: &[Lane<'_>]) -> Result<Estimate> {
        Ok(Estimate::ratio(self.values(these)?, self.values(to)?))
    }

    fn line(&self, f: &mut fmt::Formatter<'_>, index: usize, baseline: usize) -> fmt::Result {
        let mut line = vec![format!("{:55}", self.rows[index].name)];
        for (number, column) in self.columns.iter().enumerate() {
            let of = |row: usize| self.column(vec![row * self.columns.len() + number]);
            let value = Estimate::of(of(index)).value;
            let digits = column.digits;
            let ratio = Estimate::ratio(of(index), of(baseline));
            line.push(format!(" {value:10.digits$}  {ratio:22}"));
        }
        writeln!(f, "{}", line.concat().trim_end())
    }
}

impl fmt::Display for Tables {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (baseline, first) in self.rows.iter().enumerate() {
            let table = &first.table;
            if self.rows[..baseline].iter().any(|row| row.table == *table) {
                continue;
            }
            let mut head = vec![format!("{table:55}")];
            for column in self.columns {
                head.push(format!(" {:>10}  x baseline [95 %]     ", column.head));
            }
            writeln!(f, "\n{}", head.concat().trim_end())?;
            for (index, row) in self.rows.iter().enumerate() {
                if row.table == *table {
                    self.line(f, index, baseline)?;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_of_one_round_and_tables_have_their_rows_together() {
        let mut tables = Tables::new(NS);
        for (table, row) in [("a", "x"), ("b", "x"), ("a", "y")] {
            tables.row(table, row);
        }
        tables.fill(vec![vec![200.0, 7.0, 600.0]; 7]);
        let [fast, slow] = [("a", "x", 0), ("a", "y", 0)];
        let ratio = |these: &[Lane<'_>]| tables.ratio(these, &[fast]).unwrap().value;
        assert!((ratio(&[slow]) - 3.0).abs() < 1e-9);
        assert!((ratio(&[slow, fast]) - 4.0).abs() < 1e-9);
        assert!(tables.ratio(&[("c", "x", 0)], &[fast]).is_err());
        let text = tables.to_string();
        let lines: Vec<&str> = text
            .lines()
            .map(|line| &line[..line.len().min(1)])
            .collect();
        assert_eq!(lines, ["", "a", "x", "y", "", "b", "x"]);
        assert!(text.contains(" 600  3.00 [3.00, 3.00]"), "{text}");
    }
}
