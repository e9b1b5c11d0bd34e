//! The sources of events: threads that each listen to one thing, and connect again when it ends.

use std::io::{self, Read};
use std::os::unix::net::UnixStream;
use std::sync::mpsc::Sender;
use std::thread;
use std::time::Duration;

use crossterm::event::Event;

use super::window::{Input, Window, WindowId};
use crate::plot;
use crate::screen;
use condor_host::control::{self, ControlClient, ControlClientError, SystemStatus};
use condor_host::services::terminals;
use condor_host::system::SystemDirectory;

/// The time between two looks at the processors.
const STATUS: Duration = Duration::from_millis(500);
/// The time between two attempts to connect.
const AGAIN: Duration = Duration::from_millis(500);
/// Lines of the log from before.
const LOG_LINES: usize = 500;

/// An event for the plot.
#[derive(Debug)]
pub(super) enum UiEvent {
    Input(Event),
    /// The keyboard is gone.
    NoInput(io::Error),
    Status(Box<SystemStatus>),
    /// The supervisor does not answer.
    Gone(String),
    LogBegins(Vec<String>),
    Log(String),
    /// A terminal is attached, and repeats what it wrote.
    Opened(WindowId, Input),
    Output(WindowId, Vec<u8>),
    Closed(WindowId),
    /// The outcome of a request.
    Notice(String),
    Plot(plot::FeedEvent),
    /// The caption of a step of a demonstration.
    Caption(String),
}

/// The threads end with the process, or when the receiver of their news is gone.
#[derive(Debug)]
pub(super) struct UiFeeds {
    directory: SystemDirectory,
}

impl UiFeeds {
    pub(super) fn start(
        directory: &SystemDirectory,
        windows: &[Window],
        news: &Sender<UiEvent>,
    ) -> Self {
        let keys = news.clone();
        thread::spawn(move || {
            screen::keyboard(|read| {
                keys.send(read.map_or_else(UiEvent::NoInput, UiEvent::Input))
                    .is_ok()
            });
        });
        let (place, answers) = (directory.clone(), news.clone());
        thread::spawn(move || supervisor(&place, &answers));
        let (place, lines) = (directory.clone(), news.clone());
        thread::spawn(move || log(&place, &lines));
        for window in windows {
            let (place, output) = (directory.clone(), news.clone());
            let (id, processor) = (window.id, window.title.clone());
            thread::spawn(move || terminal(&place, &processor, id, &output));
        }
        Self {
            directory: directory.clone(),
        }
    }

    pub(super) const fn directory(&self) -> &SystemDirectory {
        &self.directory
    }
}

fn supervisor(directory: &SystemDirectory, news: &Sender<UiEvent>) {
    loop {
        let ended: Result<(), ControlClientError> =
            ControlClient::connect(directory).and_then(|mut client| {
                loop {
                    let status = Box::new(client.status()?);
                    if news.send(UiEvent::Status(status)).is_err() {
                        return Ok(());
                    }
                    thread::sleep(STATUS);
                }
            });
        let Err(error) = ended else {
            return;
        };
        if news.send(UiEvent::Gone(error.to_string())).is_err() {
            return;
        }
        thread::sleep(AGAIN);
    }
}

fn log(directory: &SystemDirectory, news: &Sender<UiEvent>) {
    loop {
        // The thread of the states tells why the log cannot be followed.
        if let Ok(false) = follow(directory, news) {
            return;
        }
        thread::sleep(AGAIN);
    }
}

/// False if nobody hears.
fn follow(directory: &SystemDirectory, news: &Sender<UiEvent>) -> Result<bool, ControlClientError> {
    let (lines, events) = control::follow(directory, LOG_LINES)?;
    if news.send(UiEvent::LogBegins(lines)).is_err() {
        return Ok(false);
    }
    for event in events {
        if news.send(UiEvent::Log(event?.to_string())).is_err() {
            return Ok(false);
        }
    }
    Ok(true)
}

fn terminal(directory: &SystemDirectory, name: &str, id: WindowId, news: &Sender<UiEvent>) {
    loop {
        if let Ok(stream) = UnixStream::connect(directory.terminal(name))
            && let Ok(input) = terminals::keyboard(directory, name)
        {
            let opened = UiEvent::Opened(id, Input::Terminal(input));
            if news.send(opened).is_err() || !pass_on(stream, id, news) {
                return;
            }
        }
        thread::sleep(AGAIN);
    }
}

/// Passes on what comes until it ends; false if nobody hears.
pub(super) fn pass_on(mut from: impl Read, id: WindowId, news: &Sender<UiEvent>) -> bool {
    let mut piece = [0; 16 * 1024];
    loop {
        match from.read(&mut piece) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            // A pseudo-terminal whose last user has gone is an error.
            Ok(0) | Err(_) => return news.send(UiEvent::Closed(id)).is_ok(),
            Ok(count) => {
                let bytes = piece.get(..count).unwrap_or_default().to_vec();
                if news.send(UiEvent::Output(id, bytes)).is_err() {
                    return false;
                }
            }
        }
    }
}
