//! The user interface: a window for each terminal, servo loops, messages, files, the log, and plots.
//!
//! It is a client of a running system, as commands are. It asks the supervisor for the state of
//! processors, is connected to the terminal service, and reads all counts from memory through a
//! [`View`](condor_host::view::View). It may be killed and started again at any time.
//!
//! The state is in `model`; `draw` only reads it, and `input` translates keys and the mouse into
//! requests.

mod draw;
mod feed;
mod input;
mod layout;
mod log;
mod look;
mod menu;
mod model;
mod terminal;
mod tool;
mod window;

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use crate::plot::Figure;
use crate::screen::{self, Screen};
use condor_host::control::{ControlClient, ControlClientError, told_of};
use condor_host::extension::Extension;
use condor_host::robot::Robot;
use condor_host::signals;
use condor_host::system::SystemDirectory;
use feed::{UiEvent, UiFeeds};
use input::Situation;
use look::Look;
use menu::Doer;
use model::{Leaving, Model, Page};
pub use tool::Tool;

/// The least time between two pictures.
const FRAME: Duration = Duration::from_millis(40);
/// The time between two looks at the counts.
const LOOK: Duration = Duration::from_millis(500);

/// The reason why the user interface did not start, or has ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UiError {
    /// The supervisor did not answer, or refused.
    #[error(transparent)]
    Supervisor(#[from] ControlClientError),
    /// The terminal in which it runs has failed.
    #[error("the terminal of the user interface failed: {0}")]
    Terminal(#[from] io::Error),
}

/// Shows the running system in `directory` on this terminal, until a person leaves or SIGHUP, SIGINT or SIGTERM comes.
/// `tools` are programs that the person can start on a processor. `robot` is drawn beside plots. `extensions` are those
/// of the application; plots read static variables of their processors' programs by them.
///
/// # Errors
/// Returns [`UiError`] if the supervisor or the terminal fails; the terminal is restored then.
pub fn run(
    directory: &SystemDirectory,
    tools: Vec<Tool>,
    robot: Option<Box<dyn Robot>>,
    extensions: &[&'static dyn Extension],
) -> Result<(), UiError> {
    let status = ControlClient::connect(directory)?.status()?;
    let mut model = Model::new(&status, tools);
    model.plot.figure = robot.map(Figure::new);
    model.plot.has_colors = screen::has_colors();
    let end = signals::flag()?;
    let (sender, news) = mpsc::channel();
    let feed = UiFeeds::start(directory, &model.windows, &sender);
    let mut screen = Screen::open()?;
    let doer = Doer::new(directory, extensions, sender);
    let outcome = show(&mut screen, &mut model, &news, &feed, &doer, &end);
    drop(screen);
    if outcome? == Leaving::Down {
        let killed = ControlClient::connect(directory)?.down()?;
        if let Some(text) = told_of(&killed) {
            println!("{text}");
        }
    }
    Ok(())
}

fn show(
    screen: &mut Screen,
    model: &mut Model,
    news: &mpsc::Receiver<UiEvent>,
    feed: &UiFeeds,
    doer: &Doer,
    end: &AtomicBool,
) -> io::Result<Leaving> {
    let mut look = Look::new(feed.directory());
    let (mut looked, mut drawn) = (None::<Instant>, None::<Instant>);
    let mut changed = true;
    while !end.load(Ordering::Relaxed) {
        if looked.is_none_or(|at| at.elapsed() >= LOOK) {
            look.look(model);
            looked = Some(Instant::now());
            changed = true;
        }
        if changed && drawn.is_none_or(|at| at.elapsed() >= FRAME) {
            let size = screen.size()?;
            layout::resize(model, size.width, size.height);
            screen.draw(|frame| draw::draw(frame, model))?;
            drawn = Some(Instant::now());
            changed = false;
        }
        let patience = if changed { FRAME } else { LOOK / 2 };
        let mut next = news.recv_timeout(patience).ok();
        while let Some(one) = next {
            changed |= model.is_seen(&one);
            if let Some(leaving) = take(model, one, doer)? {
                return Ok(leaving);
            }
            next = news.try_recv().ok();
            if drawn.is_none_or(|at| at.elapsed() >= FRAME) {
                if let Some(one) = next {
                    changed |= model.is_seen(&one);
                    if let Some(leaving) = take(model, one, doer)? {
                        return Ok(leaving);
                    }
                }
                break;
            }
        }
    }
    Ok(Leaving::Running)
}

fn take(model: &mut Model, news: UiEvent, doer: &Doer) -> io::Result<Option<Leaving>> {
    match news {
        UiEvent::Input(event) => {
            let action = input::action(&Situation::of(model), &event);
            let leaving = action.and_then(|action| menu::act(model, action, doer));
            if model.focus == Page::Plots && model.plot.begin() {
                doer.fetch_plots(model);
            }
            Ok(leaving)
        }
        UiEvent::NoInput(error) => Err(error),
        other => {
            model.hear(other);
            if model.plot.choose_first() {
                doer.fetch_plots(model);
            }
            Ok(None)
        }
    }
}
