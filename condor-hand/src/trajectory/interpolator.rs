use super::{Bounds, Polynomial, Segments, SetPoint, check_rates, check_start};
use crate::Subject;
use crate::math::{abs, min};
use crate::number::{NumberError, finite, positive};

/// An interpolator that computes set-points of J joints at the rate of the servos, from the less
/// frequent set-points of a master, the program that computes trajectories.
///
/// Between two ticks of the master it follows the cubic Hermite polynomial through positions and
/// velocities. If the next tick is late, it holds the last velocity for at most the length of one
/// tick, and then brakes. When ticks come again, it joins the new motion without a step of position
/// or velocity: the difference between the joint and the motion becomes a motion of its own, within
/// its own bounds, that is added.
#[derive(Clone, Debug)]
pub struct Interpolator<const J: usize> {
    substeps: u32,
    /// From step to step, s.
    period: f64,
    /// Steps from the beginning of the polynomials, and their length in steps.
    step: u32,
    length: u32,
    /// One over that length.
    part: f64,
    /// Steps since their end.
    late: u32,
    bounds: [Bounds; J],
    to: [SetPoint; J],
    /// The ways to there.
    ways: [PathPart; J],
    gaps: [Option<Gap>; J],
    /// There is a gap.
    rejoining: bool,
}

/// A cubic polynomial of the part of the way in time, and its derivatives to time: what does not
/// change from step to step is computed once.
#[derive(Clone, Copy, Debug)]
struct PathPart {
    position: [f64; 4],
    velocity: [f64; 3],
    acceleration: [f64; 2],
}

/// The difference between a joint and the motion of the ticks.
#[derive(Clone, Debug)]
struct Gap {
    way: Segments,
    /// Time on it, s.
    at: f64,
}

impl<const J: usize> Interpolator<J> {
    /// Makes an interpolator whose joints rest at `positions` (rad).
    ///
    /// * `substeps`: the number of servo periods in one tick of the master.
    /// * `tick_s`: the length of one tick of the master, s.
    /// * `bounds`: the bounds of braking, and of the motion that is added to rejoin. So a joint
    ///   moves at most at the sum of these bounds and of the rates of the master's motion.
    ///
    /// # Errors
    /// [`NumberError`] if there are no substeps, bounds are not above zero, or a number is not
    /// finite.
    pub fn new(
        substeps: u16,
        tick_s: f64,
        positions: [f64; J],
        bounds: [Bounds; J],
    ) -> Result<Self, NumberError> {
        positive("the number of servo periods in a tick", f64::from(substeps))?;
        positive("the duration of a tick, s,", tick_s)?;
        for (joint, (&position, bounds)) in positions.iter().zip(&bounds).enumerate() {
            check_start(joint, position)?;
            let jerk = bounds.jerk.unwrap_or(1.0);
            check_rates(bounds.velocity, bounds.acceleration, jerk)
                .map_err(|error| error.at(Subject::Joint(joint as u16)))?;
        }
        let substeps = u32::from(substeps);
        let to = positions.map(SetPoint::rest);
        Ok(Self {
            substeps,
            period: tick_s / f64::from(substeps),
            step: substeps,
            length: substeps,
            part: 1.0 / f64::from(substeps),
            late: 0,
            bounds,
            to,
            ways: to.map(|point| PathPart::rest(point.position)),
            gaps: [const { None }; J],
            rejoining: false,
        })
    }

    /// Takes the set-points of one tick of the master: the positions and velocities that the joints
    /// must have one tick from now. If the tick before is not over yet, they are for one tick after
    /// its end. Accelerations are not used.
    ///
    /// # Errors
    /// [`NumberError`] for the first set-point that is not finite or too far away; all set-points
    /// are ignored then.
    pub fn tick(&mut self, points: &[SetPoint; J]) -> Result<(), NumberError> {
        let early = self.length - self.step;
        // After a burst of ticks only the newest says where to be.
        if self.late > 0 || early > self.substeps {
            return self.begin_anew(points);
        }
        let length = early + self.substeps;
        let duration = self.seconds(length);
        let (mut ways, from) = (self.ways, self.base());
        for (joint, (way, (from, point))) in
            ways.iter_mut().zip(from.iter().zip(points)).enumerate()
        {
            *way = PathPart::between(from, point, duration)
                .map_err(|error| refused(joint, point, error))?;
        }
        self.ways = ways;
        self.set_out(points, length);
        Ok(())
    }

    /// Follows the line through the next points from now on, and closes what is between.
    #[cold]
    fn begin_anew(&mut self, points: &[SetPoint; J]) -> Result<(), NumberError> {
        let tick = self.seconds(self.substeps);
        let lines = points.each_ref().map(|point| SetPoint {
            position: point.position - point.velocity * tick,
            velocity: point.velocity,
            acceleration: 0.0,
        });
        let duration = self.seconds(self.substeps);
        let (mut gaps, mut ways) = (self.gaps.clone(), self.ways);
        let states = self.set_points();
        let moves = gaps.iter_mut().zip(&mut ways);
        let ends = states.iter().zip(&lines).zip(points).zip(&self.bounds);
        for (joint, ((gap, way), (((now, line), point), bounds))) in moves.zip(ends).enumerate() {
            let refused = |error| refused(joint, point, error);
            *gap = Some(Gap::between(now, line, bounds).map_err(refused)?);
            *way = PathPart::between(line, point, duration).map_err(refused)?;
        }
        self.ways = ways;
        self.gaps = gaps;
        self.rejoining = true;
        self.set_out(points, self.substeps);
        Ok(())
    }

    fn set_out(&mut self, points: &[SetPoint; J], length: u32) {
        self.to = *points;
        self.step = 0;
        self.length = length;
        self.part = 1.0 / f64::from(length);
        self.late = 0;
    }

    /// Makes one joint leave its present set-points and begin at the state `now`, for example
    /// because it did not follow before. From there it joins the motion of the ticks within the
    /// bounds of rejoining.
    ///
    /// # Errors
    /// [`NumberError`] if the state is not finite or too far away; the joint stays where it is
    /// then.
    pub fn join(&mut self, joint: usize, now: &SetPoint) -> Result<(), NumberError> {
        let base = self.base();
        let (Some(onto), Some(bounds), Some(gap)) = (
            base.get(joint),
            self.bounds.get(joint),
            self.gaps.get_mut(joint),
        ) else {
            return Ok(());
        };
        let bridge = Gap::between(now, onto, bounds).map_err(|error| refused(joint, now, error))?;
        *gap = Some(bridge);
        self.rejoining = true;
        Ok(())
    }

    /// Advances by one servo period, and returns the new set-points of all joints.
    #[inline]
    pub fn step(&mut self) -> [SetPoint; J] {
        self.advance(1);
        self.set_points()
    }

    /// Goes on by so many servo periods.
    #[inline]
    pub(crate) fn advance(&mut self, periods: u32) {
        let left = self.length - self.step;
        self.step += periods.min(left);
        self.late = self.late.saturating_add(periods.saturating_sub(left));
        if self.rejoining {
            self.go_on_in_gaps(self.seconds(periods));
        }
    }

    #[cold]
    fn go_on_in_gaps(&mut self, seconds: f64) {
        for gap in &mut self.gaps {
            if let Some(Gap { way, at }) = gap {
                *at += seconds;
                if !(*at < way.duration()) {
                    *gap = None;
                }
            }
        }
        self.rejoining = self.gaps.iter().any(Option::is_some);
    }

    /// Returns the set-points of the present servo period.
    #[inline]
    #[must_use]
    pub fn set_points(&self) -> [SetPoint; J] {
        let mut points = self.base();
        if self.rejoining {
            self.add_gaps(&mut points);
        }
        points
    }

    /// Adds what is left of gaps to the motion of the ticks.
    #[cold]
    fn add_gaps(&self, points: &mut [SetPoint; J]) {
        for (point, gap) in points.iter_mut().zip(&self.gaps) {
            if let Some(Gap { way, at }) = gap {
                let gap = way.at(*at);
                point.position += gap.position;
                point.velocity += gap.velocity;
                point.acceleration += gap.acceleration;
            }
        }
    }

    fn seconds(&self, steps: u32) -> f64 {
        f64::from(steps) * self.period
    }

    /// The motion of the ticks.
    #[inline(always)]
    fn base(&self) -> [SetPoint; J] {
        if self.late > 0 {
            return self.without_ticks();
        }
        if self.step == self.length {
            return self.to;
        }
        let s = f64::from(self.step) * self.part;
        self.ways.each_ref().map(|way| way.at(s))
    }

    /// The set-points after the last tick: the velocity is held for a while, and braked then.
    fn without_ticks(&self) -> [SetPoint; J] {
        let held = self.late.min(self.substeps);
        let (holding, braking) = (self.seconds(held), self.seconds(self.late - held));
        let mut points = self.to;
        for (point, bounds) in points.iter_mut().zip(&self.bounds) {
            *point = braked(point, bounds, holding, braking);
        }
        points
    }
}

/// The set-point after its velocity was held for `holding` and then braked for `braking`, in seconds.
fn braked(
    &SetPoint {
        position, velocity, ..
    }: &SetPoint,
    bounds: &Bounds,
    holding: f64,
    braking: f64,
) -> SetPoint {
    let position = position + velocity * holding;
    let deceleration = if velocity > 0.0 {
        bounds.acceleration
    } else {
        -bounds.acceleration
    };
    let over = abs(velocity / deceleration);
    let t = min(braking, over);
    let stands = !(braking < over);
    let moves = braking > 0.0 && !stands;
    SetPoint {
        position: position + (velocity - deceleration * t * 0.5) * t,
        velocity: if stands {
            0.0
        } else {
            velocity - deceleration * t
        },
        acceleration: if moves { -deceleration } else { 0.0 },
    }
}

/// The number of a set-point with which a joint cannot follow it: its own if one is not finite, else that of the
/// way to it.
#[cold]
fn refused(joint: usize, point: &SetPoint, way: NumberError) -> NumberError {
    let own = finite("the position, rad,", point.position)
        .and_then(|()| finite("the velocity, rad/s,", point.velocity));
    own.err().unwrap_or(way).at(Subject::Joint(joint as u16))
}

impl PathPart {
    fn rest(position: f64) -> Self {
        Self {
            position: [position, 0.0, 0.0, 0.0],
            velocity: [0.0; 3],
            acceleration: [0.0; 2],
        }
    }

    /// The cubic Hermite polynomial between two states, in a duration in s.
    #[inline(always)]
    fn between(from: &SetPoint, to: &SetPoint, duration: f64) -> Result<Self, NumberError> {
        let [c0, c1, c2, c3] = Polynomial::cubic(from, to, duration)?.cubic_coefficients();
        let hz = 1.0 / duration;
        let (d2, d3) = (c2 + c2, 3.0 * c3);
        Ok(Self {
            position: [c0, c1, c2, c3],
            velocity: [c1 * hz, d2 * hz, d3 * hz],
            acceleration: [d2 * hz * hz, (d3 + d3) * hz * hz],
        })
    }

    /// The state where this part of the time is over.
    #[inline(always)]
    fn at(&self, s: f64) -> SetPoint {
        let [c0, c1, c2, c3] = self.position;
        let [v0, v1, v2] = self.velocity;
        let [a0, a1] = self.acceleration;
        SetPoint {
            position: ((c3 * s + c2) * s + c1) * s + c0,
            velocity: (v2 * s + v1) * s + v0,
            acceleration: a1 * s + a0,
        }
    }
}

impl Gap {
    /// Closes what is between two states.
    fn between(now: &SetPoint, onto: &SetPoint, bounds: &Bounds) -> Result<Self, NumberError> {
        let gap = SetPoint {
            position: now.position - onto.position,
            velocity: now.velocity - onto.velocity,
            acceleration: 0.0,
        };
        Ok(Self {
            way: Segments::fastest(&gap, 0.0, bounds)?,
            at: 0.0,
        })
    }
}
