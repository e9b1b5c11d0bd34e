//! The program of the master: trajectories, and what is typed at its terminal.
//!
//! Its loop makes set-points at the configuration's `trajectory_hz` and publishes them to the servos of
//! both processors. Its background watches them and obeys commands; `help` lists those. It takes no
//! arguments.
//!
//! A finger follows only after somebody has said `enable`, and from where it is then. The set-points of
//! every other one are where it is measured. When a processor is restarted or a finger gives up, the
//! master says so, and all motion stops; it switches nothing on by itself. A master that ends leaves
//! the fingers to their servos, which let go when set-points stay away.
//!
//! | name in the directory | is |
//! |---|---|
//! | `console` | its terminal |
//! | `loops` | the counts of its loop |
//! | `wanted` | a published [`Wanted`] |

use core::cell::RefCell;
use core::fmt::Arguments;
use core::time::Duration;

use condor_fs::FileSystem;
use condor_hand::trajectory::{Generator, Limits};
use condor_mbox::published::Publisher;
use condor_mbox::{Call, Clock, Messenger, Published, Region};
use condor_mos::{LoopId, Rate};
use condor_rt::directory::Kind;
use condor_rt::loops::LoopReports;
use condor_rt::{Error, Machine, MailboxOf, Program, numbers};
use condor_tty::ConsoleError;
use critical_section::Mutex;
use embedded_io::{Read, ReadReady};

use crate::failure::Failure;
use crate::grasp::{JOINTS_NAME, Partner};
use crate::start::{self, Console, Ground, say};
use crate::{FINGERS, JOINTS, UtahMit};

mod commands;
mod drive;
mod others;
mod play;
mod sequence;
mod servos;
mod words;

pub use drive::Wanted;
pub use sequence::MOTION_BYTES;

use commands::Commands;
use drive::{ALL, Drive};
use others::Others;
use play::Player;
use sequence::Store;
use servos::Servos;

/// The name of the published [`Wanted`].
pub const WANTED_NAME: &str = "wanted";

/// How long the background serves before it looks around.
const NAP: Duration = Duration::from_millis(20);
/// How often it shows the counts of the loop, and how often it looks at the servos.
const REPORT_NS: u64 = 50_000_000;
const WATCH_NS: u64 = 100_000_000;
/// How long the first line that is typed waits for the fingers, so that it may be `enable`.
const FIRST_LINE: Duration = Duration::from_secs(2);
/// How long a command may wait for the file service, with restarts of it.
const FILES_TIMEOUT: Duration = Duration::from_secs(10);
/// The longest line that is typed, bytes.
const LINE: usize = 160;

/// The program.
#[derive(Clone, Copy, Debug, Default)]
pub struct Master;

impl Program for Master {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), Error> {
        let Ground {
            own,
            mut places,
            mut directory,
            terminal,
            area,
        } = Ground::<M, 1>::new(machine)?;
        let reports = LoopReports::new(&own, &mut places, &mut directory, ["trajectories"])?;
        let wanted: Published<Wanted> = places.published()?;
        let publisher = wanted.publisher(own.clone())?;
        let bytes = Published::<Wanted>::BYTES;
        directory.enter(WANTED_NAME, Kind::Other, wanted.offset(), bytes)?;

        let typed = |call: &Call<'_>| terminal.receive(call);
        let open_files = area.handler();
        let mut mailbox = start::mailbox(machine, &typed, &open_files)?;
        mailbox.join()?;
        let mailbox = &mailbox;

        let outcome = start::configuration::<M, 1>(mailbox, &own, area).and_then(|hand| {
            let files =
                FileSystem::connect(mailbox, numbers::FILES, own.clone(), area, FILES_TIMEOUT);
            let files = files.map_err(|error| Failure::File {
                name: crate::IMAGE,
                error,
            })?;
            let running = Running {
                machine,
                mailbox,
                hand: &hand,
                terminal: &terminal,
            };
            running.serve(publisher, Store(files), reports)
        });
        start::told::<M>(&terminal, mailbox, outcome)
    }
}

/// What the master runs on.
struct Running<'r, 'v, M: Machine> {
    machine: &'r M,
    mailbox: &'r MailboxOf<'v, M>,
    hand: &'r UtahMit,
    terminal: &'r Console<M>,
}

impl<'r, 'v, M: Machine> Running<'r, 'v, M> {
    fn serve(
        &self,
        publisher: Publisher<Wanted, Region<M::Window>>,
        store: Store<'r, 'v, M>,
        mut reports: LoopReports<M::Window, 1>,
    ) -> Result<(), Error> {
        let (machine, hand, mailbox) = (self.machine, self.hand, self.mailbox);
        let (numbers, seats) = servos::seats(hand)?;
        let [a, b] = numbers;
        let partners = [
            Partner::new(start::users(machine, a)?, JOINTS_NAME),
            Partner::new(start::users(machine, b)?, JOINTS_NAME),
        ];
        let rate_hz = hand.trajectory_hz;
        let limits = limits(hand);
        let middles = limits.map(|limits| f64::midpoint(limits.low, limits.high));
        let period_s = 1.0 / f64::from(rate_hz);
        let generator = Generator::new(limits, middles, period_s).map_err(Failure::from)?;
        let drive = Drive::new(generator, seats, &partners, publisher, period_s);
        let shared = Mutex::new(RefCell::new(drive));
        let servos = Servos::new(machine, hand, mailbox, &shared, numbers, seats)?;
        let mut commands = Commands {
            hand,
            mailbox,
            terminal: self.terminal,
            shared: &shared,
            servos,
            player: Player::new(&limits),
            store,
            others: Others::new(machine, hand, mailbox)?,
        };

        let rate = Rate::new(rate_hz, 1).unwrap_or(Rate::hz(1));
        let body = || {
            drive::with(&shared, Drive::tick);
        };
        self.say(format_args!(
            "master of {}, trajectories at {rate_hz} Hz; `help` lists the commands",
            hand.name
        ));
        start::with_loop(machine, rate, body, |loops| {
            let clock = machine.doorbell();
            let mut shown = clock.now();
            let mut watched = None;
            let patience = shown.after(FIRST_LINE);
            let mut listens = false;
            reports.publish(0, &loops.statistics(LoopId(0))?)?;
            let mut attend = || {
                while !machine.is_stopping() {
                    mailbox.serve(NAP)?;
                    let now = clock.now();
                    if now.ns_since(shown) >= REPORT_NS {
                        shown = now;
                        reports.publish(0, &loops.statistics(LoopId(0))?)?;
                    }
                    if !listens || watched.is_none_or(|at| now.ns_since(at) >= WATCH_NS) {
                        watched = Some(now);
                        for partner in &partners {
                            partner.look()?;
                        }
                        commands.watch()?;
                    }
                    commands.play();
                    listens = listens || commands.sees_all() || now >= patience;
                    if listens {
                        self.listen(&mut commands)?;
                    }
                }
                Ok(())
            };
            attend()
        })
    }

    /// Obeys a line, if one has been typed.
    fn listen(&self, commands: &mut Commands<'_, 'v, '_, M>) -> Result<(), Error> {
        let mut console = self.terminal.console(self.mailbox);
        console = console.with_read_timeout(Duration::ZERO);
        let mut line = [0; LINE];
        while console.read_ready().unwrap_or(false) {
            match console.read(&mut line) {
                Ok(count) => {
                    let line = core::str::from_utf8(line.get(..count).unwrap_or(&[]));
                    match line {
                        Ok(line) => commands.obey(line),
                        Err(_) => self.say(format_args!("that is no text")),
                    }
                }
                Err(ConsoleError::Interrupted) => commands.obey("abort"),
                Err(ConsoleError::Access(error)) => return Err(error.into()),
                Err(_) => break,
            }
        }
        Ok(())
    }

    fn say(&self, line: Arguments<'_>) {
        say::<M>(self.terminal, self.mailbox, line);
    }
}

/// The limits of all joints of the hand, with as much jerk as one tick changes the acceleration.
fn limits(hand: &UtahMit) -> [Limits<f64>; ALL] {
    let rate = f64::from(hand.trajectory_hz);
    let mut limits = [Limits {
        low: -1.0,
        high: 1.0,
        velocity: 1.0,
        acceleration: 1.0,
        jerk: 1.0,
    }; ALL];
    for finger in 0..FINGERS {
        for joint in 0..JOINTS {
            if let (Some(entry), Some(place)) = (
                hand.joint(finger, joint),
                limits.get_mut(finger * JOINTS + joint),
            ) {
                *place = entry.limits.with_jerk(entry.limits.acceleration * rate);
            }
        }
    }
    limits
}
