//! Rows and events of a running system as messages of ROS 2 ([`Streams`]), for programs that pass them on.
//!
//! Topics, types and bytes are those of a recording and of `condor view`.

use condor_ros2::{Head, Layout, Log, RosMessage as _, Time, encode, schema};

use crate::control::SystemStatus;
use crate::error::AnyError;
use crate::events::EventCollector;
use crate::messages::{self, EVENTS, Topics, wall_ns};
use crate::system::SystemDirectory;
use crate::view::View;
use crate::watching::{CatalogEntry, NewPrograms, RowSource, Rows, VariableCatalog};

/// A topic of [`Streams`]: its name, and the type of its messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamTopic {
    /// The name of the topic, such as `/servo_a/servo`.
    pub name: String,
    /// The name of the type of its messages, such as `condor/msg/ServoAServo`.
    pub schema_name: String,
    /// The text of the type, as `ros2msg`.
    pub schema: String,
    /// Whether each message is a row of variables; otherwise it is an event.
    pub has_rows: bool,
}

/// A message that [`Streams::read`] hands over: its topic, and its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamMessage {
    /// The place of its topic among [`Streams::topics`].
    pub topic: usize,
    /// The bytes, as CDR.
    pub payload: Vec<u8>,
}

/// The rows of variables and the events of a running system, as messages of ROS 2. Call [`read`](Self::read) again and
/// again, and [`pause`](Self::pause) in between.
pub struct Streams<'s> {
    view: &'s View,
    rows: Rows<'s>,
    newcomers: NewPrograms,
    /// By the number of the source: the place of its topic, and the layout of its rows.
    layouts: Vec<(usize, Layout)>,
    names: Topics,
    topics: Vec<StreamTopic>,
    /// The place of the topic of events.
    events_topic: usize,
    events: EventCollector<'s>,
    ahead_ns: u64,
}

impl<'s> Streams<'s> {
    /// Begins to stream the events of a system and the rows of some variables. `patterns` are the names of the
    /// variables, or patterns as in `condor vars watch`; without any, there are only events. A row comes every `every`
    /// ticks of each loop that has such variables. `directory` and `status` are those of the system. `view` must have
    /// [joined](View::join).
    ///
    /// # Errors
    /// Returns an error if a name is unknown, or if the system cannot be asked; the text says which name, or
    /// why.
    pub fn open(
        directory: &SystemDirectory,
        status: &'s SystemStatus,
        view: &'s View,
        patterns: &[String],
        every: u32,
    ) -> Result<Self, AnyError> {
        // Without patterns it needs no variables, of which there may be none.
        let known = (!patterns.is_empty())
            .then(|| VariableCatalog::all(view, &status.processors))
            .transpose()?;
        let columns = known.as_ref().map(|known| known.matching(patterns));
        let columns = columns.transpose()?.unwrap_or_default();
        let rows = Rows::of(view, &columns, every)?;
        // Without patterns it wants no variables that come later, either.
        let (members, all) = match &known {
            Some(known) => (&*status.processors, known),
            None => (&[][..], &VariableCatalog::default()),
        };
        let newcomers = NewPrograms::after(all, members, patterns);
        let now_ns = view.now().as_ns();
        // Simulated time is told as it is.
        let at_ns = if view.is_simulated() {
            now_ns
        } else {
            wall_ns()
        };
        let mut streams = Self {
            view,
            rows,
            newcomers,
            layouts: Vec::new(),
            names: Topics::default(),
            topics: Vec::new(),
            events_topic: 0,
            events: EventCollector::of(directory, status, view)?,
            ahead_ns: at_ns.wrapping_sub(now_ns),
        };
        streams.add_topics(0, &columns);
        streams.events_topic = streams.topics.len();
        streams.topics.push(StreamTopic {
            name: EVENTS.into(),
            schema_name: Log::NAME.into(),
            schema: schema::<Log>(),
            has_rows: false,
        });
        Ok(streams)
    }

    /// Adds the topics of the sources from number `first` on.
    fn add_topics(&mut self, first: usize, columns: &[&CatalogEntry]) {
        let sources: &[RowSource] = self.rows.sources.get(first..).unwrap_or_default();
        for ([name, schema_name], layout) in messages::layouts(&mut self.names, sources, columns) {
            let place = self.topics.len();
            self.topics.push(StreamTopic {
                name,
                schema_name,
                schema: layout.schema(),
                has_rows: true,
            });
            self.layouts.push((place, layout));
        }
    }

    /// Returns the topics; [`StreamMessage::topic`] is an index into them. If a program starts later,
    /// [`read`](Self::read) appends its topics, and the call of `read` after that hands over their first messages.
    #[must_use]
    pub fn topics(&self) -> &[StreamTopic] {
        &self.topics
    }

    /// Passes all messages that have come since the last call to `take`. Returns true if the system still runs.
    ///
    /// # Errors
    /// Returns an error if the system cannot be read; the text says why.
    pub fn read(&mut self, mut take: impl FnMut(StreamMessage)) -> Result<bool, AnyError> {
        let (layouts, ahead_ns) = (&self.layouts, self.ahead_ns);
        self.rows.read(|source, row| {
            let head = Head {
                stamp: Time::from_ns(row.released.as_ns().wrapping_add(ahead_ns)),
                tick: row.tick,
                lost: row.lost.into(),
            };
            // The words are those of the fields.
            if let Some((topic, layout)) = layouts.get(source)
                && let Ok(payload) = layout.encode(&head, row.words)
            {
                let topic = *topic;
                take(StreamMessage { topic, payload });
            }
        })?;
        let stamp = Time::from_ns(self.view.now().as_ns().wrapping_add(ahead_ns));
        let topic = self.events_topic;
        let mut tell = |level, name: &str, text: &str| {
            let log = Log {
                stamp,
                level,
                name: name.into(),
                text: text.into(),
            };
            let payload = encode(&log);
            take(StreamMessage { topic, payload });
        };
        for change in self.rows.changes() {
            tell(condor_ros2::Level::Warn, "condor", &change.text);
        }
        let is_alive = self.events.look(self.view, tell)?;
        let ones = self.newcomers.look(self.view);
        if !ones.is_empty() {
            let (columns, first) = (ones.iter().collect::<Vec<_>>(), self.rows.sources.len());
            self.rows.extend(&columns);
            self.add_topics(first, &columns);
        }
        Ok(is_alive)
    }

    /// Waits until there may be more messages, for some milliseconds at most.
    ///
    /// # Errors
    /// Returns the mailbox's error if the mailbox of the visitor fails.
    pub fn pause(&self) -> Result<(), AnyError> {
        self.rows.pause()
    }
}
