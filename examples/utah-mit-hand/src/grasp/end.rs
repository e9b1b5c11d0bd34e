//! [`GraspEnd`]: what the outside tells a [`Grasp`](super::Grasp), and is told.

use condor_mbox::published::{Publisher, Subscriber};
use condor_mbox::{AccessError, MemoryWindow, Region};

use super::partner::{Heard, Partner};
use super::{GraspPlaces, Joints, Order, Report};
use crate::FINGERS;

/// The time without a publication after which a partner is silent, s.
const SILENT_S: f64 = 0.021;
/// Every which tick a report is published, if it says nothing new.
const REPORT_TICKS: u32 = 16;

/// What a law is told in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Told {
    /// The order that has come since the last tick, and its number.
    pub(crate) order: Option<(u64, Order)>,
    /// The joints of the fingers on other processors, of the tick before; none of one that is silent.
    pub(crate) others: Option<Joints>,
}

/// The end of a grasp in the window of its servo processor.
pub(crate) struct GraspEnd<'p, W> {
    region: Region<W>,
    places: GraspPlaces,
    orders: Subscriber<Order, Region<W>>,
    reports: Publisher<Report, Region<W>>,
    partners: &'p [Partner<W>],
    heard: [Heard<Joints>; FINGERS],
    period_s: f64,
    seen: u32,
    reported: Report,
    quiet: u32,
}

impl<'p, W: MemoryWindow + Clone> GraspEnd<'p, W> {
    /// `region` is that of the processor itself, `partners` are the other servo processors.
    pub(crate) fn new(
        region: Region<W>,
        places: GraspPlaces,
        partners: &'p [Partner<W>],
        period_s: f64,
    ) -> Result<Self, AccessError> {
        Ok(Self {
            orders: places.order.subscriber(region.clone())?,
            reports: places.report.publisher(region.clone())?,
            // What was ordered of a former life is not done.
            seen: region.word(places.number)?,
            region,
            places,
            partners,
            heard: [Heard::NOTHING; FINGERS],
            period_s,
            reported: Report::NOTHING,
            quiet: REPORT_TICKS,
        })
    }

    /// What there is to tell the law in the tick that was due at an instant, ns, so long after the last.
    pub(crate) fn hear(&mut self, due_ns: u64, elapsed_s: f64) -> Told {
        let mut others = None;
        for (partner, heard) in self.partners.iter().zip(&mut self.heard) {
            partner.read(heard, elapsed_s);
            if heard.age_s <= SILENT_S
                && let Some(joints) = heard.before(due_ns, self.period_s)
            {
                others.get_or_insert(Joints::default()).add(&joints);
            }
        }
        let order = self.look();
        Told { order, others }
    }

    /// The order that has come since the last tick.
    fn look(&mut self) -> Option<(u64, Order)> {
        let number = self.region.word(self.places.number).ok()?;
        if number == self.seen {
            return None;
        }
        // If it cannot be read whole, the next tick looks again.
        let latest = self.orders.read().ok()?;
        self.seen = number;
        Some((number.into(), latest.value))
    }

    /// Publishes what the law says, if it is news or time.
    pub(crate) fn tell(&mut self, report: &Report) {
        let is_news = report.news() != self.reported.news();
        self.reported = *report;
        self.quiet = self.quiet.saturating_add(1);
        if is_news || self.quiet >= REPORT_TICKS {
            self.quiet = 0;
            // Who reads finds the former one then.
            let _: Result<u32, AccessError> = self.reports.publish(report);
        }
    }
}
