//! Messages between processors as rows of a recording.

use std::time::Duration;

use condor_mbox::Processor;
use condor_ros2::{Level, RosField};
use condor_rt::numbers::PROCESSORS;
use condor_vars::ValueKind;

use crate::commands::running::Running;
use crate::commands::running::name_of;
use crate::recording::{RecordingError, Writer};
use condor_host::control::{Member, SystemStatus};
use condor_host::error::{AnyError, tell};
use condor_host::plain::plain;
use condor_host::view::{HeardMessage, Hearing, HearingEvent};

/// The name under which the messages to a processor are recorded, beside its loops.
const OWNER: &str = "messages";

/// The messages to some processors, on their way into a recording.
pub(super) struct Messages<'v> {
    status: &'v SystemStatus,
    hearing: Hearing,
    inboxes: Vec<Inbox>,
}

/// The messages to one processor.
struct Inbox {
    number: Processor,
    channel: u16,
    missed: u64,
}

impl<'v> Messages<'v> {
    /// Begins to hear the messages to the processors and services with these names or numbers.
    pub(super) fn begin(
        running: &'v Running,
        names: &[String],
        writer: &mut Writer,
    ) -> Result<Option<Self>, AnyError> {
        if names.is_empty() {
            return Ok(None);
        }
        let status = &running.status;
        let members = members(status, names)?;
        let numbers: Vec<_> = members.iter().map(|it| it.processor()).collect();
        let inboxes = members.iter().map(|member| {
            Ok(Inbox {
                number: member.processor(),
                channel: writer.rows_of(&member.name, OWNER, fields(status))?,
                missed: 0,
            })
        });
        let inboxes = inboxes.collect::<Result<_, RecordingError>>()?;
        let hearing = Hearing::begin(&running.directory, status.window_bytes, &numbers)?;
        Ok(Some(Self {
            status,
            hearing,
            inboxes,
        }))
    }

    /// Collects the messages that have come. `now_ns` is the present time on the clock of the system.
    pub(super) fn take(&mut self, writer: &mut Writer, now_ns: u64) -> Result<(), RecordingError> {
        while let Some(event) = self.hearing.next(Duration::ZERO) {
            let (level, number, text) = match event {
                HearingEvent::Message(message) => {
                    self.message(&message, writer)?;
                    continue;
                }
                HearingEvent::Began(number) => {
                    (Level::Info, number, "its messages are recorded".to_owned())
                }
                HearingEvent::Waits(number, error) => {
                    let text = format!("its messages are recorded when it is up: {error}");
                    (Level::Warn, number, text)
                }
                HearingEvent::Ended(number, error) => {
                    let text = format!("its messages are not recorded any more: {error}");
                    (Level::Error, number, text)
                }
            };
            let name = name_of(self.status, number);
            if level > Level::Info {
                tell(format_args!("{}: {}", plain(&name), plain(&text)));
            }
            writer.event(now_ns, level, &name, &text);
        }
        Ok(())
    }

    fn message(
        &mut self,
        message: &HeardMessage,
        writer: &mut Writer,
    ) -> Result<(), RecordingError> {
        let mut inboxes = self.inboxes.iter_mut();
        let Some(inbox) = inboxes.find(|it| it.number == message.addressee) else {
            return Ok(());
        };
        let missed = u64::from(message.missed);
        inbox.missed += missed;
        let words = [
            message.sender.0.into(),
            message.vector.0.into(),
            message.data,
        ];
        let at_ns = message.at.as_ns();
        writer.row(inbox.channel, at_ns, message.number, missed, &words)
    }

    /// Returns the number of messages that were missed, if `channel` is that of the messages to a processor.
    pub(super) fn missed(&self, channel: u16) -> Option<u64> {
        let mut inboxes = self.inboxes.iter();
        Some(inboxes.find(|it| it.channel == channel)?.missed)
    }
}

/// Finds the processors and services with these names or numbers.
pub(super) fn members<'s>(
    status: &'s SystemStatus,
    names: &[String],
) -> Result<Vec<&'s Member>, AnyError> {
    let mut members: Vec<&Member> = Vec::new();
    for name in names {
        let member = status.member(name)?;
        if !members.iter().any(|it| it.number == member.number) {
            members.push(member);
        }
    }
    Ok(members)
}

/// Returns the fields of a row: one message.
fn fields(status: &SystemStatus) -> [RosField; 3] {
    let field = |name: &str, kind, about: &str, labels| RosField {
        name: name.into(),
        kind,
        unit: String::new(),
        about: about.into(),
        labels,
    };
    let senders = (0..PROCESSORS as u8).map(|number| name_of(status, Processor(number)));
    let (senders, none) = (senders.collect(), Vec::new());
    [
        field("message.sender", ValueKind::Choice, "", senders),
        field("message.vector", ValueKind::U8, "", none.clone()),
        field("message.data", ValueKind::U32, "", none),
    ]
}
