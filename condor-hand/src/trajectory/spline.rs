use heapless::Vec;

use super::{Polynomial, ProfilePeaks, SetPoint};
use crate::Subject;
use crate::number::{NumberError, Requirement, check, count, finite};

/// The motion of one joint through up to K points (knots), as a cubic spline with given velocities
/// at both ends. Position, velocity and acceleration are continuous. Of all such curves it has the
/// least squared acceleration.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline<const K: usize> {
    knots: Vec<Knot, K>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Knot {
    time: f64,
    position: f64,
    velocity: f64,
}

impl<const K: usize> Spline<K> {
    /// Makes the spline that is at `positions[i]` (rad) at the time `times[i]` (s); times must
    /// increase. `velocities` are those at the first and the last knot, rad/s.
    ///
    /// The other velocities are the solution of a tridiagonal system, whose diagonal dominates (C.
    /// de Boor, "A practical guide to splines", chapter IV), by L. H. Thomas' elimination.
    ///
    /// # Errors
    /// [`NumberError`] if there are too few or too many knots, times do not increase, or a number
    /// is not finite.
    pub fn clamped(
        times: &[f64],
        positions: &[f64],
        velocities: (f64, f64),
    ) -> Result<Self, NumberError> {
        let mut knots = Vec::<Knot, K>::new();
        let number = count(times.len());
        check(
            "the number of times",
            number,
            Requirement::Equal(count(positions.len())),
        )?;
        check(
            "the number of knots",
            number,
            Requirement::Within(2.0, count(K)),
        )?;
        for (index, (&time, &position)) in times.iter().zip(positions).enumerate() {
            let after = match knots.last() {
                Some(last) => Requirement::Above(last.time),
                None => Requirement::Finite,
            };
            check("the time, s,", time, after)
                .and_then(|()| finite("the position, rad,", position))
                .map_err(|error| error.at(Subject::Knot(index as u16)))?;
            let velocity = 0.0;
            let knot = Knot {
                time,
                position,
                velocity,
            };
            // There is room: the number was checked.
            let _ = knots.push(knot);
        }
        if let Some(first) = knots.first_mut() {
            first.velocity = velocities.0;
        }
        if let Some(last) = knots.last_mut() {
            last.velocity = velocities.1;
        }
        let mut spline = Self { knots };
        spline.solve();
        for piece in spline.pieces() {
            piece?;
        }
        Ok(spline)
    }

    /// Row i: `h₁ v₋ + 2 (h₀ + h₁) v + h₀ v₊ = 3 (h₁ d₀ + h₀ d₁)`, where h₀, h₁ are the intervals
    /// before and after the knot and d₀, d₁ the slopes of their chords.
    fn solve(&mut self) {
        // After elimination each row is `v + upper v₊ = right`; right takes the place of v.
        let mut uppers: Vec<f64, K> = Vec::new();
        let (mut upper, mut right) = (0.0, self.knots.first().map_or(0.0, |knot| knot.velocity));
        for index in 1..self.knots.len().saturating_sub(1) {
            let Some([before, here, after]) = self.knots.get(index - 1..index + 2) else {
                break;
            };
            let (h0, h1) = (here.time - before.time, after.time - here.time);
            let d0 = (here.position - before.position) / h0;
            let d1 = (after.position - here.position) / h1;
            let pivot = 2.0 * (h0 + h1) - h1 * upper;
            right = (3.0 * (h1 * d0 + h0 * d1) - h1 * right) / pivot;
            upper = h0 / pivot;
            // As many as there are knots.
            let _ = uppers.push(upper);
            if let Some(knot) = self.knots.get_mut(index) {
                knot.velocity = right;
            }
        }
        let mut next = self.knots.last().map_or(0.0, |knot| knot.velocity);
        let inner = self.knots.iter_mut().skip(1).take(uppers.len());
        for (knot, &upper) in inner.rev().zip(uppers.iter().rev()) {
            knot.velocity -= upper * next;
            next = knot.velocity;
        }
    }

    fn pieces(&self) -> impl Iterator<Item = Result<Polynomial, NumberError>> + '_ {
        let pairs = self.knots.iter().zip(self.knots.iter().skip(1));
        pairs.map(|(from, to)| Self::piece(from, to))
    }

    fn piece(from: &Knot, to: &Knot) -> Result<Polynomial, NumberError> {
        let state = |knot: &Knot| SetPoint {
            position: knot.position,
            velocity: knot.velocity,
            acceleration: 0.0,
        };
        Polynomial::cubic(&state(from), &state(to), to.time - from.time)
    }

    /// Returns the time from the first knot to the last, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        match (self.knots.first(), self.knots.last()) {
            (Some(first), Some(last)) => last.time - first.time,
            _ => 0.0,
        }
    }

    /// Returns the set-point at the time `t`, s, on the same axis as the times of the knots. Before
    /// the first knot it is that of the first knot, and after the last knot that of the last.
    #[must_use]
    pub fn at(&self, t: f64) -> SetPoint {
        let count = self.knots.partition_point(|knot| knot.time <= t);
        let index = count.clamp(1, self.knots.len().saturating_sub(1).max(1));
        let (from, to) = (self.knots.get(index - 1), self.knots.get(index));
        let (Some(from), Some(to)) = (from, to) else {
            return SetPoint::rest(0.0);
        };
        // Each piece has been made once, by the constructor.
        Self::piece(from, to).map_or(SetPoint::rest(from.position), |piece| {
            piece.at(t - from.time)
        })
    }

    /// Returns the extremes of position, velocity and acceleration between the first and the last
    /// knot.
    #[must_use]
    pub fn peaks(&self) -> ProfilePeaks {
        let mut peaks: Option<ProfilePeaks> = None;
        for piece in self.pieces().flatten() {
            let of_piece = piece.peaks();
            match &mut peaks {
                Some(peaks) => peaks.include(&of_piece),
                None => peaks = Some(of_piece),
            }
        }
        peaks.unwrap_or(ProfilePeaks::of(&SetPoint::rest(0.0)))
    }
}
