use ratatui::layout::Rect;

use super::*;
use crate::ui::window::WindowId;

const WINDOW: Page = Page::Window(WindowId(1));

fn situation(focus: Page) -> Situation {
    Situation {
        focus,
        popup: None,
        is_over: false,
        application_cursor: false,
        layout: Layout {
            tabs: vec![
                (WINDOW, "1:a".into(), Rect::new(0, 0, 3, 1)),
                (Page::Loops, "Loops".into(), Rect::new(4, 0, 5, 1)),
            ],
            caption: Rect::new(0, 1, 80, 0),
            panes: vec![(focus, Rect::new(0, 1, 80, 22))],
            status: Rect::new(0, 23, 80, 1),
        },
    }
}

fn press(code: KeyCode, modifiers: KeyModifiers) -> Event {
    Event::Key(KeyEvent::new(code, modifiers))
}

fn plain(code: KeyCode) -> Event {
    press(code, KeyModifiers::NONE)
}

fn typed(code: KeyCode, modifiers: KeyModifiers) -> Option<Vec<u8>> {
    match action(&situation(WINDOW), &press(code, modifiers)) {
        Some(Action::Type(bytes)) => Some(bytes),
        _ => None,
    }
}

#[test]
fn keys_go_to_the_window_as_xterm_sends_them() {
    let none = KeyModifiers::NONE;
    assert_eq!(typed(KeyCode::Char('q'), none), Some(b"q".into()));
    assert_eq!(typed(KeyCode::Char('?'), none), Some(b"?".into()));
    assert_eq!(typed(KeyCode::Char('é'), none), Some("é".into()));
    assert_eq!(typed(KeyCode::Enter, none), Some(b"\r".into()));
    assert_eq!(typed(KeyCode::Up, none), Some(b"\x1b[A".into()));
    assert_eq!(
        typed(KeyCode::Char('c'), KeyModifiers::CONTROL),
        Some(vec![3])
    );
    assert_eq!(
        typed(KeyCode::Char(']'), KeyModifiers::CONTROL),
        Some(vec![0x1d])
    );
    assert_eq!(
        typed(KeyCode::Char('x'), KeyModifiers::ALT),
        Some(b"\x1bx".into())
    );
    let mut vi = situation(WINDOW);
    vi.application_cursor = true;
    let up = action(&vi, &plain(KeyCode::Up));
    assert_eq!(up, Some(Action::Type(b"\x1bOA".into())));
}

#[test]
fn tables_have_keys_of_their_own_and_type_nothing() {
    let tables = situation(Page::Loops);
    let asked = |code| action(&tables, &plain(code));
    assert_eq!(asked(KeyCode::Char('?')), Some(Action::Show(Popup::Help)));
    assert_eq!(asked(KeyCode::Char('q')), Some(Action::Show(Popup::Leave)));
    assert_eq!(asked(KeyCode::Down), Some(Action::Scroll(Page::Loops, -1)));
    assert_eq!(asked(KeyCode::Tab), Some(Action::Step(1)));
    assert_eq!(asked(KeyCode::Char('x')), None);
    assert_eq!(action(&tables, &Event::Paste("x".into())), None);
}

#[test]
fn the_log_and_windows_are_searched() {
    let search = Some(Action::Show(Popup::Search));
    for page in [WINDOW, Page::Log] {
        assert_eq!(action(&situation(page), &plain(KeyCode::F(6))), search);
    }
    let (log, loops) = (situation(Page::Log), situation(Page::Loops));
    let asked = |here, letter| action(here, &plain(KeyCode::Char(letter)));
    assert_eq!(asked(&log, '/'), search);
    assert_eq!(asked(&log, 'l'), Some(Action::NextLevel));
    assert_eq!(asked(&loops, '/'), None);
    assert_eq!(asked(&loops, 'l'), None);
    let mut here = log;
    here.popup = Some(Popup::Search);
    let asked = |code| action(&here, &plain(code));
    assert!(matches!(asked(KeyCode::Char('q')), Some(Action::Edit(_))));
    let pasted = action(&here, &Event::Paste("a b".into()));
    assert_eq!(pasted, Some(Action::Insert("a b".into())));
    for (code, is_up) in [
        (KeyCode::Enter, true),
        (KeyCode::Up, true),
        (KeyCode::Down, false),
    ] {
        assert_eq!(asked(code), Some(Action::Search { is_up }));
    }
    assert_eq!(asked(KeyCode::Esc), Some(Action::ClosePopup));
}

#[test]
fn function_keys_mean_the_same_everywhere() {
    for page in [WINDOW, Page::Log] {
        let here = situation(page);
        let asked = |code| action(&here, &plain(code));
        assert_eq!(asked(KeyCode::F(1)), Some(Action::Show(Popup::Help)));
        assert_eq!(asked(KeyCode::F(2)), Some(Action::Menu));
        assert_eq!(asked(KeyCode::F(4)), Some(Action::Step(1)));
        assert_eq!(asked(KeyCode::F(10)), Some(Action::Show(Popup::Leave)));
        let third = press(KeyCode::Char('3'), KeyModifiers::ALT);
        assert_eq!(action(&here, &third), Some(Action::FocusWindow(2)));
    }
}

#[test]
fn what_is_in_front_takes_all_keys() {
    let mut here = situation(WINDOW);
    here.popup = Some(Popup::Leave);
    let asked = |here: &Situation, code| action(here, &plain(code));
    assert_eq!(asked(&here, KeyCode::Char('x')), None);
    assert_eq!(asked(&here, KeyCode::Esc), Some(Action::ClosePopup));
    let down = Some(Action::Leave(Leaving::Down));
    assert_eq!(asked(&here, KeyCode::Char('d')), down);
    here.popup = Some(Popup::Menu {
        member: 0,
        entry: 0,
    });
    assert_eq!(asked(&here, KeyCode::Enter), Some(Action::MenuDo));
    here.popup = Some(Popup::Program { member: 0 });
    let end = press(KeyCode::Char('u'), KeyModifiers::CONTROL);
    let Event::Key(key) = end else { unreachable!() };
    assert_eq!(action(&here, &end), Some(Action::Edit(key)));
    let pasted = action(&here, &Event::Paste("a b".into()));
    assert_eq!(pasted, Some(Action::Insert("a b".into())));
    assert_eq!(asked(&here, KeyCode::Enter), Some(Action::Load));
    here.popup = Some(Popup::Step);
    assert!(matches!(
        asked(&here, KeyCode::Char('5')),
        Some(Action::Edit(_))
    ));
    assert_eq!(asked(&here, KeyCode::Enter), Some(Action::StepClock));
    here.popup = Some(Popup::Confirm {
        member: 0,
        order: "stop",
    });
    assert_eq!(asked(&here, KeyCode::Enter), None);
    assert_eq!(asked(&here, KeyCode::Char('y')), Some(Action::Confirm));
    here.popup = Some(Popup::Help);
    assert_eq!(asked(&here, KeyCode::Char('x')), Some(Action::ClosePopup));
}

#[test]
fn the_mouse_chooses_and_scrolls_what_it_points_at() {
    let here = situation(WINDOW);
    let at = |kind, column, row| {
        let modifiers = KeyModifiers::NONE;
        let mouse = MouseEvent {
            kind,
            column,
            row,
            modifiers,
        };
        action(&here, &Event::Mouse(mouse))
    };
    let click = MouseEventKind::Down(MouseButton::Left);
    assert_eq!(at(click, 5, 0), Some(Action::Focus(Page::Loops)));
    assert_eq!(at(click, 40, 10), Some(Action::Focus(WINDOW)));
    assert_eq!(at(click, 40, 0), None);
    let right = MouseEventKind::Down(MouseButton::Right);
    assert_eq!(at(right, 5, 0), Some(Action::MenuOf(Page::Loops)));
    let wheel = at(MouseEventKind::ScrollUp, 40, 10);
    assert_eq!(wheel, Some(Action::Scroll(WINDOW, WHEEL)));
}

#[test]
fn the_window_of_a_tool_that_has_ended_is_closed() {
    let mut here = situation(WINDOW);
    here.is_over = true;
    let enter = action(&here, &plain(KeyCode::Enter));
    assert_eq!(enter, Some(Action::CloseWindow));
    assert_eq!(action(&here, &plain(KeyCode::Char('x'))), None);
}

#[test]
fn plots_have_keys_of_their_own() {
    let here = situation(Page::Plots);
    for code in [
        KeyCode::F(1),
        KeyCode::Char('q'),
        KeyCode::Tab,
        KeyCode::Left,
    ] {
        let key = KeyEvent::new(code, KeyModifiers::NONE);
        assert_eq!(action(&here, &Event::Key(key)), Some(Action::Plot(key)));
    }
    let next = action(&here, &plain(KeyCode::F(4)));
    assert_eq!(next, Some(Action::Step(1)));
}
