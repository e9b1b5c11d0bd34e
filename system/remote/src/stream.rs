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

/// The messages of one topic, from the [subscription](crate::Remote::subscribe) on. At most 1024 messages wait in this
/// process until they are read; then the oldest is lost. Lost messages are counted.
#[derive(Debug)]
pub struct RemoteStream {
    subscriber: Subscriber<RingChannelHandler<Sample>>,
    layout: Option<Layout>,
    topic: RemoteTopic,
    last: Option<StreamPosition>,
    lost: u64,
    lives: u64,
}

/// A message of a [`RemoteStream`], with the number of messages that were lost before it.
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

    /// Returns the topic of this stream: its name, and the type of its messages.
    #[must_use]
    pub const fn topic(&self) -> &RemoteTopic {
        &self.topic
    }

    /// Returns the number of messages that were lost between the gateway and the reader since the subscription. Rows
    /// that were lost before they came to the gateway are not among them: each row has its own count of those.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// Returns the number of times that the stream has begun again because the gateway was restarted. Messages that
    /// were lost meanwhile are in no count.
    #[must_use]
    pub const fn restarts(&self) -> u64 {
        self.lives.saturating_sub(1)
    }

    /// Waits for the next message, `timeout` at most; returns `None` if none has come.
    ///
    /// # Errors
    /// Returns [`RemoteError::Strange`] if a message comes that has no [position](crate::wire::StreamPosition);
    /// [`RemoteError::Zenoh`] if zenoh fails.
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

    /// Decodes `message`, which this stream has returned, as a row of values. Returns `None` if the messages of this
    /// topic are not rows, as for events.
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

    /// Returns the names of the values in a row, in the order of the values; none if the messages of this topic are not
    /// rows.
    pub fn columns(&self) -> impl Iterator<Item = &str> {
        let fields = self.layout.iter().flat_map(Layout::fields);
        fields.map(|(field, _)| field.name.as_str())
    }
}
