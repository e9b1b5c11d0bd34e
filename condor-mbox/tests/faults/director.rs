//! Kills and stops the victim while the survivors talk to it.

use std::os::unix::process::ExitStatusExt;
use std::time::{Duration, Instant};

use condor_mbox::linux::{Claim, LinuxDoorbell, LinuxSystem, SystemError};
use condor_mbox::{Clock, Doorbell, Evidence};
use rustix::process::Signal;

use super::AnyError;
use super::board::{Aim, Board, Director, Survivor, Victim};
use super::process::Process;
use super::random::Random;
use super::talk::{LONG, N, SURVIVORS, VICTIM};

/// The moment of a kill lies this much after its aim was reached, at most.
const SPREAD: Duration = Duration::from_micros(300);
/// As much where there is no more precise aim.
const WIDE_SPREAD: Duration = Duration::from_millis(5);
/// A victim that is killed while it starts lives at most this long.
const START: Duration = Duration::from_millis(3);
/// How long calls wait for a victim that may be stopped: past it they must have ended.
const PATIENCE: Duration = Duration::from_millis(400);
/// Calls of each survivor that must end in an error while the victim is stopped.
const STALLS: u32 = 4;

/// The one who kills, and what it counted.
pub(crate) struct Scene<'s> {
    system: &'s LinuxSystem<N>,
    board: &'s Board,
    clock: LinuxDoorbell<N>,
    random: Random,
    victim: u32,
    /// Kills by aim, in the order of [`Aim::ALL`].
    pub(crate) kills: [u32; Aim::ALL.len()],
    /// Stops by aim.
    pub(crate) stops: [u32; Aim::ALL.len()],
    /// Claims of the number of a stopped victim that were refused.
    pub(crate) refused: u32,
    /// How long the kernel took to end each victim, in nanoseconds.
    pub(crate) ends: Vec<u32>,
    pub(crate) faults: u32,
}

impl<'s> Scene<'s> {
    pub(crate) fn new(
        system: &'s LinuxSystem<N>,
        board: &'s Board,
        claim: &Claim<N>,
        seed: u64,
    ) -> Self {
        Self {
            system,
            board,
            clock: claim.doorbell().clone(),
            random: Random::new(seed),
            victim: 0,
            kills: [0; Aim::ALL.len()],
            stops: [0; Aim::ALL.len()],
            refused: 0,
            ends: Vec::new(),
            faults: 0,
        }
    }

    /// Kills `count` victims, one after the other.
    pub(crate) fn kill(&mut self, count: u32) -> Result<(), AnyError> {
        self.be_patient(LONG);
        for number in 0..count {
            let choice = number as usize % Aim::ALL.len();
            self.kill_one(Aim::ALL[choice])?;
            self.kills[choice] += 1;
        }
        Ok(())
    }

    fn kill_one(&mut self, aim: Aim) -> Result<(), AnyError> {
        let mut victim = self.start(aim)?;
        let number = self.victim;
        let waited_for = self.random.below(SURVIVORS.len() as u32) as usize;
        match aim {
            Aim::Joining if self.random.below(2) == 0 => {
                let span = self.random.span(START);
                pause(span);
            }
            Aim::Joining => self.until("claim", |board| board.victim(Victim::Claimed) >= number)?,
            Aim::Handler | Aim::Sending | Aim::Nested | Aim::Idle | Aim::Anywhere => {
                self.reach(aim, waited_for)?;
            }
        }
        let spread = match aim {
            Aim::Sending | Aim::Anywhere => WIDE_SPREAD,
            _ => SPREAD,
        };
        let span = self.random.span(spread);
        pause(span);
        self.board.direct_time(Director::KilledAt, self.clock.now());
        self.board.direct(Director::Kills, number);
        let killed_at = Instant::now();
        victim.signal(Signal::KILL)?;
        let status = victim.wait()?;
        self.ends.push(killed_at.elapsed().as_nanos() as u32);
        if status.signal() != Some(Signal::KILL.as_raw()) {
            self.fault(&format!("victim {number} ended by itself: {status}"));
        }
        // Sometimes the next victim comes before the survivors have noticed.
        if aim != Aim::Joining && self.random.below(4) != 0 {
            self.until("notice of the death", |board| {
                SURVIVORS
                    .iter()
                    .all(|survivor| board.survivor(survivor.index(), Survivor::Noticed) >= number)
            })?;
        }
        Ok(())
    }

    /// Stops victims `count` times, past every deadline, and lets them go on.
    pub(crate) fn stop(&mut self, count: u32) -> Result<(), AnyError> {
        self.be_patient(PATIENCE);
        let victim = self.start(Aim::Idle)?;
        for number in 0..count {
            let choice = number as usize % Aim::ALL.len();
            self.stop_one(&victim, Aim::ALL[choice], number + 1)?;
            self.stops[choice] += 1;
        }
        self.board.direct_time(Director::KilledAt, self.clock.now());
        self.board.direct(Director::Kills, self.victim);
        drop(victim);
        Ok(())
    }

    fn stop_one(&mut self, victim: &Process, aim: Aim, stop: u32) -> Result<(), AnyError> {
        let board = self.board;
        let lives = board.victim(Victim::Leaving);
        board.direct(Director::Aim, aim as u32);
        let waited_for = self.random.below(SURVIVORS.len() as u32) as usize;
        for word in [Victim::Held, Victim::Sending] {
            board.set_victim(word, 0);
        }
        board.set_survivor(waited_for, Survivor::Nested, 0);
        self.reach(aim, waited_for)?;
        self.until("beginning of incarnations", |board| {
            aim != Aim::Joining || board.victim(Victim::Leaving) != lives
        })?;
        let span = self.random.span(SPREAD);
        pause(span);

        board.direct(Director::Stopping, stop);
        victim.stop()?;
        let stalls = SURVIVORS.map(|survivor| board.survivor(survivor.index(), Survivor::Stalls));
        board.direct(Director::Stopped, stop);
        self.until("ends of calls during a stop", |board| {
            SURVIVORS.iter().zip(stalls).all(|(survivor, stalls)| {
                board.survivor(survivor.index(), Survivor::Stalls) >= stalls + STALLS
            })
        })?;
        match self.system.claim_within(VICTIM, Duration::ZERO) {
            Err(SystemError::NumberTaken { process_id, .. }) if process_id == victim.id() => {
                self.refused += 1;
            }
            Ok(_) => self.fault("the number of a stopped process was given away"),
            Err(error) => self.fault(&format!("a claim during a stop: {error}")),
        }
        if self.clock.evidence(VICTIM) != Evidence::Alive {
            self.fault("a stopped process is not alive");
        }

        // Nothing goes on in the victim that would make a call wait.
        board.direct(Director::Aim, Aim::Idle as u32);
        board.direct(Director::Continued, stop);
        victim.signal(Signal::CONT)?;
        self.until("good replies after a stop", |board| {
            SURVIVORS
                .iter()
                .all(|survivor| board.survivor(survivor.index(), Survivor::Again) >= stop)
        })
    }

    /// Starts the next victim; unless it is to die while joining, it is up when this returns.
    fn start(&mut self, aim: Aim) -> Result<Process, AnyError> {
        self.victim += 1;
        let (board, number) = (self.board, self.victim);
        let first = if aim == Aim::Joining { aim } else { Aim::Idle };
        board.direct(Director::Aim, first as u32);
        board.direct_time(Director::SpawnedAt, self.clock.now());
        board.direct(Director::Victim, number);
        let victim = Process::start(&format!("victim {number}"), |command| {
            self.system.pass_to(command);
        })?;
        if aim != Aim::Joining {
            self.until("good replies after a rejoin", |board| {
                SURVIVORS
                    .iter()
                    .all(|survivor| board.survivor(survivor.index(), Survivor::Good) >= number)
            })?;
            board.direct(Director::Aim, aim as u32);
        }
        Ok(victim)
    }

    /// Waits until the victim does what the aim is.
    fn reach(&mut self, aim: Aim, survivor: usize) -> Result<(), AnyError> {
        let number = self.victim;
        self.until(aim.name(), |board| match aim {
            Aim::Handler => board.victim(Victim::Held) >= number,
            Aim::Sending => board.victim(Victim::Sending) >= number,
            Aim::Nested => board.survivor(survivor, Survivor::Nested) >= number,
            Aim::Idle | Aim::Joining | Aim::Anywhere => true,
        })
    }

    fn be_patient(&self, patience: Duration) {
        self.board
            .direct(Director::Patience, patience.as_millis() as u32);
    }

    fn until(&self, what: &str, is_true: impl Fn(&Board) -> bool) -> Result<(), AnyError> {
        let deadline = Instant::now() + 2 * LONG;
        while !is_true(self.board) {
            if Instant::now() > deadline {
                return Err(format!("victim {}: no {what}", self.victim).into());
            }
            pause(Duration::from_micros(20));
        }
        Ok(())
    }

    fn fault(&mut self, what: &str) {
        eprintln!("WRONG: {what}");
        self.faults += 1;
    }
}

pub(crate) fn pause(span: Duration) {
    std::thread::sleep(span);
}
