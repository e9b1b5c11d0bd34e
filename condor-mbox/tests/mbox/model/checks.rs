//! What must be true of a [`World`] whenever its processors have done something.

use condor_mbox::MailboxError;
use condor_mbox::layout::SLOTS;

use super::world::{Counts, HEARD, Heard, World, number, row};
use super::{LISTENER, MISSING, N, Step, VECTORS};

impl World {
    pub(super) fn check_refusal(&self, from: usize, to: usize, is_call: bool, error: MailboxError) {
        match error {
            MailboxError::NotConnected { .. } => {
                assert!(!self.seats[from].connected[to] && from != to);
            }
            MailboxError::NoSlot { .. } => {
                let full = self.rings[from][to].len() >= SLOTS as usize;
                let unanswered = self.unanswered(from, to) >= SLOTS as usize;
                // Its requests to be admitted take slots, too.
                assert!(full || is_call && unanswered || from == LISTENER);
            }
            MailboxError::Stalled { .. } => assert!(self.seats[to].stalled),
            MailboxError::PeerDied { .. } => assert!(self.seats[to].dead),
            _ => panic!("{error}"),
        }
    }

    /// Calls of `from` to `to` that may occupy reply cells.
    fn unanswered(&self, from: usize, to: usize) -> usize {
        let lives = (self.seats[from].incarnation, self.seats[to].incarnation);
        let calls = self.offers.iter().filter(|offer| offer.is_call);
        calls
            .filter(|offer| (offer.from, offer.to) == (from, to))
            .filter(|offer| (offer.from_incarnation, offer.to_incarnation) == lives)
            .filter(|offer| offer.is_open || !offer.handled)
            .count()
    }

    /// Checks what handlers saw since the last time.
    pub(super) fn check_heard(&mut self) {
        for heard in HEARD.take() {
            let Heard {
                me, from, to, data, ..
            } = heard;
            let offer = &mut self.offers[data as usize];
            assert_eq!(
                (from, to, heard.vector),
                (offer.from, offer.to, offer.vector)
            );
            let expected = if me == to {
                offer.handled = true;
                self.seats[me].counts[row(heard.vector)].handled += 1;
                &mut self.rings[from][to]
            } else {
                let hearing = self.hearing.as_mut().expect("nobody listens");
                assert_eq!((hearing.to, LISTENER), (to, me));
                &mut hearing.expected[from]
            };
            // Not in it: from another incarnation, or a second time, or after a later one.
            let before = expected.iter().position(|next| *next == data);
            let before = before.unwrap_or_else(|| panic!("{me} got {data} of {from} to {to}"));
            let skipped: Vec<_> = expected.drain(..=before).take(before).collect();
            for data in skipped {
                let has_handler = self.offers[data as usize].vector != MISSING;
                if me == to {
                    assert!(!has_handler, "{me} got a later one than {data} of {from}");
                } else if let Some(hearing) = &mut self.hearing {
                    hearing.skip(from, has_handler);
                }
            }
        }
    }

    /// Heals every fault and lets everybody run until nothing is left, which must be everything.
    pub(super) fn settle(&mut self) {
        for who in 0..N {
            self.step(&Step::DropRings(who, 0));
            self.step(&Step::Stall(who, false));
            self.step(&Step::Revive(who));
        }
        // The second round, if not the first, finds everybody connected.
        self.drain();
        self.drain();
        for from in 0..N {
            for to in 0..N {
                self.try_send(from, to, VECTORS[0]);
                self.begin(from, to, MISSING);
                assert!(self.seats[from].connected[to], "{from} to {to}");
            }
        }
        self.drain();
        for who in 0..N {
            self.poll(who);
            assert!(self.seats[who].tickets.is_empty());
        }
        for data in self.rings.iter().flatten().flatten() {
            assert_eq!(
                self.offers[*data as usize].vector, MISSING,
                "{data} is lost"
            );
        }
        self.check_missed();
        for who in 0..N {
            self.check_counts(who);
            // Breaks the circle of the system, the program and its mailbox.
            self.system.kill(number(who));
        }
    }

    pub(super) fn drain(&mut self) {
        while (0..N).map(|who| self.service(who)).sum::<usize>() > 0 {}
    }

    pub(super) fn check_missed(&mut self) {
        let Some(mut hearing) = self.hearing.take() else {
            return;
        };
        let mailbox = self.mailbox(LISTENER);
        for from in 0..N {
            for data in std::mem::take(&mut hearing.expected[from]) {
                hearing.skip(from, self.offers[data as usize].vector != MISSING);
            }
            let counted = mailbox.read().unwrap().missed(number(from)).unwrap();
            let (least, perhaps) = (hearing.missed[from], hearing.perhaps[from]);
            assert!(counted >= least, "{counted} of {least} are known");
            // Its own requests to be admitted count, too.
            assert!(counted <= least + perhaps || from == LISTENER);
        }
    }

    /// Everybody sees the counts of `who`, exactly.
    pub(super) fn check_counts(&self, who: usize) {
        let observer = self.mailbox((who + 1) % N);
        for (vector, expected) in VECTORS.iter().zip(self.seats[who].counts) {
            let observer = observer.read().unwrap();
            let found = observer.vector_statistics(number(who), *vector).unwrap();
            let counts = Counts {
                sent: found.sent,
                handled: found.handled,
                failed: found.failed,
            };
            assert_eq!(counts, expected, "{who} {vector}");
        }
    }
}
