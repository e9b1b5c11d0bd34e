//! `condor plot` and the plots of `condor ui`, on a terminal.

use std::fs::File;
use std::io::{self, Read, Write};
use std::process::{Child, Stdio};

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use crate::commands::{TWO, complaint};
use crate::running::{self, DEADLINE, Up};

/// A program on a terminal of its own.
struct Shown {
    child: Child,
    terminal: Terminal,
}

/// The other side of a terminal; what is not written in time is an error.
struct Terminal(File);

impl Read for Terminal {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let limit = Timespec::try_from(DEADLINE).unwrap();
        let mut polled = [PollFd::new(&self.0, PollFlags::IN)];
        match rustix::event::poll(&mut polled, Some(&limit))? {
            0 => Err(io::ErrorKind::TimedOut.into()),
            _ => self.0.read(to),
        }
    }
}

impl Shown {
    fn start(up: &Up, arguments: &[&str]) -> Self {
        let host = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&host).unwrap();
        unlockpt(&host).unwrap();
        let path = ptsname(&host, Vec::new()).unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY;
        let user = rustix::fs::open(&path, flags, Mode::empty()).unwrap();
        let size = rustix::termios::Winsize {
            ws_col: 80,
            ws_row: 24,
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
            terminal: Terminal(host.into()),
        }
    }

    fn expect(&mut self, text: &str) {
        running::read_until(&mut self.terminal, text);
    }

    fn press(&mut self, keys: &str) {
        self.terminal.0.write_all(keys.as_bytes()).unwrap();
    }

    fn leaves(mut self) {
        // It leaves the other screen before it ends.
        self.expect("\x1b[?1049l");
        assert!(self.child.wait().unwrap().success());
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
    shown.expect("b:servo: its rows go on");
    shown.press("n a:mode\r");
    shown.expect("there is no variable or parameter");
    shown.press("n");
    // What was typed is there again.
    shown.press(&"\x7f".repeat(40));
    shown.press("a:mode\r");
    shown.expect("mode idle");
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
    shown.expect("no variables: n chooses some");
    shown.press("nb:bea\t");
    shown.expect("b:beats");
    shown.press("\r");
    shown.expect("beats ");
    shown.press("r");
    shown.expect("this program has no lines for the robot");
    shown.press("q");
    shown.expect("keeps running");
    shown.press("l");
    shown.leaves();
}

#[test]
fn what_cannot_be_plotted_is_said() {
    let up = Up::start(TWO, &[]);
    let wrong = complaint(&up, &["plot", "a:ticks"]);
    assert!(wrong.contains("plots need a terminal"), "{wrong}");
    let wrong = complaint(&up, &["plot", "a:ticks", "--trigger", "ticks"]);
    assert!(
        wrong.contains("`ticks` is not a trigger such as"),
        "{wrong}"
    );
    let mut shown = Shown::start(&up, &["plot", "a:tocks"]);
    assert!(!shown.child.wait().unwrap().success());
}
