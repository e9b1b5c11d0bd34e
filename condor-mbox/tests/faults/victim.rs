//! The process that is killed and stopped.

use std::cell::Cell;
use std::sync::atomic::{AtomicU32, Ordering};

use condor_mbox::linux::{Claim, LinuxMailbox, LinuxSystem};
use condor_mbox::{Call, CriticalSection, MailboxError, Messenger, PeerState, Processor, Vector};

use super::AnyError;
use super::board::{Aim, Board, Director, Victim};
use super::random::Random;
use super::talk::{
    ASK_BACK, ASK_OTHER, COUNTED, ECHO, HOLD, LONG, N, NUMBERED, Numbered, QUESTION, SURVIVORS,
    VICTIM, answer, reply,
};

/// Plays victim number `number` until it is killed.
pub(crate) fn play(number: u32) -> Result<(), AnyError> {
    let claim = LinuxSystem::<N>::inherited()?.claim(VICTIM)?;
    let board = Board::new(&claim);
    board.set_victim(Victim::Claimed, number);
    let state = VictimState {
        board: &board,
        number,
        incarnation: AtomicU32::new(0),
        latest: [const { AtomicU32::new(0) }; N],
    };
    let mut random = Random::new(u64::from(number));
    loop {
        state.live(&claim, &mut random)?;
    }
}

/// What the handlers know.
struct VictimState<'b> {
    board: &'b Board,
    number: u32,
    incarnation: AtomicU32,
    /// The latest running number of every survivor.
    latest: [AtomicU32; N],
}

impl VictimState<'_> {
    /// One incarnation; it ends when the aim is the beginning of incarnations.
    fn live(&self, claim: &Claim<N>, random: &mut Random) -> Result<(), AnyError> {
        let board = self.board;
        let begun = board.victim(Victim::Begun) + 1;
        board.set_victim(Victim::Begun, begun);

        let echo = |call: &Call<'_>| {
            self.note(call);
            self.respond(call, Some(0))
        };
        let counted = |call: &Call<'_>| self.count(call);
        let ask_back = |call: &Call<'_>| self.pass_on(call, call.sender());
        let ask_other = |call: &Call<'_>| self.pass_on(call, Processor(1 - call.sender().0));
        let hold = |call: &Call<'_>| self.hold(call);
        let (windows, doorbell) = (claim.windows().clone(), claim.doorbell().clone());
        let mut mailbox = LinuxMailbox::new(VICTIM, windows, doorbell, CriticalSection)?;
        mailbox.set_vector(ECHO, &echo, "echo")?;
        mailbox.set_vector(COUNTED, &counted, "count")?;
        mailbox.set_vector(ASK_BACK, &ask_back, "ask the sender back")?;
        mailbox.set_vector(ASK_OTHER, &ask_other, "ask the other survivor")?;
        mailbox.set_vector(HOLD, &hold, "hold the caller")?;
        mailbox.join()?;

        let PeerState::Up { incarnation, .. } = mailbox.peer_state(VICTIM)? else {
            return Err("a mailbox that has joined is up".into());
        };
        self.incarnation.store(incarnation, Ordering::Relaxed);
        for survivor in SURVIVORS {
            for index in 1..4 {
                board.set_counted(survivor.index(), index, 0);
            }
            board.set_counted(survivor.index(), 0, incarnation);
        }
        board.set_victim(Victim::Incarnation, incarnation);
        board.set_victim(Victim::Left, board.victim(Victim::Leaving));
        board.set_victim(Victim::Done, begun);
        if board.aim() != Aim::Joining {
            board.set_victim(Victim::Ready, self.number);
            self.work(&mailbox, incarnation, random)?;
        }
        board.set_victim(Victim::Begun, begun + 1);
        board.set_victim(Victim::Leaving, board.victim(Victim::Leaving) + 1);
        // Dropped here, it leaves.
        Ok(())
    }

    /// Does what the aim is, until it is the beginning of incarnations.
    fn work(
        &self,
        mailbox: &LinuxMailbox<'_, N>,
        incarnation: u32,
        random: &mut Random,
    ) -> Result<(), MailboxError> {
        let talk = Talk {
            state: self,
            mailbox,
            incarnation,
            numbers: Default::default(),
        };
        loop {
            let sends = match self.board.aim() {
                Aim::Joining => return Ok(()),
                Aim::Sending => true,
                Aim::Anywhere => random.below(2) == 0,
                Aim::Idle | Aim::Handler | Aim::Nested => false,
            };
            if sends {
                self.board.set_victim(Victim::Sending, self.number);
                talk.send_some(random);
            } else {
                // A handler's calls do not wait longer than the wait that serves it. It ends with
                // the first request, so a new aim is seen.
                mailbox.serve(LONG)?;
            }
        }
    }

    /// The reply after `nested` was told.
    fn respond(&self, call: &Call<'_>, nested: Option<u32>) -> u32 {
        reply(
            call.vector(),
            call.data(),
            nested,
            self.incarnation.load(Ordering::Relaxed),
        )
    }

    /// Requests of one sender are started in order and once, whatever their vector.
    fn note(&self, call: &Call<'_>) {
        let latest = &self.latest[call.sender().index()];
        let former = latest.swap(call.data(), Ordering::Relaxed);
        if call.data() <= former {
            self.fault(&format!(
                "{} {} was started after {former}",
                call.sender(),
                call.data()
            ));
        }
        if call.addressee() != VICTIM {
            self.fault(&format!("got a message to {}", call.addressee()));
        }
    }

    fn count(&self, call: &Call<'_>) -> u32 {
        self.note(call);
        let sender = call.sender().index();
        let number = self.board.counted(sender, 1) + 1;
        if number == 1 {
            self.board.set_counted(sender, 2, call.data());
        }
        self.board.set_counted(sender, 3, call.data());
        self.board.set_counted(sender, 1, number);
        0
    }

    fn pass_on(&self, call: &Call<'_>, to: Processor) -> u32 {
        self.note(call);
        let told = call.send_with_reply(to, QUESTION, call.data(), LONG);
        self.judge(to, &told);
        if let Ok(told) = told
            && told != answer(call.data(), to)
        {
            self.fault(&format!("{to} answered {told:#x} to {}", call.data()));
        }
        self.respond(call, told.ok())
    }

    fn hold(&self, call: &Call<'_>) -> u32 {
        self.note(call);
        self.board.set_victim(Victim::Held, self.number);
        while self.board.aim() == Aim::Handler {
            std::thread::yield_now();
        }
        self.respond(call, Some(0))
    }

    /// The survivors neither die nor stall; but who was stopped may find its own time over.
    fn judge<T>(&self, to: Processor, outcome: &Result<T, MailboxError>) {
        let stopped = self.board.director(Director::Stopping) != 0;
        match outcome {
            Ok(_) => {}
            Err(
                MailboxError::TimedOut { .. }
                | MailboxError::Stalled { .. }
                | MailboxError::TooDeep { .. }
                | MailboxError::NoSlot { .. },
            ) if stopped => {}
            Err(error) => self.fault(&format!("a request to {to} ended with: {error}")),
        }
    }

    fn fault(&self, what: &str) {
        eprintln!("WRONG: victim {}: {what}", self.number);
        let faults = self.board.victim(Victim::Faults);
        self.board.set_victim(Victim::Faults, faults + 1);
    }
}

/// The victim's own messages in one incarnation.
struct Talk<'t, 'v> {
    state: &'t VictimState<'t>,
    mailbox: &'t LinuxMailbox<'v, N>,
    incarnation: u32,
    numbers: [Cell<u32>; SURVIVORS.len()],
}

impl Talk<'_, '_> {
    fn send_some(&self, random: &mut Random) {
        for (to, last) in SURVIVORS.into_iter().zip(&self.numbers) {
            for _ in 0..random.below(4) {
                let number = last.get() + 1;
                let word = Numbered::new(self.incarnation, number).word();
                let sent = self.mailbox.send(to, NUMBERED, word, LONG);
                self.state.judge(to, &sent);
                if sent.is_ok() {
                    last.set(number);
                }
            }
            self.ask(to, random.below(u32::MAX), QUESTION);
        }
    }

    fn ask(&self, to: Processor, data: u32, vector: Vector) {
        let told = self.mailbox.send_with_reply(to, vector, data, LONG);
        self.state.judge(to, &told);
        if let Ok(told) = told
            && told != answer(data, to)
        {
            self.state
                .fault(&format!("{to} answered {told:#x} to {data:#x}"));
        }
    }
}
