//! A processor that goes on, whatever happens to the victim, and checks every word it is told.

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use condor_mbox::linux::{Claim, LinuxMailbox};
use condor_mbox::{
    Call, Clock, CriticalSection, MailboxError, Messenger, PeerState, Processor, Vector, Waiting,
};

use super::AnyError;
use super::board::{Aim, Board, Director, Survivor, Victim};
use super::judge::{Moment, Span};
use super::random::Random;
use super::record::{Count, Record, Series};
use super::talk::{
    ASK_BACK, ASK_OTHER, COUNTED, ECHO, HOLD, LONG, N, NUMBERED, Numbered, QUESTION, VICTIM,
    answer, failed_in, incarnation_of,
};

/// How long a call may last while the victim is stopped for certain.
const SHORT: Duration = Duration::from_millis(30);
/// How long a survivor goes on polling a ticket whose peer died.
const POLLED: Duration = Duration::from_millis(20);

/// Plays the survivor that holds `claim` until the director says that it is over.
pub(crate) fn play(claim: &Claim<N>, seed: u64) -> Result<(), AnyError> {
    let me = claim.number();
    let board = Board::new(claim);
    let record = Record::new(&board, me.index());
    let heard = AtomicU32::new(0);
    let pauses = AtomicU32::new(0);

    let question = |call: &Call<'_>| {
        if board.aim() == Aim::Nested {
            board.set_survivor(
                me.index(),
                Survivor::Nested,
                board.director(Director::Victim),
            );
            // Now and then long enough that the victim waits when it is killed.
            for _ in 0..pauses.fetch_add(1, Ordering::Relaxed) % 64 {
                std::thread::yield_now();
            }
        }
        answer(call.data(), me)
    };
    let numbered = |call: &Call<'_>| {
        let (former, next) = (heard.swap(call.data(), Ordering::Relaxed), call.data());
        let (former, next) = (Numbered::of(former), Numbered::of(next));
        if !next.may_follow(former) {
            record.fault(&format!("{next:?} came after {former:?}"));
        }
        0
    };
    let (windows, doorbell) = (claim.windows().clone(), claim.doorbell().clone());
    let mut mailbox = LinuxMailbox::new(me, windows, doorbell, CriticalSection)?;
    mailbox.set_waiting(Waiting::SpinThenSleep {
        spin: Duration::from_micros(20),
    });
    mailbox.set_vector(QUESTION, &question, "answer")?;
    mailbox.set_vector(NUMBERED, &numbered, "check numbers")?;
    mailbox.join()?;
    Player {
        me,
        mailbox: &mailbox,
        board: &board,
        record: &record,
        random: Random::new(seed),
        number: 0,
        acquainted: 0,
        tally: Tally::default(),
    }
    .go_on()
}

struct Player<'p, 'v> {
    me: Processor,
    mailbox: &'p LinuxMailbox<'v, N>,
    board: &'p Board,
    record: &'p Record<'p>,
    random: Random,
    /// The running number of the latest request.
    number: u32,
    /// The victim's latest incarnation that answered.
    acquainted: u32,
    tally: Tally,
}

/// Counted messages that certainly went to one incarnation of the victim.
#[derive(Default)]
struct Tally {
    incarnation: u32,
    sent: u32,
    latest: u32,
    /// The latest message to an earlier incarnation.
    before: u32,
    /// An incarnation to which some message may have gone, or to the one before.
    doubtful: u32,
}

impl Player<'_, '_> {
    fn go_on(mut self) -> Result<(), AnyError> {
        while self.board.director(Director::Over) == 0 {
            let victim = self.board.director(Director::Victim);
            let mine = |word| self.board.survivor(self.me.index(), word);
            let is_dead = self.board.director(Director::Kills) >= victim;
            let stopping = self.board.director(Director::Stopping);
            let is_new = mine(Survivor::Good) < victim || mine(Survivor::Again) < stopping;
            match self.board.aim() {
                Aim::Joining => self.anything(),
                _ if victim == 0 => drop(self.mailbox.serve(SHORT)?),
                _ if is_dead || is_new => self.ask(ECHO, 0),
                Aim::Idle => drop(self.mailbox.serve(Duration::from_millis(1))?),
                Aim::Handler => self.ask(HOLD, 0),
                Aim::Nested => self.nest(),
                Aim::Sending | Aim::Anywhere => self.anything(),
            }
        }
        Ok(())
    }

    fn anything(&mut self) {
        match self.random.below(5) {
            0 => self.ask(ECHO, 0),
            1 => self.count_together(),
            2 | 3 => self.nest(),
            _ => self.poll(),
        }
    }

    fn nest(&mut self) {
        if self.random.below(2) == 0 {
            self.ask(ASK_BACK, answer(self.number + 1, self.me));
        } else {
            let other = Processor(1 - self.me.0);
            self.ask(ASK_OTHER, answer(self.number + 1, other));
        }
    }

    /// Makes a call, checks its reply, and returns the incarnation that replied.
    fn call(&mut self, vector: Vector, nested: u32) -> Option<u32> {
        let number = self.next_number();
        let (outcome, span) = self.watched(true, |mailbox, patience| {
            mailbox.send_with_reply(VICTIM, vector, number, patience)
        });
        let value = self.accept(outcome, span)?;
        self.check_reply(value, vector, number, nested, span)
    }

    fn ask(&mut self, vector: Vector, nested: u32) {
        self.call(vector, nested);
    }

    /// Messages without reply, and then the victim's count of them.
    fn count_together(&mut self) {
        for _ in 0..=self.random.below(12) {
            let number = self.next_number();
            let waits = self.random.below(2) == 0;
            let (outcome, span) = self.watched(waits, |mailbox, patience| {
                if waits {
                    mailbox.send(VICTIM, COUNTED, number, patience)
                } else {
                    mailbox.send(VICTIM, COUNTED, number, Duration::ZERO)
                }
            });
            if self.accept(outcome, span).is_none() {
                return;
            }
            self.record.add(Count::Messages, 1);
            self.tally
                .note(number, span.before.incarnation, span.after.incarnation);
        }
        let Some(incarnation) = self.call(ECHO, 0) else {
            return;
        };
        let told = [0, 1, 2, 3].map(|index| self.board.counted(self.me.index(), index));
        let tally = &self.tally;
        if incarnation != tally.incarnation
            || told[0] != incarnation
            || self.board.victim(Victim::Incarnation) != incarnation
        {
            return;
        }
        self.record.add(Count::Audits, 1);
        if told[1] != tally.sent || told[3] != tally.latest || told[2] <= tally.before {
            self.record.fault(&format!(
                "incarnation {incarnation} got {} messages from {} to {}, but was sent {} after {} to {}",
                told[1], told[2], told[3], tally.sent, tally.before, tally.latest
            ));
        }
    }

    /// Calls as a servo loop makes them.
    fn poll(&mut self) {
        let mailbox = self.mailbox;
        let before = self.before();
        let patience = self.patience(&before);
        let mut tickets = Vec::new();
        for _ in 0..=self.random.below(4) {
            let number = self.next_number();
            let (outcome, span) = self.watched(false, |_, _| {
                mailbox.begin(VICTIM, ECHO, number, Duration::ZERO)
            });
            match self.accept(outcome, span) {
                Some(ticket) => tickets.push((number, ticket)),
                None => break,
            }
        }
        let deadline = before.at.after(patience);
        let mut dead_until = None;
        while !tickets.is_empty() {
            if let Err(error) = mailbox.serve(Duration::ZERO) {
                self.record.fault(&format!("service: {error}"));
            }
            tickets.retain_mut(|(number, ticket)| {
                let outcome = ticket.poll();
                if outcome == Ok(None) {
                    return true;
                }
                let span = self.span(before, true);
                if let Some(Some(value)) = self.accept(outcome, span) {
                    self.check_reply(value, ECHO, *number, 0, span);
                }
                false
            });
            let now = mailbox.doorbell().now();
            if now >= dead_until.unwrap_or(deadline) {
                if dead_until.is_none() && !tickets.is_empty() {
                    self.record.add(Count::Unanswered, 1);
                    let span = self.span(before, true);
                    if !span.sees_stop() {
                        self.record
                            .fault(&format!("no reply to a ticket: {span:#?}"));
                    }
                }
                return;
            }
            match mailbox.peer_state(VICTIM) {
                Ok(PeerState::Dead { .. }) if dead_until.is_none() => {
                    // A ticket sees only what the next incarnation will write; some wait for that.
                    dead_until = Some(now.after(self.random.span(POLLED)));
                    let span = self.span(before, true);
                    self.record.add(Count::SeenDead, 1);
                    if !span.sees_death() {
                        self.record
                            .fault(&format!("a living victim is Dead: {span:?}"));
                    }
                    self.notice(&span);
                }
                Ok(_) => {}
                Err(error) => self.record.fault(&format!("peer_state: {error}")),
            }
            std::thread::yield_now();
        }
    }

    fn next_number(&mut self) -> u32 {
        self.number += 1;
        self.number
    }

    fn before(&self) -> Moment {
        Moment::before(self.board, self.mailbox.doorbell().now())
    }

    fn span(&self, before: Moment, waits: bool) -> Span {
        let at = self.mailbox.doorbell().now();
        Span {
            before,
            after: Moment::after(self.board, at),
            waits,
            acquainted: self.acquainted == before.incarnation,
        }
    }

    fn patience(&self, before: &Moment) -> Duration {
        if before.is_stopped() {
            SHORT
        } else {
            Duration::from_millis(self.board.director(Director::Patience).into())
        }
    }

    fn watched<T>(
        &self,
        waits: bool,
        call: impl FnOnce(&LinuxMailbox<'_, N>, Duration) -> Result<T, MailboxError>,
    ) -> (Result<T, MailboxError>, Span) {
        let before = self.before();
        let patience = self.patience(&before);
        let outcome = call(self.mailbox, patience);
        let span = self.span(before, waits);
        let lasted = Duration::from_nanos(span.after.at.ns_since(before.at));
        let over = lasted.saturating_sub(patience);
        self.record.raise(
            Count::Overdue,
            u32::try_from(over.as_micros()).unwrap_or(u32::MAX),
        );
        if over > LONG {
            self.record
                .fault(&format!("a wait of {patience:?} lasted {lasted:?}"));
        }
        (outcome, span)
    }

    /// Counts an outcome and judges an error.
    fn accept<T>(&mut self, outcome: Result<T, MailboxError>, span: Span) -> Option<T> {
        let error = match outcome {
            Ok(value) => return Some(value),
            Err(error) => error,
        };
        self.record.add(Count::of(error), 1);
        if !span.justifies(error) {
            self.record.fault(&format!("{error}, during {span:#?}"));
        }
        if matches!(
            error,
            MailboxError::PeerDied { .. } | MailboxError::PeerRestarted { .. }
        ) {
            self.notice(&span);
        }
        if span.waits && span.before.is_stopped() {
            let stalls = self.board.survivor(self.me.index(), Survivor::Stalls) + 1;
            self.board
                .set_survivor(self.me.index(), Survivor::Stalls, stalls);
            if matches!(error, MailboxError::TimedOut { .. }) && !self.continued(&span) {
                self.record
                    .fault(&format!("{error}, but it was stopped: {span:#?}"));
            }
        }
        None
    }

    fn continued(&self, span: &Span) -> bool {
        span.after.continued != span.before.continued
            || self.board.director(Director::Continued) != span.before.continued
    }

    /// Measures how long it took to notice the latest kill, if this is the first notice of it.
    fn notice(&self, span: &Span) {
        let me = self.me.index();
        let killed_at = self.board.time(Director::KilledAt);
        let kills = span.after.kills;
        let is_first = self.board.survivor(me, Survivor::Noticed) < kills;
        // Another kill since then has another time.
        if !is_first || !span.sees_death() || self.board.director(Director::Kills) != kills {
            return;
        }
        if span.before.at <= killed_at {
            let took = span.after.at.ns_since(killed_at);
            self.record.sample(Series::Waiting, took);
        } else {
            let took = span.after.at.ns_since(span.before.at);
            self.record.sample(Series::Later, took);
        }
        self.board.set_survivor(me, Survivor::Noticed, kills);
    }

    /// Checks a reply; gives the incarnation that it came from.
    fn check_reply(
        &mut self,
        value: u32,
        vector: Vector,
        number: u32,
        nested: u32,
        span: Span,
    ) -> Option<u32> {
        let lives = span.before.incarnation..=span.after.last_incarnation;
        let incarnation = incarnation_of(value, vector, number, nested);
        if !lives.contains(&incarnation) {
            let is_failure = lives.contains(&failed_in(value, vector, number));
            if is_failure && self.board.director(Director::Stopping) != 0 {
                self.record.add(Count::FailedInside, 1);
                return None;
            }
            self.record.fault(&format!(
                "{vector} replied {value:#x} to {number} (failed: {is_failure}), during {span:#?}"
            ));
            return None;
        }
        self.record.add(Count::Replies, 1);
        self.acquainted = incarnation;
        let me = self.me.index();
        if incarnation == span.after.incarnation
            && span.after.ready > self.board.survivor(me, Survivor::Good)
        {
            let spawned_at = self.board.time(Director::SpawnedAt);
            let took = span.after.at.ns_since(spawned_at);
            self.record.sample(Series::Rejoin, took);
            self.board
                .set_survivor(me, Survivor::Good, span.after.ready);
        }
        if !span.before.is_stopped() {
            self.board
                .set_survivor(me, Survivor::Again, span.before.continued);
        }
        Some(incarnation)
    }
}

impl Tally {
    /// Notes message `number`, before and after which the victim's incarnation was this.
    fn note(&mut self, number: u32, incarnation_before: u32, incarnation_after: u32) {
        if incarnation_before != incarnation_after {
            self.doubtful = incarnation_after;
        } else if incarnation_before == self.incarnation {
            self.sent += 1;
            self.latest = number;
        } else if incarnation_before != self.doubtful {
            self.before = self.latest;
            (self.incarnation, self.sent, self.latest) = (incarnation_before, 1, number);
        }
    }
}
