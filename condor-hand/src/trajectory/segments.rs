use super::root::bracketed;
use super::{ProfilePeaks, SetPoint, check_rates};
use crate::math::{abs, clamp, max, min, sqrt};
use crate::number::{NumberError, Requirement, check, finite};

/// The greatest velocity, acceleration and jerk of a joint in a motion of [`Segments`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The greatest speed to either side, rad/s.
    pub velocity: f64,
    /// The greatest acceleration to either side, rad/s².
    pub acceleration: f64,
    /// The greatest jerk to either side, rad/s³; with `None` the acceleration may jump: a trapezoid
    /// of velocity.
    pub jerk: Option<f64>,
}

/// The motion of one joint to rest at a position, as up to seven segments of constant jerk: a
/// trapezoid of velocity, or one with rounded corners.
///
/// The joint first changes to one velocity, then keeps it, and at the end changes to zero velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segments {
    start: SetPoint,
    pieces: [Piece; 7],
    end: f64,
    duration: f64,
}

/// One segment: its duration, the acceleration it begins with, and its jerk.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    duration: f64,
    acceleration: f64,
    jerk: f64,
}

impl Piece {
    fn nothing() -> Self {
        Self {
            duration: 0.0,
            acceleration: 0.0,
            jerk: 0.0,
        }
    }

    /// The state `t` seconds after this one, in this segment.
    #[inline]
    fn after(&self, state: &SetPoint, t: f64) -> SetPoint {
        let acceleration = self.acceleration + self.jerk * t;
        let mean = (self.acceleration + acceleration) * 0.5;
        let cubic = self.acceleration * 0.5 + self.jerk * t * (1.0 / 6.0);
        SetPoint {
            position: state.position + (state.velocity + cubic * t) * t,
            velocity: state.velocity + mean * t,
            acceleration,
        }
    }

    fn end(&self, state: &SetPoint) -> SetPoint {
        self.after(state, self.duration)
    }
}

impl Bounds {
    fn check(&self) -> Result<(), NumberError> {
        let jerk = self.jerk.unwrap_or(1.0);
        check_rates(self.velocity, self.acceleration, jerk)
    }

    /// The fastest change of velocity to `to` with no acceleration at its end.
    fn change(&self, velocity: f64, acceleration: f64, to: f64) -> [Piece; 3] {
        let nothing = Piece::nothing();
        let half = 0.5;
        let Some(jerk) = self.jerk else {
            let dv = to - velocity;
            let acceleration = if dv < 0.0 {
                -self.acceleration
            } else {
                self.acceleration
            };
            let duration = dv / acceleration;
            return [
                Piece {
                    duration,
                    acceleration,
                    jerk: 0.0,
                },
                nothing,
                nothing,
            ];
        };
        let dv = to - velocity;
        let along = if dv < acceleration * abs(acceleration) * half / jerk {
            -1.0
        } else {
            1.0
        };
        let (rise, first) = (dv * along, acceleration * along);
        // The area under the acceleration is `(peak² - first²) / 2j + peak² / 2j`.
        let mut peak = sqrt(jerk * rise + first * first * half);
        let mut flat = 0.0;
        if peak > self.acceleration {
            peak = self.acceleration;
            flat = (rise - (peak * peak - first * first * half) / jerk) / peak;
        }
        [
            Piece {
                duration: max((peak - first) / jerk, 0.0),
                acceleration,
                jerk: along * jerk,
            },
            Piece {
                duration: max(flat, 0.0),
                acceleration: along * peak,
                jerk: 0.0,
            },
            Piece {
                duration: peak / jerk,
                acceleration: along * peak,
                jerk: -along * jerk,
            },
        ]
    }

    /// The acceleration from which the velocity bound can still be kept.
    fn admissible(&self, start: &SetPoint) -> f64 {
        let Some(jerk) = self.jerk else {
            return 0.0;
        };
        let twice = 2.0 * jerk;
        let up = sqrt(twice * (self.velocity - start.velocity));
        let down = sqrt(twice * (self.velocity + start.velocity));
        clamp(
            start.acceleration,
            -min(down, self.acceleration),
            min(up, self.acceleration),
        )
    }
}

/// A start at position zero whose end lies in the positive direction from where braking ends.
struct Case<'a> {
    bounds: &'a Bounds,
    velocity: f64,
    acceleration: f64,
    distance: f64,
}

/// The distance and the time to reach a velocity and then to brake to rest.
struct Via {
    distance: f64,
    duration: f64,
}

impl Case<'_> {
    fn pieces(&self, peak: f64) -> ([Piece; 3], [Piece; 3]) {
        (
            self.bounds.change(self.velocity, self.acceleration, peak),
            self.bounds.change(peak, 0.0, 0.0),
        )
    }

    fn via(&self, peak: f64) -> Via {
        let (first, last) = self.pieces(peak);
        let mut state = SetPoint {
            position: 0.0,
            velocity: self.velocity,
            acceleration: 0.0,
        };
        let mut duration = 0.0;
        for piece in first.iter().chain(&last) {
            state = piece.end(&state);
            duration += piece.duration;
        }
        Via {
            distance: state.position,
            duration,
        }
    }

    /// The velocity at which jerk alone takes the acceleration away.
    fn natural(&self) -> f64 {
        let Some(jerk) = self.bounds.jerk else {
            return self.velocity;
        };
        self.velocity + self.acceleration * abs(self.acceleration) / (2.0 * jerk)
    }

    /// The velocity to reach for the end to be just met.
    fn fastest(&self) -> f64 {
        let limit = self.bounds.velocity;
        let short = |peak: f64| self.via(peak).distance - self.distance;
        if !(short(limit) > 0.0) {
            return limit;
        }
        let natural = clamp(self.natural(), 0.0, limit);
        if short(natural) > 0.0 {
            bracketed(0.0, natural, short)
        } else {
            bracketed(natural, limit, short)
        }
    }

    /// The velocity to keep for the end to be met after exactly `duration`, up to `fastest`.
    fn lasting(&self, duration: f64, fastest: f64) -> f64 {
        if self.bounds.jerk.is_none() && self.velocity == 0.0 {
            // The smaller root of `v² - a T v + a d = 0`, in the form that keeps all digits.
            let square = duration * duration - 4.0 * self.distance / self.bounds.acceleration;
            let peak = 2.0 * self.distance / (duration + sqrt(square));
            return min(peak, fastest);
        }
        // In the form `(time left) * v - (way left)`, which has no pole at rest.
        bracketed(0.0, fastest, |peak| {
            let via = self.via(peak);
            (duration - via.duration) * peak - (self.distance - via.distance)
        })
    }
}

/// A motion from a state to rest, of which only the velocity to keep is open.
struct Way<'a> {
    start: SetPoint,
    end: f64,
    /// The direction of the motion: 1 or -1. The numbers of the case are along it.
    along: f64,
    case: Case<'a>,
}

impl<'a> Way<'a> {
    fn new(start: &SetPoint, end: f64, bounds: &'a Bounds) -> Result<Self, NumberError> {
        bounds.check()?;
        let delta = end - start.position;
        finite("the distance to go, rad,", delta)?;
        finite("the velocity at the start, rad/s,", start.velocity)?;
        finite("the acceleration at the start, rad/s²,", start.acceleration)?;
        let acceleration = bounds.admissible(start);
        let mut case = Case {
            bounds,
            velocity: start.velocity,
            acceleration,
            distance: delta,
        };
        let along = if delta < case.via(0.0).distance {
            -1.0
        } else {
            1.0
        };
        case.velocity *= along;
        case.acceleration *= along;
        case.distance *= along;
        let start = SetPoint {
            acceleration,
            ..*start
        };
        Ok(Self {
            start,
            end,
            along,
            case,
        })
    }

    /// The motion that keeps the velocity `peak`, and so lasts `duration`.
    fn with(&self, peak: f64, duration: f64) -> Result<Segments, NumberError> {
        let (first, last) = self.case.pieces(peak);
        let cruise = Piece {
            duration: self.case.cruise(peak),
            ..Piece::nothing()
        };
        let [a, b, c] = first;
        let [d, e, f] = last;
        let pieces = [a, b, c, cruise, d, e, f].map(|piece| Piece {
            duration: piece.duration,
            acceleration: piece.acceleration * self.along,
            jerk: piece.jerk * self.along,
        });
        // Terms whose sum is finite leave every state on the way finite.
        let (mut state, mut sum) = (self.start, duration);
        for piece in &pieces {
            let t = piece.duration;
            let change = abs(piece.acceleration) + abs(piece.jerk) * t;
            let rate = abs(state.velocity) + change * t;
            sum += change + rate + abs(state.position) + rate * t;
            state = piece.end(&state);
        }
        finite("the sum of the terms of the profile", sum)?;
        Ok(Segments {
            start: self.start,
            pieces,
            end: self.end,
            duration,
        })
    }
}

impl Segments {
    /// Makes the motion from any state to rest at `end`, independently of other joints.
    ///
    /// Without a bound of jerk this is the fastest possible motion; the acceleration at the start
    /// is not used. With one it is also the fastest, with one exception: a joint that brakes
    /// already, need not turn back, and could brake later. It brakes, releases the brake, and
    /// brakes again.
    ///
    /// The bounds hold from the start on if the start is within them. If the acceleration of the
    /// start would lead beyond the bound of velocity, it is reduced at once. The motion may pass
    /// `end` and return if it cannot stop before.
    ///
    /// # Errors
    /// [`NumberError`] if a number is not finite, or a bound is not above zero.
    pub fn fastest(start: &SetPoint, end: f64, bounds: &Bounds) -> Result<Self, NumberError> {
        let way = Way::new(start, end, bounds)?;
        let peak = way.case.fastest();
        way.with(peak, way.case.total(peak))
    }

    /// Makes the motion with a lower velocity, so that it lasts `duration` seconds; so several
    /// joints can arrive together. Returns `None` if no velocity leads to this duration, which happens only
    /// from a moving state.
    ///
    /// # Errors
    /// [`NumberError`] if a number is not finite, a bound is not above zero, or the duration is below that of the
    /// fastest motion.
    pub fn lasting(
        start: &SetPoint,
        end: f64,
        bounds: &Bounds,
        duration: f64,
    ) -> Result<Option<Self>, NumberError> {
        let way = Way::new(start, end, bounds)?;
        let case = &way.case;
        let fastest = case.fastest();
        let least = case.total(fastest);
        // Rounding must not refuse the slowest of several joints its own duration.
        let slack = duration * 16.0 * f64::EPSILON;
        let must = Requirement::AtLeast(least);
        check("the duration, s,", duration + slack, must).map_err(|error| NumberError {
            value: duration,
            ..error
        })?;
        if duration <= least + slack {
            return way.with(fastest, least).map(Some);
        }
        if case.distance == 0.0 && case.velocity == 0.0 && case.acceleration == 0.0 {
            return way.with(0.0, duration).map(Some);
        }
        let peak = case.lasting(duration, fastest);
        let total = case.total(peak);
        let tolerance = duration * sqrt(f64::EPSILON);
        if !(abs(total - duration) <= tolerance) {
            return Ok(None);
        }
        way.with(peak, total).map(Some)
    }

    /// Returns the duration of the motion, s; zero if it starts at its end.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Returns the set-point `t` seconds after the beginning of the motion. After the end the joint
    /// rests at the end position.
    #[inline]
    #[must_use]
    pub fn at(&self, t: f64) -> SetPoint {
        if !(t < self.duration) {
            return SetPoint::rest(self.end);
        }
        let mut left = max(t, 0.0);
        let mut state = self.start;
        for piece in &self.pieces {
            if left < piece.duration {
                return piece.after(&state, left);
            }
            if piece.duration > 0.0 {
                state = piece.end(&state);
                left -= piece.duration;
            }
        }
        // The sum of the parts may be less than the whole by rounding, and one that stays has none.
        SetPoint::rest(self.end)
    }

    /// Returns the extremes of position, velocity and acceleration during the motion.
    #[must_use]
    pub fn peaks(&self) -> ProfilePeaks {
        let mut peaks = ProfilePeaks::of(&self.start);
        peaks.include(&ProfilePeaks::of(&SetPoint::rest(self.end)));
        let mut state = self.start;
        for piece in &self.pieces {
            if !(piece.duration > 0.0) {
                continue;
            }
            let beginning = piece.after(&state, 0.0);
            let end = piece.end(&state);
            peaks.include(&ProfilePeaks::of(&beginning));
            peaks.include(&ProfilePeaks::of(&end));
            // The places where acceleration, or velocity, is zero within the segment.
            let half = 0.5;
            let (a, j) = (piece.acceleration, piece.jerk);
            let turn = sqrt(a * a - 2.0 * j * state.velocity);
            let q = -(a + if a < 0.0 { -turn } else { turn });
            for t in [
                -a / j,
                q / j,
                state.velocity / (q * half),
                half * piece.duration,
            ] {
                if t > 0.0 && t < piece.duration {
                    peaks.include(&ProfilePeaks::of(&piece.after(&state, t)));
                }
            }
            state = end;
        }
        peaks
    }
}

impl Case<'_> {
    fn cruise(&self, peak: f64) -> f64 {
        let left = self.distance - self.via(peak).distance;
        // A remaining distance from rounding is not worth a time.
        let noise = f64::EPSILON * 8.0 * abs(self.distance);
        if peak > 0.0 && left > noise {
            left / peak
        } else {
            0.0
        }
    }

    fn total(&self, peak: f64) -> f64 {
        self.via(peak).duration + self.cruise(peak)
    }
}
