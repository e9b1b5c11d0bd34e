//! [`Killer`]: ends processes at random, and [`Screen`]: a user interface that can be one of them.

use std::fs::File;
use std::io::Read;
use std::os::fd::OwnedFd;
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};

use crate::system::{Outcome, Up, kill};

const SIZE: Winsize = Winsize {
    ws_row: 50,
    ws_col: 200,
    ws_xpixel: 0,
    ws_ypixel: 0,
};

/// The user interface, in a pseudo-terminal.
pub(crate) struct Screen {
    child: Child,
    /// Bytes that it has drawn in all its incarnations.
    drawn: Arc<AtomicU64>,
}

impl Screen {
    pub(crate) fn start(up: &Up) -> Outcome<Self> {
        let drawn = Arc::default();
        let child = spawn(up, &drawn)?;
        Ok(Self { child, drawn })
    }

    pub(crate) fn drawn(&self) -> u64 {
        self.drawn.load(Relaxed)
    }

    fn again(&mut self, up: &Up) -> Outcome<()> {
        self.child.kill()?;
        self.child.wait()?;
        self.child = spawn(up, &self.drawn)?;
        Ok(())
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // Both fail if the screen has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn spawn(up: &Up, drawn: &Arc<AtomicU64>) -> Outcome<Child> {
    let pty = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&pty)?;
    unlockpt(&pty)?;
    tcsetwinsize(&pty, SIZE)?;
    let path = ptsname(&pty, Vec::new())?;
    let terminal = File::options()
        .read(true)
        .write(true)
        .open(path.to_str()?)?;
    let child = up
        .command("ui")?
        .env("TERM", "xterm-256color")
        .stdin(Stdio::from(terminal.try_clone()?))
        .stdout(Stdio::from(terminal.try_clone()?))
        .stderr(Stdio::from(terminal))
        .spawn()?;
    let drawn = drawn.clone();
    std::thread::spawn(move || look(pty, &drawn));
    Ok(child)
}

/// Takes what is drawn, until nobody draws.
fn look(pty: OwnedFd, drawn: &AtomicU64) {
    let mut pty = File::from(pty);
    let mut bytes = [0; 8192];
    while let Ok(count @ 1..) = pty.read(&mut bytes) {
        drawn.fetch_add(count as u64, Relaxed);
    }
}

/// The number of kills of each program.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Kills {
    pub(crate) screen: u32,
    pub(crate) terminals: u32,
    pub(crate) files: u32,
}

/// Kills at random.
pub(crate) struct Killer {
    chance: u64,
    next: Instant,
    pub(crate) kills: Kills,
}

impl Killer {
    pub(crate) fn new(seed: u64) -> Self {
        let mut this = Self {
            chance: seed,
            next: Instant::now(),
            kills: Kills::default(),
        };
        this.wait_again();
        this
    }

    /// Kills if it is time to.
    pub(crate) fn look(&mut self, up: &Up, screen: &mut Screen) -> Outcome<()> {
        if Instant::now() < self.next {
            return Ok(());
        }
        let victim = self.below(3);
        if victim == 0 {
            screen.again(up)?;
            self.kills.screen += 1;
        } else {
            let status = up.status()?;
            let name = if victim == 1 { "files" } else { "terminals" };
            let member = status.services.iter().find(|member| member.name == name);
            // One that is not there just now is spared.
            if let Some(process) = member.and_then(|member| member.pid)
                && kill(process).is_ok()
            {
                if victim == 1 {
                    self.kills.files += 1;
                } else {
                    self.kills.terminals += 1;
                }
            }
        }
        self.wait_again();
        Ok(())
    }

    fn wait_again(&mut self) {
        self.next = Instant::now() + Duration::from_micros(50_000 + self.below(700_000));
    }

    /// A number below a limit, each as likely as any other (splitmix64).
    fn below(&mut self, limit: u64) -> u64 {
        self.chance = self.chance.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.chance;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (mixed ^ (mixed >> 31)) % limit
    }
}
