//! The rules: which participant goes on first, and how it gets the turn.

use super::{LAG_NS, LOOK_NS, Line, NEVER, PASSING, Page, ends, holder_of, role};
use crate::handover::Handover;
use crate::obstacle::Obstacle;
use crate::sync::{Ordering, fence};

impl<const N: usize> Page<N> {
    /// Lets time go on after a change: if the turn is free, takes it for `me` and passes it to the participant that
    /// goes on first, if there is one. Any thread of `me` may call this at any moment.
    pub fn kick(&self, me: u8, by: &impl Handover) {
        // Pairs with the fence in `give`: either the last holder sees in its second look what the
        // caller has changed, or the caller sees here that the turn is free.
        fence(Ordering::SeqCst);
        if self.take(me | PASSING) {
            self.give(me | PASSING, by);
        }
    }

    pub(super) fn take(&self, me: u8) -> bool {
        let turn = self.turn.load(Ordering::Acquire);
        holder_of(turn).is_none() && self.pass(turn, Some(me)).is_some()
    }

    /// Passes the turn to `to`, if the word is still `turn`; returns the new word.
    pub(super) fn pass(&self, turn: u32, to: Option<u8>) -> Option<u32> {
        let count = (turn >> 8).wrapping_add(1) << 8;
        let next = count | to.map_or(0, |to| u32::from(to) + 1);
        // Release: the next holder finds all that this one wrote. Acquire: and this one what the
        // former ones wrote.
        self.turn
            .compare_exchange(turn, next, Ordering::AcqRel, Ordering::Relaxed)
            .is_ok()
            .then_some(next)
    }

    /// Takes the turn, for `me` to pass it on, from a holder that `is_over`; returns true if it did.
    pub(super) fn take_from(&self, me: u8, is_over: impl Fn(u8) -> bool) -> bool {
        // Pairs with the fence in `give`: the giver sees that nobody wants it, or this sees the turn.
        fence(Ordering::SeqCst);
        let turn = self.turn.load(Ordering::Acquire);
        let is_over = holder_of(turn).is_some_and(is_over);
        is_over && self.pass(turn, Some(me | PASSING)).is_some()
    }

    /// Whether `number` has no use for the turn: its program has ended, or does not ask for it any
    /// more.
    pub(super) fn is_void(&self, number: u8) -> bool {
        // Relaxed: the callers' fences order it.
        let no_wish = |line: &Line| line.next.load(Ordering::Relaxed) == NEVER;
        self.line(number)
            .is_some_and(|line| match self.role(number) {
                role::NOBODY => true,
                role::SERVICE | role::GUEST => no_wish(line),
                _ => false,
            })
    }

    /// Passes the turn of `me` to the participant that goes on first, which may be `me` itself.
    pub(super) fn give(&self, me: u8, by: &impl Handover) {
        loop {
            let turn = self.turn.load(Ordering::Relaxed);
            if holder_of(turn) != Some(me) {
                // The participant was buried and runs all the same: its actions concern nobody.
                return;
            }
            let first = match self.first(by) {
                Err(Obstacle::Idle) if by.is_closed() => self.anybody(),
                first => first.ok(),
            };
            if let Some((due, number)) = first {
                self.move_to(due, by);
                if number == me {
                    return;
                }
                let Some(granted) = self.pass(turn, Some(number)) else {
                    return;
                };
                if let Some(line) = self.line(number) {
                    // Release: pairs with the Acquire loads of `grants`.
                    line.grants.fetch_add(1, Ordering::Release);
                    by.wake(number, &line.grants);
                }
                // Pairs with the fence in `take_from`.
                fence(Ordering::SeqCst);
                // Only this turn: `number` may have had it, and a later incarnation of it another one.
                if !self.is_void(number) || self.pass(granted, Some(me)).is_none() {
                    return;
                }
            } else {
                if self.pass(turn, None).is_none() {
                    return;
                }
                // Pairs with the fence in `kick`.
                fence(Ordering::SeqCst);
                if self.first(by).is_err() || !self.take(me) {
                    return;
                }
            }
        }
    }

    /// Waits until `me` has the turn.
    pub(super) fn await_turn(&self, me: u8, by: &impl Handover) {
        let Some(line) = self.line(me) else {
            return;
        };
        let mut slept = false;
        loop {
            // Acquire: pairs with the Release addition in `give`.
            let grants = line.grants.load(Ordering::Acquire);
            if self.has_turn(me) {
                return;
            }
            let next = line.next.load(Ordering::Relaxed);
            // Before the look of `kick`, which so finds what has come due meanwhile.
            let pace = self.until_pace(next, by);
            if slept || (pace == 0 && self.speed() > 0) {
                // The last holder may have died before its second look, or time is to pass.
                self.kick(me, by);
                if self.has_turn(me) {
                    return;
                }
            }
            let look = if pace == 0 {
                LOOK_NS
            } else {
                pace.min(LOOK_NS)
            };
            by.sleep(&line.grants, grants, look);
            slept = true;
        }
    }

    /// Returns the instant and the number of the participant that goes on first, or the reason for
    /// which time stands.
    pub(super) fn first(&self, by: &impl Handover) -> Result<(u64, u8), Obstacle> {
        let holds = self.holds.load(Ordering::SeqCst);
        if holds != 0 {
            let of = holds.trailing_zeros() as u8;
            return Err(Obstacle::Entry { of });
        }
        // Before the processors, whom they may have rung.
        if let Some(number) = self.owing() {
            return Err(Obstacle::Service { number });
        }
        let (now, stop_at) = (self.now(), self.stop_at());
        let mut first: Option<(u64, bool, u8)> = None;
        for (number, line) in (0..).zip(&self.lines) {
            // Acquire: pairs with the Release stores of roles.
            let role = line.role.load(Ordering::Acquire);
            if role == role::NOBODY {
                continue;
            }
            let is_host = matches!(role, role::SERVICE | role::GUEST);
            // Acquire: pairs with the Release store in `set_next`.
            let mut due = line.next.load(Ordering::Acquire);
            // A part of the host waits for nothing else.
            let ends = if is_host {
                0
            } else {
                line.ends.load(Ordering::Relaxed)
            };
            // Acquire: pairs with the Release addition in `count_ring`.
            let rings = line.rings.load(Ordering::Acquire);
            if ends & ends::RING != 0 && rings != line.seen.load(Ordering::Relaxed) {
                due = now;
            }
            if ends & ends::STOP != 0 {
                due = due.min(stop_at);
            }
            if due != NEVER {
                let one = (due.max(now), is_host, number);
                first = Some(first.map_or(one, |first| first.min(one)));
            }
        }
        let (due, _, number) = first.ok_or(Obstacle::Idle)?;
        if due > self.limit() {
            return Err(Obstacle::Limit);
        }
        if due > now && self.until_pace(due, by) > 0 {
            return Err(Obstacle::Pace);
        }
        Ok((due, number))
    }

    /// A service that has not yet done all that it was rung for.
    ///
    /// Services ring each other, so one look at each is not enough. If the counts of the second walk
    /// are those of the first, no service had anything to do at the moment between the two.
    fn owing(&self) -> Option<u8> {
        // Acquire: pairs with the Release swap in `consumed`: whom it has rung by then is seen.
        let consumed = |line: &Line| line.consumed.load(Ordering::Acquire);
        let consumed = self.lines.each_ref().map(consumed);
        let mut lines = (0..).zip(&self.lines).zip(consumed);
        let owes = |(number, line): (u8, &Line), consumed| {
            // Acquire: pairs with the Release addition in `count_ring`.
            self.is_service(number) && line.rings.load(Ordering::Acquire) != consumed
        };
        let owing = lines.find(|&(line, consumed)| owes(line, consumed));
        owing.map(|((number, _), _)| number)
    }

    /// Whether the service `number` has something to do.
    pub(super) fn owes(&self, number: u8) -> bool {
        // Acquire: as in `owing`.
        self.line(number).is_some_and(|line| {
            line.consumed.load(Ordering::Acquire) != line.rings.load(Ordering::Acquire)
        })
    }

    /// Returns the processor with the least number, to which it is reported that no participant can
    /// ever go on.
    fn anybody(&self) -> Option<(u64, u8)> {
        let mut numbers = (0..).take(N);
        let number = numbers.find(|&number| self.is_processor(number));
        number.map(|number| (self.now(), number))
    }

    /// Returns the real time until `due`, in nanoseconds; 0 without a speed.
    fn until_pace(&self, due: u64, by: &impl Handover) -> u64 {
        let speed = self.speed();
        let wall = by.wall_ns().filter(|_| speed > 0);
        wall.map_or(0, |wall| self.pace_of(due, speed).saturating_sub(wall))
    }

    /// The real time that belongs to `due`.
    fn pace_of(&self, due: u64, speed: u64) -> u64 {
        let span = due.saturating_sub(self.pace_from.load(Ordering::Relaxed));
        let span = u128::from(span) * 1000 / u128::from(speed.max(1));
        let span = u64::try_from(span).unwrap_or(NEVER);
        self.pace_wall.load(Ordering::Relaxed).saturating_add(span)
    }

    /// Moves the time on to `due`; the caller has the turn.
    fn move_to(&self, due: u64, by: &impl Handover) {
        if due == self.now() {
            return;
        }
        self.now.store(due, Ordering::Relaxed);
        let speed = self.speed();
        if speed > 0
            && let Some(wall) = by.wall_ns()
            && wall > self.pace_of(due, speed).saturating_add(LAG_NS)
        {
            // The simulated time does not catch up with a lag as great as this.
            self.keep_pace_from(by);
        }
    }
}
