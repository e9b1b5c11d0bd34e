//! Orders and reports of grasps in the window of a servo processor.

use condor_hand::grasp::distributed::{GraspOrder, GraspReport};
use condor_mbox::published::{PublishedReadError, Publisher, Subscriber};
use condor_mbox::{AccessError, Allocator, MemoryWindow, Published, Region};

use crate::packet::Packet;

/// The number of ticks after which a report is published again if it says nothing new.
const REPORT_TICKS: u32 = 16;
/// The number of an order has a cache line of its own.
const NUMBER_BYTES: u32 = 64;

type ReportPacket = Packet<GraspReport, 1, 120>;

/// The places in the `data` of a servo processor at which a master writes the orders of a grasp,
/// and the servo loop writes its reports. Both processors must make the layout at the same offset.
#[derive(Clone, Copy, Debug)]
pub struct GraspLayout {
    /// The number of the latest order; stored after the order.
    number: u32,
    order: Published<GraspOrder>,
    report: Published<ReportPacket>,
}

impl GraspLayout {
    const BYTES: u32 =
        NUMBER_BYTES + Published::<GraspOrder>::BYTES + Published::<ReportPacket>::BYTES;

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
        let order = offset.wrapping_add(NUMBER_BYTES);
        Self {
            number: offset,
            order: Published::at(order),
            report: Published::at(order.wrapping_add(Published::<GraspOrder>::BYTES)),
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
        order: &GraspOrder,
        region: &Region<W>,
    ) -> Result<u64, AccessError> {
        let number = self.order.publisher(region)?.publish(order)?;
        region.set_word(self.number, number)?;
        Ok(number.into())
    }

    /// Reads the last report that the servo loop has published.
    ///
    /// # Errors
    /// [`PublishedReadError::Unpublished`] if there is no report that this program can read,
    /// [`PublishedReadError::Contended`] if the servo loop writes too fast, [`PublishedReadError::Access`] if the memory
    /// cannot be accessed.
    pub fn report<W: MemoryWindow>(
        &self,
        region: &Region<W>,
    ) -> Result<GraspReport, PublishedReadError> {
        let latest = self.report.subscriber(region)?.read()?;
        (latest.value.value()).map_err(|_| PublishedReadError::Unpublished)
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
    ) -> Result<GraspEnd<W>, AccessError> {
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
pub struct GraspEnd<W> {
    region: Region<W>,
    number: u32,
    orders: Subscriber<GraspOrder, Region<W>>,
    reports: Publisher<ReportPacket, Region<W>>,
    seen: u32,
    reported: GraspReport,
    quiet: u32,
}

impl<W: MemoryWindow> GraspEnd<W> {
    /// Returns the latest order and its number if an order has come since the last call; otherwise
    /// `None`. Call it once per tick, and pass the result to the grasp in
    /// [`GraspInputs`](condor_hand::grasp::distributed::GraspInputs).
    pub fn order(&mut self) -> Option<(u64, GraspOrder)> {
        let number = self.region.word(self.number).ok()?;
        if number == self.seen {
            return None;
        }
        // If it cannot be read whole, the next tick looks again.
        let latest = self.orders.read().ok()?;
        self.seen = number;
        Some((number.into(), latest.value))
    }

    /// Publishes a report if its [event](GraspReport::event) has changed; otherwise only in every
    /// 16th call. Call it once per tick.
    pub fn tell(&mut self, report: &GraspReport) {
        let is_news = report.event() != self.reported.event();
        self.reported = *report;
        self.quiet = self.quiet.saturating_add(1);
        if is_news || self.quiet >= REPORT_TICKS {
            self.quiet = 0;
            // There is room for it. If it fails, readers get the report before.
            let _: Result<u32, AccessError> = self.reports.publish(&Packet::of(report));
        }
    }
}
