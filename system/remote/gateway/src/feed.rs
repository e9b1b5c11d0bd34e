//! [`Feed`]: publishes rows and events of the system.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use condor_host::error::AnyError;
use condor_host::streams::Streams;
use condor_host::view::View;
use condor_remote::wire::{RemoteTopic, StreamPosition, stream};
use zenoh::bytes::Encoding;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};

use crate::log;
use crate::system::SystemChoice;

/// The time between two attempts to find the variables.
const AGAIN: Duration = Duration::from_millis(500);

/// The thread that publishes.
pub(crate) struct Feed {
    /// The system that is served.
    pub(crate) which: SystemChoice,
    /// The session of zenoh.
    pub(crate) session: Session,
    /// The name of the robot.
    pub(crate) robot: String,
    /// The variables, by name or pattern.
    pub(crate) variables: Vec<String>,
    /// The number of ticks from one row to the next.
    pub(crate) every: u32,
    /// The topics, while there are some.
    pub(crate) topics: Arc<Mutex<Vec<RemoteTopic>>>,
}

impl Feed {
    /// Publishes until the session is closed.
    pub(crate) fn work(&self) {
        let mut before = String::new();
        while !self.session.is_closed() {
            let why = match self.publish() {
                Ok(()) => "the system has ended".to_owned(),
                Err(error) => error.to_string(),
            };
            self.set_topics(Vec::new());
            if why != before {
                log::tell("streams", &why);
                before = why;
            }
            std::thread::sleep(AGAIN);
        }
    }

    fn set_topics(&self, topics: Vec<RemoteTopic>) {
        *self.topics.lock().unwrap_or_else(PoisonError::into_inner) = topics;
    }

    /// Publishes as long as the system runs.
    fn publish(&self) -> Result<(), AnyError> {
        let mut found = self.which.find()?;
        let mut view = View::open(&found.directory, found.status.window_bytes)?;
        view.join()?;
        let status = found.status.clone();
        let mut streams = Streams::open(
            &found.directory,
            &status,
            &view,
            &self.variables,
            self.every,
        )?;
        let (mut topics, mut publishers) = (Vec::new(), Vec::new());
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let incarnation = now.as_nanos() as u64;
        while found.is_there() && !self.session.is_closed() {
            // Those of programs that come later are added.
            if topics.len() < streams.topics().len() {
                for topic in streams.topics().iter().skip(topics.len()) {
                    let topic = RemoteTopic {
                        name: topic.name.clone(),
                        schema_name: topic.schema_name.clone(),
                        schema: topic.schema.clone(),
                        has_rows: topic.has_rows,
                    };
                    publishers.push((self.publisher(&topic)?, 0));
                    topics.push(topic);
                }
                self.set_topics(topics.clone());
            }
            let goes_on = streams.read(|message| {
                let Some((publisher, number)) = publishers.get_mut(message.topic) else {
                    return;
                };
                let place = StreamPosition {
                    incarnation,
                    number: *number,
                };
                *number += 1;
                // Messages that nobody takes are lost, and the next number says so.
                let _ = publisher
                    .put(message.payload)
                    .attachment(place.bytes())
                    .wait();
            })?;
            if !goes_on {
                break;
            }
            streams.pause()?;
        }
        Ok(())
    }

    fn publisher(&self, topic: &RemoteTopic) -> Result<Publisher<'static>, AnyError> {
        let key = stream(&self.robot, &topic.name);
        let publisher = self.session.declare_publisher(key);
        let publisher = publisher.encoding(Encoding::APPLICATION_CDR);
        // A client that does not read holds nothing up.
        let publisher = publisher.congestion_control(CongestionControl::Drop);
        Ok(publisher.wait().map_err(|error| error.to_string())?)
    }
}
