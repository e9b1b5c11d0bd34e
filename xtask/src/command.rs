//! The commands that the parts run, shown as a person would type them.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Instant;

use crate::Result;

/// The seconds of what was run since they were taken last, and what it was.
static TIMES: Mutex<Vec<(f64, String)>> = Mutex::new(Vec::new());

/// Returns the seconds and names of the commands run since the last call, in the order in which they ended.
pub(crate) fn take_times() -> Vec<(f64, String)> {
    std::mem::take(&mut *TIMES.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Does `work`, and notes how long it took.
pub(crate) fn timed<R>(what: &dyn std::fmt::Display, work: impl FnOnce() -> R) -> R {
    let start = Instant::now();
    let result = work();
    let seconds = start.elapsed().as_secs_f64();
    let mut times = TIMES.lock().unwrap_or_else(PoisonError::into_inner);
    times.push((seconds, what.to_string()));
    result
}

/// One command line, its extra environment and its directory.
pub(crate) struct Line {
    words: Vec<String>,
    env: Vec<(&'static str, String)>,
    dir: Option<String>,
    root: PathBuf,
}

impl Line {
    /// Makes a command whose words are separated by blanks, to run in `root`.
    pub(crate) fn new(line: &str, root: &Path) -> Self {
        Self {
            words: line.split_whitespace().map(str::to_owned).collect(),
            env: Vec::new(),
            dir: None,
            root: root.to_owned(),
        }
    }

    /// Sets a variable of the environment.
    pub(crate) fn env(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.env.push((name, value.into()));
        self
    }

    /// Builds into the directory of the root workspace: most of what another depends on is there.
    pub(crate) fn sharing_target(self) -> Self {
        let target = self.root.join("target").display().to_string();
        self.env("CARGO_TARGET_DIR", target)
    }

    /// Runs in this directory, relative to the root.
    pub(crate) fn dir(mut self, dir: &str) -> Self {
        self.dir = Some(dir.to_owned());
        self
    }

    /// Runs it; its output goes to the log.
    ///
    /// # Errors
    /// Returns an error if the command cannot be started or does not succeed.
    pub(crate) fn run(&self) -> Result<()> {
        self.show();
        let status = timed(self, || self.command().status());
        self.judge(status.map_err(|error| self.not_started(&error))?)
    }

    /// Runs it and returns its standard output, which does not go to the log.
    ///
    /// # Errors
    /// Returns an error if the command cannot be started or does not succeed.
    pub(crate) fn read(&self) -> Result<String> {
        let output = timed(self, || self.command().stderr(Stdio::inherit()).output());
        let output = output.map_err(|error| self.not_started(&error))?;
        self.judge(output.status)?;
        Ok(String::from_utf8(output.stdout)?)
    }

    /// Runs it; its standard output goes to the log and, line by line, to `look`.
    ///
    /// # Errors
    /// Returns an error if the command cannot be started or does not succeed.
    pub(crate) fn watch(&self, mut look: impl FnMut(&str)) -> Result<()> {
        self.show();
        let status = timed(self, || -> Result<_> {
            let mut command = self.command();
            let child = command.stdout(Stdio::piped()).spawn();
            let mut child = child.map_err(|error| self.not_started(&error))?;
            if let Some(output) = child.stdout.take() {
                for line in BufReader::new(output).split(b'\n') {
                    let line = line?;
                    let line = String::from_utf8_lossy(&line);
                    println!("{line}");
                    look(&line);
                }
            }
            Ok(child.wait()?)
        });
        self.judge(status?)
    }

    /// Runs it as [`Line::watch`] does, and returns how many of its checks it has said to be `kept`.
    ///
    /// # Errors
    /// Returns an error if the command cannot be started, does not succeed, or makes no check.
    pub(crate) fn kept(&self) -> Result<u32> {
        let mut kept = 0;
        self.watch(|line| kept += u32::from(line == "kept"))?;
        if kept == 0 {
            return Err(format!(
                "`{self}` succeeded, but has checked nothing: it printed no line `kept`, which it \
                 prints for each check that holds"
            )
            .into());
        }
        Ok(kept)
    }

    /// Runs it; all that it printed goes to the log once it has ended, and its standard output is given.
    ///
    /// # Errors
    /// Returns an error if the command cannot be started or does not succeed.
    pub(crate) fn collect(&self) -> Result<String> {
        let output = timed(self, || self.command().output());
        let output = output.map_err(|error| self.not_started(&error))?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let printed = text(&output.stdout);
        // In one piece, between those of other lines.
        eprintln!("$ {self}\n{}{printed}", text(&output.stderr));
        self.judge(output.status)?;
        Ok(printed)
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.words[0]);
        command.args(&self.words[1..]).current_dir(match &self.dir {
            Some(dir) => self.root.join(dir),
            None => self.root.clone(),
        });
        // `cargo run` describes xtask in these; a build script that watches one would run again.
        for (name, _) in std::env::vars_os() {
            if name.to_str().is_some_and(|name| {
                name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_")
            }) {
                command.env_remove(name);
            }
        }
        command
            .env_remove("CARGO")
            .envs(self.env.iter().map(|(name, value)| (name, value)));
        command
    }

    fn show(&self) {
        eprintln!("$ {self}");
    }

    fn not_started(&self, error: &std::io::Error) -> String {
        format!("`{self}` could not be started: {error}")
    }

    fn judge(&self, status: std::process::ExitStatus) -> Result<()> {
        if status.success() {
            Ok(())
        } else {
            Err(format!("`{self}`: {status}").into())
        }
    }
}

/// Does `work` for each item, for as many at a time as there are cores, and returns the results in the
/// order of the items. What `work` runs it [collects](Line::collect), or else the log is in no order.
///
/// # Errors
/// Returns the error of the first item that has one; all are worked on.
pub(crate) fn side_by_side<T: Sync, R: Send>(
    items: &[T],
    work: impl Fn(&T) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    let next = AtomicUsize::new(0);
    let results: Vec<_> = items.iter().map(|_| Mutex::new(None)).collect();
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let (Some(item), Some(place)) = (items.get(number), results.get(number)) else {
                        break;
                    };
                    // An error of any type does not go to another thread.
                    let result = work(item).map_err(|problem| problem.to_string());
                    *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
                }
            });
        }
    });
    let results = results
        .into_iter()
        .filter_map(|place| place.into_inner().unwrap_or_else(PoisonError::into_inner));
    Ok(results.collect::<Result<Vec<_>, String>>()?)
}

impl std::fmt::Display for Line {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(dir) = &self.dir {
            write!(f, "cd {dir} && ")?;
        }
        for (name, value) in &self.env {
            write!(f, "{name}=\"{value}\" ")?;
        }
        for (index, word) in self.words.iter().enumerate() {
            let blank = if index == 0 { "" } else { " " };
            let quote = if word.contains([' ', '*']) { "'" } else { "" };
            write!(f, "{blank}{quote}{word}{quote}")?;
        }
        Ok(())
    }
}
