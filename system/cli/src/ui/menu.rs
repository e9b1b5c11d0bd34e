//! Carries out the actions that a person chooses.

use std::sync::mpsc::Sender;
use std::thread;

use crossterm::event::Event;
use tui_input::backend::crossterm::EventHandler as _;

use super::feed::UiEvent;
use super::input::Action;
use super::model::{Leaving, Model, Page, Popup};
use super::scroll::scroll;
use super::search::search;
use super::tool::{self, Tool};
use crate::commands::number::duration;
use crate::plot::{self, PlotRequest};
use condor_host::control::{
    ControlClient, ControlClientError, ControlRequest, Member, MemberState, from_here,
};
use condor_host::error::me;
use condor_host::extension::Extension;
use condor_host::system::SystemDirectory;

/// The actions on a processor whose program has ended, and on one whose program runs; they come behind those on the
/// clock and the tools, which end nothing.
const ORDERS: [&[&str]; 2] = [&["start", LOAD], &["restart", "stop", LOAD]];
/// Another program, which is typed.
const LOAD: &str = "load …";

/// An entry of the menu of actions.
#[derive(Clone, Debug)]
pub(super) enum Entry {
    /// One of the `ORDERS` to the processor.
    Order(&'static str),
    /// The simulated clock stops.
    Pause,
    /// The time goes on.
    Resume,
    /// The time goes on for a time that is typed.
    Step,
    Tool(Tool),
}

/// The entries of the menu for a processor.
pub(super) fn entries(model: &Model, member: &Member) -> impl Iterator<Item = Entry> {
    let clock = match &model.clock {
        None => &[][..],
        Some(clock) if clock.paused => &[Entry::Resume, Entry::Step],
        Some(_) => &[Entry::Pause, Entry::Step],
    };
    let has_ended = matches!(member.state, MemberState::Failed | MemberState::Stopped);
    let [of_ended, of_running] = ORDERS;
    let orders = if has_ended { of_ended } else { of_running };
    let orders = orders.iter().copied().map(Entry::Order);
    let tools = model.tools.iter().cloned().map(Entry::Tool);
    tools.chain(clock.iter().cloned()).chain(orders)
}

/// The clock, in what is said of an order to it.
const CLOCK: &str = "clock";

/// Asks the supervisor, without holding up the picture.
#[derive(Debug)]
pub(super) struct Doer {
    directory: SystemDirectory,
    news: Sender<UiEvent>,
    plots: plot::PlotFeed,
}

impl Doer {
    pub(super) fn new(
        directory: &SystemDirectory,
        extensions: &[&'static dyn Extension],
        news: Sender<UiEvent>,
    ) -> Self {
        let plots = news.clone();
        let tell = move |it| plots.send(UiEvent::Plot(it)).is_ok();
        Self {
            directory: directory.clone(),
            news,
            plots: plot::PlotFeed::start(directory, extensions, tell),
        }
    }

    /// Fetches the values that the plots wish.
    pub(super) fn fetch_plots(&self, model: &Model) {
        self.plots.wish(model.plot.wish());
    }

    /// Sends a request about `processor`, which is called `order`.
    fn order(&self, order: &'static str, processor: &str, request: ControlRequest) {
        let (directory, news) = (self.directory.clone(), self.news.clone());
        let processor = processor.to_owned();
        thread::spawn(move || {
            let text = match ask(&directory, &request) {
                Ok(()) => format!("{processor}: {order} is done"),
                Err(error) => format!("{processor}: {order} failed: {error}"),
            };
            // Nobody may be there any more to read it.
            let _ = news.send(UiEvent::Notice(text));
        });
    }
}

fn ask(directory: &SystemDirectory, request: &ControlRequest) -> Result<(), ControlClientError> {
    ControlClient::connect(directory)?.ask(request)?;
    Ok(())
}

/// Returns the request to the supervisor that carries out an order.
fn request(order: &str, processor: &str) -> ControlRequest {
    let processor = processor.into();
    match order {
        "stop" => ControlRequest::Stop { processor },
        "start" => ControlRequest::Start { processor },
        _ => ControlRequest::Restart {
            processor,
            held: false,
        },
    }
}

/// Carries out `action`; returns how the person leaves, if the action is to leave.
pub(super) fn act(model: &mut Model, action: Action, doer: &Doer) -> Option<Leaving> {
    if model.popup.is_none() && action != Action::Draw {
        model.notice = None;
    }
    match action {
        Action::Type(bytes) => type_in(model, &bytes),
        Action::Focus(page) => model.focus = page,
        Action::FocusWindow(place) => {
            if let Some(window) = model.windows.get(place) {
                model.focus = Page::Window(window.id);
            }
        }
        Action::Step(tabs) => model.step(tabs),
        Action::Scroll(page, lines) => scroll(model, page, lines),
        Action::Zoom => model.zoomed = !model.zoomed,
        Action::Show(popup) => {
            model.typed.reset();
            model.popup = Some(popup);
        }
        Action::Search { is_up } => search(model, is_up),
        Action::NextLevel => model.show_from(model.least.next()),
        Action::Menu => open_menu(model),
        Action::MenuOf(page) => {
            model.focus = page;
            open_menu(model);
        }
        Action::ClosePopup => (model.popup, model.notice) = (None, None),
        Action::MenuMove { members, entries } => move_by(model, members, entries),
        Action::MenuDo => carry_out(model, doer),
        Action::Edit(key) => {
            model.notice = None;
            model.typed.handle_event(&Event::Key(key));
        }
        Action::Insert(text) if model.popup.is_some() => plot::insert(&mut model.typed, &text),
        Action::Insert(text) => plot::paste(&mut model.plot, &text),
        Action::Confirm => {
            if let Some(Popup::Confirm { member, order }) = model.popup.take() {
                give(model, doer, member, order);
            }
        }
        Action::Load => load(model, doer),
        Action::StepClock => step_clock(model, doer),
        Action::CloseWindow => {
            if let Page::Window(id) = model.focus {
                model.forget(id);
            }
        }
        Action::Plot(key) => match plot::press(&mut model.plot, &key) {
            Some(PlotRequest::Fetch) => doer.fetch_plots(model),
            Some(PlotRequest::Leave) => model.popup = Some(Popup::Leave),
            None => {}
        },
        Action::Leave(leaving) => return Some(leaving),
        Action::Draw => {}
    }
    None
}

fn open_menu(model: &mut Model) {
    let member = model.member_in_focus();
    model.popup = Some(Popup::Menu { member, entry: 0 });
}

fn type_in(model: &mut Model, bytes: &[u8]) {
    let Page::Window(id) = model.focus else {
        return;
    };
    let typed = model.window_mut(id).map(|window| window.type_in(bytes));
    if typed == Some(false) {
        model.notice = Some(
            "the terminal takes nothing now: its service is not running, or its program does not read; \
             what you type is kept (64 KiB at most)"
                .into(),
        );
    }
}

fn move_by(model: &mut Model, members: isize, lines: isize) {
    let Some(Popup::Menu { member, entry }) = model.popup else {
        return;
    };
    let member = turned(member, members, model.members.len());
    let of_member = model.members.get(member);
    let entries = of_member.map_or(0, |it| entries(model, it).count());
    // Another processor may have fewer.
    let entry = entry.min(entries.saturating_sub(1));
    let entry = turned(entry, lines, entries);
    model.popup = Some(Popup::Menu { member, entry });
}

/// A place of `count`, so many further on, and round again.
fn turned(place: usize, by: isize, count: usize) -> usize {
    let (place, count) = (place.cast_signed(), count.cast_signed().max(1));
    (place + by).rem_euclid(count).cast_unsigned()
}

fn carry_out(model: &mut Model, doer: &Doer) {
    let Some(Popup::Menu {
        member: place,
        entry,
    }) = model.popup.take()
    else {
        return;
    };
    let Some(member) = model.members.get(place).cloned() else {
        return;
    };
    let entry = entries(model, &member).nth(entry);
    let tool = match entry {
        Some(Entry::Order(LOAD)) => {
            let words = [core::slice::from_ref(&member.program), &member.arguments].concat();
            model.typed = words.join(" ").into();
            model.popup = Some(Popup::Program { member: place });
            return;
        }
        Some(Entry::Order("start")) => return give(model, doer, place, "start"),
        Some(Entry::Order(order)) => {
            model.popup = Some(Popup::Confirm {
                member: place,
                order,
            });
            return;
        }
        Some(Entry::Pause) => return doer.order("pause", CLOCK, ControlRequest::Pause {}),
        Some(Entry::Resume) => return doer.order("resume", CLOCK, ControlRequest::Resume {}),
        Some(Entry::Step) => {
            model.typed.reset();
            model.popup = Some(Popup::Step);
            return;
        }
        Some(Entry::Tool(tool)) => tool,
        None => return,
    };
    let condor = tool::condor().unwrap_or_else(|_| me());
    let Some(command) = tool.filled(&condor, &model.system, &member) else {
        let text = format!(
            "{} has no process on which {} could run; start it first",
            member.name, tool.name
        );
        model.notice = Some(text);
        return;
    };
    let title = format!("{} {}", tool.name, member.name);
    let id = model.open_window(title, member.number, true);
    match tool::start(&command, id, &doer.news) {
        Ok(()) => model.focus = Page::Window(id),
        Err(error) => {
            model.forget(id);
            model.notice = Some(format!("{} cannot be started: {error}", tool.name));
        }
    }
}

/// Sends an order to the processor at a place in the list.
fn give(model: &mut Model, doer: &Doer, member: usize, order: &'static str) {
    if let Some(member) = model.members.get(member) {
        model.notice = Some(format!("{}: {order} …", member.name));
        doer.order(order, &member.name, request(order, &member.name));
    }
}

/// Has a processor run the program that was typed: its file, then its arguments.
fn load(model: &mut Model, doer: &Doer) {
    let Some(Popup::Program { member }) = model.popup.take() else {
        return;
    };
    let Some(member) = model.members.get(member) else {
        return;
    };
    let words = model.typed.value().split_whitespace();
    let mut words = words.map(String::from);
    let program = match words.next().map(from_here).transpose() {
        Ok(Some(program)) => program,
        Ok(None) => return,
        Err(error) => {
            model.notice = Some(format!("{}: {error}", member.name));
            return;
        }
    };
    let request = ControlRequest::Load {
        processor: member.name.clone(),
        program,
        arguments: words.collect(),
    };
    model.notice = Some(format!("{}: load …", member.name));
    doer.order("load", &member.name, request);
}

/// Has the simulated clock go on for the time that was typed.
fn step_clock(model: &mut Model, doer: &Doer) {
    model.popup = None;
    let time = duration(model.typed.value().trim());
    let ns = time.and_then(|time| u64::try_from(time.as_nanos()).map_err(|_| "too long".into()));
    match ns {
        Ok(ns) => doer.order("step", CLOCK, ControlRequest::Step { ns }),
        Err(error) => model.notice = Some(format!("{CLOCK}: step failed: {error}")),
    }
}
