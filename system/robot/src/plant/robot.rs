//! [`Robot`]: the simulated hand and table, with their sensors and actuators at the boards' lines.

use core::array;
use core::num::NonZeroU32;

use condor_dev::{Bus, InterruptVector};
use condor_hand::config::{Finger, InputChannel, OutputChannel, Wire};
use condor_hand::grasp::Wrench;
use condor_hand::math::abs;
use condor_hand::plant::{
    self, DriveKind, ObjectParameters, PlantModel, SimHand, SimObject, SimStop, SimSurface,
};
use nalgebra::{SVector, Vector3};

use super::TrueState;
use super::arguments::Arguments;
use super::ball::Support;
use super::requests::{NumberRange, PlantRefusal, PlantSensor};
use super::watchdog::{BoardInput, Watchdog};
use crate::boards::{BoardError, BoardEvent, SimBoards, at_rest, processor};
use crate::recording::Fnv;
use crate::{ACTUATORS, Actuators, FINGERS, Failure, JOINTS, Mechanism, RobotDescription, joints};

/// The least rate of updates of the simulation, Hz: contacts of 5e4 N/m bear it.
const UPDATE_HZ: u32 = 10_000;
/// The place in the range of its joints at which the hand begins, from 0 to 1.
const BEGINS_AT: f64 = 0.4;
/// The largest distance of a ball from the palm, m, along each axis.
pub(super) const WORKSPACE_M: f64 = 1.0;
/// The distance beyond its limits at which a joint counts as lost, rad: its stops yield by less.
const BEYOND_RAD: f64 = 0.3;
/// Sensors of the hand and its table, at most.
const INPUTS: usize = (JOINTS + 2 * ACTUATORS + 1) * FINGERS + AXES;
const AXES: usize = 3;
/// Boards of outputs, or of inputs, at most, and the outputs of one.
const BOARDS: usize = 16;
const LINES: usize = 32;

/// The physical properties of the simulated robot that the configuration of the hand does not have, such as the
/// stiffness of its stops. The number of updates per tick is 1 here; the robot replaces it by one that fits its rate.
pub const MACHINE: PlantModel = PlantModel {
    actuator: DriveKind::exact,
    joint_stop: SimStop {
        stiffness: 50.0,
        damping: 0.1,
    },
    axis_stop: SimStop {
        stiffness: 1e5,
        damping: 1e3,
    },
    updates: 1,
    tip_radius: 0.0,
    surface: SimSurface {
        stiffness: 5e4,
        damping: 20.0,
        shear_stiffness: 5e4,
        shear_damping: 20.0,
        friction: 0.8,
    },
};

/// The simulated robot: the hand, the ball, the boards and the faults that were requested.
pub(super) struct Robot {
    hand: SimHand<Mechanism, Actuators, FINGERS, JOINTS, ACTUATORS>,
    gravity: Vector3<f64>,
    period_s: f64,
    ticks: u64,
    /// The hash of all positions so far.
    hash: Fnv,
    boards: heapless::Vec<OutputBoard, BOARDS>,
    inputs: heapless::Vec<Sensor, INPUTS>,
    /// A bit for each processor that has a wire at a board of inputs, by the numbers of boards.
    readers: [u64; BOARDS],
    period_ns: u64,
    /// The instant until which conversions have been done, ns.
    shown_ns: u64,
    /// In the axes of the palm.
    directions: [Vector3<f64>; AXES],
    cut: [[bool; ACTUATORS]; FINGERS],
    push: Wrench,
    support: Option<Support>,
    /// Failed ticks since the robot was mended, and why the last one failed.
    failures: u32,
    cause: Option<Failure>,
    /// Balls that have left the workspace; wraps.
    lost_balls: u32,
    /// The positions at which the joints begin, and the limits of their positions, rad.
    start: [SVector<f64, JOINTS>; FINGERS],
    limits: [[(f64, f64); JOINTS]; FINGERS],
}

/// A board of outputs and what is at its lines.
struct OutputBoard {
    number: u8,
    lines: heapless::Vec<Line, LINES>,
    watchdog: Watchdog<LINES>,
}

struct Line {
    wire: Wire,
    output: OutputChannel,
}

/// A sensor, and the register that shows what it says.
#[derive(Clone, Copy)]
struct Sensor {
    wire: Wire,
    adc: InputChannel,
    /// The number of its board.
    board: usize,
    /// The counts at which the sensor is stuck.
    stuck: Option<u32>,
}

impl Robot {
    pub(super) fn new<B: SimBoards>(
        hand: &RobotDescription,
        arguments: &Arguments,
    ) -> Result<Self, Failure> {
        let finger = |(entry, mechanism): (&Finger<JOINTS, ACTUATORS>, Mechanism)| {
            let limits = entry.limits();
            let q = limits.low + (limits.high - limits.low) * BEGINS_AT;
            MACHINE.finger(entry, mechanism, entry.transmission()?, q)
        };
        let absent = joints::absent();
        let entries = joints::with_mechanisms(hand, &absent);
        let mut fingers = heapless::Vec::<_, FINGERS>::new();
        for entry in entries {
            // There is one for each place.
            let _ = fingers.push(finger(entry)?);
        }
        let Ok(fingers) = fingers.into_array::<FINGERS>() else {
            return Err(Failure::NoFinger { processor: 0 });
        };
        let start = fingers.each_ref().map(|finger| *finger.q());
        let limits = entries.map(|(entry, _)| {
            let limits = entry.limits();
            array::from_fn(|joint| {
                let of = |all: &SVector<f64, JOINTS>| all.get(joint).copied().unwrap_or(0.0);
                (of(&limits.low) - BEYOND_RAD, of(&limits.high) + BEYOND_RAD)
            })
        });
        let period_s = 1.0 / f64::from(arguments.rate_hz);
        let mut parameters = MACHINE.hand_parameters(hand);
        parameters.period_s = period_s;
        parameters.updates = UPDATE_HZ.div_ceil(arguments.rate_hz).max(1);
        let mut simulated = SimHand::new(fingers, parameters)?;
        let mut directions = [Vector3::zeros(); AXES];
        if let Some(table) = &hand.table {
            simulated = simulated.with_table(MACHINE.table(table)?);
            for (direction, axis) in directions.iter_mut().zip(&table.axes) {
                *direction = Vector3::from(axis.direction);
            }
        }
        Ok(Self {
            hand: simulated,
            gravity: parameters.gravity,
            period_s,
            ticks: 0,
            hash: Fnv::new(),
            boards: output_boards::<B>(hand, arguments)?,
            inputs: sensors::<B>(hand),
            readers: readers::<B>(hand),
            period_ns: NonZeroU32::new(arguments.rate_hz)
                .map_or(1, |rate| 1_000_000_000 / rate)
                .into(),
            shown_ns: 0,
            directions,
            cut: [[false; ACTUATORS]; FINGERS],
            push: Wrench::zero(),
            support: None,
            failures: 0,
            cause: None,
            lost_balls: 0,
            start,
            limits,
        })
    }

    /// One period until `now_ns`: actuators do what the boards say, time passes, and sensors are read. `raise` gets the
    /// processors that boards interrupt.
    pub(super) fn tick<B: SimBoards, S: Bus>(
        &mut self,
        bus: &S,
        now_ns: u64,
        raise: &mut dyn FnMut(u8, InterruptVector),
    ) -> TrueState {
        let done = self.advance::<B, S>(bus);
        if let Err(cause) = done.and_then(|()| self.show::<B, S>(bus, now_ns, raise)) {
            self.failures = self.failures.saturating_add(1);
            self.cause = Some(cause);
        }
        let is_far = |ball: &SimObject| {
            let position = ball.pose().position;
            position.iter().any(|&along| abs(along) > WORKSPACE_M)
        };
        if self.hand.object().is_some_and(is_far) {
            self.lost_balls = self.lost_balls.wrapping_add(1);
            self.remove_ball();
        }
        for finger in self.hand.fingers() {
            for position in finger.q().iter().take(finger.parameters().joints.len()) {
                self.hash.add(&position.to_le_bytes());
            }
        }
        self.truth()
    }

    fn advance<B: SimBoards, S: Bus>(&mut self, bus: &S) -> Result<(), Failure> {
        let mut commands = [[0.0; ACTUATORS]; FINGERS];
        let mut force = Vector3::zeros();
        for board in &mut self.boards {
            let outputs = board.update::<B, S>(bus)?;
            for (line, output) in board.lines.iter().zip(outputs) {
                match line.wire {
                    Wire::Axis { axis } => {
                        let direction = self.directions.get(axis).copied();
                        force += direction.unwrap_or_default() * output;
                    }
                    Wire::Actuator { finger, actuator } => {
                        let commands = commands.get_mut(finger);
                        if let Some(command) = commands.and_then(|all| all.get_mut(actuator)) {
                            *command = output;
                        }
                    }
                    Wire::Position { .. } | Wire::Encoder { .. } | Wire::Touch { .. } => {}
                }
            }
        }
        for (commands, cut) in commands.iter_mut().flatten().zip(self.cut.iter().flatten()) {
            if *cut {
                *commands = 0.0;
            }
        }
        self.hand.drive_table(force)?;
        let wrench = self.on_ball();
        self.hand.push_object(wrench)?;
        self.hand.step(&commands)?;
        self.ticks = self.ticks.wrapping_add(1);
        Ok(())
    }

    /// Returns the wrench on the ball beside fingers and gravity.
    fn on_ball(&mut self) -> Wrench {
        let mut wrench = self.push;
        if let (Some(ball), Some(support)) = (self.hand.object(), &mut self.support) {
            // The support moves with the palm, and need not know the acceleration of the palm.
            let held = support.update(ball, &self.gravity, self.period_s);
            wrench.force += held.force;
            wrench.moment += held.moment;
        }
        wrench
    }

    /// Brings what the sensors say into the registers of those boards that convert before the tick that follows the one
    /// of `now_ns`.
    pub(super) fn show<B: SimBoards, S: Bus>(
        &mut self,
        bus: &S,
        now_ns: u64,
        raise: &mut dyn FnMut(u8, InterruptVector),
    ) -> Result<(), Failure> {
        let until_ns = now_ns.saturating_add(self.period_ns.saturating_sub(1));
        let mut due = [false; BOARDS];
        let used = self.readers.iter().map(|readers| *readers != 0);
        for ((board, due), is_used) in (0..).zip(&mut due).zip(used) {
            *due = is_used && B::is_due(bus, board, self.shown_ns, until_ns)?;
        }
        for sensor in &self.inputs {
            if due.get(sensor.board) == Some(&true) {
                B::set_input(bus, sensor.adc.channel(), self.counts(sensor))?;
            }
        }
        for ((board, is_due), readers) in (0..).zip(due).zip(&self.readers) {
            if is_due && let Some(vector) = B::converted(bus, board)? {
                let readers = (0..u64::BITS as u8).filter(|reader| readers >> reader & 1 != 0);
                readers.for_each(|reader| raise(reader, vector));
            }
        }
        self.shown_ns = until_ns;
        Ok(())
    }

    fn counts(&self, sensor: &Sensor) -> u32 {
        sensor
            .stuck
            .unwrap_or_else(|| sensor.adc.counts(self.value(sensor)))
    }

    /// Returns the value that a sensor measures, rad, N, N m or m.
    fn value(&self, sensor: &Sensor) -> f64 {
        let fingers = self.hand.fingers();
        let value = match sensor.wire {
            Wire::Position { finger, joint } => {
                let finger = fingers.get(finger);
                finger.and_then(|finger| finger.q().get(joint).copied())
            }
            Wire::Actuator { finger, actuator } => {
                let finger = fingers.get(finger);
                finger.and_then(|finger| finger.efforts().get(actuator).copied())
            }
            Wire::Encoder { finger, actuator } => {
                let finger = fingers.get(finger);
                finger.and_then(|finger| finger.actuator_positions().get(actuator).copied())
            }
            Wire::Touch { finger } => {
                let contacts = self.hand.object_contacts();
                contacts.get(finger).map(|contact| contact.pressing)
            }
            Wire::Axis { axis } => {
                let direction = self.directions.get(axis);
                let table = self.hand.table();
                table
                    .zip(direction)
                    .map(|(table, direction)| direction.dot(table.position()))
            }
        };
        value.unwrap_or(0.0)
    }

    fn truth(&self) -> TrueState {
        let fingers = self.hand.fingers();
        let ball = self.hand.object();
        let contacts = self.hand.object_contacts();
        let bits = |is: fn(&plant::SimContact) -> bool| {
            let contacts = contacts.iter().zip(0_u32..);
            contacts.fold(0, |bits, (contact, finger)| {
                bits | u64::from(is(contact)) << finger
            })
        };
        #[allow(clippy::cast_precision_loss, reason = "2^53 ticks are a lifetime")]
        let ticks = self.ticks as f64;
        TrueState {
            time_s: ticks * self.period_s,
            position: fingers.each_ref().map(|finger| (*finger.q()).into()),
            velocity: fingers.each_ref().map(|finger| (*finger.qd()).into()),
            effort: fingers.each_ref().map(|finger| *finger.efforts()),
            table: self
                .hand
                .table()
                .map_or([0.0; 3], |table| (*table.position()).into()),
            ball: ball.map_or([f64::NAN; 3], |ball| ball.pose().position.into()),
            orientation: ball.map_or([1.0, 0.0, 0.0, 0.0], |ball| {
                let q = ball.orientation();
                [q.w, q.i, q.j, q.k]
            }),
            touching: bits(|contact| contact.is_touching),
            sliding: bits(|contact| contact.is_sliding),
            resting: self.resting(),
            hash: self.hash.value(),
            failed: self.failures.into(),
        }
    }

    /// The ball, if there is one.
    pub(super) fn ball(&self) -> Option<&SimObject> {
        self.hand.object()
    }

    /// A bit for each D/A board whose outputs are those of its watchdog.
    pub(super) fn resting(&self) -> u64 {
        self.bits(Watchdog::is_resting)
    }

    /// A bit for each D/A board that was refreshed once, and is not any more.
    pub(super) fn tripped(&self) -> u64 {
        self.bits(Watchdog::is_tripped)
    }

    fn bits(&self, is: fn(&Watchdog<LINES>) -> bool) -> u64 {
        let boards = self.boards.iter().filter(|board| is(&board.watchdog));
        boards.fold(0, |bits, board| bits | bit(board.number))
    }

    /// Ticks in which the robot or its bus failed since it was mended.
    pub(super) const fn failures(&self) -> u32 {
        self.failures
    }

    /// Returns the reason why the last one of these ticks failed.
    pub(super) fn cause(&self) -> Option<Failure> {
        self.cause.clone()
    }

    /// Returns the number of balls that have left the workspace; it wraps.
    pub(super) const fn lost_balls(&self) -> u32 {
        self.lost_balls
    }

    pub(super) fn push_ball(&mut self, wrench: Wrench) -> Result<(), PlantRefusal> {
        if self.hand.object().is_none() {
            return Err(PlantRefusal::NoBall);
        }
        if !is_possible(&wrench) {
            return Err(PlantRefusal::Number);
        }
        self.push = wrench;
        Ok(())
    }

    pub(super) fn push_tip(&mut self, finger: usize, wrench: Wrench) -> Result<(), PlantRefusal> {
        if !is_possible(&wrench) {
            return Err(PlantRefusal::Number);
        }
        if !self.has(|wire| matches!(wire, Wire::Actuator { finger: of, .. } if of == finger)) {
            return Err(PlantRefusal::NoSuchPart);
        }
        let pushed = self.hand.push_tip(finger, wrench);
        pushed.map_err(|_| PlantRefusal::NoSuchPart)
    }

    pub(super) fn place_ball(
        &mut self,
        center: Vector3<f64>,
        radius: f64,
        mass: f64,
    ) -> Result<(), PlantRefusal> {
        let is_possible = center
            .iter()
            .all(|&along| NumberRange::PLACE.contains(along))
            && NumberRange::RADIUS.contains(radius)
            && NumberRange::MASS.contains(mass);
        if !is_possible {
            return Err(PlantRefusal::Number);
        }
        let ball = SimObject::new(ObjectParameters::ball(mass, radius), center);
        let ball = ball.map_err(|_| PlantRefusal::Number)?;
        self.hand.put_object(Some(ball));
        self.push = Wrench::zero();
        self.support = Some(Support::new(center));
        Ok(())
    }

    pub(super) fn let_go(&mut self, within_s: f64) -> Result<(), PlantRefusal> {
        if !NumberRange::LET_GO.contains(within_s) {
            return Err(PlantRefusal::Number);
        }
        let support = self.support.as_mut().ok_or(PlantRefusal::NoBall)?;
        support.let_go(within_s);
        Ok(())
    }

    pub(super) fn remove_ball(&mut self) {
        self.hand.put_object(None);
        self.push = Wrench::zero();
        self.support = None;
    }

    pub(super) fn stick(&mut self, finger: usize, sensor: PlantSensor) -> Result<(), PlantRefusal> {
        let wire = match sensor {
            PlantSensor::Position(joint) => Wire::Position {
                finger,
                joint: joint as usize,
            },
            PlantSensor::Encoder(actuator) => Wire::Encoder {
                finger,
                actuator: actuator as usize,
            },
            PlantSensor::Effort(actuator) => Wire::Actuator {
                finger,
                actuator: actuator as usize,
            },
        };
        let counts = self
            .inputs
            .iter()
            .find(|sensor| sensor.wire == wire)
            .map(|sensor| self.counts(sensor))
            .ok_or(PlantRefusal::NoSuchPart)?;
        for sensor in self.inputs.iter_mut().filter(|sensor| sensor.wire == wire) {
            sensor.stuck = Some(counts);
        }
        Ok(())
    }

    pub(super) fn cut(&mut self, finger: usize, actuator: usize) -> Result<(), PlantRefusal> {
        let wire = Wire::Actuator { finger, actuator };
        let mut lines = self.boards.iter().flat_map(|board| &board.lines);
        if !lines.any(|line| line.wire == wire) {
            return Err(PlantRefusal::NoSuchPart);
        }
        let of_finger = self.cut.get_mut(finger);
        let cut = of_finger.and_then(|all| all.get_mut(actuator));
        *cut.ok_or(PlantRefusal::NoSuchPart)? = true;
        Ok(())
    }

    /// Returns true if a sensor has such a wire.
    fn has(&self, is_such: impl Fn(Wire) -> bool) -> bool {
        self.inputs.iter().any(|sensor| is_such(sensor.wire))
    }

    pub(super) fn mend(&mut self) {
        self.cut = [[false; ACTUATORS]; FINGERS];
        for sensor in &mut self.inputs {
            sensor.stuck = None;
        }
        if self.failures > 0 || self.is_lost() {
            self.restart();
        }
    }

    /// Returns true if a joint is far beyond its limits.
    fn is_lost(&self) -> bool {
        let mut fingers = self.hand.fingers().iter().zip(&self.limits);
        fingers.any(|(finger, limits)| {
            let mut joints = finger.q().iter().zip(limits);
            joints.any(|(q, (low, high))| !(low..=high).contains(&q))
        })
    }

    /// Puts the robot at rest where it began, without a ball and pushes.
    fn restart(&mut self) {
        self.remove_ball();
        let slack = [0.0; ACTUATORS];
        for (finger, start) in self.hand.fingers_mut().iter_mut().zip(&self.start) {
            // These positions were possible at the beginning.
            let _ = finger.reset(*start, slack);
        }
        for finger in 0..FINGERS {
            // All fingers are there.
            let _ = self.hand.push_tip(finger, Wrench::zero());
        }
        (self.failures, self.cause) = (0, None);
    }
}

impl OutputBoard {
    /// Returns the output of its lines in this tick, N or N m.
    fn update<B: SimBoards, S: Bus>(&mut self, bus: &S) -> Result<[f64; LINES], Failure> {
        let told = match B::look(bus, self.number)? {
            BoardEvent::Closed => BoardInput::Closed,
            BoardEvent::Nothing => BoardInput::Nothing,
            BoardEvent::Written => {
                let mut values = [0.0; LINES];
                for (value, line) in values.iter_mut().zip(&self.lines) {
                    // 0 V is nothing, also where no whole number of counts is.
                    *value = match B::output(bus, &line.output)? {
                        Some(counts) => line.output.value(counts),
                        None => 0.0,
                    };
                }
                BoardInput::Values(values)
            }
        };
        Ok(self.watchdog.update(told))
    }
}

/// The boards of outputs with the wires of a description.
fn output_boards<B: SimBoards>(
    hand: &RobotDescription,
    arguments: &Arguments,
) -> Result<heapless::Vec<OutputBoard, BOARDS>, BoardError> {
    let patience = arguments.ticks(arguments.watchdog_ms);
    let ramp = arguments.ticks(arguments.ramp_ms);
    for (channel, wire) in hand.wires() {
        let is_output = hand.output(wire).is_some_and(|it| it.channel() == channel);
        let board = B::output_board(channel).map_or(BOARDS, usize::from);
        if is_output && board >= BOARDS {
            return Err(BoardError::NoChannel { channel });
        }
    }
    let of_board = |number: u8| {
        let (mut lines, mut least) = (heapless::Vec::new(), [0.0; LINES]);
        for (channel, wire) in hand.wires() {
            let output = hand.output(wire).filter(|it| it.channel() == channel);
            let (Some(output), true) = (output, B::output_board(channel) == Some(number)) else {
                continue;
            };
            if let Some(place) = least.get_mut(lines.len()) {
                *place = at_rest(hand, wire);
            }
            let full = BoardError::NoChannel { channel };
            let line = Line {
                wire,
                output: *output,
            };
            lines.push(line).map_err(|_| full)?;
        }
        let watchdog = Watchdog::new(least, patience, ramp);
        Ok::<_, BoardError>(OutputBoard {
            number,
            lines,
            watchdog,
        })
    };
    let mut boards = heapless::Vec::new();
    for number in 0..BOARDS as u8 {
        let board = of_board(number)?;
        if !board.lines.is_empty() {
            // There is room for all numbers.
            let _ = boards.push(board);
        }
    }
    Ok(boards)
}

/// The bit of a board.
fn bit(number: u8) -> u64 {
    1_u64.checked_shl(number.into()).unwrap_or(0)
}

/// The sensors with the wires of a description.
fn sensors<B: SimBoards>(hand: &RobotDescription) -> heapless::Vec<Sensor, INPUTS> {
    let mut sensors = heapless::Vec::new();
    for (channel, wire) in hand.wires() {
        let adc = hand.input(wire).filter(|adc| adc.channel() == channel);
        if let Some(adc) = adc {
            // There is room for all that a description of this size has.
            let _ = sensors.push(Sensor {
                wire,
                adc: *adc,
                board: B::input_board(channel).map_or(BOARDS, usize::from),
                stuck: None,
            });
        }
    }
    sensors
}

/// Returns a bit for each processor that reads a board of inputs, by the numbers of boards.
fn readers<B: SimBoards>(hand: &RobotDescription) -> [u64; BOARDS] {
    let mut readers = [0; BOARDS];
    for (channel, wire) in hand.wires() {
        let board = B::input_board(channel).map(usize::from);
        let readers = board.and_then(|board| readers.get_mut(board));
        if let Some((readers, reader)) = readers.zip(processor(hand, wire)) {
            *readers |= bit(reader);
        }
    }
    readers
}

fn is_possible(wrench: &Wrench) -> bool {
    let forces = wrench
        .force
        .iter()
        .all(|&part| NumberRange::FORCE.contains(part));
    forces
        && wrench
            .moment
            .iter()
            .all(|&part| NumberRange::MOMENT.contains(part))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boards::none::NoBoards;

    #[test]
    fn a_simulation_that_has_failed_begins_again_when_it_is_mended() {
        let text = include_str!("../../../../condor-hand/hands/utah-mit.toml");
        let hand = RobotDescription::from_toml(text, "utah-mit.toml").unwrap();
        let mut robot = Robot::new::<NoBoards>(&hand, &Arguments::default()).unwrap();
        let begins = robot.start;
        let center = Vector3::new(0.085, 0.004, -0.0625);
        robot.place_ball(center, 0.02, 0.05).unwrap();
        // Whole robots are not moved when they are mended.
        let mut moved = begins[0];
        moved[1] += 0.1;
        let slack = [0.0; ACTUATORS];
        robot.hand.fingers_mut()[0].reset(moved, slack).unwrap();
        robot.mend();
        assert_eq!(*robot.hand.fingers()[0].q(), moved);
        assert!(robot.ball().is_some());
        // Far beyond its stop.
        moved[1] = 2.094;
        robot.hand.fingers_mut()[0].reset(moved, slack).unwrap();
        robot.mend();
        assert_eq!(*robot.hand.fingers()[0].q(), begins[0]);
        assert!(robot.ball().is_none());
        // Failed ticks count until then.
        (robot.failures, robot.cause) = (3, None);
        assert_eq!(robot.truth().failed, 3);
        robot.mend();
        assert_eq!(robot.truth().failed, 0);
    }
}
