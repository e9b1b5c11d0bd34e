//! [`Screen`]: this terminal, taken over by a picture.

use std::io::{self, IsTerminal as _, Stdout};
use std::sync::Once;

use crossterm::event::{
    DisableBracketedPaste, DisableMouseCapture, EnableBracketedPaste, EnableMouseCapture, Event,
};
use crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use ratatui::backend::CrosstermBackend;
use ratatui::buffer::Buffer;
use ratatui::layout::{Rect, Size};
use ratatui::style::Color;
use ratatui::text::Line;
use ratatui::widgets::{Block, BorderType, Clear, Padding, Paragraph, Widget};
use ratatui::{Frame, Terminal};

use tui_input::Input;

use crate::guard::Guard;
use condor_host::plain::plain;

/// This terminal, taken over; restored when it is dropped, before a panic is told, and by a guard if
/// this process is killed.
pub(crate) struct Screen {
    terminal: Terminal<CrosstermBackend<Stdout>>,
    has_colors: bool,
    _guard: Option<Guard>,
}

/// Returns true if this process has a terminal on which a picture can be drawn: not one of which `TERM` says that it is
/// `dumb`, as in some editors.
pub(crate) fn is_possible() -> bool {
    io::stdin().is_terminal() && can_repaint()
}

/// Returns true if this process writes to a terminal whose lines can be written anew.
pub(crate) fn can_repaint() -> bool {
    let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    io::stdout().is_terminal() && !is_dumb
}

impl Screen {
    pub(crate) fn open() -> io::Result<Self> {
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
        let screen = Self {
            terminal: Terminal::new(CrosstermBackend::new(io::stdout()))?,
            has_colors: has_colors(),
            _guard: guard.ok(),
        };
        crossterm::execute!(
            io::stdout(),
            EnterAlternateScreen,
            EnableMouseCapture,
            EnableBracketedPaste
        )?;
        Ok(screen)
    }

    pub(crate) fn size(&self) -> io::Result<Size> {
        self.terminal.size()
    }

    /// Shows a picture; without its colours, if the person wants none.
    pub(crate) fn draw(&mut self, draw: impl FnOnce(&mut Frame<'_>)) -> io::Result<()> {
        let has_colors = self.has_colors;
        self.terminal.draw(|frame| {
            draw(frame);
            if !has_colors {
                remove_colors(frame.buffer_mut());
            }
        })?;
        Ok(())
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        restore();
    }
}

/// Hands over what is typed, and what the mouse does, until nobody hears it or the keyboard is gone;
/// `tell` returns false if nobody does.
pub(crate) fn keyboard(tell: impl Fn(io::Result<Event>) -> bool) {
    loop {
        let read = crossterm::event::read();
        let is_last = read.is_err();
        if !tell(read) || is_last {
            return;
        }
    }
}

/// Columns of the frame of a popup.
const FRAME: u16 = 4;

/// Shows lines in front of everything, in the middle of `area`, as large as needed and at least `least`
/// columns wide.
pub(crate) fn popup(
    title: &str,
    lines: Vec<Line<'_>>,
    least: u16,
    area: Rect,
    buffer: &mut Buffer,
) {
    let widest = lines.iter().map(Line::width).max().unwrap_or(0);
    let width = u16::try_from(widest)
        .unwrap_or(u16::MAX)
        .saturating_add(FRAME)
        .clamp(least.min(area.width), area.width);
    let height = u16::try_from(lines.len() + 2)
        .unwrap_or(u16::MAX)
        .min(area.height);
    let area = Rect {
        x: area.x + (area.width - width) / 2,
        y: area.y + (area.height - height) / 2,
        width,
        height,
    };
    let block = Block::bordered()
        .title(title)
        .border_type(BorderType::Double)
        .padding(Padding::horizontal(1));
    Clear.render(area, buffer);
    Paragraph::new(lines).block(block).render(area, buffer);
}

/// Breaks a text between words into lines of at most `width` columns; all but the first begin with `indent` blanks. A
/// word that is longer than a line is cut.
pub(crate) fn wrapped(text: &str, width: u16, indent: usize) -> Vec<String> {
    let width = usize::from(width);
    let (mut lines, mut line, mut room) = (Vec::new(), String::new(), width);
    for mut word in text.split_inclusive(' ') {
        loop {
            let len = word.trim_end().chars().count();
            if len <= room {
                line += word;
                room = room.saturating_sub(word.chars().count());
                break;
            }
            let is_begun = line.len() > indent;
            if !is_begun {
                // No line is long enough for this word.
                let at = word
                    .char_indices()
                    .nth(room.max(1))
                    .map_or(word.len(), |it| it.0);
                let (part, rest) = word.split_at(at);
                line += part;
                word = rest;
            }
            lines.push(core::mem::replace(&mut line, " ".repeat(indent)));
            room = width.saturating_sub(indent);
        }
    }
    lines.push(line);
    lines
}

/// A text that is being typed, with its cursor: as much of it as a popup in `area` has room for.
pub(crate) fn field(typed: &Input, area: Rect) -> Line<'static> {
    let room = usize::from(area.width.saturating_sub(FRAME + 1)).max(1);
    let (first, cursor) = (typed.visual_scroll(room), typed.cursor());
    let letters = |from: usize, to: usize| -> String {
        let letters = typed.value().chars().skip(from);
        letters.take(to.saturating_sub(from)).collect()
    };
    let (before, behind) = (letters(first, cursor), letters(cursor, first + room));
    Line::raw(format!("{}▏{}", plain(&before), plain(&behind)))
}

/// Returns true if the person wants colours: the environment variable `NO_COLOR` is not set, or empty.
pub(crate) fn has_colors() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// Leaves what crossterm keeps with `NO_COLOR`, too: bold and reversed text, which it loses where a
/// colour follows.
fn remove_colors(buffer: &mut Buffer) {
    for cell in &mut buffer.content {
        (cell.fg, cell.bg) = (Color::Reset, Color::Reset);
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

#[cfg(test)]
mod tests {
    use ratatui::style::{Modifier, Style};

    use super::*;

    #[test]
    fn a_picture_without_colours_keeps_its_text() {
        let mut buffer = Buffer::empty(Rect::new(0, 0, 5, 1));
        let style = Style::new().fg(Color::Red).bg(Color::Blue);
        buffer.set_string(0, 0, "alarm", style.add_modifier(Modifier::BOLD));
        remove_colors(&mut buffer);
        let mut expected = Buffer::empty(Rect::new(0, 0, 5, 1));
        let bold = Style::new().add_modifier(Modifier::BOLD);
        expected.set_string(0, 0, "alarm", bold);
        assert_eq!(buffer, expected);
    }
}
