//! [`Table`]: how long a message takes, as in Table 1 of A. I. Memo 977; and [`Echo`], its other end.
//!
//! `table to=1,5 rounds=2000 after=0` measures messages to processors 1 and 5, once processor 0 has
//! measured. Each of them runs [`Echo`], or [`Table`], which answers, too. With the argument `sleep` a
//! processor never looks again and again for what comes, but sleeps until it is rung.

use core::time::Duration;

use condor_mbox::published::Publisher;
use condor_mbox::{Clock as _, Messenger, PeerState, Processor, Region, Vector, Waiting};
use condor_rt::{Background, Machine, MailboxOf, PROCESSORS, Program, ProgramError, Setup, users};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::arguments::{self, Peers};
use crate::{WRONG, late, published};

/// The name under which [`Times`] are published.
pub const NAME: &str = "times";

const NOTHING: Vector = Vector(11);
const INCREMENT: Vector = Vector(12);
const PATIENCE: Duration = Duration::from_secs(30);
const NAP: Duration = Duration::from_millis(20);

/// The program that measures.
#[derive(Clone, Copy, Debug, Default)]
pub struct Table;

/// The program that answers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Echo;

/// The times that messages to each processor have taken, ns; 0 where none were sent.
#[derive(Clone, Copy, Debug, Default, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Times {
    /// 1 if all has been measured.
    pub is_complete: u32,
    /// The time of a message without reply: that from the first of many to the end of the last one's
    /// handler, divided by their number.
    pub sent: [u32; PROCESSORS],
    /// The time of a message with reply: the median.
    pub replied: [u32; PROCESSORS],
}

impl Program for Echo {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        with_mailbox(machine, |background, _| attend(background))
    }
}

impl Program for Table {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let peers = Peers::of(machine, "to")?;
        let before = Peers::of(machine, "after")?;
        let rounds = arguments::number(machine, "rounds", 1000)?;
        with_mailbox(machine, |background, mut publisher| {
            let mailbox = background.mailbox();
            let mut times = Times::default();
            wait(machine, mailbox, before, |processor| {
                let region = users(machine, processor)?;
                let times: Option<Times> = published(&region, NAME)?;
                Ok(times.is_some_and(|times| times.is_complete == 1))
            })?;
            wait(machine, mailbox, peers, |processor| {
                let state = mailbox.peer_state(processor)?;
                Ok(matches!(
                    state,
                    PeerState::Up {
                        connected: true,
                        ..
                    }
                ))
            })?;
            for peer in peers.iter() {
                let (sent, replied) = measure(machine, mailbox, peer, rounds)?;
                for (row, value) in [(&mut times.sent, sent), (&mut times.replied, replied)] {
                    if let Some(cell) = row.get_mut(peer.index()) {
                        *cell = value;
                    }
                }
                background.print(format_args!(
                    "to processor {}: {sent} ns, with reply {replied} ns\n",
                    peer.0
                ));
            }
            times.is_complete = 1;
            publisher.publish(&times)?;
            attend(background)
        })
    }
}

/// Runs `body` in the background of a program that answers.
fn with_mailbox<M: Machine>(
    machine: &M,
    body: impl FnOnce(
        &Background<'_, M>,
        Publisher<Times, Region<M::Window>>,
    ) -> Result<(), ProgramError>,
) -> Result<(), ProgramError> {
    let mut setup = Setup::new(machine)?;
    let publisher = setup.publish::<Times>(NAME)?;
    if arguments::is_there(machine, "sleep") {
        setup.waiting(Waiting::Sleep);
    }
    setup
        .console()?
        .on(NOTHING, "nothing", &|_| 0)
        .on(INCREMENT, "increment", &|call| call.data().wrapping_add(1))
        .background(|background| body(background, publisher))
}

fn attend<M: Machine>(background: &Background<'_, M>) -> Result<(), ProgramError> {
    while !background.is_stopping() {
        background.serve(NAP)?;
    }
    Ok(())
}

/// Waits until something is so of all of them.
fn wait<M: Machine>(
    machine: &M,
    mailbox: &MailboxOf<'_, M>,
    processors: Peers,
    is_so: impl Fn(Processor) -> Result<bool, ProgramError>,
) -> Result<(), ProgramError> {
    let clock = machine.doorbell();
    for processor in processors.iter() {
        let deadline = clock.now().after(PATIENCE);
        while !is_so(processor)? {
            if clock.now() >= deadline || machine.is_stopping() {
                return Err(late(processor));
            }
            mailbox.serve(NAP)?;
        }
    }
    Ok(())
}

/// Rounds of which one time is taken, at most.
const MOST: usize = 4096;

/// Returns the time that a message takes without and with reply, ns.
fn measure<M: Machine>(
    machine: &M,
    mailbox: &MailboxOf<'_, M>,
    peer: Processor,
    rounds: u32,
) -> Result<(u32, u32), ProgramError> {
    let clock = machine.doorbell();
    let call = |data: u32| {
        let reply = mailbox.send_with_reply(peer, INCREMENT, data, PATIENCE)?;
        if reply == data.wrapping_add(1) {
            Ok(())
        } else {
            Err(ProgramError::program(&WRONG))
        }
    };
    let rounds = rounds.clamp(1, MOST as u32);
    for data in 0..rounds / 10 {
        call(data)?;
    }
    let mut times = [0_u32; MOST];
    for (data, time) in (0..rounds).zip(&mut times) {
        let begun = clock.now();
        call(data)?;
        *time = u32::try_from(clock.now().ns_since(begun)).unwrap_or(u32::MAX);
    }
    let taken = || times.iter().take(rounds as usize);
    let median = median(taken);
    let begun = clock.now();
    for data in 0..rounds {
        mailbox.send(peer, NOTHING, data, PATIENCE)?;
    }
    // This message is handled after all that were sent before.
    call(0)?;
    let all = clock.now().ns_since(begun);
    let each = u32::try_from(all / u64::from(rounds)).unwrap_or(u32::MAX);
    Ok((each, median))
}

/// Returns the value that half of all values are at most: bit by bit, since sorting can panic.
fn median<'t, T: Iterator<Item = &'t u32>>(times: impl Fn() -> T) -> u32 {
    let half = times().count() / 2;
    (0..u32::BITS).rev().fold(0, |median, bit| {
        let higher = median | 1 << bit;
        // There are as many as that below what has this bit.
        if times().filter(|&&time| time < higher).count() <= half {
            higher
        } else {
            median
        }
    })
}

#[cfg(test)]
mod tests {
    use super::median;

    #[test]
    fn median_is_the_one_in_the_middle() {
        let all = [7_u32, 3, 0, u32::MAX, 3, 9, 100, 8, 1];
        for len in 1..=all.len() {
            let mut sorted = all[..len].to_vec();
            sorted.sort_unstable();
            assert_eq!(median(|| all.iter().take(len)), sorted[len / 2], "{len}");
        }
    }
}
