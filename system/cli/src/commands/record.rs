//! `condor record`.

mod messages;

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

use clap::Args;
use condor_platform::linux::read_regular;
use condor_ros2::{JointState, Level, StringMessage, TFMessage};
use serde_json::json;

use super::number::duration;
use super::running::Running;
use super::{How, print, print_json};
use crate::recording::{
    self, AttachedFile, Damage, Former, Origin, RecordedTopic, RecordingError, TopicCounts, Writer,
};
use condor_host::application::Application;
use condor_host::description::SystemDescription;
use condor_host::error::{AnyError, tell};
use condor_host::events::EventCollector;
use condor_host::messages::{
    DESCRIPTION, FRAMES, JOINTS, PoseMessages, STATIC_FRAMES, field, wall_ns,
};
use condor_host::plain::plain;
use condor_host::robot::Robot;
use condor_host::signals;
use condor_host::view::View;
use condor_host::watching::{CatalogEntry, NewPrograms, RowSource, Rows, VariableCatalog};
use messages::Messages;

/// The arguments of `condor record`.
#[derive(Debug, Args)]
pub(crate) struct Record {
    /// The file to write; an existing recording is completed and renamed to NAME.1.mcap, or the next free number
    file: PathBuf,
    /// The variables, parameters and fields of published cells, as for `vars watch`; all of them by
    /// default
    names: Vec<String>,
    /// Records the messages to this processor, too: sender, vector and data; may be given several times
    #[arg(long, value_name = "PROCESSOR")]
    messages: Vec<String>,
    /// Ends after this time, such as 10s; a system with a simulated clock counts simulated time
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    limit: Option<Duration>,
    /// Records a row of each loop only once in this number of ticks
    #[arg(long, value_name = "TICKS", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Completes a recording whose recorder was killed; records nothing new
    #[arg(long, conflicts_with_all = ["names", "messages", "limit", "every", "system"])]
    finish: bool,
    #[command(flatten)]
    how: How,
}

impl Record {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        if self.finish {
            return self.finish();
        }
        let running = Running::find(&self.how.which)?;
        let mut view = running.view()?;
        view.join()?;
        let end = signals::flag()?;
        let (robot, attached) = configuration(Path::new(&running.status.file), application);
        let mut recorder = self.begin(&running, &view, robot.as_deref(), &attached)?;
        let begun = view.now();
        let ends = || {
            let elapsed = view.now().as_ns().saturating_sub(begun.as_ns());
            let is_over = |limit: Duration| u128::from(elapsed) >= limit.as_nanos();
            end.load(Ordering::Relaxed) || self.limit.is_some_and(is_over)
        };
        let followed = recorder.follow(ends);
        // The file is completed even after an error.
        let Recorder {
            writer,
            channels,
            rows,
            messages,
            ..
        } = recorder;
        let written = match writer.end() {
            Ok(written) => written,
            Err(error) => return followed.and(Err(error.into())),
        };
        self.summary(&written, &channels, &rows, messages.as_ref())?;
        followed
    }

    /// Makes the file, and asks for rows and events.
    fn begin<'v>(
        &self,
        running: &'v Running,
        view: &'v View,
        robot: Option<&'v dyn Robot>,
        attached: &[AttachedFile],
    ) -> Result<Recorder<'v>, AnyError> {
        messages::members(&running.status, &self.messages)?;
        let known = VariableCatalog::all(view, &running.status.processors)?;
        known.tell_troubles();
        let newcomers = NewPrograms::after(&known, &running.status.processors, &self.names);
        let columns = match self.names.as_slice() {
            [] => known.all.iter().collect(),
            names => known.matching(names)?,
        };
        // This may take long, and rows that are asked for are lost meanwhile.
        let former = Former::complete(&self.file)?;
        let rows = Rows::of(view, &columns, self.every)?;
        if let Some(mut former) = former {
            if let Some(trouble) = former.trouble.take() {
                tell(format_args!(
                    "the earlier recording was broken off and cannot be repaired; it is kept as it is: {trouble}"
                ));
            }
            let kept = former.keep()?;
            let (file, kept) = (self.file.display(), kept.display());
            tell(format_args!("the earlier {file} was renamed to {kept}"));
        }
        let ahead_ns = wall_ns().wrapping_sub(view.now().as_ns());
        let origin = Origin {
            system: &running.status.system,
            is_simulated: running.status.clock.is_some(),
            ahead_ns,
            every: self.every,
            attached,
        };
        let events = EventCollector::of(&running.directory, &running.status, view)?;
        let pose = robot.and_then(|robot| PoseMessages::of(robot, &known, &columns, &rows.sources));
        let mut writer = Writer::create(&self.file, &origin)?;
        let made = describe(&mut writer, robot, pose.as_ref(), view.now().as_ns());
        let add = || {
            made?;
            let (channels, pose) = Self::channels(&mut writer, &columns, &rows, pose)?;
            let messages = Messages::begin(running, &self.messages, &mut writer)?;
            Ok::<_, AnyError>((channels, pose, messages))
        };
        match add() {
            Ok((channels, pose, messages)) => Ok(Recorder {
                view,
                rows,
                newcomers,
                channels,
                messages,
                events,
                pose,
                writer,
            }),
            Err(error) => {
                writer.end()?;
                Err(error)
            }
        }
    }

    /// Adds the channels of rows and of the robot.
    fn channels<'v>(
        writer: &mut Writer,
        columns: &[&CatalogEntry],
        rows: &Rows<'_>,
        pose: Option<PoseMessages<'v>>,
    ) -> Result<(Vec<u16>, Option<Moving<'v>>), RecordingError> {
        let mut channels = Vec::new();
        for source in &rows.sources {
            channels.push(channel(writer, source, columns)?);
        }
        let pose = match pose {
            Some(pose) => Some(Moving {
                pose,
                joints: writer.channel_of::<JointState<'_>>(JOINTS)?,
                frames: writer.channel_of::<TFMessage<'_>>(FRAMES)?,
            }),
            None => None,
        };
        Ok((channels, pose))
    }

    fn finish(&self) -> Result<(), AnyError> {
        let completed = recording::complete(&self.file)?;
        if self.how.json {
            let topics: Vec<_> = (completed.topics.iter())
                .map(|it| {
                    json!({
                        "topic": it.name, "messages": it.messages, "dropped": it.dropped
                    })
                })
                .collect();
            let Damage { places, bytes } = completed.damage;
            return print_json(&json!({
                "was_complete": completed.was_complete, "topics": topics,
                "damaged_places": places, "damaged_bytes": bytes, "damaged_file": completed.kept
            }));
        }
        let file = self.file.display();
        if completed.was_complete {
            return print(format_args!("{file} is complete already\n"));
        }
        for topic in &completed.topics {
            print(format_args!("{}\n", plain(&topic_line(topic))))?;
        }
        if let Damage { places: 1.., bytes } = completed.damage {
            let places = completed.damage.places;
            let text = if places == 1 { "place" } else { "places" };
            print(format_args!(
                "{places} {text} of the file, {bytes} bytes, could not be read and are left out\n"
            ))?;
        }
        if let Some(kept) = &completed.kept {
            let kept = kept.display();
            print(format_args!("the damaged file is kept as {kept}\n"))?;
        }
        print(format_args!("{file} is complete now\n"))
    }

    /// Tells how much was recorded.
    fn summary(
        &self,
        written: &[TopicCounts],
        channels: &[u16],
        rows: &Rows<'_>,
        messages: Option<&Messages<'_>>,
    ) -> Result<(), AnyError> {
        let source = |channel: u16| {
            let place = channels.iter().position(|it| *it == channel)?;
            rows.sources.get(place)
        };
        let missed = |channel| messages.and_then(|it| it.missed(channel));
        if self.how.json {
            let topics: Vec<_> = (written.iter())
                .map(|it| {
                    let source = source(it.channel);
                    let (lost, skipped) =
                        (source.map(RowSource::lost), source.map(RowSource::skipped));
                    let lost = lost.or_else(|| missed(it.channel));
                    json!({
                        "topic": it.topic, "messages": it.messages, "bytes": it.bytes,
                        "lost": lost, "skipped": skipped, "dropped": it.dropped
                    })
                })
                .collect();
            return print_json(&json!({ "file": self.file, "topics": topics }));
        }
        for it in written {
            let (topic, bytes) = (plain(&it.topic), it.bytes);
            let messages = it.messages;
            let dropped = match it.dropped {
                0 => String::new(),
                dropped => format!(", {dropped} dropped"),
            };
            let kept = source(it.channel).map(|source| source.kept(messages));
            let heard =
                || missed(it.channel).map(|missed| format!("{messages} messages, {missed} missed"));
            let counts = kept.or_else(heard);
            let counts = counts.unwrap_or_else(|| format!("{messages} messages"));
            eprintln!("{topic}: {counts}{dropped}, {bytes} bytes");
        }
        Ok(())
    }
}

fn topic_line(topic: &RecordedTopic) -> String {
    let RecordedTopic {
        name,
        messages,
        dropped,
    } = topic;
    match dropped {
        Some(dropped) => format!("{name}: {messages} messages, {dropped} dropped"),
        None => format!("{name}: {messages} messages; how many were dropped is not known"),
    }
}

/// Returns the robot that the description in `file` names, and what is attached to the recording:
/// the description, and the configuration of the robot. Says what cannot be read.
fn configuration(
    file: &Path,
    application: &dyn Application,
) -> (Option<Box<dyn Robot>>, Vec<AttachedFile>) {
    let mut attached = Vec::new();
    let mut attach = |path: &Path| match read_regular(path) {
        Ok(content) => attached.push(AttachedFile {
            name: path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            content,
        }),
        Err(error) => tell(format_args!(
            "cannot attach {} to the recording: {error}",
            path.display()
        )),
    };
    attach(file);
    let robot = match SystemDescription::read(file, application) {
        Ok(description) => description.robot,
        Err(error) => {
            tell(format_args!(
                "the recording will lack joints, frames and the robot's configuration: {error}"
            ));
            None
        }
    };
    let Some(path) = robot else {
        return (None, attached);
    };
    attach(&path);
    let robot = application.robot(&path).unwrap_or_else(|error| {
        tell(format_args!(
            "the recording will lack joints and frames: {error}"
        ));
        None
    });
    (robot, attached)
}

/// Writes the model of a robot, and its frames that no source moves.
fn describe(
    writer: &mut Writer,
    robot: Option<&dyn Robot>,
    pose: Option<&PoseMessages<'_>>,
    now_ns: u64,
) -> Result<(), RecordingError> {
    if let Some(urdf) = robot.and_then(Robot::urdf) {
        let channel = writer.channel_of::<StringMessage<'_>>(DESCRIPTION)?;
        writer.message(channel, now_ns, &StringMessage(&urdf));
    }
    if let Some(pose) = pose {
        let channel = writer.channel_of::<TFMessage<'_>>(STATIC_FRAMES)?;
        let stamp = writer.stamp(now_ns);
        let transforms = &pose.fixed()[..];
        writer.message(channel, now_ns, &TFMessage { stamp, transforms });
    }
    Ok(())
}

/// Adds the channel of the rows of a source.
fn channel(
    writer: &mut Writer,
    source: &RowSource,
    columns: &[&CatalogEntry],
) -> Result<u16, RecordingError> {
    let chosen = source.fields().iter();
    let chosen = chosen.filter_map(|field| columns.get(*field.columns.first()?));
    let (processor, owner) = source.place();
    writer.rows_of(processor, owner, chosen.map(|one| field(one)))
}

/// A recording that is being made.
struct Recorder<'v> {
    view: &'v View,
    rows: Rows<'v>,
    newcomers: NewPrograms,
    /// The channels of the sources of rows.
    channels: Vec<u16>,
    /// The messages between processors that are recorded, if any.
    messages: Option<Messages<'v>>,
    events: EventCollector<'v>,
    pose: Option<Moving<'v>>,
    writer: Writer,
}

/// A robot that moves, and its channels.
struct Moving<'v> {
    pose: PoseMessages<'v>,
    joints: u16,
    frames: u16,
}

impl Recorder<'_> {
    /// Records until it `ends`, or the system has ended.
    fn follow(&mut self, ends: impl Fn() -> bool) -> Result<(), AnyError> {
        loop {
            let is_end = ends();
            let is_alive = self.look()?;
            if is_end {
                return Ok(());
            }
            if !is_alive {
                tell("the system has ended");
                return Ok(());
            }
            self.rows.pause()?;
        }
    }

    /// Records what there is; returns true if the system still runs.
    fn look(&mut self) -> Result<bool, AnyError> {
        let Self {
            channels,
            pose,
            writer,
            ..
        } = self;
        let mut failed: Result<(), RecordingError> = Ok(());
        let read = self.rows.read(|source, row| {
            let (at_ns, lost) = (row.released.as_ns(), row.lost.into());
            if let Some(channel) = channels.get(source)
                && let Err(error) = writer.row(*channel, at_ns, row.tick, lost, row.words)
            {
                failed = Err(error);
            }
            if let Some(Moving {
                pose,
                joints,
                frames,
            }) = pose
                && let Some(posed) = pose.row(source, row)
            {
                let stamp = writer.stamp(at_ns);
                writer.message(*joints, at_ns, &posed.joints(stamp));
                let transforms = &posed.frames()[..];
                writer.message(*frames, at_ns, &TFMessage { stamp, transforms });
            }
        });
        let now = self.view.now().as_ns();
        for change in self.rows.changes() {
            tell(plain(&change.text));
            self.writer.event(now, Level::Warn, "record", &change.text);
        }
        let writer = &mut self.writer;
        let is_alive = self.events.look(self.view, |level, source, text| {
            writer.event(now, level, source, text);
        });
        let heard = self.messages.as_mut();
        let heard = heard.map_or(Ok(()), |it| it.take(writer, now));
        // The rows that were read are written even after an error.
        self.writer.commit()?;
        failed.and(heard)?;
        read?;
        self.take_newcomers()?;
        is_alive
    }

    /// Asks for the rows of programs that have come since.
    fn take_newcomers(&mut self) -> Result<(), RecordingError> {
        let ones = self.newcomers.look(self.view);
        if ones.is_empty() {
            return Ok(());
        }
        let columns: Vec<_> = ones.iter().collect();
        let known = self.rows.sources.len();
        self.rows.extend(&columns);
        for source in self.rows.sources.iter().skip(known) {
            let channel = channel(&mut self.writer, source, &columns)?;
            self.channels.push(channel);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use condor_host::robot::{Frame, RobotJoint, RobotLine};

    /// A base that nothing moves.
    struct Base;

    impl Robot for Base {
        fn joints(&self) -> &[RobotJoint] {
            &[]
        }

        fn lines(&self, _: &[f64]) -> Vec<RobotLine> {
            Vec::new()
        }

        fn frames(&self, _: &[f64]) -> Vec<Frame> {
            vec![Frame {
                name: "base".into(),
                parent: "world".into(),
                translation: [1.0, 0.0, 0.0],
                rotation: [0.0, 0.0, 0.0, 1.0],
            }]
        }

        fn urdf(&self) -> Option<String> {
            Some("<robot name=\"base\"/>".into())
        }
    }

    #[test]
    fn a_recording_has_the_model_of_the_robot() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("run.mcap");
        let origin = Origin {
            system: "tested",
            is_simulated: false,
            ahead_ns: 0,
            every: 1,
            attached: &[],
        };
        let mut writer = Writer::create(&path, &origin).unwrap();
        describe(
            &mut writer,
            Some(&Base),
            Some(&PoseMessages::still(&Base)),
            7,
        )
        .unwrap();
        writer.commit().unwrap();
        writer.end().unwrap();
        let file = std::fs::read(&path).unwrap();
        let messages = mcap::MessageStream::new(&file).unwrap().map(Result::unwrap);
        let messages = messages.map(|it| (it.channel.topic.clone(), it.data.into_owned()));
        let stamp = condor_ros2::Time::from_ns(7);
        let transforms = &PoseMessages::still(&Base).fixed()[..];
        assert_eq!(transforms.len(), 1);
        let urdf = Base.urdf().unwrap();
        let expected = [
            (
                "/robot_description",
                condor_ros2::encode(&StringMessage(&urdf)),
            ),
            (
                "/tf_static",
                condor_ros2::encode(&TFMessage { stamp, transforms }),
            ),
        ];
        let expected = expected.map(|(topic, message)| (topic.to_owned(), message));
        assert_eq!(messages.collect::<Vec<_>>(), expected);
    }
}
