//! What a program hands on of a running system: rows and events as messages of ROS 2 ([`Streams`]), and parameters by
//! name ([`Parameters`]).
//!
//! Topics, types and bytes are those of a recording and of `condor view`.

use condor_ros2::{Head, Layout, Log, Message as _, Time, encode, schema};
use serde_json::{Value as Json, json};

use crate::control::{Member, Status};
use crate::error::AnyError;
use crate::events::Events;
use crate::messages::{EVENTS, Topics, field, wall_ns};
use crate::system::SystemDirectory;
use crate::view::View;
use crate::watching::{Clients, Known, One, Rows};
use condor_vars::{Kind, Value};

/// A topic, with the type of its messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Its name, such as `/servo_a/servo`.
    pub name: String,
    /// The name of the type of its messages, such as `condor/msg/ServoAServo`.
    pub schema_name: String,
    /// The text of the type, as `ros2msg`.
    pub schema: String,
    /// Whether each message is a row of variables; otherwise it is an event.
    pub has_rows: bool,
}

/// A message of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// The place of its topic among [`Streams::topics`].
    pub topic: usize,
    /// The bytes, as CDR.
    pub payload: Vec<u8>,
}

/// Rows of variables, and events, of a running system.
pub struct Streams<'s> {
    view: &'s View,
    rows: Rows<'s>,
    layouts: Vec<Layout>,
    topics: Vec<Topic>,
    events: Events<'s>,
    ahead_ns: u64,
}

impl<'s> Streams<'s> {
    /// Asks for a row every `every` ticks of each loop that has variables of these names or patterns, as `vars watch`
    /// understands them, and for the events. `view` has [joined](View::join).
    ///
    /// # Errors
    /// An error that says which name is unknown, or why the system cannot be asked.
    pub fn open(
        directory: &SystemDirectory,
        status: &'s Status,
        view: &'s View,
        patterns: &[String],
        every: u32,
    ) -> Result<Self, AnyError> {
        let (mut topics, mut names) = (Vec::new(), Topics::default());
        let (mut layouts, rows) = (Vec::new(), rows(view, status, patterns, every)?);
        let (rows, known) = rows;
        for source in &rows.sources {
            let (processor, owner) = source.place();
            let ones = source.fields().iter().filter_map(|field| {
                let mut of_source = known
                    .all
                    .iter()
                    .filter(|one| place(one) == (processor, owner));
                of_source.find(|one| *one.entry.name == *field.name)
            });
            let layout = Layout::new(ones.map(field));
            let [name, schema_name] = names.of(processor, owner);
            topics.push(Topic {
                name,
                schema_name,
                schema: layout.schema(),
                has_rows: true,
            });
            layouts.push(layout);
        }
        topics.push(Topic {
            name: EVENTS.into(),
            schema_name: Log::NAME.into(),
            schema: schema::<Log>(),
            has_rows: false,
        });
        let now_ns = view.now().as_ns();
        // Simulated time is told as it is.
        let at_ns = if view.is_simulated() {
            now_ns
        } else {
            wall_ns()
        };
        Ok(Self {
            view,
            rows,
            layouts,
            topics,
            events: Events::of(directory, status, view)?,
            ahead_ns: at_ns.wrapping_sub(now_ns),
        })
    }

    /// Returns the topics.
    #[must_use]
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// Hands over all messages that there are. Returns whether the system still runs.
    ///
    /// # Errors
    /// An error that says why the system cannot be read.
    pub fn read(&mut self, mut take: impl FnMut(Message)) -> Result<bool, AnyError> {
        let (layouts, ahead_ns) = (&self.layouts, self.ahead_ns);
        self.rows.read(|topic, row| {
            let head = Head {
                stamp: Time::from_ns(row.released.as_ns().wrapping_add(ahead_ns)),
                tick: row.tick,
                lost: row.lost.into(),
            };
            let layout = layouts.get(topic);
            // The words are those of the fields.
            if let Some(Ok(payload)) = layout.map(|layout| layout.encode(&head, row.words)) {
                take(Message { topic, payload });
            }
        })?;
        let stamp = Time::from_ns(self.view.now().as_ns().wrapping_add(ahead_ns));
        let topic = layouts.len();
        let mut tell = |level, name: &str, text: &str| {
            let log = Log {
                stamp,
                level,
                name: name.into(),
                text: text.into(),
            };
            let payload = encode(&log);
            take(Message { topic, payload });
        };
        for change in self.rows.changes() {
            tell(condor_ros2::Level::Warn, "condor", &change.text);
        }
        self.events.look(self.view, tell)
    }

    /// Waits until there may be more, some milliseconds at most.
    ///
    /// # Errors
    /// An error of the mailbox.
    pub fn pause(&self) -> Result<(), AnyError> {
        self.rows.pause()
    }
}

/// Asks for rows; returns the names, too.
fn rows<'s>(
    view: &'s View,
    status: &Status,
    patterns: &[String],
    every: u32,
) -> Result<(Rows<'s>, Known), AnyError> {
    if patterns.is_empty() {
        let known = Known {
            all: Vec::new(),
            troubles: Vec::new(),
        };
        return Ok((Rows::of(view, &[], every)?, known));
    }
    let known = Known::all(view, &status.processors)?;
    let columns = known.matching(patterns)?;
    let rows = Rows::of(view, &columns, every)?;
    Ok((rows, known))
}

fn place(one: &One) -> (&str, &str) {
    (&one.member.name, &one.owner)
}

/// Variables and parameters by name, as `condor vars` has them. Values are JSON: a number, a boolean, or the label of a
/// choice.
pub struct Parameters<'v> {
    view: &'v View,
    clients: Clients<'v>,
}

impl<'v> Parameters<'v> {
    /// Makes the way to the programs of a system. `view` has [joined](View::join).
    #[must_use]
    pub const fn new(view: &'v View) -> Self {
        Self {
            view,
            clients: Clients::new(view),
        }
    }

    /// Describes all variables, parameters and fields of published cells: an array with an object for each.
    ///
    /// # Errors
    /// An error that says why there are none.
    pub fn list(&self, members: &[Member]) -> Result<Json, AnyError> {
        let known = Known::all(self.view, members)?;
        let all: Vec<_> = known.all.iter().collect();
        let names = known.labels(&all);
        let described = all.iter().zip(names).map(|(one, name)| {
            let bounds = one.entry.bounds;
            json!({
                "name": name,
                "processor": one.member.name,
                "of": *one.owner,
                "type": one.of.to_string(),
                "unit": one.entry.unit.to_string(),
                "about": one.entry.about.to_string(),
                "bounds": bounds.map(|both| both.map(|bound| one.of.json(bound))),
                "labels": one.of.labels,
            })
        });
        Ok(described.collect())
    }

    /// Returns the value of a parameter, or of a field of a cell.
    ///
    /// # Errors
    /// An error that says that there is no such name, that it is a variable, whose values are only in rows, or why its
    /// program cannot be asked.
    pub fn get(&mut self, members: &[Member], name: &str) -> Result<Json, AnyError> {
        let known = Known::all(self.view, members)?;
        let one = known.find(name)?;
        let value = self.clients.value(one)?;
        let value =
            value.ok_or_else(|| format!("`{name}` is a variable: its values are in rows"))?;
        Ok(one.of.json(value))
    }

    /// Sets a parameter if it has the value `from`, or whatever it has without one. Returns the value that it had. The
    /// program checks the new value.
    ///
    /// # Errors
    /// An error that says that there is no such parameter, what is wrong with the value, that it has another one than
    /// `from`, or why its program cannot be asked.
    pub fn set(
        &mut self,
        members: &[Member],
        name: &str,
        from: Option<&Json>,
        new: &Json,
    ) -> Result<Json, AnyError> {
        let known = Known::all(self.view, members)?;
        let one = known.find(name)?;
        if !one.can_be_set() {
            let others = known.parameters_like(name);
            return Err(format!("`{name}` is no parameter that can be set: {others}").into());
        }
        let from = from.map(|from| parse(one, from)).transpose()?;
        let new = parse(one, new)?;
        let before = self.clients.set(name, one, from, new)?;
        Ok(one.of.json(before))
    }
}

/// Reads a value of JSON. A text is the label of a choice.
fn parse(one: &One, value: &Json) -> Result<Value, String> {
    match value {
        Json::String(label) if one.of.kind == Kind::Choice => one.of.parse(label),
        value => one.of.parse(&value.to_string()),
    }
}
