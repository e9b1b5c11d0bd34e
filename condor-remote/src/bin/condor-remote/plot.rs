//! `plot`: variables over time, as text.

use std::collections::VecDeque;
use std::io::{Write, stdout};
use std::time::{Duration, Instant};

use condor_remote::{Remote, RemoteError, Stream};

use crate::AnyError;

/// The columns and lines of a drawing.
const SIZE: (usize, usize) = (72, 8);
/// The greatest number of values that are kept of a variable.
const KEPT: usize = 1 << 16;

/// A variable with the values that have come.
struct Curve {
    name: String,
    stream: Stream,
    column: usize,
    /// Times in ns, and values.
    values: VecDeque<(u64, f64)>,
    lost: u64,
}

/// Waits for the time that is to be drawn, and draws it.
pub(crate) fn run(
    remote: &Remote,
    names: &[String],
    span: Duration,
    timeout: Duration,
) -> Result<(), AnyError> {
    let mut curves = Vec::new();
    for name in names {
        curves.push(Curve::find(remote, name, timeout)?);
    }
    let end = Instant::now() + span;
    while Instant::now() < end {
        for curve in &mut curves {
            curve.take()?;
        }
    }
    let mut out = stdout().lock();
    for curve in &curves {
        let values: Vec<_> = curve.values.iter().copied().collect();
        let lost = match curve.lost {
            0 => String::new(),
            lost => format!(", {lost} rows lost"),
        };
        writeln!(out, "{} ({} values{lost})", curve.name, values.len())?;
        for line in drawn(&values) {
            writeln!(out, "{line}")?;
        }
    }
    Ok(())
}

impl Curve {
    fn find(remote: &Remote, name: &str, timeout: Duration) -> Result<Self, AnyError> {
        for topic in remote
            .topics(timeout)?
            .iter()
            .filter(|topic| topic.has_rows)
        {
            let stream = remote.subscribe(&topic.name, timeout)?;
            let column = stream.columns().position(|column| column == name);
            if let Some(column) = column {
                return Ok(Self {
                    name: name.into(),
                    stream,
                    column,
                    values: VecDeque::new(),
                    lost: 0,
                });
            }
        }
        Err(format!(
            "no stream has the variable `{name}`; the gateway's `variables` says which are streamed"
        )
        .into())
    }

    /// Takes what has come.
    fn take(&mut self) -> Result<(), AnyError> {
        while let Some(message) = self.stream.next(Duration::from_millis(5))? {
            let row = self.stream.row(&message)?;
            let row = row.ok_or_else(|| RemoteError::Strange(self.name.clone()))?;
            let head = row.head();
            self.lost += head.lost + message.lost;
            let number = row.value(self.column).map(|value| value.to_string());
            let number = number.and_then(|text| match text.as_str() {
                "true" => Some(1.0),
                "false" => Some(0.0),
                text => text.parse().ok(),
            });
            let at_ns = head.stamp.as_ns();
            self.values.extend(number.map(|number| (at_ns, number)));
            if self.values.len() > KEPT {
                self.values.pop_front();
            }
        }
        Ok(())
    }
}

#[expect(
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    reason = "places in a drawing are small and not negative"
)]
/// Draws values as lines of text: each column from the least to the greatest value of its time.
fn drawn(values: &[(u64, f64)]) -> Vec<String> {
    let (width, height) = SIZE;
    let finite = || values.iter().filter(|(_, value)| value.is_finite());
    let (Some(&(first, _)), Some(&(last, _))) = (finite().next(), finite().next_back()) else {
        return vec!["  no values".into()];
    };
    let low = finite().fold(f64::INFINITY, |low, (_, value)| low.min(*value));
    let high = finite().fold(f64::NEG_INFINITY, |high, (_, value)| high.max(*value));
    let line_of = |value: f64| {
        let part = if high > low {
            (value - low) / (high - low)
        } else {
            0.5
        };
        // From the top.
        height - 1 - (part * (height - 1) as f64).round() as usize
    };
    let mut cells = vec![vec![' '; width]; height];
    let mut before = None;
    for &(at, value) in finite() {
        let part = (at - first) as f64 / (last - first).max(1) as f64;
        let (column, line) = ((part * (width - 1) as f64).round() as usize, line_of(value));
        let from = before.replace(line).unwrap_or(line);
        for cells in &mut cells[from.min(line)..=from.max(line)] {
            cells[column] = '█';
        }
    }
    let mut lines: Vec<_> = cells
        .into_iter()
        .map(|cells| {
            format!(
                "{:>12} │{}",
                "",
                cells.iter().collect::<String>().trim_end()
            )
        })
        .collect();
    for (line, value) in [(0, high), (height - 1, low)] {
        let text = &lines[line][12..];
        lines[line] = format!("{value:>12.5}{text}");
    }
    lines.push(format!(
        "{:>12} └{:>width$.2} s",
        "",
        (last - first) as f64 * 1e-9
    ));
    lines
}

#[cfg(test)]
mod tests {
    use super::drawn;

    #[test]
    fn a_ramp_goes_from_corner_to_corner() {
        let values: Vec<_> = (0_u32..100)
            .map(|it| (u64::from(it) * 10_000_000, f64::from(it)))
            .collect();
        let lines = drawn(&values);
        assert!(
            lines[0].starts_with("    99.00000 │") && lines[0].ends_with('█'),
            "{lines:#?}"
        );
        assert!(lines[7].starts_with("     0.00000 │█"), "{lines:#?}");
        assert!(lines[8].ends_with("0.99 s"), "{lines:#?}");
        assert_eq!(drawn(&[(0, f64::NAN)]), ["  no values"]);
    }
}
