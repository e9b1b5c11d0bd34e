//! The completions of the word at the cursor, by the list of commands.

use core::fmt::Write as _;

use condor_hand::config::{Finger, Name};
use condor_mbox::Processor;
use condor_rt::{Machine, numbers};
use condor_vars::{TableEntry, VariableTable};

use super::super::words::Words;
use super::list::{all, find};
use super::{Commands, GROUPS};
use crate::joints::{actuator_names, joint_names};
use crate::{ACTUATORS, JOINTS};

/// The function that takes each word that may stand there.
type Offer<'o> = &'o mut dyn FnMut(&str);

impl<M: Machine> Commands<'_, '_, M> {
    /// Offers what the last word of a line, which may be empty or begun, may become.
    pub(in super::super) fn complete(&mut self, before: &str, offer: Offer<'_>) {
        let begun = before
            .bytes()
            .rev()
            .take_while(|byte| *byte != b' ')
            .count();
        let done = before
            .get(..before.len().saturating_sub(begun))
            .unwrap_or("");
        let mut words = Words::of(done);
        let Some(word) = words.next() else {
            return all(GROUPS).for_each(|command| offer(command.name));
        };
        let Some(command) = find(GROUPS, word) else {
            return;
        };
        for what in command.choices(words.peek().count()) {
            match what {
                "GROUP" => GROUPS.iter().for_each(|group| offer(group.name)),
                "COMMAND" => all(GROUPS).for_each(|command| offer(command.name)),
                "FINGER" => {
                    let fingers = self.hand.fingers.iter();
                    fingers.for_each(|finger| offer(&finger.name));
                }
                "FINGER.JOINT" => self.offer_parts(joint_names, offer),
                "FINGER.ACTUATOR" => self.offer_parts(actuator_names, offer),
                "FINGER.PART" => {
                    self.offer_parts(joint_names, &mut *offer);
                    self.offer_parts(actuator_names, offer);
                }
                // Without its directory there are none.
                "MOTION" => self.store.list(&mut *offer).unwrap_or_default(),
                "GAIN" => self.offer_gains(&mut words.clone(), offer),
                "VALUE" => self.offer_values(&mut words.clone(), offer),
                "PROCESSOR" => self.offer_processors(offer),
                word if word.bytes().all(|it| it.is_ascii_lowercase()) => offer(word),
                _ => {}
            }
        }
    }

    /// Offers FINGER.NAME for each of these names of each finger.
    fn offer_parts<'f, I>(
        &'f self,
        names: impl Fn(&'f Finger<JOINTS, ACTUATORS>) -> I,
        offer: Offer<'_>,
    ) where
        I: Iterator<Item = &'f Name>,
    {
        for finger in &self.hand.fingers {
            for part in names(finger) {
                let mut name = heapless::String::<64>::new();
                // The names of a configuration are short enough.
                let _ = write!(name, "{}.{part}", finger.name);
                offer(&name);
            }
        }
    }

    /// Offers the gains of the joint or actuator that is named before; of none that is not there.
    fn offer_gains(&mut self, words: &mut Words<'_>, offer: Offer<'_>) {
        if let Some((joint, table)) = self.parameters(words) {
            let entries = table.entries().flatten();
            entries.for_each(|entry| gain_of(joint, &entry).into_iter().for_each(&mut *offer));
        }
    }

    /// Offers the values of the gain that is named last before, if they have names.
    fn offer_values(&mut self, words: &mut Words<'_>, offer: Offer<'_>) {
        let Some((joint, table)) = self.parameters(words) else {
            return;
        };
        let gain = words.peek().last();
        let mut entries = table.entries().flatten();
        if let Some(entry) = entries.find(|entry| gain.is_some() && gain_of(joint, entry) == gain) {
            let labels = (0..entry.labels.into()).map(|number| table.label(&entry, number));
            labels.flatten().flatten().for_each(|label| offer(&label));
        }
    }

    /// The joint or actuator that is named next, and the parameters of the loop that serves it.
    fn parameters<'l>(
        &mut self,
        words: &mut Words<'l>,
    ) -> Option<(&'l str, VariableTable<M::Window>)> {
        let joint = words.peek().next()?;
        let (finger, _) = words.joint_or_actuator(self.hand).ok()?;
        let (_, table) = self.servos.table(finger).ok()?;
        Some((joint, table))
    }

    /// Offers the names of processors, or the numbers of those of the hand if nobody knows names.
    fn offer_processors(&mut self, offer: Offer<'_>) {
        let supervisor = &mut self.processors.supervisor;
        let mut any = false;
        for number in numbers::PROGRAMS {
            let Ok(name) = supervisor.name(Processor(number)) else {
                break;
            };
            if let Some(name) = name {
                offer(name.as_str());
                any = true;
            }
        }
        for processor in self.hand.processors.iter().filter(|_| !any) {
            let mut name = heapless::String::<4>::new();
            // A number has at most three digits.
            let _ = write!(name, "{}", processor.number);
            offer(&name);
        }
    }
}

/// The name of a gain of a joint or actuator; `None` if the entry is none.
fn gain_of<'e>(joint: &str, entry: &'e TableEntry) -> Option<&'e str> {
    let name = entry.name.strip_prefix(joint)?.strip_prefix('.')?;
    entry.bounds.is_some().then_some(name)
}
