//! The commands that record motions, and keep them in files: `record`, `save` and `open`.

use condor_rt::Machine;

use super::super::words::{Problem, Words};
use super::Commands;
use super::shown::MotionCount;

impl<M: Machine> Commands<'_, '_, M> {
    pub(super) fn record<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let name = words.name()?;
        words.end()?;
        self.requests.check_kept()?;
        self.drop_recording();
        self.player.kept.clear();
        self.player.name_kept(name);
        self.player.is_recording = true;
        self.say(format_args!("recording {name}: `save` writes it to a file"));
        Ok(())
    }

    /// Tells the person that a recording is dropped, if it was not saved: another motion comes into memory.
    fn drop_recording(&self) {
        if self.player.is_recording && !self.player.kept.is_empty() {
            let former = &self.player.kept_title;
            self.say(format_args!("{former} is dropped: it was not saved"));
        }
    }

    pub(super) fn open<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let name = words.name()?;
        words.end()?;
        self.requests.check_kept()?;
        self.store.check(name)?;
        self.drop_recording();
        self.player.is_recording = false;
        self.store.load(name, &mut self.player.kept)?;
        self.player.name_kept(name);
        let count = self.player.kept.motions().map_or(0, |it| it.len());
        let count = MotionCount(count);
        self.say(format_args!(
            "{name}: {count}; `run` runs what is in memory"
        ));
        Ok(())
    }

    pub(super) fn save<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let given = match words.peek().next() {
            Some(_) => Some(words.name()?),
            None => None,
        };
        words.end()?;
        if self.player.kept.is_empty() {
            return Err(Problem::Nothing);
        }
        let title = self.player.kept_title.clone();
        let name = given.unwrap_or(&title);
        self.store.save(name, &self.player.kept)?;
        self.player.name_kept(name);
        self.player.is_recording = false;
        let count = MotionCount(self.player.kept.motions().map_or(0, |it| it.len()));
        self.say(format_args!("{name}: {count} saved"));
        Ok(())
    }
}
