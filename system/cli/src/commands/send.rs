//! `condor send`.

use std::time::{Duration, Instant};

use clap::Args;
use condor_mbox::{LoadOrder, MailboxError, MemoryWindow, Messenger, Processor, layout};
use serde::Serialize;

use super::number::duration;
use super::running::Running;
use super::{How, print, print_json};
use condor_host::error::AnyError;
use condor_host::names::word;
use condor_host::view::Post;
use condor_rt::numbers::PROCESSORS;

#[derive(Debug, Args)]
pub(crate) struct Send {
    /// The name or the number of the processor or service
    processor: String,
    /// The name or the number of the vector
    vector: String,
    /// The data: a number of 32 bits, decimal, or hexadecimal after 0x; it may be negative
    #[arg(value_parser = word, allow_hyphen_values = true)]
    data: u32,
    /// Waits for the reply, and prints it
    #[arg(long)]
    reply: bool,
    /// The longest time to wait until the message is taken, or with --reply until it is answered
    #[arg(long, value_name = "TIME", default_value = "2s", value_parser = duration)]
    timeout: Duration,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct Answer<'s> {
    processor: &'s str,
    vector: u8,
    data: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    reply: Option<u32>,
}

impl Send {
    pub(crate) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let member = running.member(&self.processor)?;
        let to = member.processor();
        let mut view = running.view()?;
        let vector = view.vector(member, &self.vector)?;
        let post = view.join()?;
        let failed = |error| {
            let name = &member.name;
            let remedy = match error {
                MailboxError::NoHandler { .. } => {
                    format!("; `vectors {name}` shows those that have one")
                }
                _ => String::new(),
            };
            format!("{name}, vector {}: {error}{remedy}", vector.0)
        };
        let reply = if self.reply {
            let reply = post.send_with_reply(to, vector, self.data, self.timeout);
            Some(reply.map_err(failed)?)
        } else {
            let deadline = Instant::now() + self.timeout;
            let sent = post.send(to, vector, self.data, self.timeout);
            sent.map_err(failed)?;
            wait_until_taken(post, to, deadline)?;
            None
        };
        if self.how.json {
            return print_json(&Answer {
                processor: &member.name,
                vector: vector.0,
                data: self.data,
                reply,
            });
        }
        match reply {
            Some(reply) if reply.cast_signed() < 0 => print(format_args!(
                "{reply} ({reply:#x}, as a signed number {})\n",
                reply.cast_signed()
            )),
            Some(reply) => print(format_args!("{reply} ({reply:#x})\n")),
            None => Ok(()),
        }
    }
}

/// Waits until the first message of this incarnation has been taken: it would not outlive its sender.
fn wait_until_taken(post: &Post, to: Processor, deadline: Instant) -> Result<(), AnyError> {
    let mail = &post.windows(to)?.mail;
    let taken = layout::taken(PROCESSORS as u32, post.number().0.into());
    while mail.load(taken, LoadOrder::Acquire)? == 0 {
        if Instant::now() >= deadline {
            return Err(
                format!("{to} did not take the message in time, so it was withdrawn").into(),
            );
        }
        post.serve(Duration::from_millis(1))?;
    }
    Ok(())
}
