//! `condor plot`.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use crossterm::event::{Event, KeyEventKind};
use ratatui::layout::{Constraint, Layout};
use ratatui::style::Stylize;
use ratatui::text::Line;

use super::SystemChoice;
use super::number::duration;
use super::running::Running;
use crate::plot::{self, Condition, FeedEvent, Figure, PlotFeed, PlotRequest, Prompt, press};
use crate::recording::RecordingReader;
use crate::screen::{self, Screen, has_colors, keyboard};
use condor_host::application::Application;
use condor_host::error::AnyError;
use condor_host::plain::plain;
use condor_host::reading::robot_of;
use condor_host::signals;

/// The least and the greatest time between two pictures of what changes.
const FRAME: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(1)];
/// The time between two pictures is at least this many times what a picture takes, so that drawing many
/// curves takes a thirtieth of a core.
const REST: u32 = 30;
/// The time of a running system that is seen at once by default.
const SPAN: Duration = Duration::from_secs(10);
/// The time between two looks whether to end.
const LOOK: Duration = Duration::from_millis(250);

#[derive(Debug, Args)]
pub(crate) struct Plot {
    /// The variables of the first pane, of any loops; if several have the same name, put PROCESSOR: or
    /// PROCESSOR:LOOP: before it. PROCESSOR:EXPRESSION is a number of a program, as for `print`. In a
    /// name, * stands for any characters, and ? for one. If the first name ends with .mcap, it is a recording,
    /// and variables of the recording are drawn instead of those of a system
    #[arg(required_unless_present_any = ["panes", "robot"])]
    names: Vec<String>,
    /// Adds a pane with these variables, separated by spaces; may be given several times
    #[arg(long = "pane", value_name = "NAMES")]
    panes: Vec<String>,
    /// The length of time that is shown, such as 10s; by default 10s, or all of a recording
    #[arg(long, value_name = "TIME", value_parser = duration)]
    span: Option<Duration>,
    /// Shows the time around each instant at which a variable passes a level: NAME>LEVEL or NAME<LEVEL,
    /// followed by ~WIDTH for a hysteresis
    #[arg(long, value_name = "CONDITION")]
    trigger: Option<Condition>,
    /// Also draws the robot
    #[arg(long)]
    robot: bool,
    #[command(flatten)]
    which: SystemChoice,
}

/// An event for the plot: of the keyboard, or of the source of values.
enum PlotEvent {
    Input(Event),
    /// The keyboard is gone.
    NoInput(io::Error),
    Plot(FeedEvent),
}

impl Plot {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        if !screen::is_possible() {
            return Err(
                "plots need a terminal, and TERM must not be `dumb`; without one, use `vars watch`"
                    .into(),
            );
        }
        let (recording, names) = self.split();
        let end = signals::flag()?;
        let (sender, events) = channel();
        let news = sender.clone();
        let tell = move |it| news.send(PlotEvent::Plot(it)).is_ok();
        let (mut plot, feed);
        if let Some(path) = recording {
            let reader = RecordingReader::open(path)?;
            let time = reader.span();
            let span = Duration::from_nanos(time.end.saturating_sub(time.start));
            plot = self.plot(names, span, application.description(), application)?;
            plot.zero_ns = Some(time.start);
            if self.panes.is_empty() && names.is_empty() && !self.robot {
                plot.prompt = Some(Prompt::Names);
            }
            feed = PlotFeed::of_file(reader, tell);
        } else {
            let running = Running::find(&self.which)?;
            let file = Some(running.status.file.into());
            plot = self.plot(names, SPAN, file, application)?;
            feed = PlotFeed::start(&running.directory, application.extensions(), tell);
        }
        feed.wish(plot.wish());
        // If nothing can be plotted, the reason is told without a picture.
        match events.recv() {
            Ok(PlotEvent::Plot(FeedEvent::Trouble(text))) => return Err(text.into()),
            Ok(PlotEvent::Plot(news)) => plot.hear(news),
            _ => {}
        }
        let screen = Screen::open()?;
        thread::spawn(move || {
            keyboard(|read| {
                sender
                    .send(read.map_or_else(PlotEvent::NoInput, PlotEvent::Input))
                    .is_ok()
            });
        });
        Ok(show(screen, &mut plot, &events, &feed, &end)?)
    }

    /// Splits the recording from the names.
    fn split(&self) -> (Option<&Path>, &[String]) {
        let first = self.names.split_first();
        let recording = first.filter(|(first, _)| {
            let extension = Path::new(first).extension();
            extension.is_some_and(|it| it.eq_ignore_ascii_case("mcap"))
        });
        match recording {
            Some((path, names)) => (Some(Path::new(path)), names),
            None => (None, &self.names),
        }
    }

    /// Makes a plot that shows so much time by default, of the robot of the description `file`.
    fn plot(
        &self,
        names: &[String],
        span: Duration,
        file: Option<PathBuf>,
        application: &dyn Application,
    ) -> Result<plot::Plot, AnyError> {
        let robot = file.map(|file| robot_of(&file, application));
        let robot = robot.transpose()?.flatten();
        if self.robot && robot.is_none() {
            return Err(
                "no drawing: the description has no `robot` that this program knows".into(),
            );
        }
        let span = self.span.unwrap_or(span);
        let mut plot = plot::Plot::new(span, robot.map(Figure::new), has_colors());
        if !names.is_empty() {
            plot.add_pane(names.to_vec());
        }
        for names in &self.panes {
            plot.add_pane(names.split_whitespace().map(String::from).collect());
        }
        if self.robot {
            plot.show_robot(names.is_empty() && self.panes.is_empty());
        }
        plot.arm(self.trigger.clone());
        Ok(plot)
    }
}

/// Shows a plot until the person leaves, or it is to `end`.
fn show(
    mut screen: Screen,
    plot: &mut plot::Plot,
    events: &Receiver<PlotEvent>,
    feed: &PlotFeed,
    end: &AtomicBool,
) -> io::Result<()> {
    let mut drawn = None::<Instant>;
    let mut changed = true;
    let [least, greatest] = FRAME;
    let mut frame_time = least;
    while !end.load(Ordering::Relaxed) {
        let since = drawn.map_or(frame_time, |at| at.elapsed());
        if changed && since >= frame_time {
            let begun = Instant::now();
            screen.draw(|frame| {
                let rows = [Constraint::Fill(1), Constraint::Length(1)];
                let [area, line] = Layout::vertical(rows).areas(frame.area());
                plot::draw(plot, area, frame.buffer_mut());
                let state = format!("{}, F1 keys, q leave", plot.state());
                let told = match &plot.notice {
                    Some(notice) => Line::raw(plain(notice)).yellow(),
                    None => Line::raw(plain(&state)).dim(),
                };
                frame.render_widget(told, line);
            })?;
            drawn = Some(begun);
            frame_time = (REST * begun.elapsed()).clamp(least, greatest);
            changed = false;
        }
        let patience = if changed {
            frame_time.saturating_sub(since)
        } else {
            LOOK
        };
        let mut next = events.recv_timeout(patience).ok();
        while let Some(one) = next {
            changed = true;
            match one {
                PlotEvent::Plot(news) => plot.hear(news),
                PlotEvent::NoInput(error) => return Err(error),
                PlotEvent::Input(Event::Key(key)) if key.kind != KeyEventKind::Release => {
                    match press(plot, &key) {
                        Some(PlotRequest::Fetch) => feed.wish(plot.wish()),
                        Some(PlotRequest::Leave) => return Ok(()),
                        None => {}
                    }
                }
                PlotEvent::Input(Event::Paste(text)) => plot::paste(plot, &text),
                PlotEvent::Input(_) => {}
            }
            next = events.try_recv().ok();
        }
    }
    Ok(())
}
