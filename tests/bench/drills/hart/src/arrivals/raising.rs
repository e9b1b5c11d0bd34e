//! [`Arrivals`]: simulates all boards of the target, and compares their requests with what the target has served.

use core::time::Duration;

use condor_dev::{Bus as _, InterruptVector};
use condor_mbox::{Clock as _, Messenger as _, Processor, Vector};
use condor_rt::{Background, Interrupts, Machine, Program, ProgramError, Raiser, Setup, users};

use super::{
    ALONE, CLAIMS, ECHO, FICKLE, NOTE, NOTES, RESTART, SHARED, STICKING, STRANGERS, STRIDE, STUCK,
    TICKS, UNHANDLED, compute, now, restart, word,
};

/// Nothing takes as long, unless something is broken.
const PATIENCE: Duration = Duration::from_secs(60);
/// The number of interrupts after which a vector without a board is disabled for good. A vector of boards is
/// disabled after as many in a row for which none of its boards has asked, but that does not happen here.
const TOO_MANY: u32 = 16;
/// The greatest number of times in a row that a vector is raised without a request that stays until it is served.
/// The target may count two more, whose requests it has served together with the one before.
const IN_A_ROW: u32 = 8;
/// The greatest number of interrupts in a burst, after which all requests must be served.
const BURST: u32 = 16;
/// The greatest number of interrupts at the end, when all vectors without a board are disabled: as many as that
/// takes, and for each vector one more, which must do nothing.
const LAST: u32 = STRANGERS.len() as u32 * (TOO_MANY + 1);
/// About as many turns as a restart takes.
const RESTART_TURNS: u32 = 12_000;
/// The greatest number of interrupts of a round in which a vector gets stuck.
const ROUND: u32 = BURST + 3;

/// The places of boards in [`Boards`](super::Boards).
const SINGLE: usize = 0;
const PAIR: [usize; 2] = [1, 2];
/// The first one gets stuck.
const STUCK_PAIR: [usize; 2] = [3, 4];
const WITHDRAWING: usize = 5;

/// A vector of boards.
struct Line {
    vector: u16,
    /// The number of times in a row that it was raised without a request that stays until it is served.
    in_a_row: u32,
    /// Whether a board has asked since all requests were served.
    has_asked: bool,
}

const fn line(vector: u16) -> Line {
    Line {
        vector,
        in_a_row: 0,
        has_asked: false,
    }
}

/// The program that simulates the boards.
///
/// Its arguments are the number of the target, the greatest number of interrupts that it raises, and the seed of
/// its random numbers.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Arrivals;

impl Program for Arrivals {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let number = |index| {
            let text = machine.argument(index);
            let number = text.and_then(|text| text.parse::<u64>().ok());
            number.ok_or_else(|| ProgramError::program(&"arguments: TARGET INTERRUPTS SEED"))
        };
        let (target, most, seed) = (number(0)? as u8, number(1)? as u32, number(2)?);
        let arrivals = |background: &Background<'_, M>| {
            background.print(format_args!("seed {seed}\n"));
            let mut raising = Raising {
                background,
                bus: machine.bus(),
                raiser: Raiser::new(machine),
                target: Processor(target),
                random: Random(seed.max(1)),
                most,
                raised: 0,
                asked: [0; 6],
                lines: [ALONE, SHARED, STICKING, FICKLE].map(line),
                held: 0,
                served: 0,
                notes: 0,
                echoes: 0,
                is_stuck: false,
                stuck: 0,
                restarts: 0,
                met: 0,
            };
            raising.all()
        };
        Setup::new(machine)?.console()?.background(arrivals)
    }
}

/// The boards, and what the target must have counted.
struct Raising<'r, M: Machine> {
    background: &'r Background<'r, M>,
    bus: M::Bus,
    raiser: Raiser<M>,
    target: Processor,
    random: Random,
    /// The greatest number of interrupts.
    most: u32,
    /// The number of interrupts that were raised.
    raised: u32,
    /// The number of requests of each board, by its place.
    asked: [u32; 6],
    lines: [Line; 4],
    /// The number of requests of the board that withdraws them.
    held: u32,
    /// The least number of interrupts that the target must have counted as served.
    served: u32,
    /// The number of messages without reply.
    notes: u32,
    /// The number of messages that were answered during bursts.
    echoes: u32,
    /// Whether the vector [`STICKING`] is disabled.
    is_stuck: bool,
    /// The number of times that it was.
    stuck: u32,
    /// The number of times that it was enabled again.
    restarts: u32,
    /// The number of restarts during which a request came.
    met: u32,
}

impl<M: Machine> Raising<'_, M> {
    fn all(&mut self) -> Result<(), ProgramError> {
        // The target answers when its boards are there.
        self.ask(NOTES, 0)?;
        let most = self.most.saturating_sub(LAST);
        while self.raised < most {
            if self.random.below(32) == 0 && self.raised.saturating_add(ROUND) <= most {
                self.get_stuck()?;
            } else {
                self.burst(most.saturating_sub(self.raised))?;
            }
        }
        self.disable_strangers()?;
        self.compare()
    }

    /// Raises some interrupts at random instants, and waits until all requests are served.
    ///
    /// Some bursts come with messages. In the others nothing but interrupts has the target look at its boards, so
    /// that a request whose interrupt is lost is never served.
    fn burst(&mut self, most: u32) -> Result<(), ProgramError> {
        let (mailbox, question) = (self.background.mailbox(), self.raised);
        let mut ticket = None;
        if self.random.below(4) == 0 {
            ticket = Some(mailbox.begin(self.target, ECHO, question, PATIENCE)?);
        }
        // Often one alone: in a long burst, a later interrupt may make up for a lost one.
        let longest = BURST >> self.random.below(8);
        let count = self.random.below(longest).saturating_add(1);
        for _ in 0..count.min(most) {
            if ticket.is_some() && self.random.below(4) == 0 {
                mailbox.send(self.target, NOTE, 0, PATIENCE)?;
                self.notes += 1;
            }
            self.event()?;
            self.pause();
        }
        self.wait_until_served()?;
        if let Some(mut ticket) = ticket {
            if ticket.wait(PATIENCE)? != Some(question.wrapping_add(1)) {
                return wrong(format_args!("{question} was answered wrongly"));
            }
            self.echoes += 1;
        }
        Ok(())
    }

    /// Raises one interrupt.
    fn event(&mut self) -> Result<(), ProgramError> {
        match self.random.below(64) {
            0..=15 => self.request(&[SINGLE]),
            16..=19 => self.request(&PAIR[..1]),
            20..=23 => self.request(&PAIR[1..]),
            24..=35 => self.request(&PAIR),
            36..=39 => self.request(&STUCK_PAIR[..1]),
            40..=43 => self.request(&STUCK_PAIR[1..]),
            44..=52 => {
                let vector = self.one_of([ALONE, SHARED, STICKING]);
                if self.comes_for_nothing(vector) {
                    self.raise(vector);
                    return Ok(());
                }
                self.request(&[SINGLE])
            }
            53 => {
                let vector = self.one_of(STRANGERS);
                self.raise(vector);
                Ok(())
            }
            _ => self.withdraw(),
        }
    }

    /// Has boards of one vector ask, and raises the vector once.
    fn request(&mut self, boards: &[usize]) -> Result<(), ProgramError> {
        let mut vector = None;
        for &place in boards {
            let Some(asked) = self.asked.get_mut(place) else {
                continue;
            };
            *asked = asked.wrapping_add(1);
            let asked = *asked;
            self.write(place, word::ASKED, asked)?;
            vector = vector_of(place);
        }
        let Some(vector) = vector else { return Ok(()) };
        if let Some(line) = self.line(vector) {
            line.has_asked = true;
            line.in_a_row = 0;
        }
        self.raise(vector);
        Ok(())
    }

    /// Has a board ask. Then the board withdraws its request, served or not, or waits until it is served.
    fn withdraw(&mut self) -> Result<(), ProgramError> {
        self.held = self.held.wrapping_add(1);
        let held = self.held;
        self.write(WITHDRAWING, word::HOLDS, held)?;
        self.raise(FICKLE);
        if self.random.below(2) == 0 && self.comes_for_nothing(FICKLE) {
            self.pause();
        } else {
            let seen = || Ok(self.read(WITHDRAWING, word::SEEN)? == held);
            self.until(seen, || self.lost(WITHDRAWING))?;
            self.served += 1;
            if let Some(line) = self.line(FICKLE) {
                line.in_a_row = 0;
            }
        }
        self.write(WITHDRAWING, word::HOLDS, 0)
    }

    /// Has a board ask for ever, which disables its vector, and has the target enable the vector again.
    fn get_stuck(&mut self) -> Result<(), ProgramError> {
        let [sticking, _] = STUCK_PAIR;
        self.write(sticking, word::HOLDS, 1)?;
        self.raise(STICKING);
        let expected = self.stuck.wrapping_add(1);
        let is_stuck = || Ok(self.ask(STUCK, STICKING)? == expected);
        self.until(is_stuck, || self.error("a vector is not disabled"))?;
        (self.stuck, self.is_stuck) = (expected, true);
        // Other boards are served, and the loop runs.
        let ticks = self.ask(TICKS, 0)?;
        self.burst(BURST)?;
        let goes_on = || Ok(self.ask(TICKS, 0)?.wrapping_sub(ticks) >= 2);
        self.until(goes_on, || self.error("the loop stands"))?;
        self.write(sticking, word::HOLDS, 0)?;
        self.restart()
    }

    /// Has the target enable the vector again. A request comes before that, or at about the same time, or both.
    fn restart(&mut self) -> Result<(), ProgramError> {
        let clock = self.background.machine().doorbell();
        let mailbox = self.background.mailbox();
        let early = self.random.below(3) == 0;
        if early {
            self.request_of_stuck()?;
        }
        self.restarts = self.restarts.wrapping_add(1);
        let number = self.restarts;
        let mut ticket = mailbox.begin(self.target, RESTART, number, PATIENCE)?;
        let is_ready = || Ok(self.read(0, restart::TARGET)? == number);
        self.until(is_ready, || self.error("the target does not restart"))?;
        self.write(0, restart::BOARDS, number)?;
        let mut requested = None;
        if !early || self.random.below(2) == 0 {
            compute(self.random.below(RESTART_TURNS));
            requested = Some(now(&clock));
            self.request_of_stuck()?;
        }
        self.is_stuck = false;
        self.wait_until_served()?;
        let ended = ticket.wait(PATIENCE)?.unwrap_or_default();
        // Such instants wrap.
        let begun = self.read(0, restart::BEGUN)?;
        let is_meanwhile = |at: u32| at.wrapping_sub(begun) <= ended.wrapping_sub(begun);
        self.met += u32::from(requested.is_some_and(is_meanwhile));
        Ok(())
    }

    fn request_of_stuck(&mut self) -> Result<(), ProgramError> {
        let board = self.one_of(STUCK_PAIR);
        self.request(&[board])
    }

    /// Waits until all requests are served. Only looks at the memory of the boards: a message would have the target
    /// look at its boards.
    fn wait_until_served(&mut self) -> Result<(), ProgramError> {
        for (place, &asked) in self.asked.iter().enumerate() {
            if self.is_stuck && STUCK_PAIR.contains(&place) {
                continue;
            }
            let is_served = || Ok(self.read(place, word::SERVED)? == asked);
            self.until(is_served, || self.lost(place))?;
        }
        for line in &mut self.lines {
            if !(self.is_stuck && line.vector == STICKING) {
                // By at least one interrupt: before, these boards had no request.
                self.served += u32::from(line.has_asked);
                line.has_asked = false;
            }
        }
        Ok(())
    }

    /// Raises each vector without a board until it is disabled, and once more.
    fn disable_strangers(&mut self) -> Result<(), ProgramError> {
        for vector in STRANGERS {
            let mut count = self.ask(UNHANDLED, vector)?;
            while count < TOO_MANY {
                self.raise(vector);
                let has_come = || Ok(self.ask(UNHANDLED, vector)? > count);
                self.until(has_come, || self.error("an unhandled interrupt is lost"))?;
                count = self.ask(UNHANDLED, vector)?;
            }
            self.raise(vector);
        }
        Ok(())
    }

    /// Compares what the target has counted with what was raised.
    fn compare(&self) -> Result<(), ProgramError> {
        let target = users(self.background.machine(), self.target)?;
        let published = || drills::published::<Interrupts, _>(&target, Interrupts::NAME);
        let sum = |counts: &Interrupts| counts.served + counts.unclaimed + counts.unhandled;
        // The target publishes its counts from time to time.
        let is_new = || {
            let claims = self.ask(CLAIMS, 0)?;
            Ok(published()?.is_some_and(|counts| sum(&counts) == claims))
        };
        self.until(is_new, || self.error("the counts are not published"))?;
        let Some(counts) = published()? else {
            return Err(self.error("there are no counts"));
        };
        let strangers = STRANGERS.len() as u32;
        let is_named = |vector: &&u16| counts.unhandled_vectors.contains(&i32::from(**vector));
        let named = STRANGERS.iter().filter(is_named).count() as u32;
        let [stuck, other, ..] = counts.stuck_vectors;
        let notes = self.ask(NOTES, 0)?;
        let equal = [
            ("unhandled", counts.unhandled, strangers * TOO_MANY),
            ("unhandled vectors named", named, strangers),
            ("times stuck", counts.stuck, self.stuck + strangers),
            ("named as stuck", stuck.cast_unsigned(), STICKING.into()),
            ("named as stuck, too", other.cast_unsigned(), u32::MAX),
            ("unhandled causes", counts.unhandled_causes, 0),
            ("notes", notes, self.notes),
            // Interrupts merge: how many depends on the instants at which they come.
            (
                "served at least",
                counts.served.min(self.served),
                self.served,
            ),
            (
                "interrupts at most",
                sum(&counts).max(self.raised),
                self.raised,
            ),
        ];
        for (what, counted, expected) in equal {
            if counted != expected {
                return wrong(format_args!("{what}: {counted}, not {expected}"));
            }
        }
        self.background.print(format_args!(
            "{} interrupts raised: {} served, {} unclaimed, {} unhandled, {} spurious; {} times stuck, \
             {} requests while their vector was enabled again; {} notes, {} echoes\nended: all is right\n",
            self.raised,
            counts.served,
            counts.unclaimed,
            counts.unhandled,
            counts.spurious,
            self.stuck,
            self.met,
            self.notes,
            self.echoes
        ));
        Ok(())
    }

    fn raise(&mut self, vector: u16) {
        self.raised += 1;
        self.raiser.raise(self.target, InterruptVector(vector));
    }

    /// Counts an interrupt by a vector whose boards may not be asking when it is served. Returns false if there have
    /// been too many in a row.
    fn comes_for_nothing(&mut self, vector: u16) -> bool {
        let Some(line) = self.line(vector) else {
            return false;
        };
        let may_come = line.in_a_row < IN_A_ROW;
        line.in_a_row += u32::from(may_come);
        may_come
    }

    fn line(&mut self, vector: u16) -> Option<&mut Line> {
        self.lines.iter_mut().find(|line| line.vector == vector)
    }

    /// Lets a random time pass: in half of all cases none, and rarely a long one.
    fn pause(&mut self) {
        let longest = 1 << self.random.below(14);
        if self.random.below(2) == 0 {
            compute(self.random.below(longest));
        }
    }

    fn one_of<T: Copy + Default, const N: usize>(&mut self, choices: [T; N]) -> T {
        let chosen = self.random.below(N as u32) as usize;
        choices.get(chosen).copied().unwrap_or_default()
    }

    /// Asks the target a question, which may be about an interrupt vector.
    fn ask(&self, question: Vector, about: u16) -> Result<u32, ProgramError> {
        let mailbox = self.background.mailbox();
        Ok(mailbox.send_with_reply(self.target, question, about.into(), PATIENCE)?)
    }

    fn read(&self, place: usize, word: usize) -> Result<u32, ProgramError> {
        let value = self.bus.read32(place * STRIDE + word);
        value.map_err(|error| ProgramError::program(&error))
    }

    fn write(&self, place: usize, word: usize, value: u32) -> Result<(), ProgramError> {
        let written = self.bus.write32(place * STRIDE + word, value);
        written.map_err(|error| ProgramError::program(&error))
    }

    /// Waits until something is so, without sleeping. If that takes too long, returns the error that `late` makes.
    fn until(
        &self,
        is_so: impl Fn() -> Result<bool, ProgramError>,
        late: impl FnOnce() -> ProgramError,
    ) -> Result<(), ProgramError> {
        let machine = self.background.machine();
        let clock = machine.doorbell();
        let deadline = clock.now().after(PATIENCE);
        while !is_so()? {
            self.background.mailbox().beat()?;
            if clock.now() >= deadline || machine.is_stopping() {
                return Err(late());
            }
        }
        Ok(())
    }

    /// The error of a request that is not served.
    fn lost(&self, place: usize) -> ProgramError {
        let asked = self.asked.get(place).copied().unwrap_or_default();
        let served = self.read(place, word::SERVED).unwrap_or_default();
        ProgramError::program(&format_args!(
            "board {place} is not served: {served} of {asked} requests, after {} interrupts",
            self.raised
        ))
    }

    fn error(&self, what: &str) -> ProgramError {
        ProgramError::program(&format_args!("{what} after {} interrupts", self.raised))
    }
}

/// The vector of a board.
fn vector_of(place: usize) -> Option<u16> {
    let vectors = [ALONE, SHARED, SHARED, STICKING, STICKING, FICKLE];
    vectors.get(place).copied()
}

fn wrong(what: core::fmt::Arguments<'_>) -> Result<(), ProgramError> {
    Err(ProgramError::program(&what))
}

/// Random numbers, by an xorshift of a state that is not 0.
struct Random(u64);

impl Random {
    /// Returns a number below `limit`, or 0 if that is 0.
    fn below(&mut self, limit: u32) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        let high = self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 32;
        ((high * u64::from(limit)) >> 32) as u32
    }
}
