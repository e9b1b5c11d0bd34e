//! `condor plot`, the plots of `condor ui`, and `condor demo`, on a terminal.

use std::fs::File;
use std::io::{Read, Write};
use std::num::NonZero;
use std::process::{Child, Stdio};
use std::time::Instant;

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use crate::joint::{TWO, load_joint, start, start_one};
use crate::running::{self, DEADLINE, Up};

const COLUMNS: NonZero<u16> = NonZero::new(80).unwrap();
const ROWS: NonZero<u16> = NonZero::new(24).unwrap();

/// A program on a terminal of its own.
struct Shown {
    child: Child,
    /// The other side of the terminal.
    terminal: File,
    screen: vt100::Parser,
}

impl Shown {
    fn start(up: &Up, arguments: &[&str]) -> Self {
        let host = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&host).unwrap();
        unlockpt(&host).unwrap();
        let path = ptsname(&host, Vec::new()).unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let user = rustix::fs::open(&path, flags, Mode::empty()).unwrap();
        let size = rustix::termios::Winsize {
            ws_col: COLUMNS.get(),
            ws_row: ROWS.get(),
            ws_xpixel: 0,
            ws_ypixel: 0,
        };
        rustix::termios::tcsetwinsize(&user, size).unwrap();
        let mut command = up.command(arguments);
        let command = command
            .stdin(Stdio::from(user.try_clone().unwrap()))
            .stdout(Stdio::from(user));
        Self {
            child: command.spawn().unwrap(),
            terminal: host.into(),
            screen: vt100::Parser::new(ROWS, COLUMNS, 0),
        }
    }

    /// Waits until a text is on the screen.
    fn expect(&mut self, text: &str) {
        self.wait(text, |screen| screen.contents().contains(text));
    }

    fn wait(&mut self, what: &str, is_there: impl Fn(&vt100::Screen) -> bool) {
        let begun = Instant::now();
        let mut piece = [0; 4096];
        while !is_there(self.screen.screen()) {
            let left = DEADLINE.saturating_sub(begun.elapsed());
            let limit = Timespec::try_from(left).unwrap();
            let mut polled = [PollFd::new(&self.terminal, PollFlags::IN)];
            let ready = rustix::event::poll(&mut polled, Some(&limit)).unwrap();
            let seen = self.screen.screen().contents();
            assert!(ready > 0 && !left.is_zero(), "no {what:?} in\n{seen}");
            let count = self.terminal.read(&mut piece).unwrap();
            self.screen.process(&piece[..count]);
        }
    }

    fn press(&mut self, keys: &str) {
        self.terminal.write_all(keys.as_bytes()).unwrap();
    }

    fn leaves(mut self) {
        // The screen of before is back.
        self.wait("end", |screen| !screen.alternate_screen());
        assert!(self.child.wait().unwrap().success());
    }
}

/// A test that fails leaves nothing behind.
impl Drop for Shown {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_plot_shows_variables_of_several_processors_and_restarts() {
    let up = Up::start(TWO, &[]);
    let mut shown = Shown::start(
        &up,
        &[
            "plot",
            "?:joint.position",
            "--pane",
            "b:beats",
            "--trigger",
            "b:beats>40",
        ],
    );
    shown.expect("a a:servo:joint.position");
    shown.expect("at 0");
    running::kill(up.status().processors[1].pid.unwrap());
    shown.expect("its rows go on");
    // What was chosen before is there again.
    shown.press("n a:mode beets\r");
    shown.expect("there is no variable or parameter `beets`");
    shown.expect("mode idle");
    shown.press("q");
    shown.leaves();
}

#[test]
fn a_recording_is_plotted() {
    let up = start(&[]);
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("run.mcap");
    let file = file.to_str().unwrap();
    let recorded = up.run(&["record", file, "a:joint.position", "b:beats", "--for", "1s"]);
    assert!(recorded.status.success(), "{recorded:?}");
    let mut shown = Shown::start(&up, &["plot", file]);
    // Nothing is chosen yet.
    shown.press("joint.p");
    shown.expect("  joint.position");
    shown.press("\t\r");
    shown.expect("a joint.position  ");
    shown.press("n beats beets\r");
    shown.expect("there is no variable or parameter `beets`");
    shown.expect("b beats  ");
    shown.press("q");
    shown.leaves();
}

#[test]
fn a_page_of_the_user_interface_has_plots() {
    let up = Up::start(TWO, &[]);
    let mut shown = Shown::start(&up, &["ui"]);
    shown.expect("F10");
    // The page before the first one.
    shown.press("\x1b[13~");
    shown.expect("F1 keys");
    // It has begun with some variables.
    shown.press("n\x15b:bea");
    shown.expect("  b:beats");
    shown.press("\t");
    shown.expect("b:beats▏");
    shown.press("\r");
    shown.expect("beats ");
    shown.press("r");
    shown.expect("no drawing: the description has no `robot` that this program knows");
    shown.press("q");
    shown.expect("keeps running");
    shown.press("l");
    shown.leaves();
    // The next one begins with the same page and the same curves.
    let mut shown = Shown::start(&up, &["ui"]);
    shown.expect("a beats ");
    shown.press("q");
    shown.expect("keeps running");
    shown.press("l");
    shown.leaves();
}

/// Something is typed at a processor, which is then killed, and comes back.
const DEMO: &str = r#"
    [[step]]
    caption = "Somebody types."
    at = "b"
    type = "this"
    until = "typed this"
    seconds = 0
    [[step]]
    caption = "A program is killed."
    kill = "b"
    seconds = 0
    [[step]]
    caption = "The next one reads on."
    at = "b"
    type = "that"
    until = "typed that"
    seconds = 0
    [[step]]
    caption = "The end."
    seconds = 0
"#;

#[test]
fn a_demonstration_types_and_kills_and_says_what_it_does() {
    // A description whose system does not run.
    let up = start_one();
    up.run(&["down"]);
    up.wait_for_end();
    std::fs::write(up.path("demo.toml"), DEMO).unwrap();
    let file = up.path("tested.toml");
    let mut shown = Shown::start(&up, &["demo", file.to_str().unwrap()]);
    shown.expect("4/4  The end.");
    let status = up.status();
    let killed = status.members().find(|it| it.name == "b").unwrap();
    assert_eq!(killed.restarts, 1);
    assert_eq!(killed.last_exit.as_deref(), Some("killed by SIGKILL"));
    // F10.
    shown.press("\x1b[21~");
    shown.expect("d  stop the system and leave");
    shown.press("d");
    shown.leaves();
}

#[test]
fn what_cannot_be_plotted_is_said() {
    let up = Up::start(TWO, &[]);
    let mut shown = Shown::start(&up, &["plot", "a:tocks"]);
    assert!(!shown.child.wait().unwrap().success());
}

#[test]
fn a_program_that_is_loaded_later_is_plotted() {
    let up = start_one();
    let mut shown = Shown::start(&up, &["plot", "*:ticks"]);
    shown.expect("ticks");
    load_joint(&up);
    shown.expect("b:servo:ticks");
    shown.press("q");
    shown.leaves();
}
