//! [`Partner`]: a value that another processor publishes, at any place.

use core::sync::atomic::{AtomicU32, Ordering};

use condor_mbox::{AccessError, MemoryWindow, Published, Region};
use condor_rt::objects::{self, ObjectKind};
use zerocopy::{FromBytes, IntoBytes};

/// An offset at which nothing is published: the object table is there.
const NOWHERE: u32 = 0;

/// A published value of another processor, found by its name.
///
/// The background [looks it up](Self::look) now and then, since a processor may start later, or start
/// anew with another program; the servo loop reads it.
#[derive(Debug)]
pub(crate) struct Partner<W> {
    region: Region<W>,
    name: &'static str,
    offset: AtomicU32,
}

/// A value with the time at which the tick was due that published it.
pub(crate) trait TickTime {
    /// The time at which the tick was due, in ns of the processor's clock.
    fn due_ns(&self) -> u64;
}

/// The value that a servo loop has read of a partner, and its age.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PartnerState<T> {
    /// The last value; none before the first.
    pub(crate) value: Option<T>,
    /// The value before the last.
    former: Option<T>,
    sequence: u32,
    /// The time since the last one was published, as far as this loop could see, s.
    pub(crate) age_s: f64,
}

impl<W: MemoryWindow + Clone> Partner<W> {
    pub(crate) const fn new(region: Region<W>, name: &'static str) -> Self {
        Self {
            region,
            name,
            offset: AtomicU32::new(NOWHERE),
        }
    }

    /// Looks up the place at which the value is published now.
    ///
    /// # Errors
    /// Returns [`AccessError`] if the memory cannot be accessed.
    pub(crate) fn look(&self) -> Result<(), AccessError> {
        let object = objects::find(&self.region, self.name, ObjectKind::Other)?;
        let offset = object.map_or(NOWHERE, |object| object.offset);
        // Relaxed: it says where to look, and the cell there says by itself what is published.
        self.offset.store(offset, Ordering::Relaxed);
        Ok(())
    }

    /// The latest value, for the loop that calls this in every tick, so long after the last one.
    pub(crate) fn read<T: FromBytes + IntoBytes + Copy>(
        &self,
        state: &mut PartnerState<T>,
        elapsed_s: f64,
    ) {
        state.age_s += elapsed_s;
        // Relaxed: pairs with the store of `look`.
        let offset = self.offset.load(Ordering::Relaxed);
        if offset == NOWHERE {
            return;
        }
        let Ok(cell) = Published::<T>::at(offset).subscriber(&self.region) else {
            return;
        };
        if let Ok(latest) = cell.read()
            && (state.value.is_none() || latest.sequence != state.sequence)
        {
            *state = PartnerState {
                value: Some(latest.value),
                former: state.value,
                sequence: latest.sequence,
                age_s: 0.0,
            };
        }
    }
}

impl<T> PartnerState<T> {
    pub(crate) const NOTHING: Self = Self {
        value: None,
        former: None,
        sequence: 0,
        age_s: f64::INFINITY,
    };
}

impl<T: TickTime + Copy> PartnerState<T> {
    /// The last value of a tick before this one, which was due at an instant, ns.
    ///
    /// Processors whose loops are due together read what the other has just published, or what it
    /// published the tick before, as it happens. This is always the latter.
    pub(crate) fn before(&self, due_ns: u64, period_s: f64) -> Option<T> {
        #[allow(
            clippy::cast_precision_loss,
            reason = "ticks are close together, or they differ"
        )]
        let is_of_this_tick = |value: &T| {
            let apart_ns = value.due_ns().abs_diff(due_ns);
            (apart_ns as f64) < 0.5e9 * period_s
        };
        self.value
            .filter(|value| !is_of_this_tick(value))
            .or(self.former)
    }
}
