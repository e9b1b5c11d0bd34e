//! Orders and reports of grasps in the window of a servo processor.

use condor_mbox::published::{PublishedReadError, Publisher, Subscriber};
use condor_mbox::{AccessError, Allocator, MemoryWindow, Published, Region};

use super::HandLoop;
use super::words::{WordReader, WordWriter};
use crate::controller::FingerController;
use crate::dynamics::Dynamics;
use crate::grasp::distributed::{
    FingerControllers, GraspOrder, GraspReason, GraspReport, GraspState, MOST_FINGERS,
};

/// The number of ticks after which a report is published again if it says nothing new.
const REPORT_TICKS: u32 = 16;
/// The number of an order has a cache line of its own.
const NUMBER_BYTES: u32 = 64;

/// The words of the order and of the report of a hand with [`MOST_FINGERS`].
type OrderWords = [u32; GraspOrder::<MOST_FINGERS>::WORDS];
type ReportWords = [u32; 18 + 2 * MOST_FINGERS];

impl<const F: usize> GraspOrder<F> {
    /// The number of 32-bit words that [`put`](Self::put) writes for an order.
    pub const WORDS: usize = 2 * (87 + 3 * F);

    /// Writes the order as words of 32 bits to the beginning of `words`, which must have room for
    /// [`WORDS`](Self::WORDS): its fields one after another, with two words for each number, the
    /// low one first.
    pub fn put(&self, words: &mut [u32]) {
        WordWriter::into(words)
            .long(self.fingers)
            .numbers(self.stiffness.as_flattened())
            .numbers(self.damping.as_flattened())
            .numbers(&self.center)
            .numbers(&self.force)
            .numbers(&self.moment)
            .numbers(self.tips.as_flattened())
            .numbers(&[self.squeeze_n, self.posture_stiffness])
            .numbers(&[self.posture_damping, self.friction, self.ramp_s]);
    }

    /// Reads an order from the words that [`put`](Self::put) wrote; missing words count as zeros.
    #[must_use]
    pub fn take(words: &[u32]) -> Self {
        let mut taken = WordReader::from(words);
        Self {
            fingers: taken.long(),
            stiffness: core::array::from_fn(|_| taken.numbers()),
            damping: core::array::from_fn(|_| taken.numbers()),
            center: taken.numbers(),
            force: taken.numbers(),
            moment: taken.numbers(),
            tips: core::array::from_fn(|_| taken.numbers()),
            squeeze_n: taken.number(),
            posture_stiffness: taken.number(),
            posture_damping: taken.number(),
            friction: taken.number(),
            ramp_s: taken.number(),
        }
    }
}

impl<const F: usize> GraspReport<F> {
    fn words(&self) -> ReportWords {
        let mut words = ReportWords::default();
        WordWriter::into(&mut words)
            .words(&[self.state as u32, self.reason as u32])
            .long(self.order)
            .number(self.squeeze_share)
            .numbers(&self.deviation)
            .numbers(&self.margins);
        words
    }

    fn take(words: &ReportWords) -> Self {
        let mut taken = WordReader::from(words);
        Self {
            state: match taken.word() {
                1 => GraspState::Waiting,
                2 => GraspState::Holding,
                3 => GraspState::Refused,
                4 => GraspState::Left,
                _ => GraspState::Idle,
            },
            reason: match taken.word() {
                1 => GraspReason::Fingers,
                2 => GraspReason::Tuning,
                3 => GraspReason::Law,
                4 => GraspReason::Partner,
                5 => GraspReason::Fault,
                6 => GraspReason::Switched,
                _ => GraspReason::None,
            },
            order: taken.long(),
            squeeze_share: taken.number(),
            deviation: taken.numbers(),
            margins: taken.numbers(),
        }
    }
}

/// The places in the `data` of a servo processor at which a master writes the orders of a grasp,
/// and the servo loop writes its reports. The hand has `F` fingers.
///
/// Both processors must make the layout at the same offset and with the same `F`.
#[derive(Clone, Copy, Debug)]
pub struct GraspLayout<const F: usize> {
    /// The number of the latest order; stored after the order.
    number: u32,
    order: Published<OrderWords>,
    report: Published<ReportWords>,
}

impl<const F: usize> GraspLayout<F> {
    const BYTES: u32 =
        NUMBER_BYTES + Published::<OrderWords>::BYTES + Published::<ReportWords>::BYTES;

    /// Allocates room for orders and reports from `places`.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no room.
    pub const fn new(places: &mut Allocator) -> Result<Self, AccessError> {
        match places.bytes(Self::BYTES as usize) {
            Ok(offset) => Ok(Self::at(offset)),
            Err(error) => Err(error),
        }
    }

    /// Returns the layout that begins at `offset`, in bytes from the beginning of the users' region
    /// of the servo processor's `data`.
    #[must_use]
    pub const fn at(offset: u32) -> Self {
        const { assert!(F <= MOST_FINGERS) };
        let order = offset.wrapping_add(NUMBER_BYTES);
        Self {
            number: offset,
            order: Published::at(order),
            report: Published::at(order.wrapping_add(Published::<OrderWords>::BYTES)),
        }
    }

    /// Publishes an order of the master to the servo processor, and returns the number by which reports name the order.
    /// There must be only one master at a time.
    ///
    /// `region` is the users' region of the servo processor's `data` ([`Region::users`]).
    ///
    /// # Errors
    /// Returns [`AccessError`] if the places are not in the region, or if the memory cannot be written.
    pub fn give<W: MemoryWindow + Clone>(
        &self,
        order: &GraspOrder<F>,
        region: &Region<W>,
    ) -> Result<u64, AccessError> {
        let mut words = [0; GraspOrder::<MOST_FINGERS>::WORDS];
        order.put(&mut words);
        let number = self.order.publisher(region)?.publish(&words)?;
        region.set_word(self.number, number)?;
        Ok(number.into())
    }

    /// Reads the last report that the servo loop has published.
    ///
    /// # Errors
    /// [`PublishedReadError::Unpublished`] if there is no report yet, [`PublishedReadError::Contended`] if the servo
    /// loop writes too fast, [`PublishedReadError::Access`] if the memory cannot be accessed.
    pub fn report<W: MemoryWindow>(
        &self,
        region: &Region<W>,
    ) -> Result<GraspReport<F>, PublishedReadError> {
        let latest = self.report.subscriber(region)?.read()?;
        Ok(GraspReport::take(&latest.value))
    }

    /// Makes the part for the servo loop, which reads orders and publishes reports. Only orders
    /// that come after this call count. There must be only one such part at a time.
    ///
    /// `region` is the users' region of the servo processor's own `data` ([`Region::users`]).
    ///
    /// # Errors
    /// [`AccessError`] if the places are not in the region, or if the memory cannot be accessed.
    pub fn servo_end<W: MemoryWindow + Clone>(
        &self,
        region: Region<W>,
    ) -> Result<GraspEnd<W, F>, AccessError> {
        Ok(GraspEnd {
            orders: self.order.subscriber(region.clone())?,
            reports: self.report.publisher(region.clone())?,
            number: self.number,
            seen: region.word(self.number)?,
            region,
            reported: GraspReport::NOTHING,
            quiet: REPORT_TICKS,
        })
    }
}

/// The part of a [`GraspLayout`] for the servo loop, which reads the orders of the master and
/// publishes the reports.
#[derive(Debug)]
pub struct GraspEnd<W, const F: usize> {
    region: Region<W>,
    number: u32,
    orders: Subscriber<OrderWords, Region<W>>,
    reports: Publisher<ReportWords, Region<W>>,
    seen: u32,
    reported: GraspReport<F>,
    quiet: u32,
}

impl<W: MemoryWindow, const F: usize> GraspEnd<W, F> {
    /// Returns the latest order and its number if an order has come since the last call; otherwise
    /// `None`. Call it once per tick, and pass the result to the grasp in
    /// [`GraspInputs`](crate::grasp::distributed::GraspInputs).
    pub fn order(&mut self) -> Option<(u64, GraspOrder<F>)> {
        let number = self.region.word(self.number).ok()?;
        if number == self.seen {
            return None;
        }
        // If it cannot be read whole, the next tick looks again.
        let latest = self.orders.read().ok()?;
        self.seen = number;
        Some((number.into(), GraspOrder::take(&latest.value)))
    }

    /// Publishes a report if its [event](GraspReport::event) has changed; otherwise only in every
    /// 16th call. Call it once per tick.
    pub fn tell(&mut self, report: &GraspReport<F>) {
        let is_news = report.event() != self.reported.event();
        self.reported = *report;
        self.quiet = self.quiet.saturating_add(1);
        if is_news || self.quiet >= REPORT_TICKS {
            self.quiet = 0;
            // If it fails, readers get the report before.
            let _: Result<u32, AccessError> = self.reports.publish(&report.words());
        }
    }
}

impl<M, W, const F: usize, const N: usize> FingerControllers<M, N> for HandLoop<'_, M, W, F, N>
where
    M: Dynamics<f64, N>,
    W: MemoryWindow,
{
    fn of_finger(&mut self, finger: usize) -> Option<&mut FingerController<M, N>> {
        self.controller_mut(finger)
    }
}
