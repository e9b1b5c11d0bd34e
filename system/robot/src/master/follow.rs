//! [`Follow`]: how well the joints follow each motion.

use core::fmt::Arguments;

use condor_hand::decimal::Decimal;
use condor_mbox::Region;
use condor_mbox::published::Publisher;
use condor_rt::Machine;
use zerocopy::FromZeros as _;

use super::drive::{SharedDrive, with};
use super::play::Title;
use super::servos::Servos;
use crate::queue::RequestIdentity;
use crate::servo::Figures;
use crate::tracking::TrackingReport;
use crate::{FINGERS, RobotDescription, objects};

/// The number of looks for the figures of a motion that has ended.
const LOOKS: u32 = 25;

/// A motion that runs, or whose figures are awaited.
struct Run {
    number: u64,
    title: Title,
    is_named: bool,
}

/// The tracking errors of the joints in the motion that runs, and in those before it.
pub(super) struct Follow<M: Machine> {
    running: Option<Run>,
    ended: Option<Run>,
    looks: u32,
    followed: TrackingReport,
    publisher: Publisher<TrackingReport, Region<M::Window>>,
}

impl<M: Machine> Follow<M> {
    pub(super) fn new(publisher: Publisher<TrackingReport, Region<M::Window>>) -> Self {
        Self {
            running: None,
            ended: None,
            looks: 0,
            followed: TrackingReport::new_zeroed(),
            publisher,
        }
    }

    /// Starts tracking the motion of `request`. Servo processors are told so with the next set-points.
    pub(super) fn begin(
        &mut self,
        shared: &SharedDrive<'_, M::Window>,
        request: RequestIdentity,
        title: &Title,
        is_named: bool,
    ) {
        let number = u64::from(request.session) << 32 | u64::from(request.number);
        self.running = Some(Run {
            number,
            title: title.clone(),
            is_named,
        });
        with(shared, |drive| drive.motion = number);
    }

    /// The motion that runs is broken off: its figures do not count.
    pub(super) fn cancel(&mut self, shared: &SharedDrive<'_, M::Window>) {
        with(shared, |drive| drive.motion = 0);
        self.running = None;
    }

    /// The motion that runs has ended.
    pub(super) fn end(&mut self, shared: &SharedDrive<'_, M::Window>) {
        with(shared, |drive| drive.motion = 0);
        if let Some(run) = self.running.take() {
            self.ended = Some(run);
            self.looks = LOOKS;
        }
    }

    /// Says how well a motion that has ended was followed, once all servo processors have told it.
    pub(super) fn look(
        &mut self,
        servos: &Servos<'_, '_, M>,
        hand: &RobotDescription,
        say: impl Fn(Arguments<'_>),
    ) {
        let Some(run) = &self.ended else {
            return;
        };
        let Some(figures) = figures(servos, run.number) else {
            self.looks = self.looks.saturating_sub(1);
            if self.looks == 0 {
                // A processor is gone, or has seen another motion end since.
                self.ended = None;
            }
            return;
        };
        if let Some(worst) = figures.worst()
            && let Some(finger) = hand.fingers.get(worst.finger)
            && let Some(joint) = finger.joints.get(worst.joint)
        {
            say(format_args!(
                "{}: largest tracking error {:.2} deg, at {}.{} (rms {:.2} deg)",
                run.title,
                Decimal(worst.peak_rad.to_degrees()),
                finger.name,
                joint.name,
                Decimal(worst.rms_rad.to_degrees()),
            ));
        }
        if run.is_named {
            self.followed.add(&run.title, &figures);
            // After an error the reader finds the former value.
            let _ = self.publisher.publish(&self.followed);
        }
        self.ended = None;
    }
}

/// The figures of a motion that has ended, of the fingers of all servo processors.
fn figures<M: Machine>(servos: &Servos<'_, '_, M>, number: u64) -> Option<Figures> {
    let mut all = Figures::default();
    for (processor, region) in servos.regions() {
        let cell = objects::tracking(region).ok()??;
        let tracking = cell.subscriber(region).ok()?.read().ok()?.value;
        let figures = tracking.ended(number)?;
        for finger in (0..FINGERS).filter(|&it| servos.processor(it) == processor) {
            all.merge_finger(finger, figures);
        }
    }
    Some(all)
}
