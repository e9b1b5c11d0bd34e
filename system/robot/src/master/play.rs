//! [`Player`]: the motion that runs, and the one that is recorded.

use core::fmt::{self, Arguments, Write as _};

use condor_hand::trajectory::image::MotionSequence;
use condor_hand::trajectory::{
    Happening, MotionEnd, MotionError, MotionGuard, MotionProgress, MotionTicket, ProfileLimits,
    StreamEnd, Target,
};
use condor_hand::{ImageError, Subject};

use super::drive::{ALL, Drive, Motion, SharedDrive, with};
use super::sequence::Sequence;
use super::words::{GuardText, MotionName, Problem};
use crate::RobotDescription;
use crate::joints::{JointName, JointNumbers};
use crate::queue::{RefusalReason, RequestState};

/// The title of a motion.
pub(super) type Title = heapless::String<136>;
/// Motions that the generator has, or that it has ended since it was asked last.
const GIVEN: usize = 64;

/// The motion that runs, and the one that is recorded or loaded.
pub(super) struct Player {
    limits: [ProfileLimits; ALL],
    running: Sequence,
    /// Its name, while it runs.
    title: Option<Title>,
    /// The number of the first motion that the generator does not have yet.
    next: u32,
    /// The place of that motion in the sequence.
    place: usize,
    /// A motion that runs alone, until the generator has it.
    single: Option<Motion>,
    count: u32,
    /// Motions that the generator has and has not ended.
    tickets: heapless::Vec<MotionTicket, GIVEN>,
    /// Whether what runs is a stream.
    is_stream: bool,
    /// A bit for each finger that what runs moves.
    fingers: u32,
    /// The sequence that is recorded, or was loaded.
    pub(super) kept: Sequence,
    /// The name that it was given.
    pub(super) kept_title: MotionName,
    pub(super) is_recording: bool,
    is_held: bool,
    /// The end of the motion that runs, as far as it is known.
    end: (RequestState, RefusalReason),
}

/// The end of a motion of which nothing else is known.
const DONE: (RequestState, RefusalReason) = (RequestState::Done, RefusalReason::None);

impl Player {
    pub(super) const fn new(limits: &[ProfileLimits; ALL], joints: usize) -> Self {
        Self {
            limits: *limits,
            running: Sequence::new(joints),
            title: None,
            next: 0,
            place: 0,
            single: None,
            count: 0,
            tickets: heapless::Vec::new(),
            is_stream: false,
            fingers: 0,
            kept: Sequence::new(joints),
            kept_title: MotionName::new(),
            is_recording: false,
            is_held: false,
            end: DONE,
        }
    }

    /// The name of the motion that runs.
    pub(super) fn title(&self) -> Option<&str> {
        self.title.as_deref()
    }

    /// The number of its motions that have begun, and the number of all.
    pub(super) fn progress<W>(&self, shared: &SharedDrive<'_, W>) -> (u32, u32) {
        let waits = |&&ticket: &&MotionTicket| {
            let progress = with(shared, |drive| drive.generator.progress(ticket));
            matches!(progress.flatten(), Some(MotionProgress::Queued { .. }))
        };
        let waiting = self.tickets.iter().filter(waits).count() as u32;
        (self.next.saturating_sub(waiting), self.count)
    }

    /// Returns true if the motion that runs moves a finger.
    pub(super) const fn moves(&self, finger: usize) -> bool {
        self.title.is_some() && self.fingers >> finger & 1 == 1
    }

    /// The fraction of the motion that is done, in 0..=1; `None` for a stream, whose points are still to come.
    pub(super) fn done<W>(&self, shared: &SharedDrive<'_, W>) -> Option<f64> {
        if self.count == 0 {
            return None;
        }
        let first = self.tickets.first();
        let first =
            first.and_then(|&ticket| with(shared, |drive| drive.generator.progress(ticket)));
        let part = match first.flatten() {
            Some(MotionProgress::Running { fraction, .. }) => fraction,
            _ => 0.0,
        };
        let ended = self.next.saturating_sub(self.tickets.len() as u32);
        Some((f64::from(ended) + part) / f64::from(self.count))
    }

    /// Forgets what runs.
    pub(super) fn stop(&mut self) {
        self.title = None;
        (self.next, self.count, self.place) = (0, 0, 0);
        self.single = None;
        self.tickets.clear();
        (self.is_stream, self.fingers) = (false, 0);
    }

    /// Returns the room for the next motion; call [`begin`](Self::begin) then.
    pub(super) fn room(&mut self) -> &mut Sequence {
        self.stop();
        &mut self.running
    }

    /// The kept sequence is to run.
    pub(super) fn take_kept(&mut self) {
        self.stop();
        self.running.copy(&self.kept);
    }

    /// A single motion is to run.
    pub(super) fn put(&mut self, motion: Motion) {
        self.stop();
        self.running.clear();
        self.single = Some(motion);
    }

    /// Returns the fingers that the sequence in [`room`](Self::room) moves, a bit for each.
    ///
    /// # Errors
    /// Returns the [`Problem`] if the robot cannot make one of the motions, or if there is none.
    pub(super) fn fingers(&self, hand: &RobotDescription) -> Result<u32, Problem<'static>> {
        let motions = self.running.motions().map_err(Problem::Offered)?;
        check(hand, motions.iter())
    }

    /// Sets the name of the sequence that is recorded or loaded.
    pub(super) fn name_kept(&mut self, name: &str) {
        self.kept_title.clear();
        // Names are short enough.
        let _ = self.kept_title.push_str(name);
    }

    /// Runs the sequence or the motion that is there, which moves these fingers.
    pub(super) fn begin(
        &mut self,
        title: Title,
        fingers: u32,
    ) -> Result<(), ImageError<MotionError>> {
        let motions = match &self.single {
            Some(_) => None,
            None => Some(self.running.motions()?),
        };
        self.count = motions.as_ref().map_or(1, MotionSequence::len);
        if self.is_recording {
            let sequence = motions.iter().flat_map(MotionSequence::iter);
            for motion in self.single.iter().cloned().chain(sequence) {
                self.kept.push(&motion)?;
            }
        }
        self.title = Some(title);
        self.fingers = fingers;
        self.is_held = false;
        self.end = DONE;
        Ok(())
    }

    /// A stream runs, which moves these fingers.
    pub(super) fn begin_stream(&mut self, title: Title, fingers: u32) {
        self.stop();
        self.title = Some(title);
        (self.is_stream, self.fingers) = (true, fingers);
    }

    /// The limits of all joints.
    pub(super) const fn limits(&self) -> &[ProfileLimits; ALL] {
        &self.limits
    }

    /// Feeds the generator as many motions as it has room for, and reports events. Returns the motion that has
    /// ended and how, if one has.
    pub(super) fn play<W>(
        &mut self,
        hand: &RobotDescription,
        shared: &SharedDrive<'_, W>,
        mut say: impl FnMut(Arguments<'_>),
    ) -> Option<(Title, RequestState, RefusalReason)> {
        if self.is_stream {
            let end = with(shared, Drive::take_stream_end).flatten()?;
            let (state, reason) = match end {
                StreamEnd::Done => DONE,
                StreamEnd::Starved => (RequestState::Aborted, RefusalReason::Starved),
                StreamEnd::Aborted => (RequestState::Aborted, RefusalReason::Command),
            };
            let title = self.title.take().unwrap_or_default();
            self.stop();
            return Some((title, state, reason));
        }
        if let Err(error) = self.feed(hand, shared) {
            let number = self.next + 1;
            say(format_args!(
                "motion {number} is not possible, so the sequence stops: {}",
                Named(hand, error)
            ));
            return Some(self.break_off(shared, RefusalReason::FromHere));
        }
        while let Some(Some((finger, stop))) = with(shared, |drive| drive.stops.pop_front()) {
            if let Some(entry) = hand.fingers.get(finger) {
                say(format_args!("{}", GuardText { entry, stop }));
            }
        }
        // A generator that is idle at this moment has reported all ends already.
        let state = with(shared, |drive| {
            (drive.generator.is_idle(), drive.generator.is_held())
        });
        let (is_idle, is_held) = state.unwrap_or((false, self.is_held));
        while let Some(Some(event)) = with(shared, |drive| drive.generator.take_event()) {
            let is_start = matches!(event.happening, Happening::Started { .. });
            if is_start || !self.tickets.contains(&event.ticket) {
                continue;
            }
            self.tickets.retain(|it| *it != event.ticket);
            let reason = match event.happening {
                Happening::Refused(error) => {
                    say(format_args!(
                        "a motion of the sequence is not possible from the present position: {}",
                        Named(hand, error)
                    ));
                    RefusalReason::FromHere
                }
                Happening::Ended(MotionEnd::Stopped(guard)) => {
                    if guard == MotionGuard::Time {
                        say(format_args!(
                            "a motion of the sequence was stopped at its time limit"
                        ));
                    }
                    self.end.0 = RequestState::Stopped;
                    continue;
                }
                Happening::Ended(MotionEnd::Superseded { by }) if self.tickets.contains(&by) => {
                    continue;
                }
                Happening::Ended(MotionEnd::Reached) | Happening::Started { .. } => continue,
                // Joints were taken from it.
                Happening::Ended(MotionEnd::Aborted | MotionEnd::Superseded { .. }) => {
                    RefusalReason::Failure
                }
            };
            return Some(self.break_off(shared, reason));
        }
        if is_held && !self.is_held {
            say(format_args!("the motion waits: `resume` continues it"));
        }
        self.is_held = is_held;
        if is_idle && self.next >= self.count && !self.tickets.is_empty() {
            // The generator has lost events: nobody knows how these motions have ended.
            return Some(self.break_off(shared, RefusalReason::Failure));
        }
        if is_idle
            && self.next >= self.count
            && let Some(title) = self.title.take()
        {
            self.stop();
            return Some((title, self.end.0, self.end.1));
        }
        None
    }

    /// Passes as many motions to the generator as it has room for.
    ///
    /// # Errors
    /// Returns the error of a motion that the generator refuses.
    fn feed<W>(
        &mut self,
        hand: &RobotDescription,
        shared: &SharedDrive<'_, W>,
    ) -> Result<(), MotionError> {
        if self.title.is_none() || self.next >= self.count {
            return Ok(());
        }
        let motions = self.running.motions().ok();
        let (single, place) = (&mut self.single, &mut self.place);
        let tickets = &mut self.tickets;
        let fed = with(shared, |drive| {
            let next = || {
                let next = single.take();
                let mut motion = next.or_else(|| motions.as_ref()?.read(place))?;
                hand.rest_between_stops(&mut motion);
                Some(motion)
            };
            drive.generator.feed(core::iter::from_fn(next), tickets)
        });
        let (fed, result) = fed.unwrap_or((0, Ok(())));
        self.next += fed;
        result
    }

    /// Stops what runs, for a reason.
    fn break_off<W>(
        &mut self,
        shared: &SharedDrive<'_, W>,
        reason: RefusalReason,
    ) -> (Title, RequestState, RefusalReason) {
        with(shared, |drive| drive.generator.abort());
        let title = self.title.take().unwrap_or_default();
        self.stop();
        (title, RequestState::Aborted, reason)
    }
}

/// The error of a motion, with the name of its joint.
struct Named<'h>(&'h RobotDescription, MotionError);

impl fmt::Display for Named<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(hand, error) = *self;
        if let MotionError::Number(mut error) = error
            && let Subject::Joint(joint) = error.at
        {
            error.at = Subject::Whole;
            return write!(f, "{}: {error}", JointName(hand, joint.into()));
        }
        error.fmt(f)
    }
}

/// Returns the fingers that motions move, a bit for each.
///
/// # Errors
/// Returns the [`Problem`] if there is a guard of contact without a sensor, a target or via point beyond
/// the limits, or no motion.
pub(super) fn check(
    hand: &RobotDescription,
    motions: impl IntoIterator<Item = Motion>,
) -> Result<u32, Problem<'static>> {
    let numbers = JointNumbers::of(hand);
    let mut fingers = 0;
    for (number, motion) in (1..).zip(motions) {
        if motion.start.contact || motion.stop.contact {
            for (finger, entry) in hand.fingers.iter().enumerate() {
                let moves = motion.mask & numbers.mask(finger) != 0;
                if moves && entry.touch.is_none() {
                    let finger = entry.name.clone();
                    return Err(Problem::Guard { number, finger });
                }
            }
        }
        fingers |= numbers.fingers(motion.mask);
        for (joint, limits) in hand.trajectory_limits().enumerate() {
            if motion.mask >> joint & 1 == 0 {
                continue;
            }
            let Some(&Target::Absolute(target)) = motion.targets.get(joint) else {
                continue;
            };
            let vias = motion
                .vias
                .iter()
                .filter_map(|via| via.positions.get(joint));
            for &value in vias.chain([&target]) {
                if !limits.contains(value) {
                    let (low, high) = (limits.low, limits.high);
                    let mut name = heapless::String::new();
                    // The names of a description are short enough.
                    let _ = write!(name, "{}", JointName(hand, joint));
                    return Err(Problem::Beyond {
                        number,
                        joint: name,
                        value,
                        low,
                        high,
                    });
                }
            }
        }
    }
    if fingers == 0 {
        return Err(Problem::Nothing);
    }
    Ok(fingers)
}
