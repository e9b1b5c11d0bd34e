//! [`Player`]: the motion that runs, and the one that is recorded.

use core::fmt::Arguments;

use condor_hand::queue::{Reason, State};
use condor_hand::trajectory::image::ImageError;
use condor_hand::trajectory::{Ended, Guard, Happening, Limits, Target};

use super::drive::{ALL, Motion, Shared, with};
use super::sequence::Sequence;
use super::words::{NAME_BYTES, Problem, Tripped};
use crate::{FINGERS, JOINTS, UtahMit};

pub(super) type Title = heapless::String<NAME_BYTES>;

/// The motion that runs, and the one that is recorded or loaded.
pub(super) struct Player {
    limits: [Limits<f64>; ALL],
    running: Sequence,
    /// Its name, while it runs.
    title: Option<Title>,
    /// The number of the first motion that the generator does not have yet.
    next: u32,
    count: u32,
    /// What is recorded, or was loaded.
    pub(super) kept: Sequence,
    /// The name that it was given.
    pub(super) kept_title: Title,
    pub(super) is_recording: bool,
    is_held: bool,
    /// How the motion that runs will have ended.
    end: (State, Reason),
}

/// How a motion ends of which nothing else is known.
const DONE: (State, Reason) = (State::Done, Reason::None);

impl Player {
    pub(super) const fn new(limits: &[Limits<f64>; ALL]) -> Self {
        Self {
            limits: *limits,
            running: Sequence::new(),
            title: None,
            next: 0,
            count: 0,
            kept: Sequence::new(),
            kept_title: Title::new(),
            is_recording: false,
            is_held: false,
            end: DONE,
        }
    }

    /// The name of the motion that runs.
    pub(super) fn title(&self) -> Option<&str> {
        self.title.as_deref()
    }

    /// How many of its motions the generator has taken, of how many.
    pub(super) const fn progress(&self) -> (u32, u32) {
        (self.next, self.count)
    }

    /// Forgets what runs.
    pub(super) fn stop(&mut self) {
        self.title = None;
        (self.next, self.count) = (0, 0);
    }

    /// Room for a motion that is to run; give it to [`begin`](Self::begin) then.
    pub(super) fn room(&mut self) -> &mut Sequence {
        self.stop();
        &mut self.running
    }

    /// The kept sequence is to run.
    pub(super) fn take_kept(&mut self) {
        self.stop();
        self.running.copy(&self.kept);
    }

    /// The fingers that the sequence which is to run moves, a bit for each.
    ///
    /// # Errors
    /// A guard of contact where no sensor is, a target or via point beyond the limits, no motion.
    pub(super) fn fingers(&self, hand: &UtahMit) -> Result<u32, Problem<'static>> {
        let motions = self.running.motions().map_err(Problem::Recording)?;
        let mut fingers = 0;
        for (number, motion) in (1..).zip(motions.iter()) {
            if motion.start.contact || motion.stop.contact {
                for (finger, entry) in hand.fingers.iter().enumerate() {
                    let moves = motion.mask >> (finger * JOINTS) & ((1 << JOINTS) - 1) != 0;
                    if moves && entry.touch.is_none() {
                        let finger = entry.name.clone();
                        return Err(Problem::Guard { number, finger });
                    }
                }
            }
            for (joint, limits) in self.limits.iter().enumerate() {
                if motion.mask >> joint & 1 == 0 {
                    continue;
                }
                fingers |= 1 << (joint / JOINTS);
                let Some(&Target::Absolute(target)) = motion.targets.get(joint) else {
                    continue;
                };
                let vias = motion
                    .vias
                    .iter()
                    .filter_map(|via| via.positions.get(joint));
                for &value in vias.chain([&target]) {
                    if !(limits.low <= value && value <= limits.high) {
                        let (low, high) = (limits.low, limits.high);
                        return Err(Problem::Beyond {
                            number,
                            joint,
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
        Ok(fingers & ((1 << FINGERS) - 1))
    }

    /// Runs the sequence that is there.
    pub(super) fn begin(&mut self, title: &str) -> Result<(), ImageError> {
        let motions = self.running.motions()?;
        self.count = motions.len();
        if self.is_recording {
            for motion in motions.iter() {
                self.kept.push(&motion)?;
            }
        }
        let mut name = Title::new();
        // Names are short enough.
        let _ = name.push_str(title);
        self.title = Some(name);
        self.next = 0;
        self.is_held = false;
        self.end = DONE;
        Ok(())
    }

    /// Keeps a motion that was accepted, if that is to be recorded.
    pub(super) fn record(&mut self, motion: &Motion) -> Result<(), ImageError> {
        if self.is_recording {
            self.kept.push(motion)?;
        }
        Ok(())
    }

    /// Gives the generator what it has room for, and says what has happened. Returns how the motion has
    /// ended, if it has.
    pub(super) fn play<W>(
        &mut self,
        hand: &UtahMit,
        shared: &Shared<'_, W>,
        mut say: impl FnMut(Arguments<'_>),
    ) -> Option<(State, Reason)> {
        if self.title.is_some() && self.next < self.count {
            let fed = with(shared, |drive| {
                self.running.feed(self.next, hand, &mut drive.generator)
            });
            match fed {
                None => {}
                Some(Ok(next)) => self.next = next,
                Some(Err(error)) => {
                    let number = self.next + 1;
                    say(format_args!("motion {number} cannot be: {error}; stopped"));
                    with(shared, |drive| drive.generator.abort());
                    self.stop();
                    return Some((State::Aborted, Reason::FromHere));
                }
            }
        }
        while let Some(Some((finger, stop))) = with(shared, |drive| drive.stops.pop_front()) {
            if let Some(entry) = hand.fingers.get(finger) {
                say(format_args!("{}", Tripped { entry, stop }));
            }
        }
        while let Some(Some(event)) = with(shared, |drive| drive.generator.take_event()) {
            if event.happening == Happening::Ended(Ended::Stopped(Guard::Time)) {
                say(format_args!("its time has stopped a motion"));
            }
            match event.happening {
                Happening::Refused(error) => {
                    say(format_args!("a motion cannot be from here: {error}"));
                    self.end = (State::Aborted, Reason::FromHere);
                }
                Happening::Ended(Ended::Stopped(_)) if self.end.0 == State::Done => {
                    self.end.0 = State::Stopped;
                }
                _ => {}
            }
        }
        let state = with(shared, |drive| {
            (drive.generator.is_idle(), drive.generator.is_held())
        });
        let (is_idle, is_held) = state.unwrap_or((false, self.is_held));
        if is_held && !self.is_held {
            say(format_args!("waits: `resume` goes on"));
        }
        self.is_held = is_held;
        if is_idle
            && self.next >= self.count
            && let Some(title) = self.title.take()
        {
            say(format_args!("{title} is done"));
            self.stop();
            return Some(self.end);
        }
        None
    }
}
