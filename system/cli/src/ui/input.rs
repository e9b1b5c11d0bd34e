//! The actions that keys, the mouse and pastes ask for.

use crossterm::event::{
    Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers, MouseButton, MouseEvent, MouseEventKind,
};

use super::layout::{Layout, layout};
use super::model::{Leaving, Model, Page, Popup};

/// Lines that a turn of the wheel scrolls.
const WHEEL: i32 = 3;
/// Lines that a page has, for scrolling.
const PAGE: i32 = 15;

/// The state on which the meaning of an event depends.
#[derive(Clone, Debug)]
pub(super) struct Situation {
    pub(super) focus: Page,
    pub(super) popup: Option<Popup>,
    /// The window in front is that of a tool that has ended.
    pub(super) is_over: bool,
    pub(super) application_cursor: bool,
    pub(super) layout: Layout,
}

impl Situation {
    pub(super) fn of(model: &Model) -> Self {
        let window = match model.focus {
            Page::Window(id) => model.window(id),
            _ => None,
        };
        Self {
            focus: model.focus,
            popup: model.popup,
            is_over: window.is_some_and(|it| it.is_tool && !it.is_connected()),
            application_cursor: window.is_some_and(|it| it.screen().application_cursor()),
            layout: layout(model.area, model),
        }
    }
}

/// An action that a person asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Action {
    Type(Vec<u8>),
    Focus(Page),
    /// The window of this place, from 0.
    FocusWindow(usize),
    Step(isize),
    Scroll(Page, i32),
    Zoom,
    Show(Popup),
    /// The typed text is searched for above the lines that are seen, or below them.
    Search {
        is_up: bool,
    },
    /// The log shows lines from the next level on.
    NextLevel,
    Menu,
    /// The actions of what a page shows.
    MenuOf(Page),
    ClosePopup,
    MenuMove {
        members: isize,
        entries: isize,
    },
    MenuDo,
    /// A key, and a text that is pasted, for what is typed into a popup.
    Edit(KeyEvent),
    Insert(String),
    /// The order that was asked about is to be carried out.
    Confirm,
    /// The program that was typed is to run.
    Load,
    /// The clock is to go on for the time that was typed.
    StepClock,
    CloseWindow,
    Leave(Leaving),
    /// A key for the plots.
    Plot(KeyEvent),
    /// The size has changed.
    Draw,
}

/// Returns the action that an event asks for; `None` for most events.
pub(super) fn action(situation: &Situation, event: &Event) -> Option<Action> {
    match event {
        Event::Key(key) if key.kind != KeyEventKind::Release => self::key(situation, key),
        Event::Mouse(mouse) => self::mouse(situation, *mouse),
        Event::Paste(text) => {
            let typed = || Action::Type(text.replace('\n', "\r").into_bytes());
            match (situation.popup, situation.focus) {
                (Some(Popup::Program { .. } | Popup::Step | Popup::Search), _)
                | (None, Page::Plots) => Some(Action::Insert(text.clone())),
                (None, Page::Window(_)) => Some(typed()),
                _ => None,
            }
        }
        Event::Resize(..) => Some(Action::Draw),
        _ => None,
    }
}

fn key(situation: &Situation, key: &KeyEvent) -> Option<Action> {
    if let Some(popup) = situation.popup {
        return in_popup(popup, key);
    }
    let action = match key.code {
        KeyCode::F(1) if situation.focus != Page::Plots => Action::Show(Popup::Help),
        KeyCode::F(2) => Action::Menu,
        KeyCode::F(3) => Action::Step(-1),
        KeyCode::F(4) => Action::Step(1),
        KeyCode::F(5) => Action::Zoom,
        KeyCode::F(6) if matches!(situation.focus, Page::Window(_) | Page::Log) => {
            Action::Show(Popup::Search)
        }
        KeyCode::F(10) => Action::Show(Popup::Leave),
        KeyCode::PageUp => Action::Scroll(situation.focus, PAGE),
        KeyCode::PageDown => Action::Scroll(situation.focus, -PAGE),
        KeyCode::Char(digit @ '1'..='9') if key.modifiers.contains(KeyModifiers::ALT) => {
            let place = digit.to_digit(10).unwrap_or(1) as usize;
            Action::FocusWindow(place.saturating_sub(1))
        }
        _ => return in_page(situation, key),
    };
    Some(action)
}

fn in_page(situation: &Situation, key: &KeyEvent) -> Option<Action> {
    let page = situation.focus;
    if matches!(page, Page::Window(_)) {
        if situation.is_over {
            return (key.code == KeyCode::Enter).then_some(Action::CloseWindow);
        }
        return bytes(key, situation.application_cursor).map(Action::Type);
    }
    if page == Page::Plots {
        return Some(Action::Plot(*key));
    }
    Some(match key.code {
        KeyCode::Char('?') => Action::Show(Popup::Help),
        KeyCode::Char('q') => Action::Show(Popup::Leave),
        KeyCode::Char('/') if page == Page::Log => Action::Show(Popup::Search),
        KeyCode::Char('l') if page == Page::Log => Action::NextLevel,
        KeyCode::Char('a') | KeyCode::Enter => Action::Menu,
        KeyCode::Tab | KeyCode::Right => Action::Step(1),
        KeyCode::BackTab | KeyCode::Left => Action::Step(-1),
        KeyCode::Up | KeyCode::Char('k') => Action::Scroll(page, 1),
        KeyCode::Down | KeyCode::Char('j') => Action::Scroll(page, -1),
        _ => return None,
    })
}

fn in_popup(popup: Popup, key: &KeyEvent) -> Option<Action> {
    let menu = |members, entries| Some(Action::MenuMove { members, entries });
    match (popup, key.code) {
        (Popup::Menu { .. }, KeyCode::Up) => menu(0, -1),
        (Popup::Menu { .. }, KeyCode::Down) => menu(0, 1),
        (Popup::Menu { .. }, KeyCode::Left) => menu(-1, 0),
        (Popup::Menu { .. }, KeyCode::Right) => menu(1, 0),
        (Popup::Menu { .. }, KeyCode::Enter) => Some(Action::MenuDo),
        (Popup::Search, KeyCode::Enter | KeyCode::Up) => Some(Action::Search { is_up: true }),
        (Popup::Search, KeyCode::Down) => Some(Action::Search { is_up: false }),
        (Popup::Step, KeyCode::Enter) => Some(Action::StepClock),
        (Popup::Program { .. }, KeyCode::Enter) => Some(Action::Load),
        (Popup::Leave, KeyCode::Char('l') | KeyCode::Enter) => {
            Some(Action::Leave(Leaving::Running))
        }
        (Popup::Leave, KeyCode::Char('d')) => Some(Action::Leave(Leaving::Down)),
        (Popup::Confirm { .. }, KeyCode::Char('y')) => Some(Action::Confirm),
        (_, KeyCode::Esc | KeyCode::F(_)) | (Popup::Help, _) => Some(Action::ClosePopup),
        (Popup::Program { .. } | Popup::Step | Popup::Search, _) => Some(Action::Edit(*key)),
        _ => None,
    }
}

fn mouse(situation: &Situation, mouse: MouseEvent) -> Option<Action> {
    if situation.popup.is_some() {
        let is_click = matches!(mouse.kind, MouseEventKind::Down(_));
        return is_click.then_some(Action::ClosePopup);
    }
    let page = situation.layout.page_at(mouse.column, mouse.row)?;
    match mouse.kind {
        MouseEventKind::Down(MouseButton::Left) => Some(Action::Focus(page)),
        MouseEventKind::Down(MouseButton::Right) => Some(Action::MenuOf(page)),
        MouseEventKind::ScrollUp => Some(Action::Scroll(page, WHEEL)),
        MouseEventKind::ScrollDown => Some(Action::Scroll(page, -WHEEL)),
        _ => None,
    }
}

/// Returns the bytes that a terminal sends for a key, as xterm does.
fn bytes(key: &KeyEvent, application_cursor: bool) -> Option<Vec<u8>> {
    let cursor = |letter: char| {
        let lead = if application_cursor { 'O' } else { '[' };
        format!("\x1b{lead}{letter}").into_bytes()
    };
    let bytes = match key.code {
        KeyCode::Char(letter) if key.modifiers.contains(KeyModifiers::CONTROL) => {
            let byte = u8::try_from(letter.to_ascii_uppercase()).ok()?;
            match byte {
                b'@'..=b'_' => vec![byte & 0x1f],
                b' ' | b'2' => vec![0],
                b'3'..=b'7' => vec![byte - b'3' + 0x1b],
                b'?' | b'8' => vec![0x7f],
                _ => return None,
            }
        }
        KeyCode::Char(letter) => letter.to_string().into_bytes(),
        KeyCode::Enter => b"\r".into(),
        KeyCode::Tab => b"\t".into(),
        KeyCode::BackTab => b"\x1b[Z".into(),
        KeyCode::Backspace => b"\x7f".into(),
        KeyCode::Esc => b"\x1b".into(),
        KeyCode::Up => cursor('A'),
        KeyCode::Down => cursor('B'),
        KeyCode::Right => cursor('C'),
        KeyCode::Left => cursor('D'),
        KeyCode::Home => cursor('H'),
        KeyCode::End => cursor('F'),
        KeyCode::Insert => b"\x1b[2~".into(),
        KeyCode::Delete => b"\x1b[3~".into(),
        _ => return None,
    };
    if key.modifiers.contains(KeyModifiers::ALT) {
        return Some([b"\x1b", bytes.as_slice()].concat());
    }
    Some(bytes)
}

#[cfg(test)]
mod tests;
