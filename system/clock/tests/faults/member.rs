//! What the children do, until they are killed.

use std::sync::atomic::Ordering::SeqCst;

use condor_clock::linux::Futex;
use condor_clock::{LOOPS, LocalClock, NEVER, Page};

use super::AnyError;
use super::shared::{PROCESSORS, Random, SERVICE, Shared};

pub(crate) fn play(shared: &Shared, number: u8, seed: u64) -> Result<(), AnyError> {
    shared.page.check()?;
    if number == SERVICE {
        serve(shared)
    } else {
        Processor {
            shared,
            clock: LocalClock::new(number, &shared.page, Futex::new(), [0; LOOPS]),
            random: Random(seed),
        }
        .run()
    }
}

/// Rings whom it was told to ring.
fn serve(Shared { page, board }: &Shared) -> ! {
    let by = Futex::new();
    page.serve(SERVICE);
    loop {
        let seen = page.rings(SERVICE);
        for number in 0..PROCESSORS {
            let seat = board.seat(number);
            let told = seat.told.load(SeqCst);
            if seat.done.load(SeqCst) != told {
                page.ring(SERVICE, number, &by);
                seat.done.store(told, SeqCst);
            }
        }
        page.consumed(SERVICE, seen, &by);
        if page.has_turn(SERVICE) {
            page.finish(SERVICE, &by);
        }
        page.doze(SERVICE, seen, &by);
    }
}

struct Processor<'s> {
    shared: &'s Shared,
    clock: LocalClock<&'s Page, Futex>,
    random: Random,
}

impl Processor<'_> {
    fn run(mut self) -> ! {
        let (number, board) = (self.clock.number(), &self.shared.board);
        self.clock.announce(0);
        self.clock.begin();
        loop {
            let now = self.clock.now();
            board.take(number, now);
            let seen = self.clock.rings();
            let mut is_rung = false;
            for _ in 0..self.random.below(3) {
                let other = self.random.below(PROCESSORS.into()) as u8;
                match self.random.below(3) {
                    0 => self.clock.ring(other),
                    1 => self.tell(other),
                    _ => {
                        self.ask();
                        is_rung = true;
                        continue;
                    }
                }
                board.ring(other, now);
                is_rung |= other == number;
            }
            let until = now + self.random.below(20);
            let hears = self.random.below(2) == 0;
            let due = if is_rung && hears { now } else { until };
            board.give(number, due, hears);
            if hears {
                self.clock.wait(seen, until, None);
            } else {
                self.clock.pass(until - now);
            }
        }
    }

    /// Has the service ring `number`.
    fn tell(&self, number: u8) {
        let by = self.clock.handover();
        self.shared.board.seat(number).told.fetch_add(1, SeqCst);
        self.shared.page.ring(self.clock.number(), SERVICE, by);
    }

    /// Has the service ring this processor, and waits for that with the turn.
    fn ask(&self) {
        let seen = self.clock.rings();
        self.tell(self.clock.number());
        while self.clock.rings() == seen {
            self.clock.wait(seen, NEVER, Some(SERVICE));
        }
    }
}
