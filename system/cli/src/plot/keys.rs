//! The actions of keys on a [`Plot`].

use crossterm::event::{Event, KeyCode, KeyEvent, KeyModifiers};
use tui_input::backend::crossterm::EventHandler as _;
use tui_input::{Input, InputRequest};

use super::curve::Pane;
use super::draw::seen;
use super::model::{Plot, Prompt, RobotPane};

/// Steps of a cursor over the time that is seen.
const CURSOR_STEPS: u16 = 200;
/// The factor by which a key changes a range of values.
const STRETCH: f64 = 1.25;

/// A request of a person that the program around the plot carries out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PlotRequest {
    /// The plot's wish has changed.
    Fetch,
    /// The person wants to leave.
    Leave,
}

/// Does what a key says.
pub(crate) fn press(plot: &mut Plot, key: &KeyEvent) -> Option<PlotRequest> {
    plot.notice = None;
    match plot.prompt {
        Some(Prompt::Help) => {
            plot.prompt = None;
            None
        }
        Some(prompt) => in_prompt(plot, prompt, key),
        None => in_plot(plot, key),
    }
}

/// Inserts a text that a person pastes, if one is being typed.
pub(crate) fn paste(plot: &mut Plot, text: &str) {
    if plot.prompt.is_some_and(|prompt| prompt != Prompt::Help) {
        insert(&mut plot.typed, text);
    }
}

/// Inserts a text into one that is being typed.
pub(crate) fn insert(typed: &mut Input, text: &str) {
    for letter in text.chars() {
        typed.handle(InputRequest::InsertChar(letter));
    }
}

fn in_plot(plot: &mut Plot, key: &KeyEvent) -> Option<PlotRequest> {
    let many = if key.modifiers.contains(KeyModifiers::SHIFT) {
        10
    } else {
        1
    };
    match key.code {
        KeyCode::Char('q') => return Some(PlotRequest::Leave),
        KeyCode::Char('?') | KeyCode::F(1) => plot.prompt = Some(Prompt::Help),
        KeyCode::Left => sideways(plot, -many),
        KeyCode::Right => sideways(plot, many),
        KeyCode::End => plot.follow(),
        KeyCode::Char('+' | '=') => plot.zoom(-1),
        KeyCode::Char('-' | '_') => plot.zoom(1),
        KeyCode::Char(' ') => plot.pause(),
        KeyCode::Char('c') => plot.toggle_cursor(),
        KeyCode::Tab => plot.step_pane(1),
        KeyCode::BackTab => plot.step_pane(-1),
        KeyCode::Up => stretch(plot, 1, 1.0),
        KeyCode::Down => stretch(plot, -1, 1.0),
        KeyCode::Char('[') => stretch(plot, 0, 1.0 / STRETCH),
        KeyCode::Char(']') => stretch(plot, 0, STRETCH),
        KeyCode::Char('y') => {
            let range = range(plot);
            plot.fix_range(range);
        }
        KeyCode::Char('x') => {
            plot.remove_pane();
            return Some(PlotRequest::Fetch);
        }
        KeyCode::Char('n') => return open(plot, Prompt::Names),
        KeyCode::Char('p') => return open(plot, Prompt::NewPane),
        KeyCode::Char('t') => return open(plot, Prompt::Trigger),
        KeyCode::Char('r') => return next_place(plot),
        KeyCode::Char('a') => turn(plot, 1, 0),
        KeyCode::Char('d') => turn(plot, -1, 0),
        KeyCode::Char('w') => turn(plot, 0, 1),
        KeyCode::Char('s') => turn(plot, 0, -1),
        _ => {}
    }
    None
}

fn sideways(plot: &mut Plot, steps: i32) {
    if plot.cursor_ns.is_some() {
        plot.move_cursor(steps, CURSOR_STEPS);
    } else {
        plot.pan(steps);
    }
}

/// Returns the values of the pane in focus that are seen.
fn range(plot: &Plot) -> (f64, f64) {
    let pane = plot.panes.get(plot.focus);
    pane.map_or((0.0, 1.0), |pane: &Pane| seen(plot, pane))
}

fn stretch(plot: &mut Plot, steps: i32, factor: f64) {
    let range = range(plot);
    plot.move_range(range, steps, factor);
}

fn turn(plot: &mut Plot, left: i32, up: i32) {
    if let Some(figure) = &mut plot.figure {
        figure.turn(left, up);
    }
}

fn next_place(plot: &mut Plot) -> Option<PlotRequest> {
    if plot.figure.is_none() {
        plot.notice =
            Some("no drawing: the description has no `robot` that this program knows".into());
        return None;
    }
    plot.place = match plot.place {
        RobotPane::Hidden => RobotPane::Beside,
        RobotPane::Beside => RobotPane::Alone,
        RobotPane::Alone => RobotPane::Hidden,
    };
    (plot.place != RobotPane::Alone).then_some(PlotRequest::Fetch)
}

fn open(plot: &mut Plot, prompt: Prompt) -> Option<PlotRequest> {
    let typed = match prompt {
        // With a blank behind each, so that another one can be typed.
        Prompt::Names => {
            let pane = plot.panes.get(plot.focus);
            let names = pane.map(|pane| pane.names.as_slice()).unwrap_or_default();
            names
                .iter()
                .fold(String::new(), |all, name| all + name + " ")
        }
        Prompt::Trigger => plot
            .trigger()
            .map(|(condition, _)| condition.to_string())
            .unwrap_or_default(),
        Prompt::NewPane | Prompt::Help => String::new(),
    };
    plot.typed = typed.into();
    plot.prompt = Some(prompt);
    // The answer tells which names there are.
    plot.known.is_empty().then_some(PlotRequest::Fetch)
}

fn in_prompt(plot: &mut Plot, prompt: Prompt, key: &KeyEvent) -> Option<PlotRequest> {
    match key.code {
        KeyCode::Tab => plot.complete(),
        KeyCode::Esc => plot.prompt = None,
        KeyCode::Enter => {
            let taken = plot.take_typed(prompt);
            if let Err(error) = taken {
                plot.notice = Some(error);
                return None;
            }
            plot.prompt = None;
            return Some(PlotRequest::Fetch);
        }
        _ => {
            plot.typed.handle_event(&Event::Key(*key));
        }
    }
    None
}
