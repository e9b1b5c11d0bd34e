//! The command `status`.

use condor_rt::Machine;

use super::super::drive::with;
use super::super::servos::tell_fault;
use super::super::words::{Problem, Words};
use super::shown::{Boards, MeasuredObject, MixedModes, MotionCount, Row, Titles};
use super::{Commands, said};
use crate::queue::InControl;
use crate::table::TableRequest;

impl<M: Machine> Commands<'_, '_, M> {
    pub(super) fn status<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        let mut titles: Option<Titles<'_>> = None;
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            if !titles.as_ref().is_some_and(|titles| titles.suit(entry)) {
                self.say(format_args!("{}", titles.insert(Titles(entry))));
            }
            let measured = with(self.shared, |drive| {
                drive.measured.get(finger).copied().flatten()
            });
            let row = Row {
                finger: entry,
                status: self.servos.status(finger),
                processor: self.servos.processor(finger),
                measured: measured.flatten(),
            };
            self.say(format_args!("{row}"));
        }
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            if let Some(status) = self.servos.status(finger)
                && let Some(mixed) = MixedModes::of(entry, status)
            {
                self.say(format_args!("{mixed}"));
            }
        }
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            if let Some(fault) = self.servos.status(finger).and_then(|status| status.fault) {
                tell_fault(entry, fault, said(self.background, self.prompted));
            }
        }
        if let Some(resting @ 1..) = self.others.resting() {
            let boards = Boards(resting);
            self.say(format_args!(
                "no program sends values to the D/A boards {boards}: their actuators are at rest"
            ));
        }
        let failed = self.others.failed();
        if failed.is_some() {
            self.say(format_args!(
                "the robot is simulated without collisions: its fingers can pass through each other"
            ));
        }
        if let Some(failed @ 1..) = failed {
            self.say(format_args!(
                "the simulation of the robot has failed in {failed} ticks; the terminal of its processor says why, and \
                 `clear` puts the robot back to its start"
            ));
        }
        let is_paused = with(self.shared, |drive| drive.generator.is_paused());
        let paused = if is_paused == Some(true) {
            ", paused"
        } else {
            ""
        };
        match self.player.title() {
            Some(title) => {
                let (begun, count) = self.player.progress(self.shared);
                if count == 0 {
                    self.say(format_args!(
                        "motion {title} runs: it follows the points that a program sends{paused}"
                    ));
                } else {
                    self.say(format_args!(
                        "motion {title} runs: {begun} of its {count} steps have begun{paused}"
                    ));
                }
            }
            None => self.say(format_args!("no motion runs{paused}")),
        }
        let (waiting, in_control) = self.requests.waiting();
        if waiting > 0 {
            self.say(format_args!("waiting: {}", MotionCount(waiting as u32)));
        }
        if matches!(in_control, InControl::Session(_)) {
            self.say(format_args!("{in_control}"));
        }
        if !self.player.kept.is_empty() || self.player.is_recording {
            let count = self.player.kept.motions().map_or(0, |it| it.len());
            let what = if self.player.is_recording {
                "recording"
            } else {
                "in memory"
            };
            self.say(format_args!(
                "{what}: {}, {}",
                self.player.kept_title,
                MotionCount(count)
            ));
        }
        match self.others.see(self.background) {
            Ok(object) => self.say(format_args!("object: {}", MeasuredObject(&object))),
            Err(problem) => self.say(format_args!("object: {problem}")),
        }
        if self.hand.table.is_some() {
            match self.others.table(&TableRequest::Status) {
                Ok(state) => self.say(format_args!("table: {state}")),
                Err(problem) => self.say(format_args!("table: {problem}")),
            }
        }
        Ok(())
    }
}
