//! [`RemoteStream`]: the messages of a topic.

use std::time::{Duration, Instant};

use condor_ros2::{DecodeError, Layout, RowMessage};
use zenoh::Wait;
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

use crate::error::RemoteError;
use crate::network::Network;
use crate::wire::{self, RemoteTopic, StreamPosition};

/// The greatest number of messages that wait for their reader; then the oldest is lost.
const WAITING: usize = 1024;

/// The messages of a topic, from the subscription on. Lost messages are counted: those lost at the gateway,
/// on the way, and in this process, if more than 1024 messages wait.
#[derive(Debug)]
pub struct RemoteStream {
    subscriber: Subscriber<RingChannelHandler<Sample>>,
    layout: Option<Layout>,
    topic: RemoteTopic,
    last: Option<StreamPosition>,
    lost: u64,
    lives: u64,
}

/// A message of a stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RemoteMessage {
    /// The bytes, as CDR of the type of the topic.
    pub payload: Vec<u8>,
    /// The number of messages that were lost between the one before and this one.
    pub lost: u64,
}

impl RemoteStream {
    pub(crate) fn open(
        network: &Network,
        robot: &str,
        topic: &RemoteTopic,
    ) -> Result<Self, RemoteError> {
        let key = wire::stream(robot, &topic.name);
        let subscriber = network.session.declare_subscriber(key);
        let layout = Layout::of_schema(&topic.schema).ok();
        Ok(Self {
            subscriber: subscriber.with(RingChannel::new(WAITING)).wait()?,
            layout: layout.filter(|_| topic.has_rows),
            topic: topic.clone(),
            last: None,
            lost: 0,
            lives: 0,
        })
    }

    /// Returns the topic.
    #[must_use]
    pub const fn topic(&self) -> &RemoteTopic {
        &self.topic
    }

    /// Returns the number of messages that were lost on the way or in this process. Rows that were lost
    /// before they came to the gateway are counted in the rows.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// Returns the number of times that the stream has begun anew because the gateway was restarted. The
    /// number of messages that were lost meanwhile is unknown.
    #[must_use]
    pub const fn restarts(&self) -> u64 {
        self.lives.saturating_sub(1)
    }

    /// Waits for the next message; returns `None` if none has come within `timeout`.
    ///
    /// # Errors
    /// [`RemoteError::Strange`] if the message is not one of a stream; [`RemoteError::Zenoh`] if zenoh
    /// fails.
    pub fn next(&mut self, timeout: Duration) -> Result<Option<RemoteMessage>, RemoteError> {
        let deadline = Instant::now() + timeout;
        let Some(sample) = self.subscriber.recv_deadline(deadline)? else {
            return Ok(None);
        };
        let attachment = sample.attachment().map(|it| it.to_bytes().into_owned());
        let place = attachment.as_deref().and_then(StreamPosition::read);
        let place = place.ok_or_else(|| RemoteError::Strange(sample.key_expr().to_string()))?;
        let lost = match self.last.replace(place) {
            Some(last) if last.incarnation == place.incarnation => {
                place.number.saturating_sub(last.number).saturating_sub(1)
            }
            _ => {
                self.lives += 1;
                0
            }
        };
        self.lost += lost;
        let payload = sample.payload().to_bytes().into_owned();
        Ok(Some(RemoteMessage { payload, lost }))
    }

    /// Decodes a message as a row of values; `None` if this topic has no rows, as that of events.
    ///
    /// # Errors
    /// [`DecodeError`] if the bytes are not those of a row of this topic.
    pub fn row<'m>(
        &'m self,
        message: &'m RemoteMessage,
    ) -> Result<Option<RowMessage<'m>>, DecodeError> {
        let layout = self.layout.as_ref();
        layout.map(|it| it.decode(&message.payload)).transpose()
    }

    /// Returns the names of the values of a row, in their order.
    pub fn columns(&self) -> impl Iterator<Item = &str> {
        let fields = self.layout.iter().flat_map(Layout::fields);
        fields.map(|(field, _)| field.name.as_str())
    }
}
