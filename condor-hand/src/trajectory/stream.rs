use heapless::Deque;
use thiserror::Error;

use super::{Polynomial, ProfileLimits, SetPoint, check_start};
use crate::decimal::Decimal;
use crate::math::{abs, clamp};
use crate::number::{NumberError, Requirement, check_motion, positive, tolerance};

/// A point of a [`JointStream`]: the positions and velocities that the joints must have at a time.
/// Values of joints that are not in the mask of the stream are ignored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamPoint<const J: usize> {
    /// The time since the start of the stream, s.
    pub time: f64,
    /// The positions, rad.
    pub positions: [f64; J],
    /// The velocities, rad/s.
    pub velocities: [f64; J],
}

/// The way in which a stream has ended. Its joints are at rest then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StreamEnd {
    /// The joints have come to the last point.
    Done,
    /// The next point had not come when the last one was reached, or the first one not in time.
    Starved,
    /// The stream was aborted.
    Aborted,
}

/// The reason why points are refused; joints are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Error, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum JointStreamError {
    /// There is no room for the points.
    #[error("the stream has points until {} s, and no room for more", Decimal(*.until))]
    Full {
        /// The time of the last point that it has, s.
        until: f64,
    },
    /// The stream has ended, or brakes, or has its last point.
    #[error("the stream takes no more points: it has ended, is braking, or has its last point")]
    Ended,
    /// A batch before this one has not come.
    #[error("batch {found} has come, but batch {expected} must come first")]
    Sequence {
        /// The number of the batch.
        found: u32,
        /// The number of the next batch that the stream takes.
        expected: u32,
    },
    /// A point is before the one that must come before it.
    #[error(
        "a point at {} s is not after the point before it, or the start, at {} s",
        Decimal(*.time),
        Decimal(*.after)
    )]
    Time {
        /// The time of the point, s.
        time: f64,
        /// The time of the point before it, s.
        after: f64,
    },
    /// A joint would leave one of its limits, at a point, on the way to it, or if it brakes there.
    #[error(
        "joint {joint} at {time} s: {quantity} is {value}; it must be {must}",
        time = Decimal(*.time),
        quantity = .quantity.name(),
        value = Decimal(*.value),
    )]
    Joint {
        /// The joint that would leave a limit.
        joint: usize,
        /// The time of the point, s.
        time: f64,
        /// The quantity that would be out of its limits.
        quantity: StreamQuantity,
        /// The value of the quantity, in its unit.
        value: f64,
        /// The requirement that the value does not meet.
        must: Requirement,
    },
}

/// The quantity of a joint for which a [`JointStream`] refuses a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum StreamQuantity {
    /// The position at a point, rad.
    Position,
    /// The speed at a point, rad/s.
    Speed,
    /// The position at which the joint would rest if it braked from a point, rad.
    PositionAfterBraking,
    /// The time from the point before, s.
    Duration,
    /// The least position on the way to a point, rad.
    LeastPosition,
    /// The greatest position on the way to a point, rad.
    GreatestPosition,
    /// The greatest speed on the way to a point, rad/s.
    SpeedOnTheWay,
    /// The greatest acceleration on the way to a point, rad/s².
    Acceleration,
    /// The speed at the last point of the stream, rad/s.
    SpeedAtEnd,
    /// The position at the time of the point before, which must be the same, rad.
    RepeatedPosition,
    /// The velocity at the time of the point before, which must be the same, rad/s.
    RepeatedVelocity,
}

impl StreamQuantity {
    /// Returns the name of the quantity with its unit, as errors have it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Position => "the position, rad,",
            Self::Speed => "the speed, rad/s,",
            Self::PositionAfterBraking => "the position after braking, rad,",
            Self::Duration => "the time from the point before, s,",
            Self::LeastPosition => "the least position on the way, rad,",
            Self::GreatestPosition => "the greatest position on the way, rad,",
            Self::SpeedOnTheWay => "the speed on the way, rad/s,",
            Self::Acceleration => "the acceleration, rad/s²,",
            Self::SpeedAtEnd => "the speed at the end, rad/s,",
            Self::RepeatedPosition => "the position at the time of the point before, rad,",
            Self::RepeatedVelocity => "the velocity at the time of the point before, rad/s,",
        }
    }
}

/// The joints brake, each as fast as it can.
#[derive(Clone, Copy, Debug)]
struct Brake<const J: usize> {
    /// Since this time of the stream, s.
    since: f64,
    from: [SetPoint; J],
    end: StreamEnd,
}

/// A stream of points with timestamps that come while the joints move, from which it computes the set-points of some of
/// J joints.
///
/// Points come in numbered batches; the stream has room for up to N points that are ahead of its time. Its time begins
/// with the first batch, from rest. Between two points each joint moves along the cubic polynomial with their positions
/// and velocities. A batch is refused as a whole if a joint would leave its limits of position, velocity or
/// acceleration on the way to one of its points, or if it could not brake to rest there within them. A point at the
/// time of the one before it, or at 0 s, must agree with that one, or with where the joints are, and changes nothing.
///
/// When the next point has not come by the time of the last one, each joint brakes from there as fast as its limit
/// permits, and the stream ends with [`StreamEnd::Starved`]. So the set-points of every tick are within the limits, and
/// positions and velocities are continuous, whatever comes and whenever.
///
/// ```
/// use condor_hand::trajectory::{ProfileLimits, JointStream, StreamPoint};
///
/// let limits = ProfileLimits { low: -1.0, high: 1.0, velocity: 2.0, acceleration: 20.0, jerk: 1e4 };
/// let mut stream = JointStream::<1, 8>::new(0b1, [limits], [0.0], 0.02, 50)?;
/// let point = StreamPoint { time: 0.2, positions: [0.05], velocities: [0.0] };
/// stream.push(0, &[point], true)?; // the first batch, and the last point
/// while stream.end().is_none() {
///     let [joint] = stream.tick();
///     println!("{:.3} rad", joint.position);
/// }
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct JointStream<const J: usize, const N: usize> {
    mask: u32,
    limits: [ProfileLimits; J],
    tick: f64,
    /// The point that was passed last.
    former: StreamPoint<J>,
    points: Deque<StreamPoint<J>, N>,
    /// The number of the next batch.
    next: u32,
    /// Whether the last point has come.
    is_complete: bool,
    /// Ticks since the first batch.
    ticks: u32,
    /// Ticks for which it waits for the first batch.
    patience: u32,
    state: [SetPoint; J],
    brake: Option<Brake<J>>,
    end: Option<StreamEnd>,
}

impl<const J: usize, const N: usize> JointStream<J, N> {
    /// Makes a stream that moves the joints in `mask` (bit *i* is joint *i*).
    ///
    /// * `limits`: the limits of each joint.
    /// * `positions`: the positions at which the joints rest now, rad.
    /// * `tick_s`: the time between two calls of [`tick`](Self::tick), s.
    /// * `patience`: the number of ticks for which the stream waits for the first batch.
    ///
    /// # Errors
    /// [`NumberError`] if a limit is wrong, or a number is not finite.
    pub fn new(
        mask: u32,
        limits: [ProfileLimits; J],
        positions: [f64; J],
        tick_s: f64,
        patience: u32,
    ) -> Result<Self, NumberError> {
        const { assert!(J > 0 && J <= 32, "a mask has 32 bits") };
        positive("the duration of a tick, s,", tick_s)?;
        for (joint, (limits, &position)) in limits.iter().zip(&positions).enumerate() {
            limits.validate(joint)?;
            check_start(joint, position)?;
        }
        Ok(Self {
            mask,
            limits,
            tick: tick_s,
            former: StreamPoint {
                time: 0.0,
                positions,
                velocities: [0.0; J],
            },
            points: Deque::new(),
            next: 0,
            is_complete: false,
            ticks: 0,
            patience,
            state: positions.map(SetPoint::rest),
            brake: None,
            end: None,
        })
    }

    /// Adds the points of batch number `sequence`; batches are counted from 0. If `is_last` is
    /// true, the stream ends with this batch, and its joints must rest at the last point.
    ///
    /// A batch that was added before changes nothing. After an error nothing is changed, either.
    ///
    /// # Errors
    /// [`JointStreamError`]. Send the same again after [`JointStreamError::Full`].
    pub fn push(
        &mut self,
        sequence: u32,
        points: &[StreamPoint<J>],
        is_last: bool,
    ) -> Result<(), JointStreamError> {
        if sequence < self.next {
            return Ok(());
        }
        if self.is_complete || self.brake.is_some() || self.end.is_some() {
            return Err(JointStreamError::Ended);
        }
        if sequence > self.next {
            let expected = self.next;
            let found = sequence;
            return Err(JointStreamError::Sequence { found, expected });
        }
        let (mut former, mut count) = (self.last(), 0_usize);
        for point in points {
            if self.repeats(former, point) {
                self.check_repeated(former, point)?;
            } else {
                self.check(former, point)?;
                former = point;
                count = count.saturating_add(1);
            }
        }
        if count > N - self.points.len() {
            let until = self.until();
            return Err(JointStreamError::Full { until });
        }
        if is_last {
            let time = former.time;
            let rest = Requirement::AtMost(0.0);
            for (joint, limits) in self.limits.iter().enumerate() {
                if self.moves(joint) {
                    let speed = abs(former.at(joint).velocity);
                    check_quantity(StreamQuantity::SpeedAtEnd, speed, rest, limits.velocity)
                        .map_err(|excess| excess.of(joint, time))?;
                }
            }
        }
        for &point in points {
            if !self.repeats(self.last(), &point) {
                // There is room.
                let _ = self.points.push_back(point);
            }
        }
        self.is_complete = is_last;
        self.next = self.next.saturating_add(1);
        Ok(())
    }

    /// Stops all joints as fast as their limits permit; after that the stream ends with [`StreamEnd::Aborted`]. A
    /// stream that brakes already, or has ended, does not change.
    pub fn abort(&mut self) {
        if self.brake.is_none() && self.end.is_none() {
            self.brake = Some(Brake {
                since: self.time(),
                from: self.state,
                end: StreamEnd::Aborted,
            });
        }
    }

    /// Runs one tick, and returns the new set-points of all joints. Joints that are not in the mask
    /// keep their positions.
    pub fn tick(&mut self) -> [SetPoint; J] {
        if self.end.is_some() {
            return self.state;
        }
        if self.next == 0 && self.brake.is_none() {
            self.patience = self.patience.saturating_sub(1);
            if self.patience == 0 {
                self.end = Some(StreamEnd::Starved);
            }
            return self.state;
        }
        self.ticks = self.ticks.saturating_add(1);
        let now = self.time();
        while self.brake.is_none()
            && let Some(point) = self.points.front()
            && point.time <= now
        {
            self.former = *point;
            self.points.pop_front();
        }
        if self.brake.is_none() && self.points.is_empty() {
            let mut places = self.former.positions.iter().zip(&self.former.velocities);
            let mut from = self.state;
            for place in &mut from {
                if let Some((&position, &velocity)) = places.next() {
                    *place = SetPoint {
                        position,
                        velocity,
                        acceleration: 0.0,
                    };
                }
            }
            self.brake = Some(Brake {
                since: self.former.time,
                from,
                end: if self.is_complete {
                    StreamEnd::Done
                } else {
                    StreamEnd::Starved
                },
            });
        }
        match self.brake {
            Some(brake) => self.slow(&brake, now),
            None => self.follow(now),
        }
        self.state
    }

    /// Returns true if the stream brakes or has ended. It then takes no more points.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.brake.is_some() || self.end.is_some()
    }

    /// Returns the way in which the stream has ended; `None` if it has not ended yet.
    #[must_use]
    pub fn end(&self) -> Option<StreamEnd> {
        self.end
    }

    /// Returns the mask of the joints that the stream moves: bit *i* is joint *i*.
    #[must_use]
    pub fn mask(&self) -> u32 {
        self.mask
    }

    /// Returns the set-points of the last tick.
    #[must_use]
    pub fn set_points(&self) -> [SetPoint; J] {
        self.state
    }

    /// Returns the time since the stream began with its first batch, s; zero before that.
    #[must_use]
    pub fn time(&self) -> f64 {
        f64::from(self.ticks) * self.tick
    }

    /// Returns the time until which the stream has points: the time of its last point, s since the
    /// start of the stream.
    #[must_use]
    pub fn until(&self) -> f64 {
        self.last().time
    }

    /// The last point that it has.
    fn last(&self) -> &StreamPoint<J> {
        self.points.back().unwrap_or(&self.former)
    }

    /// Returns true if a point has the time of the one before it.
    fn repeats(&self, from: &StreamPoint<J>, to: &StreamPoint<J>) -> bool {
        abs(to.time - from.time) <= tolerance(self.tick)
    }

    /// Checks that a point with the time of the one before it agrees with that one.
    fn check_repeated(
        &self,
        from: &StreamPoint<J>,
        to: &StreamPoint<J>,
    ) -> Result<(), JointStreamError> {
        let time = to.time;
        for (joint, limits) in self.limits.iter().enumerate() {
            if self.moves(joint) {
                let (from, to) = (from.at(joint), to.at(joint));
                let range = limits.high - limits.low;
                agrees(
                    StreamQuantity::RepeatedPosition,
                    to.position,
                    from.position,
                    range,
                )
                .and_then(|()| {
                    let most = limits.velocity;
                    agrees(
                        StreamQuantity::RepeatedVelocity,
                        to.velocity,
                        from.velocity,
                        most,
                    )
                })
                .map_err(|excess| excess.of(joint, time))?;
            }
        }
        Ok(())
    }

    fn moves(&self, joint: usize) -> bool {
        self.mask >> joint & 1 == 1
    }

    /// Checks that all joints can go from one point to a later one, and brake there.
    fn check(&self, from: &StreamPoint<J>, to: &StreamPoint<J>) -> Result<(), JointStreamError> {
        let (time, after) = (to.time, from.time);
        if !Requirement::Above(after).holds(time) {
            return Err(JointStreamError::Time { time, after });
        }
        for (joint, limits) in self.limits.iter().enumerate() {
            if self.moves(joint) {
                check_joint(limits, &from.at(joint), &to.at(joint), to.time - from.time)
                    .map_err(|excess| excess.of(joint, time))?;
            }
        }
        Ok(())
    }

    /// The set-points between two points.
    fn follow(&mut self, now: f64) {
        let Some(to) = self.points.front() else {
            return;
        };
        let from = &self.former;
        let duration = to.time - from.time;
        for (joint, state) in self.state.iter_mut().enumerate() {
            if self.mask >> joint & 1 == 0 {
                continue;
            }
            // The polynomial was possible when the point came.
            if let Ok(path) = Polynomial::cubic(&from.at(joint), &to.at(joint), duration) {
                *state = path.at(now - from.time);
            }
        }
    }

    /// The set-points while it brakes.
    fn slow(&mut self, brake: &Brake<J>, now: f64) {
        let elapsed = now - brake.since;
        let mut rests = true;
        for (joint, (state, from)) in self.state.iter_mut().zip(&brake.from).enumerate() {
            let Some(limits) = self
                .limits
                .get(joint)
                .filter(|_| self.mask >> joint & 1 == 1)
            else {
                continue;
            };
            let stop = abs(from.velocity) / limits.acceleration;
            let time = clamp(elapsed, 0.0, stop);
            let braking = if from.velocity < 0.0 {
                limits.acceleration
            } else {
                -limits.acceleration
            };
            let velocity = from.velocity + braking * time;
            let mean = (from.velocity + velocity) * 0.5;
            let position = clamp(from.position + mean * time, limits.low, limits.high);
            *state = if elapsed >= stop {
                SetPoint::rest(position)
            } else {
                rests = false;
                SetPoint {
                    position,
                    velocity,
                    acceleration: braking,
                }
            };
        }
        if rests {
            self.end = Some(brake.end);
        }
    }
}

impl<const J: usize> StreamPoint<J> {
    fn at(&self, joint: usize) -> SetPoint {
        let of = |all: &[f64; J]| all.get(joint).copied().unwrap_or(0.0);
        SetPoint {
            position: of(&self.positions),
            velocity: of(&self.velocities),
            acceleration: 0.0,
        }
    }
}

/// A number of a joint that would be out of its limits.
struct Excess {
    quantity: StreamQuantity,
    value: f64,
    must: Requirement,
}

impl Excess {
    fn of(self, joint: usize, time: f64) -> JointStreamError {
        let Self {
            quantity,
            value,
            must,
        } = self;
        JointStreamError::Joint {
            joint,
            time,
            quantity,
            value,
            must,
        }
    }
}

/// Checks a number of a joint that moves, whose limits are about `scale` apart.
fn check_quantity(
    quantity: StreamQuantity,
    value: f64,
    must: Requirement,
    scale: f64,
) -> Result<(), Excess> {
    check_motion(quantity.name(), value, must, scale).map_err(|_| Excess {
        quantity,
        value,
        must,
    })
}

/// Checks that a joint can go from one state to the next one in a time (s), and brake there.
fn check_joint(
    limits: &ProfileLimits,
    from: &SetPoint,
    to: &SetPoint,
    duration: f64,
) -> Result<(), Excess> {
    let least = Requirement::AtLeast(limits.low);
    let most = Requirement::AtMost(limits.high);
    let fastest = Requirement::AtMost(limits.velocity);
    let hardest = Requirement::AtMost(limits.acceleration);
    let range = limits.high - limits.low;
    check_quantity(StreamQuantity::Position, to.position, least, range)?;
    check_quantity(StreamQuantity::Position, to.position, most, range)?;
    check_quantity(
        StreamQuantity::Speed,
        abs(to.velocity),
        fastest,
        limits.velocity,
    )?;
    let braking = to.velocity * abs(to.velocity) * 0.5 / limits.acceleration;
    let rest = to.position + braking;
    check_quantity(StreamQuantity::PositionAfterBraking, rest, least, range)?;
    check_quantity(StreamQuantity::PositionAfterBraking, rest, most, range)?;
    let path = Polynomial::cubic(from, to, duration).map_err(|_| Excess {
        quantity: StreamQuantity::Duration,
        value: duration,
        must: Requirement::Above(0.0),
    })?;
    let peaks = path.peaks();
    check_quantity(StreamQuantity::LeastPosition, peaks.low, least, range)?;
    check_quantity(StreamQuantity::GreatestPosition, peaks.high, most, range)?;
    check_quantity(
        StreamQuantity::SpeedOnTheWay,
        peaks.velocity,
        fastest,
        limits.velocity,
    )?;
    check_quantity(
        StreamQuantity::Acceleration,
        peaks.acceleration,
        hardest,
        limits.acceleration,
    )
}

/// Checks that a number is equal to its former value.
fn agrees(quantity: StreamQuantity, is: f64, was: f64, scale: f64) -> Result<(), Excess> {
    check_quantity(quantity, is, Requirement::AtLeast(was), scale)?;
    check_quantity(quantity, is, Requirement::AtMost(was), scale)
}
