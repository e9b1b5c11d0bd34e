//! The program that is the robot: a simulated hand on a table, behind the other side of the boards.
//!
//! It writes what sensors say into the registers of A/D and encoder boards, and takes from those of the
//! D/A boards what actuators are to do, with the calibration and the widths that the configuration has.
//! A/D boards convert when their timers say, or at the last tick before, and interrupt the processors that
//! have a wire there. The robot's loop is ahead of the loops of others by 0.1 ms; if its rate is an odd
//! multiple of theirs, each conversion is done at its instant, 0.1 ms before it is read.
//! Boards identify themselves once their registers are right, so a controller that is early waits.
//!
//! Each D/A board has a watchdog. Without a strobe for some time, or once nobody has the board open, it
//! takes its outputs to those of rest within the time of a ramp, and goes on
//! with the next strobe. Registers are memory here, so a board does not take its channels at the
//! instant of the strobe, but when the robot looks next.
//!
//! Arguments, in any order:
//!
//! | argument | is | without it |
//! |---|---|---|
//! | `rate=HZ` | how often the robot looks at its boards | 2000 |
//! | `watchdog_ms=MS` | after which time without a strobe a board rests | 25 |
//! | `ramp_ms=MS` | how long it takes to rest | 250 |
//! | `camera_hz=HZ` | how often the camera takes a picture of the ball | 50 |
//! | `camera_um=UM` | the standard deviation of a point in it, µm | exact |
//! | `seed=N` | from which the noise of the pictures follows | 1 |
//!
//! | object | is |
//! |---|---|
//! | `console` | its terminal: boards that rest and go on |
//! | `robot` | its loop: counts and variables |
//! | `truth` | a published [`TrueState`] |
//! | `object` | a published [`CameraObject`]: what the camera measures |
//! | `plant` | the blocks of [`PLANT`] with [`PlantRequest`] and [`PlantResponse`]: [`PlantBlocks`] |

use condor_vars::cell_struct;
use core::cell::RefCell;
use core::marker::PhantomData;
use core::time::Duration;

use condor_hand::grasp::Wrench;
use condor_mbox::exchange::Blocks;
use condor_mbox::{Clock as _, Vector};
use condor_rt::objects;
use condor_rt::{Machine, PROCESSORS, Processor, Program, ProgramError, Raiser, Setup};
use condor_vars::{Var, Vars};
use critical_section::Mutex;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::boards::SimBoards;
use crate::packet::{self, ShortPacket};
use crate::{ACTUATORS, FINGERS, Failure, JOINTS, start};

mod arguments;
mod ball;
mod camera;
mod requests;
mod robot;
mod watchdog;

use arguments::Arguments;
use camera::Camera;
pub use camera::CameraObject;
pub use requests::{NumberRange, PlantRefusal, PlantRequest, PlantResponse, PlantSensor};
pub use robot::MACHINE;
use robot::{Robot, WORKSPACE_M};

/// The vector of messages with requests to the simulated robot: see [`PlantRequest`].
pub const PLANT: Vector = Vector(4);
/// The blocks by which other processors ask the simulated robot.
pub type PlantBlocks = Blocks<ShortPacket<PlantRequest>, ShortPacket<PlantResponse>>;
/// The name of the blocks for requests to the simulated robot in its processor's object table.
pub const NAME: &str = "plant";
/// The name of the published [`TrueState`] in the object table of the robot's processor.
pub const TRUTH_NAME: &str = "truth";
/// The name of the published [`CameraObject`] in the object table of the robot's processor.
pub const OBJECT_NAME: &str = "object";

/// The time from a release of the robot's loop to that of the loops that read its boards.
const AHEAD: Duration = Duration::from_micros(100);

/// The true state of the simulated robot, which its program publishes in every tick; controllers see only sensors.
/// Vectors are in the axes of the palm.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct TrueState {
    /// The time since the robot began, s.
    pub time_s: f64,
    /// The positions of the joints of each finger, rad.
    pub position: [[f64; JOINTS]; FINGERS],
    /// The velocities of the joints of each finger, rad/s.
    pub velocity: [[f64; JOINTS]; FINGERS],
    /// The efforts of the actuators of each finger, N or N m.
    pub effort: [[f64; ACTUATORS]; FINGERS],
    /// The positions of the table's axes, m.
    pub table: [f64; 3],
    /// The centre of the ball, m; NaN without one.
    pub ball: [f64; 3],
    /// The orientation of the ball, a unit quaternion, the real part first.
    pub orientation: [f64; 4],
    /// A bit for each finger that touches the ball.
    pub touching: u64,
    /// A bit for each finger that slides on it.
    pub sliding: u64,
    /// A bit for each D/A board that rests.
    pub resting: u64,
    /// A hash of the positions of all joints in all ticks so far, by which runs can be compared.
    pub hash: u64,
    /// Ticks in which the robot or its bus failed since it was last mended.
    pub failed: u64,
}

cell_struct!(TrueState {
    "time_s": time_s, "s", "Since the robot began.";
    "position": position, "rad", "Joints in the order of the fingers.";
    "velocity": velocity, "rad/s";
    "effort": effort, "N", "Actuators in the order of the fingers.";
    "table": table, "m";
    "ball": ball, "m", "Centre of the ball; NaN without one.";
    "orientation": orientation, "", "Of the ball: a unit quaternion, the real part first.";
    "touching": touching, "", "A bit for each finger that touches the ball.";
    "sliding": sliding, "", "A bit for each finger that slides on it.";
    "resting": resting, "", "A bit for each D/A board that rests.";
    "hash": hash, "", "Of the positions of all joints in all ticks so far.";
    "failed": failed, "", "Ticks in which the robot or its bus failed since it was mended.";
});

/// The robot, between handlers and the loop.
type SharedRobot = Mutex<RefCell<Robot>>;

/// The program of the simulated robot: a hand on a table, with a ball, which programs reach by the registers of its
/// boards.
#[derive(Clone, Copy, Debug, Default)]
pub struct Plant<B>(PhantomData<B>);

impl<B> Plant<B> {
    /// Makes the program.
    #[must_use]
    pub const fn new() -> Self {
        Self(PhantomData)
    }
}

impl<B: SimBoards> Program for Plant<B> {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let arguments = Arguments::of(machine)?;
        let bus = machine.bus();
        // Boards of a former incarnation answer no more.
        B::plug(&bus, false).map_err(Failure::from)?;
        let mut place = None;
        let (hand, robot) = start::configured(machine, &mut place, |_, hand| {
            B::check(hand).map_err(Failure::from)?;
            let mut robot = Robot::new::<B>(hand, &arguments)?;
            robot.show::<B, _>(&bus, machine.doorbell().now().as_ns(), &mut |_, _| ())?;
            B::plug(&bus, true).map_err(Failure::from)?;
            Ok((hand, robot))
        })?;
        let shared: SharedRobot = Mutex::new(RefCell::new(robot));
        let ball = Vars::<f64, 3>::named(&["ball.x", "ball.y", "ball.z"], "m");
        let ball = ball.about("Its centre, in the axes of the palm; NaN without one.");
        let touching = Var::<u64>::new("ball.touching", "").about("A bit for each finger.");
        let resting = Var::<u64>::new("boards.resting", "").about("A bit for each D/A board.");

        let raiser = Raiser::new(machine);
        let mut raise = |processor, vector| raiser.raise(Processor(processor), vector);
        let mut setup = Setup::new(machine)?;
        let mut truth = setup.publish_fields(TRUTH_NAME)?;
        let mut seen = setup.publish_fields(OBJECT_NAME)?;
        let mut camera = Camera::new(&arguments);
        let blocks = setup.place(NAME, objects::ObjectKind::Other, |allocator| {
            PlantBlocks::new(allocator, PROCESSORS as u8)
        })?;
        let own = setup.own().clone();
        setup
            .console()?
            .on(PLANT, NAME, &|call| {
                packet::answer(blocks, call, &own, |request| respond(&shared, request))
            })
            .watch(&ball)
            .watch(&touching)
            .watch(&resting)
            // So that the conversions for a servo's release are done before it.
            .ahead(AHEAD)
            .fixed()
            .servo("robot", start::rate(arguments.rate_hz), &mut |tick| {
                let done = with(&shared, |robot| {
                    let now = robot.tick::<B, _>(&bus, tick.due.as_ns(), &mut raise);
                    (now, camera.look(robot.ball(), now.time_s))
                });
                if let Some((now, picture)) = done {
                    ball.set_all(&now.ball);
                    touching.set(now.touching);
                    resting.set(now.resting);
                    // After an error the reader finds the former value.
                    let _ = truth.publish(&now);
                    if let Some(picture) = picture {
                        let _ = seen.publish(&picture);
                    }
                }
            })
            .background(|background| {
                let (name, hz) = (&hand.name, arguments.rate_hz);
                background.print(format_args!("simulates the hand {name} at {hz} Hz\n"));
                let (mut tripped, mut failures, mut lost) = (0, 0, 0);
                start::attend(background, || {
                    let seen = with(&shared, |robot| {
                        (robot.tripped(), robot.failures(), robot.lost_balls(), robot.cause())
                    });
                    let Some((now, failed, balls, cause)) = seen else {
                        return Ok(());
                    };
                    for board in 0..u64::BITS {
                        let is_new = (now ^ tripped) >> board & 1 != 0;
                        let ms = arguments.watchdog_ms;
                        if is_new && now >> board & 1 != 0 {
                            background.print(format_args!(
                                "D/A board {board} takes its outputs to those of rest: no values came for {ms} ms\n"
                            ));
                        } else if is_new {
                            background.print(format_args!("D/A board {board} works again\n"));
                        }
                    }
                    if let Some(cause) = cause.filter(|_| failed != failures) {
                        background.print(format_args!(
                            "the robot or its bus failed during {failed} ticks: {cause}; `clear` at the master puts the \
                             robot back to its start\n"
                        ));
                    }
                    if balls != lost {
                        background.print(format_args!(
                            "the ball was more than {WORKSPACE_M} m from the palm and is taken away\n"
                        ));
                    }
                    (tripped, failures, lost) = (now, failed, balls);
                    Ok(())
                })
            })
    }
}

/// Does something with the robot; `None` if that is in progress already.
fn with<R>(shared: &SharedRobot, work: impl FnOnce(&mut Robot) -> R) -> Option<R> {
    critical_section::with(|section| {
        let mut robot = shared.borrow(section).try_borrow_mut().ok()?;
        Some(work(&mut robot))
    })
}

fn respond(shared: &SharedRobot, request: PlantRequest) -> PlantResponse {
    with(shared, |robot| obey(robot, request)).unwrap_or(Err(PlantRefusal::Busy))
}

/// Does what is asked for.
fn obey(robot: &mut Robot, request: PlantRequest) -> PlantResponse {
    let wrench = |force: [f64; 3], moment: [f64; 3]| Wrench {
        force: force.into(),
        moment: moment.into(),
    };
    match request {
        PlantRequest::Push { force, moment } => robot.push_ball(wrench(force, moment)),
        PlantRequest::PushTip {
            finger,
            force,
            moment,
        } => robot.push_tip(finger as usize, wrench(force, moment)),
        PlantRequest::PlaceBall {
            center,
            radius,
            mass,
        } => robot.place_ball(center.into(), radius, mass),
        PlantRequest::LetGo { seconds } => robot.let_go(seconds),
        PlantRequest::RemoveBall => {
            robot.remove_ball();
            Ok(())
        }
        PlantRequest::StickSensor { finger, sensor } => robot.stick(finger as usize, sensor),
        PlantRequest::CutDrive { finger, actuator } => {
            robot.cut(finger as usize, actuator as usize)
        }
        PlantRequest::Mend => {
            robot.mend();
            Ok(())
        }
    }
}
