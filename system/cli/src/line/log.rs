//! `condor log`.

use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use clap::Args;
use condor_host::control::{ControlClient, SystemStatus, follow};
use condor_host::error::AnyError;
use condor_host::plain::{plain, plain_json};
use condor_host::signals;
use condor_host::system::{self, SystemDirectory};
use condor_mbox::MemoryWindow as _;
use condor_mbox::shared_log::SharedLogEntry;
use condor_rt::shared_log;
use serde_json::json;

use crate::commands::SystemChoice;
use crate::commands::number::lines as count_of_lines;
use crate::commands::running::name_of;

/// The time between two looks for new lines of programs.
const LOOK: Duration = Duration::from_millis(50);

#[derive(Debug, Args)]
pub(super) struct Log {
    /// Also shows new lines as they come, until the system ends
    #[arg(short, long)]
    follow: bool,
    /// The number of earlier lines to show
    #[arg(short = 'n', long, default_value = "50", value_parser = count_of_lines)]
    lines: usize,
    /// Shows the log to which the programs append in shared memory, each line with the time of its processor's clock
    #[arg(long)]
    shared: bool,
    /// Prints each line as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    which: SystemChoice,
}

impl Log {
    pub(super) fn run(&self) -> Result<(), AnyError> {
        let directory = system::find(self.which.system.as_deref())?;
        if self.shared {
            return self.show_shared(&directory);
        }
        let (lines, events) = follow(&directory, self.lines)?;
        for line in &lines {
            if self.json {
                println!("{}", plain_json(&json!({ "line": line }))?);
            } else {
                println!("{}", plain(line));
            }
        }
        let followed = if self.follow { usize::MAX } else { 0 };
        for event in events.take(followed) {
            let event = event?;
            if self.json {
                println!("{}", plain_json(&event)?);
            } else {
                println!("{}", plain(&event.to_string()));
            }
        }
        Ok(())
    }

    /// Shows the log in the memory that belongs to no processor.
    fn show_shared(&self, directory: &SystemDirectory) -> Result<(), AnyError> {
        let status = ControlClient::connect(directory)?.status()?;
        let memory = status.shared_memory.as_ref().ok_or_else(|| {
            let system = &status.system;
            format!(
                "`{system}` has no log of its programs: its description has no `[shared_memory]`"
            )
        })?;
        let memory = memory.window()?;
        let Ok(mut reader) = shared_log::reader(&memory) else {
            let (system, bytes) = (&status.system, shared_log::BYTES);
            return Err(format!(
                "`{system}` has no room for a log of its programs: `bytes` of `[shared_memory]` in its description must \
                 be at least {bytes}, not {}",
                memory.size()
            )
            .into());
        };
        let mut earlier = Vec::new();
        // Others may append all the while.
        while earlier.len() < shared_log::LINES as usize
            && let Some(entry) = reader.next_entry()?
        {
            earlier.push(entry);
        }
        let mut next = None;
        let left_out = earlier.len().saturating_sub(self.lines);
        for entry in earlier.iter().skip(left_out) {
            self.show_entry(&status, entry, &mut next)?;
        }
        let end = signals::flag()?;
        while self.follow && !end.load(Ordering::Relaxed) {
            match reader.next_entry()? {
                Some(entry) => self.show_entry(&status, &entry, &mut next)?,
                None if directory.is_running() => thread::sleep(LOOK),
                None => break,
            }
        }
        Ok(())
    }

    /// Shows an entry, and how many are missing before it. `next` is the number of the entry that should be next.
    fn show_entry(
        &self,
        status: &SystemStatus,
        entry: &SharedLogEntry,
        next: &mut Option<u32>,
    ) -> Result<(), AnyError> {
        let number = entry.number;
        let missing = next.replace(number.wrapping_add(1));
        let missing = missing.map_or(0, |next| number.wrapping_sub(next));
        let (name, text) = (name_of(status, entry.processor()), entry.text());
        let ns = entry.at().as_ns();
        if self.json {
            let line = json!({ "number": number, "ns": ns, "processor": name, "text": text });
            println!("{}", plain_json(&line)?);
            return Ok(());
        }
        // A log that was cleared begins anew.
        if (1..=u32::MAX >> 1).contains(&missing) {
            println!("{:>14}  {missing} lines were overwritten", "...");
        }
        let seconds = Duration::from_nanos(ns).as_secs_f64();
        println!("{seconds:>14.6}  {}: {}", plain(&name), plain(text));
        Ok(())
    }
}
