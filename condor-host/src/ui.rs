//! The user interface: a window for each terminal, servo loops, messages, files and the log.
//!
//! It is a client of a running system, as commands are. It asks the supervisor for the state of
//! processors, is connected to the terminal service, and reads all counts from memory through a
//! [`View`](crate::view::View). It may be killed and started again at any time.
//!
//! The state is in `model`; `draw` only reads it, and `input` translates keys and the mouse into
//! requests.

mod draw;
mod feed;
mod guard;
mod input;
mod layout;
mod log;
mod look;
mod menu;
mod model;
mod screen;
mod tool;
mod window;

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Once, mpsc};
use std::time::{Duration, Instant};

use crossterm::event::{
    DisableBracketedPaste, DisableMouseCapture, EnableBracketedPaste, EnableMouseCapture,
};
use crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;

use crate::control::{Client, ClientError};
use crate::signals;
use crate::system::SystemDirectory;
use feed::{Feed, News};
use guard::Guard;
use input::Situation;
use look::Look;
use menu::Doer;
use model::{Leaving, Model};
pub use tool::Tool;

/// The least time between two pictures.
const FRAME: Duration = Duration::from_millis(40);
/// The time between two looks at the counts.
const LOOK: Duration = Duration::from_millis(500);

/// The reason for which there is no user interface.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UiError {
    /// The supervisor did not answer, or refused.
    #[error(transparent)]
    Supervisor(#[from] ClientError),
    /// The terminal in which it runs has failed.
    #[error("the terminal of the user interface failed: {0}")]
    Terminal(#[from] io::Error),
}

/// Shows a running system on this terminal until a person leaves or a signal comes. `tools` are the
/// programs that the person can start on a processor.
///
/// # Errors
/// [`UiError`] if the supervisor or the terminal fails; the terminal is restored then.
pub fn run(directory: &SystemDirectory, tools: Vec<Tool>) -> Result<(), UiError> {
    let status = Client::connect(directory)?.status()?;
    let mut model = Model::new(&status, tools);
    let end = signals::flag()?;
    let (sender, news) = mpsc::channel();
    let feed = Feed::start(directory, &model.windows, &sender);
    let screen = Screen::open()?;
    let doer = Doer::new(directory, sender);
    let outcome = show(&mut model, &news, &feed, &doer, &end);
    drop(screen);
    if outcome? == Leaving::Down {
        Client::connect(directory)?.down()?;
    }
    Ok(())
}

fn show(
    model: &mut Model,
    news: &mpsc::Receiver<News>,
    feed: &Feed,
    doer: &Doer,
    end: &AtomicBool,
) -> io::Result<Leaving> {
    let mut terminal = Terminal::new(CrosstermBackend::new(io::stdout()))?;
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
            let size = terminal.size()?;
            layout::resize(model, size.width, size.height);
            terminal.draw(|frame| draw::draw(frame, model))?;
            drawn = Some(Instant::now());
            changed = false;
        }
        let patience = if changed { FRAME } else { LOOK / 2 };
        let mut next = news.recv_timeout(patience).ok();
        while let Some(one) = next {
            changed = true;
            if let Some(leaving) = take(model, one, doer)? {
                return Ok(leaving);
            }
            next = news.try_recv().ok();
            if drawn.is_none_or(|at| at.elapsed() >= FRAME) {
                if let Some(one) = next
                    && let Some(leaving) = take(model, one, doer)?
                {
                    return Ok(leaving);
                }
                break;
            }
        }
    }
    Ok(Leaving::Running)
}

fn take(model: &mut Model, news: News, doer: &Doer) -> io::Result<Option<Leaving>> {
    match news {
        News::Input(event) => {
            let action = input::action(&Situation::of(model), &event);
            Ok(action.and_then(|action| menu::act(model, action, doer)))
        }
        News::NoInput(error) => Err(error),
        other => {
            model.hear(other);
            Ok(None)
        }
    }
}

/// This terminal, taken over; restored when it is dropped, before a panic is told, and by a guard if
/// this process is killed.
struct Screen {
    _guard: Option<Guard>,
}

impl Screen {
    fn open() -> io::Result<Self> {
        static HOOK: Once = Once::new();
        HOOK.call_once(|| {
            let before = std::panic::take_hook();
            std::panic::set_hook(Box::new(move |info| {
                restore();
                before(info);
            }));
        });
        let mut leave = Vec::new();
        write_leave(&mut leave)?;
        // Without a shell there is none.
        let guard = Guard::start("/dev/tty".as_ref(), &String::from_utf8_lossy(&leave));
        enable_raw_mode()?;
        let screen = Self { _guard: guard.ok() };
        crossterm::execute!(
            io::stdout(),
            EnterAlternateScreen,
            EnableMouseCapture,
            EnableBracketedPaste
        )?;
        Ok(screen)
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        restore();
    }
}

/// Nothing can be done about a terminal that has gone.
fn restore() {
    let _ = write_leave(&mut io::stdout());
    let _ = disable_raw_mode();
}

/// Writes what undoes all that was asked of the terminal.
fn write_leave(to: &mut impl io::Write) -> io::Result<()> {
    crossterm::execute!(
        to,
        DisableBracketedPaste,
        DisableMouseCapture,
        LeaveAlternateScreen,
        crossterm::cursor::Show
    )
}
