//! The program of the table's processor: three axes that carry the hand.
//!
//! Its loop reads the encoder board, moves the axes, and publishes the acceleration that the palm is to
//! have, which the servos take from gravity. It takes no arguments.
//!
//! | object | is |
//! |---|---|
//! | `console` | its terminal |
//! | `axes` | its loop: counts, variables, and its parameters, the gains of the axes |
//! | `palm` | a published [`Palm`] |
//! | `table` | the blocks of [`TABLE`] with [`TableRequest`] and [`TableResponse`]: [`TableBlocks`] |
//!
//! A table takes motions after it has been home.

use core::fmt;
use core::marker::PhantomData;

use condor_vars::cell_struct;
use core::cell::RefCell;

use condor_hand::config::{Axis, AxisNumber};
use condor_hand::controller::{AXES, TableController, TableState, read_table, write_table};
use condor_hand::trajectory::{MotionError, Pace, Primitive, Profile, Target};
use condor_mbox::exchange::Blocks;
use condor_mbox::published::Publisher;
use condor_mbox::{Clock, Instant, Region, Vector};
use condor_rt::objects;
use condor_rt::{Machine, PROCESSORS, Program, ProgramError, Setup};
use condor_vars::Vars;
use critical_section::Mutex;
use serde::{Deserialize, Serialize};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::boards::{Boards, Wires};
use crate::failure::Failure;
use crate::grasp::TickTime;
use crate::numbers::{Number, NumberPlace, Numbers};
use crate::packet::{self, ShortPacket};
use crate::{RobotDescription, start};

/// The vector of messages with requests to the table: see [`TableRequest`].
pub const TABLE: Vector = Vector(3);
/// The name of the blocks for requests to the table in its processor's object table.
pub const NAME: &str = "table";
/// The name of the published [`Palm`] in the object table of the table's processor.
pub const PALM_NAME: &str = "palm";

/// The state of the table that carries the hand, which its processor publishes in every tick: the positions of its
/// axes, and the acceleration of the palm.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Palm {
    /// The acceleration that the palm is to have, in its own axes, m/s².
    pub acceleration: [f64; 3],
    /// The measured positions of the axes, m.
    pub position: [f64; AXES],
    /// The desired positions of the axes, m.
    pub target: [f64; AXES],
    /// The state of the table: 0 off, 1 going home, 2 stopped on its way home, 3 ready, 4 failed.
    pub state: u64,
    /// When the tick was due, ns of the processor's clock.
    pub due_ns: u64,
}

impl TickTime for Palm {
    fn due_ns(&self) -> u64 {
        self.due_ns
    }
}

cell_struct!(Palm {
    "acceleration": acceleration, "m/s^2", "Of the palm, in its own axes.";
    "position": position, "m", "Position of the axes.";
    "target": target, "m", "Target of the axes.";
    "state": state, "";
    "due_ns": due_ns, "ns";
});

/// The state of the table: whether it is off, goes home, takes motions, or has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u32)]
#[non_exhaustive]
pub enum TableStatus {
    /// The drives of the table are off.
    Off = 0,
    /// The table goes home.
    Homing = 1,
    /// The table was stopped on its way home.
    Stopped = 2,
    /// The table takes motions.
    Ready = 3,
    /// A sensor has failed, or the ticks were late for too long.
    Failed = 4,
}

impl fmt::Display for TableStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Off => "off",
            Self::Homing => "going home",
            Self::Stopped => "stopped on its way home",
            Self::Ready => "ready",
            Self::Failed => "failed",
        })
    }
}

impl TableStatus {
    const fn of(state: TableState) -> Self {
        match state {
            TableState::Starting { .. } | TableState::Homing => Self::Homing,
            TableState::Stopped => Self::Stopped,
            TableState::Ready => Self::Ready,
            TableState::Failed { .. } | TableState::Late => Self::Failed,
            _ => Self::Off,
        }
    }
}

/// A request to the table. A speed is a fraction of the limits of velocity, above 0 and at most 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum TableRequest {
    /// Asks for the state of the table.
    Status,
    /// Enables the table, which goes home.
    Home {
        /// The speed on the way home, as a fraction of the limits.
        speed: f64,
    },
    /// Goes to a position, after the motions before.
    Move {
        /// The targets of the axes, m; a target without an axis is ignored.
        to: [f64; AXES],
        /// The speed on the way, as a fraction of the limits.
        speed: f64,
    },
    /// Stops on the way, and forgets all motions.
    Stop,
    /// Disables the table: nothing drives it.
    Disable,
    /// Forgets a failure.
    Clear,
}

/// The response of the table to a [`TableRequest`]: its state when what was asked for is done, or on its way.
pub type TableResponse = Result<TableStatus, TableRefusal>;

/// The blocks by which other processors ask the table.
pub type TableBlocks = Blocks<ShortPacket<TableRequest>, ShortPacket<TableResponse>>;

/// The reason why the table refuses a [`TableRequest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum TableRefusal {
    /// The table is busy with another request: ask again.
    Busy,
    /// The table has not been home, or has failed.
    NotReady,
    /// The speed is not above 0 and at most 1.
    Speed,
    /// The motion goes beyond the limits of the table, or there is no room for it.
    Motion,
}

impl fmt::Display for TableRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Busy => "it is busy with another request: ask again",
            Self::NotReady => "it has not been home, or has failed: type `table home`",
            Self::Speed => "the speed must be above 0 and at most 1",
            Self::Motion => "the motion goes beyond the limits of the table, or too many wait: `table stop` ends those",
        })
    }
}

/// The controller, between handlers and the loop.
type SharedTable = Mutex<RefCell<DrivenTable>>;

struct DrivenTable {
    controller: TableController,
    /// The number of axes.
    axes: usize,
}

/// The program of the table's processor, which moves the axes that carry a robot with boards `B`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Table<B>(PhantomData<B>);

impl<B> Table<B> {
    /// Makes the program.
    #[must_use]
    pub const fn new() -> Self {
        Self(PhantomData)
    }
}

impl<B: Boards> Program for Table<B> {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let number = machine.number().0;
        let (mut place, mut panel) = (None, None);
        let (hand, rate_hz, driven, panel, mut wires) =
            start::configured(machine, &mut place, |background, hand| {
                let processor = hand.processor(number);
                let processor = processor.ok_or(Failure::NoProcessor { processor: number })?;
                let controller = TableController::new(hand).map_err(Failure::from)?;
                let driven = DrivenTable {
                    controller: controller.ok_or(Failure::NoTable)?,
                    axes: hand.table.as_ref().map_or(0, |table| table.axes.len()),
                };
                let (bus, interrupts) = (machine.bus(), machine.interrupt_controller());
                let panel = &*panel.insert(B::panel(bus, interrupts, hand, number));
                let wires = start::wires::<M, B>(background, panel, hand)?;
                Ok((hand, hand.rate_hz(processor), driven, panel, wires))
            })?;
        let shared: SharedTable = Mutex::new(RefCell::new(driven));
        let variables = Variables::new();
        let axes = hand.table.as_ref().map_or(&[][..], |table| &table.axes);
        let gains = AxisGains::new(hand, gains(axes, rate_hz), f64::MIN..=f64::MAX);
        let clock = machine.doorbell();

        let mut setup = Setup::new(machine)?;
        let mut axes = Axes::<M> {
            hand,
            shared: &shared,
            wires: &mut wires,
            publisher: setup.publish_fields(PALM_NAME)?,
            variables: &variables,
            gains: &gains,
            tuned: gains.version(),
            clock: &clock,
            last: None,
            period_s: 1.0 / f64::from(rate_hz),
        };
        let blocks = setup.place(NAME, objects::ObjectKind::Other, |allocator| {
            TableBlocks::new(allocator, PROCESSORS as u8)
        })?;
        let own = setup.own().clone();
        setup
            .console()?
            .interrupts(panel)
            .on(TABLE, NAME, &|call| {
                packet::answer(blocks, call, &own, |request| respond(&shared, request))
            })
            .watch(&variables.position)
            .watch(&variables.target)
            .watch(&variables.force)
            .fixed()
            .tune(&gains)
            .servo("axes", start::rate(rate_hz), &mut |tick| {
                axes.tick(tick.due);
            })
            .background(|background| {
                background.print(format_args!("controls the table at {rate_hz} Hz\n"));
                let mut before = TableStatus::Off;
                start::attend(background, || {
                    let state = with(&shared, |table| table.controller.state());
                    let state = state.map_or(before, TableStatus::of);
                    if state != before {
                        before = state;
                        background.print(format_args!("{state}\n"));
                    }
                    Ok(())
                })
            })
    }
}

/// The variables of the axes, which the loop sets in every tick.
struct Variables {
    position: Vars<f64, AXES>,
    target: Vars<f64, AXES>,
    force: Vars<f64, AXES>,
}

impl Variables {
    const fn new() -> Self {
        Self {
            position: Vars::numbered("table.position", "m").about("Measured position."),
            target: Vars::numbered("table.target", "m"),
            force: Vars::numbered("table.force", "N").about("Command to the drives."),
        }
    }
}

/// All that happens in a tick of the table's loop.
struct Axes<'r, M: Machine> {
    hand: &'r RobotDescription,
    shared: &'r SharedTable,
    wires: &'r mut dyn Wires,
    publisher: Publisher<Palm, Region<M::Window>>,
    variables: &'r Variables,
    gains: &'r AxisGains<'r>,
    /// The version of the gains that the controller has.
    tuned: u32,
    clock: &'r M::Doorbell,
    last: Option<Instant>,
    period_s: f64,
}

impl<M: Machine> Axes<'_, M> {
    fn tick(&mut self, due: Instant) {
        let Some(table) = &self.hand.table else {
            return;
        };
        let now = self.clock.now();
        #[allow(clippy::cast_precision_loss, reason = "2^53 ns are a hundred days")]
        let since = (self.last.replace(now)).map(|last| now.ns_since(last) as f64 * 1e-9);
        let period_s = since.unwrap_or(self.period_s);
        self.wires.scan();
        let position = read_table(table, |channel| self.wires.read(channel));
        // Nobody else has it: handlers are interrupted outside of their sections only.
        let (gains, tuned) = (self.gains, &mut self.tuned);
        let Some(tick) = with(self.shared, |table| {
            if gains.version() != *tuned {
                *tuned = gains.version();
                tune(&mut table.controller, gains);
            }
            table.controller.tick(&position, period_s)
        }) else {
            return;
        };
        let wires = &mut *self.wires;
        write_table(table, &tick.force, |channel, counts| {
            wires.write(channel, counts);
        });
        self.wires.put();
        let palm = Palm {
            acceleration: tick.acceleration.into(),
            position,
            target: tick.target.map(|point| point.position),
            state: u64::from(TableStatus::of(tick.state) as u32),
            due_ns: due.as_ns(),
        };
        self.variables.position.set_all(&palm.position);
        self.variables.target.set_all(&palm.target);
        self.variables.force.set_all(&tick.force);
        // The servos take an acceleration that is not published any more for none.
        let _ = self.publisher.publish(&palm);
    }
}

/// The gains and filters of the axes, as parameters of the loop.
type AxisGains<'h> = Numbers<'h, f64, { AXES * AxisNumber::ALL.len() }>;

/// The gains of these axes, whose loop has this rate.
fn gains(axes: &[Axis], rate_hz: u32) -> impl Iterator<Item = Number<f64>> {
    axes.iter().enumerate().flat_map(move |(axis, entry)| {
        AxisNumber::ALL.into_iter().map(move |number| Number {
            place: NumberPlace::Axis(axis as u8, number),
            value: number.of(&entry.servo),
            range: number.range(entry, rate_hz),
        })
    })
}

/// Sets the gains that have changed.
#[cold]
fn tune(controller: &mut TableController, gains: &AxisGains<'_>) {
    for (place, value) in gains.present() {
        if let NumberPlace::Axis(axis, number) = place
            && controller.number(axis.into(), number) != Some(value)
        {
            // Gains within their ranges are accepted.
            let _ = controller.set_number(axis.into(), number, value);
        }
    }
}

/// Does something with the controller; `None` if that is in progress already.
fn with<R>(shared: &SharedTable, work: impl FnOnce(&mut DrivenTable) -> R) -> Option<R> {
    critical_section::with(|section| {
        let mut table = shared.borrow(section).try_borrow_mut().ok()?;
        Some(work(&mut table))
    })
}

fn respond(shared: &SharedTable, request: TableRequest) -> TableResponse {
    let done = with(shared, |table| {
        obey(table, request)?;
        Ok(TableStatus::of(table.controller.state()))
    });
    done.unwrap_or(Err(TableRefusal::Busy))
}

fn obey(table: &mut DrivenTable, request: TableRequest) -> Result<(), TableRefusal> {
    let DrivenTable { controller, axes } = table;
    match request {
        TableRequest::Status => {}
        TableRequest::Home { speed } => controller
            .start(speed)
            .map_err(|error| refusal(error, TableRefusal::Speed))?,
        TableRequest::Move { to, speed } => {
            let pace = Pace::Speed(speed);
            let mut motion = Primitive::new(pace, Profile::MinimumJerk);
            for (axis, &to) in to.iter().enumerate().take(*axes) {
                let more = motion.with(axis, Target::Absolute(to));
                motion = more.map_err(|_| TableRefusal::Motion)?;
            }
            controller
                .enqueue(motion)
                .map_err(|error| refusal(error, TableRefusal::Motion))?;
        }
        TableRequest::Stop => controller.stop(),
        TableRequest::Disable => controller.disable(),
        TableRequest::Clear => controller.clear(),
    }
    Ok(())
}

/// The refusal for an error, and for any other than that the table is not ready `otherwise`.
fn refusal(error: MotionError, otherwise: TableRefusal) -> TableRefusal {
    match error {
        MotionError::NotReady => TableRefusal::NotReady,
        _ => otherwise,
    }
}
