//! [`LogShare`]: the limit on the output of a program that goes into the log.

use std::time::{Duration, Instant};

/// The greatest number of lines of a program that are logged in a [`SPAN`]; further lines are
/// counted.
pub(super) const LINES: u32 = 100;
const SPAN: Duration = Duration::from_secs(1);
/// The pause in reading a program that wrote more than the supervisor can read in a turn. The
/// program waits during the pause, once its pipe is full.
const REST: Duration = Duration::from_millis(20);

/// The share of the log, and of the supervisor's time, that a program has had.
#[derive(Debug, Default)]
pub(super) struct LogShare {
    /// The beginning of the span whose lines are counted.
    since: Option<Instant>,
    told: u32,
    left_out: u64,
    rests_until: Option<Instant>,
}

impl LogShare {
    /// Returns true if the next line is logged.
    pub(super) fn takes_line(&mut self, now: Instant) -> bool {
        self.since.get_or_insert(now);
        if self.told < LINES {
            self.told += 1;
            return true;
        }
        self.left_out += 1;
        false
    }

    /// Begins a new span if it is time to. Returns the number of lines that were left out in the
    /// previous span, if there were any.
    pub(super) fn turn(&mut self, now: Instant) -> Option<u64> {
        let is_over = self.since.is_some_and(|since| now >= since + SPAN);
        if !is_over {
            return None;
        }
        (self.since, self.told) = (None, 0);
        let left_out = core::mem::take(&mut self.left_out);
        (left_out > 0).then_some(left_out)
    }

    /// The program has more to say than a turn has time for.
    pub(super) fn rest(&mut self, now: Instant) {
        self.rests_until = Some(now + REST);
    }

    /// Whether the program is read now.
    pub(super) fn is_open(&self, now: Instant) -> bool {
        self.rests_until.is_none_or(|until| now >= until)
    }

    /// When something must be done, if nothing happens before.
    pub(super) fn due(&self, now: Instant) -> Option<Instant> {
        let rest = self.rests_until.filter(|until| now < *until);
        let span = self.since.filter(|_| self.left_out > 0);
        rest.into_iter().chain(span.map(|since| since + SPAN)).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_beyond_the_share_are_counted_and_the_next_second_begins_anew() {
        let (begun, mut hearing) = (Instant::now(), LogShare::default());
        for number in 0..500 {
            assert_eq!(hearing.takes_line(begun), number < LINES);
        }
        assert_eq!(hearing.turn(begun), None);
        let later = hearing.due(begun).expect("what was left out is said");
        assert_eq!(hearing.turn(later), Some(u64::from(500 - LINES)));
        assert_eq!(hearing.due(later), None);
        assert!(hearing.takes_line(later));
        assert_eq!(hearing.turn(later + SPAN), None);
    }

    #[test]
    fn who_says_too_much_is_not_read_for_a_while() {
        let (begun, mut hearing) = (Instant::now(), LogShare::default());
        assert!(hearing.is_open(begun));
        hearing.rest(begun);
        assert!(!hearing.is_open(begun));
        let due = hearing.due(begun).expect("it is read again");
        assert!(hearing.is_open(due));
        assert_eq!(hearing.due(due), None);
    }
}
