//! [`Order`]: what comes when, in one simulated time for all processors.
//!
//! Each of the processors that `peers=` names waits and asks the others by turns, `rounds=` times, above
//! two loops that send. It folds all that it sees, with its instants, into one number, which is also its
//! answer. In simulated time this number is the same in every run and on every kind of processor.

use core::sync::atomic::{AtomicU64, Ordering::Relaxed};
use core::time::Duration;

use condor_mbox::{Clock as _, Messenger as _, Vector};
use condor_mos::Rate;
use condor_rt::{Machine, Program, ProgramError, Setup};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::arguments::{self, Peers};

/// The name under which a [`Record`] is published.
pub const NAME: &str = "record";

/// The vectors of messages: of loops, without reply, and of backgrounds, with reply.
const TICK: Vector = Vector(13);
const ASK: Vector = Vector(14);
const PATIENCE: Duration = Duration::from_millis(20);
const LOOPS: [&str; 2] = ["fast", "slow"];
const RATES: [Rate; 2] = [Rate::hz(400), Rate::hz(100)];
/// The time between two looks of a program whether it must end.
const NAP: Duration = Duration::from_millis(50);

/// The program.
#[derive(Clone, Copy, Debug, Default)]
pub struct Order;

/// The results of the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Record {
    /// All values that were seen, folded.
    pub seen: u64,
    /// The instant of the last answer, in nanoseconds.
    pub at_ns: u64,
    /// Questions that were answered.
    pub answered: u32,
    /// Questions that were not answered.
    pub unanswered: u32,
    /// Releases of both loops.
    pub released: [u32; 2],
    /// Releases that were skipped.
    pub skipped: [u32; 2],
}

impl Program for Order {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let peers = Peers::of(machine, "peers")?;
        let rounds = arguments::number(machine, "rounds", 1000)?;
        let clock = machine.doorbell();
        let seen = Seen::default();
        let mut setup = Setup::new(machine)?;
        let mut publisher = setup.publish::<Record>(NAME)?;
        setup
            .on(TICK, "tick", &|call| {
                seen.fold([call.sender().0.into(), call.data().into()]);
                seen.fold([clock.now().as_ns()])
            })
            .on(ASK, "ask", &|call| {
                seen.fold([call.sender().0.into(), call.data().into()]);
                seen.fold([clock.now().as_ns()])
            })
            .servo(LOOPS[0], RATES[0], &mut |tick| {
                let last = seen.fold([tick.due.as_ns(), tick.number.into()]);
                if let Some(peer) = peers.nth(tick.number) {
                    let is_sent = tick.send(peer, TICK, last).is_ok();
                    seen.fold([is_sent.into()]);
                }
            })
            .servo(LOOPS[1], RATES[1], &mut |tick| {
                seen.fold([clock.now().as_ns(), tick.number.into()]);
            })
            .background(|background| {
                let mut record = Record::default();
                for round in 0..rounds {
                    let last = seen.fold([round.into()]);
                    let nap = Duration::from_micros((last % 4096).into());
                    let until = clock.now().after(nap);
                    while clock.now() < until {
                        background.serve(Duration::from_nanos(until.ns_since(clock.now())))?;
                    }
                    let Some(peer) = peers.nth(last) else {
                        continue;
                    };
                    let mailbox = background.mailbox();
                    match mailbox.send_with_reply(peer, ASK, last, PATIENCE) {
                        Ok(reply) => {
                            record.answered += 1;
                            seen.fold([reply.into()]);
                        }
                        Err(_) => record.unanswered += 1,
                    }
                }
                record.seen = seen.0.load(Relaxed);
                record.at_ns = clock.now().as_ns();
                for (place, name) in LOOPS.into_iter().enumerate() {
                    let counts = background.statistics(name)?;
                    for (row, count) in [
                        (&mut record.released, counts.released),
                        (&mut record.skipped, counts.skipped),
                    ] {
                        if let Some(cell) = row.get_mut(place) {
                            *cell = count as u32;
                        }
                    }
                }
                publisher.publish(&record)?;
                while !background.is_stopping() {
                    background.serve(NAP)?;
                }
                Ok(())
            })
    }
}

/// All that a processor has seen; its contexts interrupt each other only where one waits.
#[derive(Default)]
struct Seen(AtomicU64);

impl Seen {
    /// Folds words in, and returns some bits of the result.
    fn fold<const N: usize>(&self, words: [u64; N]) -> u32 {
        let seen = words.into_iter().fold(self.0.load(Relaxed), |seen, word| {
            (seen ^ word)
                .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .rotate_left(29)
        });
        self.0.store(seen, Relaxed);
        seen as u32
    }
}
