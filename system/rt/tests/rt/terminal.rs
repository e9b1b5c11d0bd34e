//! Terminal devices without hardware.
#![cfg(feature = "sim")]

use std::fs::File;
use std::path::PathBuf;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Makes a terminal device: returns its other end and its path.
pub(crate) fn terminal() -> (File, PathBuf) {
    let end = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&end).unwrap();
    unlockpt(&end).unwrap();
    let path = ptsname(&end, Vec::new()).unwrap();
    (end.into(), path.to_str().unwrap().into())
}

/// Makes one that passes all bytes on as they are.
pub(crate) fn raw_terminal() -> (File, PathBuf) {
    let (end, path) = terminal();
    let mut raw = tcgetattr(&end).unwrap();
    raw.make_raw();
    tcsetattr(&end, OptionalActions::Now, &raw).unwrap();
    (end, path)
}
