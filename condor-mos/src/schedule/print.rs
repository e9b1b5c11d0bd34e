//! The printed form of an [`EventTable`].

use core::fmt;

use super::EventTable;

/// Prints the events of one hyperperiod, with a mark under each rate that is due.
impl<const L: usize, const E: usize> fmt::Display for EventTable<L, E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let frequency = self.clock().frequency().as_hz();
        write!(f, "{:>12} {:>12}", "at µs", "gap µs")?;
        for number in self.set().ranks() {
            if let Some(rate) = self.rates().get(usize::from(*number)) {
                write!(f, " {rate:>10}")?;
            }
        }
        let mut at = 0_u64;
        for event in self.events() {
            // Below 2^53 ticks nothing is lost.
            #[allow(clippy::cast_precision_loss)]
            let microseconds = |ticks: u64| ticks as f64 * 1e6 / frequency;
            let gap = microseconds(event.gap.into());
            write!(f, "\n{:>12.1} {gap:>12.1}", microseconds(at))?;
            at += u64::from(event.gap);
            let last = u32::BITS - event.ranks.leading_zeros();
            for rank in 0..last {
                let mark = if event.ranks >> rank & 1 == 1 {
                    "•"
                } else {
                    ""
                };
                write!(f, " {mark:>10}")?;
            }
        }
        Ok(())
    }
}
