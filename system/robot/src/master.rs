//! The program of the master: trajectories, and what is typed at its terminal.
//!
//! Its loop makes set-points at the configuration's `trajectory_hz` and publishes them to the servos of
//! all processors. Its background watches them and obeys commands; `help` lists those. It takes no
//! arguments.
//!
//! A finger follows only after somebody has said `enable`, and from where it is then. The set-points of
//! every other one, and of joints in another mode, are where they are measured. When a processor is
//! restarted or a finger has a fault, the master says so, and all motion stops; it switches nothing on by
//! itself. A master that ends leaves the fingers to their servos, which let go when set-points stay away.
//!
//! | object | is |
//! |---|---|
//! | `console` | its terminal |
//! | `trajectories` | its loop: counts, variables, and its parameters, the limits of motions |
//! | `wanted-2` | a published [`DesiredPositions`] |
//! | `followed` | a published [`TrackingReport`]: how well the joints have followed each motion |
//! | `motions` | where its [queue](crate::motions) is asked |

use core::cell::{Cell, RefCell};
use core::time::Duration;

use condor_hand::config::MotionNumber;
use condor_hand::trajectory::{Generator, ProfileLimits};
use condor_mbox::{Clock, Processor};
use condor_rt::objects::ObjectKind;
use condor_rt::{Machine, MailboxOf, PROCESSORS, Program, ProgramError, Setup, users};
use condor_tty::{ConsoleError, LineEditor, TerminalSettings};
use condor_vars::{Var, VariableClient, Vars};
use critical_section::Mutex;
use embedded_io::{Read, ReadReady};

use crate::failure::Failure;
use crate::joints::JointNumbers;
use crate::motions::{MOTIONS, MotionResponse, MotionsBlocks};
use crate::numbers::{Number, NumberPlace, Numbers};
use crate::objects::MOTIONS_NAME;
use crate::{RobotDescription, start};

mod commands;
mod drive;
mod follow;
mod others;
mod play;
mod queue;
mod sequence;
mod servos;
mod words;

pub use crate::desired::{DesiredPositions, WANTED_NAME};
pub use crate::tracking::{FOLLOWED_NAME, TrackedMotion, TrackingReport};
pub use sequence::MOTION_BYTES;
pub use words::is_name;

use commands::{Commands, Processors, Watching};
use drive::{ALL, Drive, OfServos, ServoListener};
use follow::Follow;
use others::Others;
use play::Player;
use queue::{Post, Requests};
use sequence::Store;
use servos::Servos;

/// The time between two looks of the background at the servos.
const WATCH_NS: u64 = 100_000_000;
/// The time for which the first line that is typed waits for the fingers, so that it may be `enable`.
const FIRST_LINE: Duration = Duration::from_secs(2);
/// The time for which a command may wait for the file service, with restarts of it.
const FILES_TIMEOUT: Duration = Duration::from_secs(10);
/// The editor of what is typed: the longest line, bytes, and how many of them it keeps.
type Editor = LineEditor<160, 16>;
/// Whether the prompt, and what has been typed after it, stand in the last line of the terminal.
type Prompted = Cell<bool>;

/// The program of the master, which moves the fingers: it makes the set-points of motions, and executes the commands
/// that are typed at its terminal.
#[derive(Clone, Copy, Debug, Default)]
pub struct Master;

impl Program for Master {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let mut place = None;
        let hand = start::configured(machine, &mut place, |_, hand| Ok(hand))?;
        let (numbers, servo_indices) = servos::servo_indices(hand);
        let mut ears = OfServos::new();
        for &number in &numbers {
            // As many as there are.
            let _ = ears.push(ServoListener::new(&users(machine, Processor(number))?));
        }
        let rate_hz = hand.trajectory_hz;
        let period_s = 1.0 / f64::from(rate_hz);

        let mut setup = Setup::new(machine)?;
        let publisher = setup.publish_fields(WANTED_NAME)?;
        let followed = setup.publish(FOLLOWED_NAME)?;
        let limits = limits(hand);
        let middles = limits.map(|limits| f64::midpoint(limits.low, limits.high));
        let generator = Generator::new(limits, middles, period_s).map_err(Failure::from)?;
        let generator = generator.with_guards_in_servos();
        let drive = Drive::new(
            generator,
            JointNumbers::of(hand),
            servo_indices,
            &ears,
            publisher,
            period_s,
        );
        let shared = Mutex::new(RefCell::new(drive));
        let wanted = Vars::<f64, ALL>::numbered("joint", "rad");
        let wanted = wanted.about("Targets; joints in the order of the fingers.");
        let loose =
            Var::<u32>::new("loose", "").about("A bit for each finger that does not follow.");
        let rates = MotionRates::new(hand, rates(hand), f64::MIN..=f64::MAX);
        let mut taken = rates.version();
        let tuning = setup.place("tuning", ObjectKind::Other, |allocator| {
            let free = allocator.clone();
            allocator.bytes(VariableClient::<MailboxOf<'_, M>, M::Window>::BYTES)?;
            Ok(free)
        })?;
        let blocks = setup.place(MOTIONS_NAME, ObjectKind::Other, |allocator| {
            MotionsBlocks::new(allocator, PROCESSORS as u8)
        })?;
        let own = setup.own().clone();
        let post = Post::new();
        setup
            .console_with(&TerminalSettings::CBREAK)?
            .files()?
            .supervisor()?
            .on(MOTIONS, MOTIONS_NAME, &|call| {
                post.answer(call, &blocks, &own, |sender, identity, batch| {
                    drive::with(&shared, |drive| drive.take_points(sender, identity, batch))
                        .unwrap_or(Some(MotionResponse::Busy))
                })
            })
            .watch(&wanted)
            .watch(&loose)
            .fixed()
            .tune(&rates)
            .servo("trajectories", start::rate(rate_hz), &mut |_| {
                drive::with(&shared, |drive| {
                    let version = rates.version();
                    if version != taken && drive.set_rates(&rates) {
                        taken = version;
                    }
                    drive.tick();
                    let points = drive.generator.set_points();
                    for (joint, point) in points.iter().enumerate() {
                        wanted.set_at(joint, point.position);
                    }
                    loose.set(drive.loose_fingers());
                });
            })
            .background(|background| {
                background.print(format_args!(
                    "master of {}, trajectories at {rate_hz} Hz; `help` lists the commands\n",
                    hand.name
                ));
                let files = background.files()?;
                files.set_timeout(FILES_TIMEOUT);
                let prompted = Prompted::new(false);
                let commands = Commands {
                    hand,
                    prompted: &prompted,
                    numbers: JointNumbers::of(hand),
                    background,
                    shared: &shared,
                    servos: Servos::new(background, hand, &shared, &numbers, servo_indices)?,
                    player: Player::new(&limits, JointNumbers::of(hand).count()),
                    follow: Follow::new(followed),
                    closing: None,
                    store: Store(&files),
                    requests: Requests::new(&post, &files, background, hand),
                    processors: Processors::new(background.supervisor()?),
                    watching: Watching::new(),
                    others: Others::new(machine, hand, background.mailbox())?,
                    tuning,
                };
                attend(commands, &ears)
            })
    }
}

/// The background, until the program is to end.
fn attend<M: Machine>(
    mut commands: Commands<'_, '_, M>,
    ears: &[ServoListener<M::Window>],
) -> Result<(), ProgramError> {
    let background = commands.background;
    let clock = background.machine().doorbell();
    let mut watched = None;
    let patience = clock.now().after(FIRST_LINE);
    let mut listens = false;
    let mut editor = Editor::new().with_prompt("> ");
    start::attend(background, || {
        let now = clock.now();
        if !listens || watched.is_none_or(|at| now.ns_since(at) >= WATCH_NS) {
            watched = Some(now);
            for ears in ears {
                ears.look()?;
            }
            commands.watch()?;
            commands.follow_order();
        }
        commands.play();
        commands.show_watched()?;
        listens = listens || commands.sees_all() || now >= patience;
        if listens {
            listen(&mut commands, &mut editor)?;
        }
        Ok(())
    })
}

/// Takes what has been typed up to the end of a line, and obeys the line. The next line has its turn
/// after the messages and motions that wait.
fn listen<M: Machine>(
    commands: &mut Commands<'_, '_, M>,
    editor: &mut Editor,
) -> Result<(), ProgramError> {
    let background = commands.background;
    let terminal = background.console()?;
    let console = terminal.console(background.mailbox());
    let mut console = console.with_read_timeout(Duration::ZERO);
    let mut screen = terminal.console(background.mailbox());
    if !commands.is_watching() && !commands.prompted.replace(true) {
        // The terminal counts the bytes for which it has no room, here and below.
        let _ = editor.show(&mut screen);
    }
    // One at a time: an interrupt drops all that wait in the terminal.
    let mut byte = [0];
    while console.read_ready().unwrap_or(false) {
        match console.read(&mut byte) {
            Ok(_) => {
                if commands.is_watching() {
                    commands.end_watch();
                    commands.prompted.set(true);
                    let _ = editor.show(&mut screen);
                }
                let [byte] = byte;
                let mut complete = |before: &str, offer: &mut dyn FnMut(&str)| {
                    commands.complete(before, offer);
                };
                if let Ok(Some(line)) = editor.feed(byte, &mut complete, &mut screen) {
                    commands.prompted.set(false);
                    commands.obey(line.as_str());
                    return Ok(());
                }
            }
            Err(ConsoleError::Interrupted) => {
                commands.end_watch();
                editor.clear();
                background.print(format_args!("^C\n"));
                commands.prompted.set(false);
                commands.obey("abort");
                return Ok(());
            }
            Err(ConsoleError::Access(error)) => return Err(error.into()),
            Err(_) => break,
        }
    }
    Ok(())
}

/// The limits of motions of the joints, as parameters of the loop of trajectories.
type MotionRates<'h> = Numbers<'h, f64, { ALL * MotionNumber::ALL.len() }>;

/// The limits of motions of all joints.
fn rates(hand: &RobotDescription) -> impl Iterator<Item = Number<f64>> {
    hand.fingers.iter().enumerate().flat_map(|(finger, entry)| {
        let joints = entry.joints.iter().enumerate();
        joints.flat_map(move |(joint, entry)| {
            let limits = &entry.limits;
            MotionNumber::ALL.into_iter().map(move |number| Number {
                place: NumberPlace::Motion(finger as u8, joint as u8, number),
                value: number.of(limits),
                range: number.range(limits),
            })
        })
    })
}

/// The limits of all joints of the hand, which has as many.
fn limits(hand: &RobotDescription) -> [ProfileLimits; ALL] {
    let mut limits = [ProfileLimits {
        low: -1.0,
        high: 1.0,
        velocity: 1.0,
        acceleration: 1.0,
        jerk: 1.0,
    }; ALL];
    for (place, own) in limits.iter_mut().zip(hand.trajectory_limits()) {
        *place = own;
    }
    limits
}
