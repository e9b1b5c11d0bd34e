//! `plot`: variables over time, as text.

use std::collections::VecDeque;
use std::io::{Write, stdout};
use std::time::{Duration, Instant};

use crate::AnyError;
use crate::watch::WatchedStream;

/// The columns and lines of a drawing.
const SIZE: (usize, usize) = (72, 8);
/// The greatest number of values that are kept of a variable.
const KEPT: usize = 1 << 16;

/// The times, in ns, and values of a variable.
type Curve = VecDeque<(u64, f64)>;

/// Waits for the span of time to draw, and draws it.
pub(crate) fn run(mut all: Vec<WatchedStream>, span: Duration) -> Result<(), AnyError> {
    let curves = all.iter().map(|it| vec![Curve::new(); it.columns.len()]);
    let mut curves: Vec<_> = curves.collect();
    let end = Instant::now() + span;
    while Instant::now() < end {
        for (watched, curves) in all.iter_mut().zip(&mut curves) {
            while let Some(message) = watched.next()? {
                let row = watched.row(&message)?;
                for ((column, _), curve) in watched.columns.iter().zip(curves.iter_mut()) {
                    let number = row.value(*column).and_then(|it| number(&it.to_string()));
                    curve.extend(number.map(|number| (row.head().stamp.as_ns(), number)));
                    if curve.len() > KEPT {
                        curve.pop_front();
                    }
                }
                if Instant::now() >= end {
                    break;
                }
            }
        }
    }
    let mut out = stdout().lock();
    for (watched, curves) in all.iter().zip(curves) {
        for ((_, name), curve) in watched.columns.iter().zip(curves) {
            let values: Vec<_> = curve.into();
            let lost = match watched.lost {
                0 => String::new(),
                lost => format!(", {lost} rows lost"),
            };
            writeln!(out, "{name} ({} values{lost})", values.len())?;
            for line in drawn(&values) {
                writeln!(out, "{line}")?;
            }
        }
    }
    Ok(())
}

/// A value as a number.
fn number(text: &str) -> Option<f64> {
    match text {
        "true" => Some(1.0),
        "false" => Some(0.0),
        text => text.parse().ok(),
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
