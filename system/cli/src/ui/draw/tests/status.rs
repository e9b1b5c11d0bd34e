//! The line at the bottom, and screens that are too small.

use super::*;

#[test]
fn a_notice_that_is_longer_than_a_line_is_whole() {
    let mut model = model();
    let names = (0..9).map(|number| format!("program-{number}"));
    let names = names.collect::<Vec<_>>().join(", ");
    let text = format!("servo-a: load failed: there is no program `x`; there are {names}");
    model.hear(UiEvent::Notice(text));
    let lines = picture(&mut model, SMALL);
    assert!(lines[22].starts_with("servo-a: load failed"), "{lines:?}");
    assert!(lines[23].trim_end().ends_with("program-8"), "{lines:?}");
    model.notice = None;
    let socket = "/run/user/1000/condor/utah-mit-hand/control";
    let why = format!("cannot connect to {socket}: Connection refused (os error 111)");
    model.hear(UiEvent::Gone(why));
    let lines = picture(&mut model, SMALL);
    assert!(lines[22].starts_with("No supervisor (F10 leaves)"));
    assert!(lines[23].trim_end().ends_with("(os error 111)"));
}

#[test]
fn an_error_of_a_text_that_is_typed_is_whole() {
    let mut model = model();
    model.focus = Page::Plots;
    model.plot.prompt = Some(plot::Prompt::Trigger);
    model.plot.notice = Some(format!("{}end", "some words ".repeat(8)));
    let lines = picture(&mut model, SMALL);
    expect(&lines, &["║ some words", "end "]);
}

#[test]
fn a_screen_that_is_too_small_says_so() {
    let mut model = model();
    expect(&picture(&mut model, (40, 10)), &["this is master"]);
    for size in [(39, 24), (80, 9)] {
        let lines = picture(&mut model, size);
        expect(&lines, &["Too small: this terminal needs 40"]);
    }
    expect(&picture(&mut model, (10, 2)), &["Too small:"]);
    picture(&mut model, (1, 1));
}
