use core::fmt;

use heapless::Vec;
use nalgebra::Vector3;

use super::axis::AxisServo;
use crate::Subject;
use crate::config::{Axis, AxisNumber, Hand};
use crate::decimal::Decimal;
use crate::fault::sensor::Run;
use crate::math::{is_finite, max, min, round};
use crate::number::{NumberError, Requirement, check, positive};
use crate::trajectory::{
    Generator, MotionError, MotionEvent, MotionTicket, Observations, Pace, Primitive, Profile,
    ProfileLimits, SetPoint, Target,
};

/// The greatest number of axes that a table can have.
pub const AXES: usize = 3;

/// The number of motions of the table that can wait.
const QUEUE: usize = 8;

/// The controller of a configured table: it moves the axes, and returns the acceleration of the
/// palm, which the controllers of the fingers need.
///
/// Call [`tick`](Self::tick) in every tick of the table's loop. [`start`](Self::start) makes the
/// table go home from its present position. After that it takes motions, which are [`Primitive`]s
/// with positions in m. Set-points stay within the limits of the axes. Where a guard of a motion
/// names a torque, the controller compares the force of the axis (N) with it.
#[derive(Clone, Debug)]
pub struct TableController {
    axes: Vec<DrivenAxis, AXES>,
    generator: Generator<AXES, QUEUE>,
    state: TableState,
    homing: Option<MotionTicket>,
    sensor_samples: u16,
    /// The longest time between two ticks that is in time, s; how many deadlines in a row are too
    /// many, and how many were missed.
    longest_s: f64,
    deadlines: u16,
    missed: Run,
    force: [f64; AXES],
    /// The ticks over which a change of gains is spread.
    transition: u32,
}

/// One axis that there is.
#[derive(Clone, Debug)]
struct DrivenAxis {
    servo: AxisServo,
    /// The positions that its converter can read, m.
    range: (f64, f64),
    /// The number of readings in a row that were not finite or out of its range.
    bad: u16,
}

/// The state of a [`TableController`]: off, on the way home, ready for motions, or failed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum TableState {
    /// The drives of the table are off.
    Off,
    /// The table begins to go home in the next tick, at this fraction of its limits of velocity.
    Starting {
        /// The fraction, above 0 and at most 1.
        speed: f64,
    },
    /// The table is on its way home.
    Homing,
    /// The table was stopped on its way home, and stays where it is.
    Stopped,
    /// The table has been home, and takes motions.
    Ready,
    /// The ticks of the table were late for too long; its drives are off until [`TableController::clear`].
    Late,
    /// A sensor of the table has failed; its drives are off until [`TableController::clear`].
    Failed {
        /// The axis, from 0.
        axis: usize,
    },
}

impl TableState {
    /// Returns true if the drives are off until [`TableController::clear`].
    const fn is_failure(self) -> bool {
        matches!(self, Self::Failed { .. } | Self::Late)
    }
}

impl fmt::Display for TableState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Starting { speed } => {
                write!(f, "to go home at {} of its limits", Decimal(*speed))
            }
            Self::Homing => f.write_str("on its way home"),
            Self::Stopped => f.write_str("stopped on its way home"),
            Self::Ready => f.write_str("ready"),
            Self::Failed { axis } => write!(f, "failed: axis {axis}"),
            Self::Late => f.write_str("stopped: its ticks were late"),
        }
    }
}

/// A number of ticks.
#[allow(
    clippy::cast_sign_loss,
    clippy::cast_possible_truncation,
    reason = "not below 0, and what is too large is the most"
)]
fn ticks(count: f64) -> u32 {
    round(count) as u32
}

/// The result of one tick of a [`TableController`]: the forces for the drives, and the acceleration
/// of the palm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableTick {
    /// The forces of the drives, N; elements without an axis are zero.
    pub force: [f64; AXES],
    /// The set-points of the axes, m.
    pub target: [SetPoint; AXES],
    /// The desired acceleration of the palm, in its own axes, m/s². Fingers are controlled in
    /// gravity less this.
    pub acceleration: Vector3<f64>,
    /// The state of the table.
    pub state: TableState,
}

impl TableController {
    /// Makes the controller of the table of a hand, with its drives off. Returns `None` if the hand has no table.
    ///
    /// # Errors
    /// [`NumberError`] for settings that [`Hand::check`] would have refused.
    pub fn new<const F: usize, const N: usize, const A: usize>(
        hand: &Hand<F, N, A>,
    ) -> Result<Option<Self>, NumberError> {
        let Some(table) = &hand.table else {
            return Ok(None);
        };
        let rate = |axis: &Axis| {
            let processor = hand.processor(axis.processor);
            processor.map_or(hand.servo_hz, |processor| hand.rate_hz(processor))
        };
        let first_hz = table.axes.first().map_or(hand.servo_hz, rate);
        let sample_hz = f64::from(first_hz);
        // Without an axis, nothing is moved.
        let mut limits = [ProfileLimits {
            low: -1.0,
            high: 1.0,
            velocity: 1.0,
            acceleration: 1.0,
            jerk: 1.0,
        }; AXES];
        let mut homes = [0.0; AXES];
        let mut axes = Vec::new();
        let places = limits.iter_mut().zip(&mut homes);
        for (axis, (entry, (limits, home))) in table.axes.iter().zip(places).enumerate() {
            let of_axis = |error: NumberError| error.at(Subject::Axis(axis as u16));
            let as_first = Requirement::Equal(sample_hz);
            let what = "the rate of its loop, as that of the first axis, Hz,";
            check(what, f64::from(rate(entry)), as_first).map_err(of_axis)?;
            let servo = AxisServo::new(entry, sample_hz).map_err(of_axis)?;
            // None is configured: all acceleration may come within a tick.
            let jerk = entry.limits.acceleration * sample_hz;
            *limits = entry.limits.with_jerk(jerk);
            *home = entry.home;
            let ends = [entry.adc.value(0), entry.adc.value(entry.adc.full_scale())];
            // There is room for as many as a configuration has.
            let _ = axes.push(DrivenAxis {
                servo,
                range: (min(ends[0], ends[1]), max(ends[0], ends[1])),
                bad: 0,
            });
        }
        Ok(Some(Self {
            axes,
            generator: Generator::new(limits, homes, 1.0 / sample_hz)?,
            state: TableState::Off,
            homing: None,
            sensor_samples: hand.faults.sensor_samples,
            longest_s: 1.5 / sample_hz,
            deadlines: hand.faults.missed_deadlines,
            missed: Run::default(),
            force: [0.0; AXES],
            transition: ticks(hand.transition_s * sample_hz),
        }))
    }

    /// Returns the present state of the table, such as off, on the way home or ready.
    #[must_use]
    pub fn state(&self) -> TableState {
        self.state
    }

    /// Returns the value of a number of an axis's servo; `None` for an axis that the table does not have.
    #[must_use]
    pub fn number(&self, axis: usize, number: AxisNumber) -> Option<f64> {
        Some(self.axes.get(axis)?.servo.number(number))
    }

    /// Changes a number of the servo of an axis, which [`Hand::transition_s`] brings about. Take it from its
    /// [range](AxisNumber::range). Nothing happens if the table does not have the axis.
    ///
    /// # Errors
    /// [`NumberError`] if no servo can have the number; it keeps its own then.
    pub fn set_number(
        &mut self,
        axis: usize,
        number: AxisNumber,
        value: f64,
    ) -> Result<(), NumberError> {
        let ticks = self.transition;
        self.axes
            .get_mut(axis)
            .map_or(Ok(()), |axis| axis.servo.set_number(number, value, ticks))
    }

    /// Switches the drives on and moves all axes to their home positions, beginning in the next
    /// tick. Motions that run or wait are dropped. When the table has arrived, its state is
    /// [`TableState::Ready`].
    ///
    /// `speed` is the fraction of the axes' limits of velocity at which they move, above 0 and at
    /// most 1.
    ///
    /// # Errors
    /// [`MotionError::Number`] if the speed is not above 0 and at most 1; [`MotionError::NotReady`] if the table
    /// has failed.
    pub fn start(&mut self, speed: f64) -> Result<(), MotionError> {
        let what = "the speed of the way home, as a fraction of the limits,";
        positive(what, speed)?;
        check(what, speed, Requirement::AtMost(1.0))?;
        match self.state {
            TableState::Failed { .. } | TableState::Late => Err(MotionError::NotReady),
            TableState::Stopped | TableState::Ready | TableState::Homing => {
                self.generator.abort();
                self.go_home(speed);
                Ok(())
            }
            TableState::Off | TableState::Starting { .. } => {
                self.state = TableState::Starting { speed };
                Ok(())
            }
        }
    }

    /// Adds a motion at the end of the queue. Returns the ticket by which progress and events name
    /// the motion.
    ///
    /// # Errors
    /// [`MotionError::NotReady`] if the table has not been home; [`MotionError::Mask`] if the motion moves an axis
    /// that does not exist; otherwise the errors of [`Generator::enqueue`].
    pub fn enqueue(&mut self, motion: Primitive<AXES>) -> Result<MotionTicket, MotionError> {
        if self.state != TableState::Ready {
            return Err(MotionError::NotReady);
        }
        let joints = self.axes.len();
        if motion.mask >> joints != 0 {
            let mask = motion.mask;
            return Err(MotionError::Mask { mask, joints });
        }
        self.generator.enqueue(motion)
    }

    /// Slows the axes down to a stop on their paths, and drops all motions, also those that wait.
    pub fn stop(&mut self) {
        self.generator.abort();
        if matches!(self.state, TableState::Starting { .. }) {
            self.state = TableState::Off;
        }
    }

    /// Slows the axes down to a stop on their paths. Motions stay in the queue, and continue after
    /// [`resume`](Self::resume).
    pub fn pause(&mut self) {
        self.generator.pause();
    }

    /// Continues the motions after a [`pause`](Self::pause).
    pub fn resume(&mut self) {
        self.generator.resume();
    }

    /// Switches the drives of the table off, from the next tick on. A table that has failed stays
    /// in that state.
    pub fn disable(&mut self) {
        if !self.state.is_failure() {
            self.state = TableState::Off;
        }
    }

    /// Clears the state [`Failed`](TableState::Failed) or [`Late`](TableState::Late), so that
    /// [`start`](Self::start) is possible again. The drives stay off.
    pub fn clear(&mut self) {
        if self.state.is_failure() {
            self.state = TableState::Off;
        }
    }

    /// Returns the generator that runs the motions of the table, for example to read the progress
    /// of one.
    #[must_use]
    pub fn trajectory(&self) -> &Generator<AXES, QUEUE> {
        &self.generator
    }

    /// Returns the oldest event of a motion that was not returned yet, and removes it; `None` if
    /// there is none. The way home is such a motion, too.
    pub fn take_event(&mut self) -> Option<MotionEvent> {
        self.generator.take_event()
    }

    /// Runs one tick of the table's loop, and returns the forces for the drives. `positions` are
    /// the measured positions of the axes, m; elements without an axis are ignored. `period_s` is
    /// the time since the last tick in seconds, or one period for the first tick.
    pub fn tick(&mut self, positions: &[f64; AXES], period_s: f64) -> TableTick {
        let is_late = (self.missed).misses(self.deadlines, period_s, self.longest_s);
        if is_late && self.is_driven() {
            self.state = TableState::Late;
        }
        self.sense(positions);
        if let TableState::Starting { speed } = self.state {
            self.take_over(speed, positions, period_s);
        }
        let driven = self.is_driven();
        let mut force = [0.0; AXES];
        let mut acceleration = Vector3::zeros();
        let target = if driven {
            let seen = Observations {
                torques: self.force,
                ..Observations::none()
            };
            let target = self.generator.tick(&seen);
            self.look_home();
            for (((axis, point), &position), force) in self
                .axes
                .iter_mut()
                .zip(&target)
                .zip(positions)
                .zip(&mut force)
            {
                *force = axis.servo.update(point, position, period_s);
                acceleration += Vector3::from(axis.servo.axis.direction) * point.acceleration;
            }
            target
        } else {
            let mut target = [SetPoint::default(); AXES];
            for ((axis, &position), point) in self.axes.iter_mut().zip(positions).zip(&mut target) {
                axis.servo.watch(position, period_s);
                *point = SetPoint::rest(axis.servo.position());
            }
            target
        };
        self.force = force;
        TableTick {
            force,
            target,
            acceleration,
            state: self.state,
        }
    }

    /// Returns true if the drives hold or move the table.
    fn is_driven(&self) -> bool {
        matches!(
            self.state,
            TableState::Homing | TableState::Stopped | TableState::Ready
        )
    }

    /// Counts what no sensor can say, and gives up after too much of it.
    fn sense(&mut self, positions: &[f64; AXES]) {
        for (number, (axis, &position)) in self.axes.iter_mut().zip(positions).enumerate() {
            let (low, high) = axis.range;
            let good = is_finite(position) && low <= position && position <= high;
            axis.bad = if good { 0 } else { axis.bad.saturating_add(1) };
            if axis.bad >= self.sensor_samples {
                self.state = TableState::Failed { axis: number };
            }
        }
    }

    /// Rests where the axes are, and goes home from there.
    fn take_over(&mut self, speed: f64, positions: &[f64; AXES], period_s: f64) {
        let mut start = [0.0; AXES];
        for ((axis, &position), start) in self.axes.iter_mut().zip(positions).zip(&mut start) {
            axis.servo.watch(position, period_s);
            axis.servo.reset();
            *start = axis.servo.position();
        }
        // All of them are finite.
        if self.generator.reset(start).is_ok() {
            self.go_home(speed);
        }
    }

    fn go_home(&mut self, speed: f64) {
        let mut home = Primitive::new(Pace::Speed(speed), Profile::MinimumJerk);
        for (number, axis) in self.axes.iter().enumerate() {
            if let Ok(more) = home
                .clone()
                .with(number, Target::Absolute(axis.servo.axis.home))
            {
                home = more;
            }
        }
        self.generator.resume();
        self.homing = self.generator.enqueue(home).ok();
        self.state = match self.homing {
            Some(_) => TableState::Homing,
            None => TableState::Stopped,
        };
    }

    /// Ends the way home if it is over: the table is ready if it is at home, and stopped elsewhere.
    fn look_home(&mut self) {
        let Some(homing) = self.homing else { return };
        if self.generator.progress(homing).is_some() {
            return;
        }
        self.homing = None;
        let points = self.generator.set_points();
        let mut points = self.axes.iter().zip(&points);
        let arrived = points.all(|(axis, point)| *point == SetPoint::rest(axis.servo.axis.home));
        self.state = if arrived {
            TableState::Ready
        } else {
            TableState::Stopped
        };
    }
}
