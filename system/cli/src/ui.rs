//! The user interface: a window for each terminal, servo loops, messages, files, the log, and plots.
//!
//! It is a client of a running system, as commands are. It asks the supervisor for the state of
//! processors, is connected to the terminal service, and reads all counts from memory through a
//! [`View`](condor_host::view::View). It may be killed and started again at any time.
//!
//! The state is in `model`; `draw` only reads it, and `input` translates keys and the mouse into
//! requests.

mod choices;
mod draw;
mod feed;
mod input;
mod layout;
mod log;
mod look;
mod menu;
mod model;
mod scroll;
mod search;
mod terminal;
mod tool;
mod window;

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use crate::demo::Demo;
use crate::plot::Figure;
use crate::screen::{self, Screen};
use condor_host::control::{ControlClient, ControlClientError, told_of};
use condor_host::error::me;
use condor_host::extension::Extension;
use condor_host::robot::Robot;
use condor_host::signals;
use condor_host::system::SystemDirectory;
use feed::{UiEvent, UiFeeds};
use input::Situation;
use look::Look;
use menu::Doer;
use model::{Leaving, Model};
pub(crate) use tool::Tool;

/// The least time between two pictures.
const FRAME: Duration = Duration::from_millis(40);
/// The time between two looks at the counts.
const LOOK: Duration = Duration::from_millis(500);

/// The reason why the user interface did not start, or has ended.
#[derive(Debug, thiserror::Error)]
pub(crate) enum UiError {
    /// The supervisor did not answer, or refused.
    #[error(transparent)]
    Supervisor(#[from] ControlClientError),
    /// The terminal in which it runs has failed.
    #[error("the terminal of the user interface failed: {0}")]
    Terminal(#[from] io::Error),
}

/// Shows the running system in `directory` on this terminal, until a person leaves or SIGHUP, SIGINT or SIGTERM comes.
/// `tools` are programs that the person can start on a processor. `robot` is drawn beside plots. `extensions` are those
/// of the application; plots read static variables of their processors' programs by them. `demo` is carried out beside.
///
/// # Errors
/// Returns [`UiError`] if the supervisor or the terminal fails; the terminal is restored then.
pub(crate) fn run(
    directory: &SystemDirectory,
    tools: Vec<Tool>,
    robot: Option<Box<dyn Robot>>,
    extensions: &[&'static dyn Extension],
    demo: Option<Demo>,
) -> Result<(), UiError> {
    let status = ControlClient::connect(directory)?.status()?;
    let mut model = Model::new(&status, tools);
    model.plot.figure = robot.map(Figure::new);
    model.plot.has_colors = screen::has_colors();
    let kept = directory.path().join(choices::FILE);
    choices::restore(&mut model, &kept);
    let end = signals::flag()?;
    let (sender, news) = mpsc::channel();
    let feed = UiFeeds::start(directory, &model.windows, &sender);
    if let Some(demo) = demo {
        let (place, captions) = (directory.clone(), sender.clone());
        thread::spawn(move || {
            demo.play(&place, |caption| {
                captions.send(UiEvent::Caption(caption)).is_ok()
            });
        });
    }
    let mut screen = Screen::open()?;
    let doer = Doer::new(directory, extensions, sender);
    let outcome = show(&mut screen, &mut model, &news, &feed, &doer, &end);
    drop(screen);
    // A directory of a system that has ended belongs to the next one.
    if model.gone.is_none()
        && let Err(error) = choices::keep(&model, &kept)
    {
        let (me, kept) = (me(), kept.display());
        eprintln!("{me}: layout and plots are not kept: {kept}: {error}");
    }
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
            if model.begin_plots() {
                doer.fetch_plots(model);
            }
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
            Ok(action.and_then(|action| menu::act(model, action, doer)))
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
