//! Pictures of the user interface for the READMEs: the hand shows what it can do in simulated time at the speed of the
//! real one, and is photographed in tmux at three sizes.

mod svg;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::Result;
use crate::context::Context;
use crate::parts::{Summary, page};
use crate::tools::need_debian;

/// The folder of the pictures.
const PICTURES: &str = "system/cli/pictures";
/// The time that a text may take to appear.
const PATIENCE: Duration = Duration::from_secs(60);
/// The time of a wave after which the fingers are in the midst of it.
const WAVING: Duration = Duration::from_millis(3300);
/// The time until plots have values everywhere, and the wave before has ended.
const SPAN: Duration = Duration::from_secs(8);
/// The most bytes that a picture may have: the README shows it.
const MOST_BYTES: usize = 200_000;

const POSITIONS: &str = "index.proximal.position index.proximal.target";
const EFFORTS: &str = "index.proximal-flexor.effort index.proximal-extensor.effort";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_debian(context, "tmux", "tmux")?;
    context
        .command("cargo build --release -p utah-mit-hand")
        .run()?;
    let hand = context.target()?.join("release/utah-mit-hand");
    // A directory of systems, and a server of terminals, of its own.
    let place = std::env::temp_dir().join(format!("condor-pictures-{}", std::process::id()));
    fs::create_dir_all(&place)?;
    let tmux = Tmux {
        place: place.clone(),
        hand: hand.clone(),
        out: context.root.join(PICTURES),
    };
    fs::create_dir_all(&tmux.out)?;
    let outcome = tmux.pictures();
    // Nothing may be left, whatever happened.
    let _ = tmux.hand(&["down"]);
    let _ = tmux.ask(&["kill-server"]);
    let removed = fs::remove_dir_all(&place);
    let count = outcome?;
    removed?;
    page::look(context, &hand.to_string_lossy(), PICTURES)?;
    Ok(Summary::of(format!(
        "{count} pictures in {PICTURES}, and those of the page"
    )))
}

/// The name of a picture, or of a terminal, of this size.
fn named(name: &str, (columns, rows): (u16, u16)) -> String {
    format!("{name}-{columns}x{rows}")
}

/// A server of terminals in which the hand runs.
struct Tmux {
    place: PathBuf,
    hand: PathBuf,
    out: PathBuf,
}

impl Tmux {
    /// Makes the pictures, and returns how many.
    fn pictures(&self) -> Result<usize> {
        let hand = self.hand.display();
        let sizes = [(200, 50), (120, 40), (80, 24)];
        for (size, command) in sizes.into_iter().zip(["demo", "ui", "ui"]) {
            let name = named("ui", size);
            self.open(&name, size, &format!("{hand} {command}"))?;
            self.expect(&name, "lists the commands")?;
        }
        let large = named("ui", (200, 50));
        self.expect(&large, "`run wave`")?;
        thread::sleep(WAVING);
        let mut count = 0;
        for size in sizes {
            count += self.photograph(&named("ui", size), size, &named("ui", size))?;
        }
        self.expect(&large, "`push 0 0 0.2`")?;
        count += self.photograph(&large, (200, 50), "demo-200x50")?;
        self.expect(&large, "That was it")?;
        // The page of plots is the last one.
        let keys = [
            "F3", "F5", "n", "C-u", POSITIONS, "Enter", "p", EFFORTS, "Enter",
        ];
        self.send(&large, &keys)?;
        self.wave()?;
        thread::sleep(WAVING);
        count += self.photograph(&large, (200, 50), "hand-200x50")?;

        let panes = format!("plot {POSITIONS} --pane '{EFFORTS}' --span 5s");
        for (name, before) in [("80x24", ""), ("80x24-no-color", "NO_COLOR=1 ")] {
            self.open(
                name,
                (80, 24),
                &format!("{before}{} {panes}", self.hand.display()),
            )?;
            self.expect(name, "a index.proximal.position")?;
            self.wave()?;
            thread::sleep(SPAN);
            self.wave()?;
            thread::sleep(WAVING);
            count += self.photograph(name, (80, 24), &format!("plot-{name}"))?;
            self.send(name, &["r", "r"])?;
            count += self.photograph(name, (80, 24), &format!("hand-{name}"))?;
        }
        Ok(count)
    }

    /// Types at the master that the fingers wave.
    fn wave(&self) -> Result<()> {
        let line = format!("{} tty master", self.hand.display());
        self.open("wave", (80, 24), &line)?;
        self.expect("wave", "> ")?;
        self.send("wave", &["run wave", "Enter"])?;
        thread::sleep(Duration::from_millis(300));
        self.ask(&["kill-session", "-t", "wave"])?;
        Ok(())
    }

    /// Opens a terminal in which `line` runs.
    fn open(&self, name: &str, (columns, rows): (u16, u16), line: &str) -> Result<()> {
        let (columns, rows) = (columns.to_string(), rows.to_string());
        let size = ["-x", &columns, "-y", &rows];
        let new = ["new-session", "-d", "-s", name];
        self.ask(&[&new[..], &size, &[line]].concat())?;
        self.ask(&["set-option", "-g", "status", "off"])?;
        self.ask(&["resize-window", "-t", name, "-x", &columns, "-y", &rows])?;
        Ok(())
    }

    /// Presses keys, and types texts.
    fn send(&self, name: &str, keys: &[&str]) -> Result<()> {
        for key in keys {
            self.ask(&["send-keys", "-t", name, key])?;
            thread::sleep(Duration::from_millis(150));
        }
        Ok(())
    }

    /// Waits until a text is seen.
    fn expect(&self, name: &str, text: &str) -> Result<()> {
        let begun = Instant::now();
        loop {
            let seen = self.ask(&["capture-pane", "-p", "-t", name])?;
            if seen.contains(text) {
                return Ok(());
            }
            if begun.elapsed() >= PATIENCE {
                return Err(format!(
                    "`{text}` does not appear on the terminal, which shows\n{seen}"
                )
                .into());
            }
            thread::sleep(Duration::from_millis(100));
        }
    }

    /// Writes what is seen as a picture.
    fn photograph(&self, name: &str, (columns, rows): (u16, u16), picture: &str) -> Result<usize> {
        let seen = self.ask(&["capture-pane", "-e", "-p", "-t", name])?;
        let svg = svg::of(&seen, columns, rows);
        if svg.len() > MOST_BYTES {
            return Err(
                format!("{picture} has {} bytes of at most {MOST_BYTES}", svg.len()).into(),
            );
        }
        fs::write(self.out.join(picture).with_extension("svg"), svg)?;
        Ok(1)
    }

    fn ask(&self, words: &[&str]) -> Result<String> {
        let mut tmux = Command::new("tmux");
        tmux.arg("-f/dev/null")
            .arg("-S")
            .arg(self.place.join("tmux"));
        self.output(tmux.args(words))
    }

    fn hand(&self, words: &[&str]) -> Result<String> {
        self.output(Command::new(&self.hand).args(words))
    }

    fn output(&self, command: &mut Command) -> Result<String> {
        let systems: &Path = &self.place;
        let command = command
            .env("XDG_RUNTIME_DIR", systems)
            .env_remove("NO_COLOR")
            .env_remove("TMUX")
            .stdin(Stdio::null());
        let output = command.output()?;
        if !output.status.success() {
            let why = String::from_utf8_lossy(&output.stderr);
            return Err(format!("{command:?}: {}: {why}", output.status).into());
        }
        Ok(String::from_utf8(output.stdout)?)
    }
}
