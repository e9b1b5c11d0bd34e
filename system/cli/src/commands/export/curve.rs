//! [`Curve`]: a variable over time, with as many points as a drawing can show.

use std::ops::Range;

/// The number of parts of the time, each of which keeps four points at most.
const PARTS: f64 = 1000.0;

/// A point: the time in seconds, and the value.
pub(super) type Point = (f64, f64);

/// A variable over time.
pub(super) struct Curve {
    pub(super) name: String,
    pub(super) unit: String,
    shown: Range<f64>,
    parts: Vec<Part>,
    is_interrupted: bool,
}

/// The least and the greatest value in a part of the time.
struct Part {
    number: f64,
    /// Whether values are missing before it.
    is_first: bool,
    /// The first, the least, the greatest and the last point.
    points: [Point; 4],
}

impl Curve {
    pub(super) fn new(name: &str, unit: &str, shown: Range<f64>) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            shown,
            parts: Vec::new(),
            is_interrupted: true,
        }
    }

    /// Says that values are missing between the last point and the next.
    pub(super) const fn interrupt(&mut self) {
        self.is_interrupted = true;
    }

    /// Adds a point; times do not decrease. A value that is not finite interrupts the curve.
    pub(super) fn add(&mut self, at: f64, value: f64) {
        if !value.is_finite() {
            self.interrupt();
            return;
        }
        let length = (self.shown.end - self.shown.start).max(f64::MIN_POSITIVE);
        let number = ((at - self.shown.start) / length * PARTS).floor();
        let point = (at, value);
        match self.parts.last_mut() {
            Some(part) if part.number >= number && !self.is_interrupted => {
                let [_, least, greatest, newest] = &mut part.points;
                if value < least.1 {
                    *least = point;
                }
                if value > greatest.1 {
                    *greatest = point;
                }
                *newest = point;
            }
            _ => self.parts.push(Part {
                number,
                is_first: self.is_interrupted,
                points: [point; 4],
            }),
        }
        self.is_interrupted = false;
    }

    /// Returns the unbroken pieces of the curve.
    pub(super) fn pieces(&self) -> Vec<Vec<Point>> {
        let mut pieces: Vec<Vec<Point>> = Vec::new();
        for part in &self.parts {
            let mut points = part.points;
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            match pieces.last_mut() {
                Some(piece) if !part.is_first => piece.extend(points),
                _ => pieces.push(points.into()),
            }
        }
        for piece in &mut pieces {
            piece.dedup();
        }
        pieces
    }

    /// Returns the least and the greatest value; `None` if there is none.
    pub(super) fn range(&self) -> Option<Range<f64>> {
        let all = self.parts.iter().flat_map(|part| part.points);
        all.map(|(_, value)| value..value)
            .reduce(|a, b| a.start.min(b.start)..a.end.max(b.end))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_points_are_kept_as_they_are() {
        let mut curve = Curve::new("a", "rad", 0.0..1.0);
        let points = [(0.0, 1.0), (0.25, -3.0), (0.5, 2.0)];
        for (at, value) in points {
            curve.add(at, value);
        }
        assert_eq!(curve.pieces(), [points.to_vec()]);
        assert_eq!(curve.range(), Some(-3.0..2.0));
    }

    #[test]
    fn of_many_points_the_extremes_are_kept() {
        let mut curve = Curve::new("a", "", 0.0..1.0);
        let mut at = 0.0;
        for number in 0..1_000_000_u32 {
            at = f64::from(number) / 1e6;
            curve.add(at, if number == 500_123 { 7.0 } else { 0.5 });
        }
        let pieces = curve.pieces();
        assert!(pieces[0].len() <= 4000, "{}", pieces[0].len());
        assert!(pieces[0].contains(&(0.500_123, 7.0)));
        assert_eq!(pieces[0].last(), Some(&(at, 0.5)));
    }

    #[test]
    fn missing_values_break_the_curve() {
        let mut curve = Curve::new("a", "", 0.0..1.0);
        curve.add(0.1, 1.0);
        curve.interrupt();
        curve.add(0.1, 2.0);
        curve.add(0.2, f64::NAN);
        curve.add(0.3, 3.0);
        let expected = [vec![(0.1, 1.0)], vec![(0.1, 2.0)], vec![(0.3, 3.0)]];
        assert_eq!(curve.pieces(), expected);
    }
}
