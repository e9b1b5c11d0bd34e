//! `condor vectors --follow`.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use condor_mbox::Processor;
use serde_json::json;

use crate::commands::print;
use crate::commands::running::{Running, name_of};
use condor_host::control::{Member, SystemStatus};
use condor_host::error::{AnyError, tell};
use condor_host::plain::{plain, plain_json};
use condor_host::signals;
use condor_host::view::{HeardMessage, Hearing, HearingEvent};

/// The time between two looks whether to end.
const LOOK: Duration = Duration::from_millis(50);
/// The time without messages after which the system is looked for.
const SILENCE: Duration = Duration::from_secs(1);

/// Shows the messages to `members` until `limit` has passed, a signal comes, or the system ends.
pub(super) fn follow(
    running: &Running,
    members: &[&Member],
    limit: Option<Duration>,
    is_json: bool,
) -> Result<(), AnyError> {
    let end = signals::flag()?;
    let numbers: Vec<_> = members.iter().map(|it| it.processor()).collect();
    let hearing = Hearing::begin(&running.directory, running.status.window_bytes, &numbers)?;
    let mut lines = Lines {
        status: &running.status,
        is_json,
        first_ns: None,
        counts: members.iter().map(|it| (it.processor(), 0, 0)).collect(),
    };
    if !is_json {
        let [time, from, to] = ["time [s]", "from", "to"];
        print(line(time, [from, to, "vector"], "data"))?;
    }
    let (begun, mut last) = (Instant::now(), Instant::now());
    while !end.load(Ordering::Relaxed) && limit.is_none_or(|limit| begun.elapsed() < limit) {
        match hearing.next(LOOK) {
            Some(event) => {
                last = Instant::now();
                lines.show(event)?;
            }
            None if last.elapsed() < SILENCE => {}
            None if running.directory.is_running() => last = Instant::now(),
            None => {
                tell("the system has ended");
                break;
            }
        }
    }
    lines.summary()
}

fn line(time: &str, [from, to, vector]: [&str; 3], data: &str) -> String {
    format!("{time:>12}  {from:<12}  {to:<12}  {vector:<20}  {data}\n")
}

/// Messages as lines of text, or of JSON.
struct Lines<'s> {
    status: &'s SystemStatus,
    is_json: bool,
    /// The time of the first message.
    first_ns: Option<u64>,
    /// For each processor, the numbers of messages that were heard and missed.
    counts: Vec<(Processor, u64, u64)>,
}

impl Lines<'_> {
    fn show(&mut self, event: HearingEvent) -> Result<(), AnyError> {
        let name = |number| name_of(self.status, number);
        match event {
            HearingEvent::Began(to) => {
                tell(format_args!("hears the messages to {}", plain(&name(to))));
                Ok(())
            }
            HearingEvent::Waits(to, error) => {
                let to = name(to);
                tell(format_args!("waits until {} is up: {error}", plain(&to)));
                Ok(())
            }
            HearingEvent::Ended(to, error) => Err(format!("{}: {error}", name(to)).into()),
            HearingEvent::Message(message) => self.message(&message),
        }
    }

    fn message(&mut self, message: &HeardMessage) -> Result<(), AnyError> {
        let HeardMessage {
            at, data, missed, ..
        } = *message;
        let mut counts = self.counts.iter_mut();
        if let Some((_, heard, all_missed)) = counts.find(|it| it.0 == message.addressee) {
            *heard += 1;
            *all_missed += u64::from(missed);
        }
        let from = name_of(self.status, message.sender);
        let to = name_of(self.status, message.addressee);
        let (vector, name) = (message.vector.0, &message.name);
        if self.is_json {
            return print(format_args!(
                "{}\n",
                plain_json(&json!({
                    "heard_ns": at.as_ns(), "from": from, "to": to, "vector": vector,
                    "name": name, "data": data, "missed": missed
                }))?
            ));
        }
        if missed > 0 {
            let to = plain(&to);
            print(format_args!(
                "{:>12}  {missed} to {to} were missed\n",
                "..."
            ))?;
        }
        let first_ns = *self.first_ns.get_or_insert(at.as_ns());
        // Another thread may have heard its message before the first that is shown.
        let since = at.as_ns().wrapping_sub(first_ns).cast_signed();
        #[expect(clippy::cast_precision_loss, reason = "microseconds are shown")]
        let time = format!("{:.6}", since as f64 / 1e9);
        let signed = match data.cast_signed() {
            negative @ ..0 => format!(" or {negative}"),
            _ => String::new(),
        };
        let vector = format!("{vector} {name}");
        let cells = [from, to, vector].map(|it| plain(&it).into_owned());
        let cells = cells.each_ref().map(String::as_str);
        print(line(&time, cells, &format!("{data:#010x}  {data}{signed}")))
    }

    /// Tells how many messages there were.
    fn summary(&self) -> Result<(), AnyError> {
        if self.is_json {
            let processors: Vec<_> = (self.counts.iter())
                .map(|(number, heard, missed)| {
                    let name = name_of(self.status, *number);
                    json!({ "processor": name, "messages": heard, "missed": missed })
                })
                .collect();
            let summary = plain_json(&json!({ "processors": processors }))?;
            return print(format_args!("{summary}\n"));
        }
        for (number, heard, missed) in &self.counts {
            let name = name_of(self.status, *number);
            eprintln!("{}: {heard} messages, {missed} missed", plain(&name));
        }
        Ok(())
    }
}
