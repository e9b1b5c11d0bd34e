//! The program that is the robot: a simulated hand on a table, behind the other side of the boards.
//!
//! It writes what sensors say into the registers of A/D and encoder boards, and takes from those of the
//! D/A boards what actuators are to do, with the calibration and the widths that the configuration has.
//! Boards identify themselves once their registers are right, so a controller that is early waits.
//!
//! Each D/A board has a watchdog. Without a strobe for some time, or once nobody has the board open, it
//! takes its tensions to the least ones, and its forces to none, within the time of a ramp, and goes on
//! with the next strobe. Registers are memory here, so a board does not take its channels at the
//! instant of the strobe, but when the robot looks next.
//!
//! Arguments, in any order:
//!
//! | argument | is | without it |
//! |---|---|---|
//! | `rate=HZ` | how often the robot looks at its boards | 2000 |
//! | `watchdog_ms=MS` | after which time without a strobe a board rests | 25 |
//! | `ramp_ms=MS` | how long it takes to the least tensions | 250 |
//!
//! | name in the directory | is |
//! |---|---|
//! | `console` | its terminal: boards that rest and go on |
//! | `loops` | the counts of its loop |
//! | `truth` | a published [`Truth`] |
//! | `plant` | the blocks of [`PLANT`]: a [`Desk`] of [`Request`] and [`Response`] |

use core::cell::RefCell;

use condor_mbox::published::Publisher;
use condor_mbox::{Call, Published, Region, Vector};
use condor_mos::Rate;
use condor_rt::directory::Kind;
use condor_rt::loops::LoopReports;
use condor_rt::{Error, Machine, MailboxOf, Program};
use critical_section::Mutex;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::desk::Desk;
use crate::start::{self, Console, Ground, say};
use crate::{FINGERS, JOINTS, UtahMit};

mod arguments;
mod ball;
mod registers;
mod requests;
mod robot;
mod watchdog;

use arguments::Arguments;
use registers::Registers;
pub use requests::{Refusal, Request, Response, Verb, Which};
pub use robot::MACHINE;
use robot::Robot;

/// The vector of requests to the robot.
pub const PLANT: Vector = Vector(4);
/// The name of the robot's blocks in its processor's directory.
pub const NAME: &str = "plant";
/// The name of the published [`Truth`].
pub const TRUTH_NAME: &str = "truth";

/// How the robot really is, published in every tick. Vectors are in the axes of the palm.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Truth {
    /// Since the robot began, s.
    pub time_s: f64,
    /// Of the joints of each finger, rad.
    pub position: [[f64; JOINTS]; FINGERS],
    /// Of the joints of each finger, rad/s.
    pub velocity: [[f64; JOINTS]; FINGERS],
    /// Of the flexor and the extensor of each joint, N.
    pub tension: [[[f64; 2]; JOINTS]; FINGERS],
    /// Of the table, m.
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
}

/// The robot, between handlers and the loop.
type Shared = Mutex<RefCell<Option<Robot>>>;

/// The program.
#[derive(Clone, Copy, Debug, Default)]
pub struct Plant;

impl Program for Plant {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), Error> {
        let arguments = Arguments::of(machine)?;
        let Ground {
            own,
            mut places,
            mut directory,
            terminal,
            area,
        } = Ground::<M, 1>::new(machine)?;
        let reports = LoopReports::new(&own, &mut places, &mut directory, ["plant"])?;
        let truth: Published<Truth> = places.published()?;
        let desk = Desk::<Request, Response>::new(&mut places)?;

        let shared: Shared = Mutex::new(RefCell::new(None));
        let typed = |call: &Call<'_>| terminal.receive(call);
        let open_files = area.handler();
        let asked = |call: &Call<'_>| desk.answer(call, &own, |request| respond(&shared, &request));
        let mut mailbox = start::mailbox(machine, &typed, &open_files)?;
        mailbox.set_vector(PLANT, &asked, NAME)?;
        let registers = Registers::new(machine.bus());
        // Boards of a former life answer no more.
        registers.unplug()?;
        mailbox.join()?;
        let mailbox = &mailbox;
        directory.enter(
            NAME,
            Kind::Other,
            desk.offset(),
            Desk::<Request, Response>::BYTES,
        )?;

        let outcome = start::configuration::<M, 1>(mailbox, &own, area).and_then(|hand| {
            let robot = Robot::new(&hand, &arguments)?;
            robot.show(&registers)?;
            registers.plug()?;
            critical_section::with(|section| {
                if let Ok(mut place) = shared.borrow(section).try_borrow_mut() {
                    *place = Some(robot);
                }
            });
            let publisher = truth.publisher(own.clone())?;
            let bytes = Published::<Truth>::BYTES;
            directory.enter(TRUTH_NAME, Kind::Other, truth.offset(), bytes)?;
            let running = Running {
                machine,
                mailbox,
                shared: &shared,
                registers: &registers,
                arguments,
            };
            running.serve(&hand, publisher, reports, &terminal)
        });
        start::told::<M>(&terminal, mailbox, outcome)
    }
}

/// What the robot runs on.
struct Running<'r, 'v, M: Machine> {
    machine: &'r M,
    mailbox: &'r MailboxOf<'v, M>,
    shared: &'r Shared,
    registers: &'r Registers<M::Bus>,
    arguments: Arguments,
}

impl<M: Machine> Running<'_, '_, M> {
    fn serve(
        &self,
        hand: &UtahMit,
        mut publisher: Publisher<Truth, Region<M::Window>>,
        mut reports: LoopReports<M::Window, 1>,
        terminal: &Console<M>,
    ) -> Result<(), Error> {
        let (machine, arguments) = (self.machine, &self.arguments);
        let rate = Rate::new(arguments.rate_hz, 1).unwrap_or(Rate::hz(1));
        let body = || {
            if let Some(truth) = with(self.shared, |robot| robot.tick(self.registers)) {
                // Who reads finds the former one.
                let _ = publisher.publish(&truth);
            }
        };
        let (name, hz) = (&hand.name, arguments.rate_hz);
        say::<M>(
            terminal,
            self.mailbox,
            format_args!("is the hand {name}, at {hz} Hz"),
        );
        let (mut resting, mut failures) = (0, 0);
        start::with_loop(machine, rate, body, |loops| {
            let look = || {
                let seen = with(self.shared, |robot| (robot.tripped(), robot.failures()));
                let Some((now, failed)) = seen else {
                    return Ok(());
                };
                for board in 0..u64::BITS {
                    let is_new = (now ^ resting) >> board & 1 != 0;
                    let ms = arguments.watchdog_ms;
                    if is_new && now >> board & 1 != 0 {
                        say::<M>(
                            terminal,
                            self.mailbox,
                            format_args!("D/A board {board} rests: nothing came for {ms} ms"),
                        );
                    } else if is_new {
                        say::<M>(
                            terminal,
                            self.mailbox,
                            format_args!("D/A board {board} goes on"),
                        );
                    }
                }
                if failed != failures {
                    say::<M>(
                        terminal,
                        self.mailbox,
                        format_args!("{failed} ticks in which the robot or its bus failed"),
                    );
                }
                (resting, failures) = (now, failed);
                Ok(())
            };
            start::attend(machine, self.mailbox, loops, &mut reports, look)
        })
    }
}

/// Does something with the robot, once there is one.
fn with<R>(shared: &Shared, work: impl FnOnce(&mut Robot) -> R) -> Option<R> {
    critical_section::with(|section| {
        let mut place = shared.borrow(section).try_borrow_mut().ok()?;
        place.as_mut().map(work)
    })
}

fn respond(shared: &Shared, request: &Request) -> Response {
    let done = with(shared, |robot| {
        (requests::obey(robot, request), robot.resting())
    });
    let (outcome, resting) = done.unwrap_or((Err(Refusal::NotStarted), 0));
    Response {
        refusal: outcome.err().map_or(0, |refusal| refusal as u32),
        resting: resting as u32,
    }
}
