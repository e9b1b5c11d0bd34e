//! [`Demo`]: a run that a file prescribes: what is typed, which program is killed, and what is said about it.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use condor_host::control::ControlClient;
use condor_host::description::SystemDescription;
use condor_host::error::{AnyError, NamedFileError};
use condor_host::plain::shown_lines;
use condor_host::services::terminals;
use condor_host::system::SystemDirectory;
use condor_toml::{SourceText, Spanned, TextErrors};
use rustix::process::{Pid, Signal, kill_process};

/// The name of the file, beside the description of the system.
const FILE: &str = "demo.toml";
/// The time between two looks at what a terminal shows.
const LOOK: Duration = Duration::from_millis(50);
/// The longest wait for a text.
const PATIENCE: Duration = Duration::from_secs(60);
/// The longest time that a step may last after that, s.
const LONGEST_S: f64 = 600.0;

/// The steps of a demonstration.
#[derive(Clone, Debug)]
pub(crate) struct Demo(Vec<Step>);

#[derive(Clone, Debug)]
struct Step {
    /// A sentence for those who watch.
    caption: String,
    /// The processor at whose terminal something is typed and awaited; empty if nothing is.
    at: String,
    typed: Option<String>,
    /// The processor whose program is killed.
    killed: Option<String>,
    /// The step lasts until the terminal shows this text.
    until: Option<String>,
    /// The time after that.
    then: Duration,
}

impl Demo {
    /// Reads the demonstration of a system, whose `description` was read from `file`.
    pub(crate) fn of(file: &Path, description: &SystemDescription) -> Result<Self, AnyError> {
        let file = file.with_file_name(FILE);
        let read = fs::read_to_string(&file).map_err(NamedFileError::at("read", &file));
        let known: Vec<_> = (description.processors.iter())
            .map(|processor| processor.name.as_str())
            .collect();
        Ok(Self::parse(&file, &read?, &known)?)
    }

    fn parse(file: &Path, content: &str, processors: &[&str]) -> Result<Self, TextErrors> {
        let name = file.display().to_string();
        let text = SourceText::new(&name, content);
        let root = match text.parse() {
            Ok(root) => root,
            Err(error) => return Err(TextErrors(vec![error])),
        };
        let mut steps = Vec::new();
        if let Some(mut keys) = text.keys(&root) {
            let known = |name: Spanned<String>| {
                if !processors.contains(&name.get_ref().as_str()) {
                    let known = processors.join(", ");
                    let problem = format!(
                        "there is no processor `{}`; there are {known}",
                        name.get_ref()
                    );
                    text.wrong(&name.span(), problem);
                }
                name.into_inner()
            };
            for mut step in keys.tables("step", "a list of tables, the steps of the demonstration")
            {
                let span = step.span();
                let one = Step {
                    caption: step
                        .need("caption", "a sentence for those who watch")
                        .unwrap_or_default(),
                    at: step.get("at").map(known).unwrap_or_default(),
                    typed: step.get("type"),
                    killed: step.get("kill").map(known),
                    until: step.get("until"),
                    then: seconds(step.need("seconds", "the time that the step lasts, s")),
                };
                if one.at.is_empty() && (one.typed.is_some() || one.until.is_some()) {
                    text.wrong(
                        &span,
                        "`type` and `until` need `at`, the processor with the terminal",
                    );
                }
                steps.push(one);
                step.finish();
            }
            keys.finish();
        }
        text.finish(Some(Self(steps)))
    }

    /// Carries out the steps, and has `say` say what each is about, until it returns false.
    pub(crate) fn play(&self, directory: &SystemDirectory, mut say: impl FnMut(String) -> bool) {
        let count = self.0.len();
        for (number, step) in (1..).zip(&self.0) {
            if !say(format!("{number}/{count}  {}", step.caption)) {
                return;
            }
            if let Err(error) = step.run(directory) {
                say(format!("the demonstration ends at step {number}: {error}"));
                return;
            }
        }
    }
}

impl Step {
    fn run(&self, directory: &SystemDirectory) -> Result<(), AnyError> {
        let log = terminals::log(&directory.terminals(), &self.at);
        let before = fs::metadata(&log).map_or(0, |log| log.len());
        if let Some(line) = &self.typed {
            let line = format!("{line}\n");
            terminals::type_in(directory, &self.at, line.as_bytes())?;
        }
        if let Some(name) = &self.killed {
            kill(directory, name)?;
        }
        if let Some(text) = &self.until {
            let end = Instant::now() + PATIENCE;
            while !shown(&log, before)?.contains(text) {
                if Instant::now() >= end {
                    let (at, patience) = (&self.at, PATIENCE.as_secs());
                    return Err(format!("{at} has not said \"{text}\" within {patience} s").into());
                }
                thread::sleep(LOOK);
            }
        }
        thread::sleep(self.then);
        Ok(())
    }
}

/// The text that a terminal has shown behind so many bytes of its log.
fn shown(log: &PathBuf, before: u64) -> Result<String, NamedFileError> {
    let bytes = match fs::read(log) {
        // Nothing has been said yet.
        Err(error) if error.kind() == ErrorKind::NotFound => Vec::new(),
        read => read.map_err(NamedFileError::at("read", log))?,
    };
    let before = usize::try_from(before).unwrap_or(usize::MAX);
    // A log that has become shorter was begun anew.
    let after = bytes.get(before..).unwrap_or(&bytes);
    Ok(shown_lines(&String::from_utf8_lossy(after)))
}

/// Kills the program of a processor.
fn kill(directory: &SystemDirectory, name: &str) -> Result<(), AnyError> {
    let status = ControlClient::connect(directory)?.status()?;
    let mut members = status.members();
    let member = members.find(|member| member.name == name);
    let pid = member.and_then(|member| Pid::from_raw(member.pid?.cast_signed()));
    let pid =
        pid.ok_or_else(|| format!("{name} has no process on this machine that could be killed"))?;
    Ok(kill_process(pid, Signal::KILL)?)
}

/// A time that is a number of seconds, or none at all.
fn seconds(given: Option<f64>) -> Duration {
    let given = given.unwrap_or_default();
    Duration::from_secs_f64(given.clamp(0.0, LONGEST_S))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(content: &str) -> Result<Demo, String> {
        let parsed = Demo::parse(Path::new("demo.toml"), content, &["master", "servo-a"]);
        parsed.map_err(|errors| errors.to_string())
    }

    #[test]
    fn a_step_types_kills_and_waits() {
        let demo = parse(
            "[[step]]\ncaption = \"Hold.\"\nat = \"master\"\ntype = \"enable\"\nuntil = \"enabled\"\nseconds = 1.5\n\
             [[step]]\ncaption = \"Kill.\"\nkill = \"servo-a\"\nseconds = 2\n",
        );
        let Demo(steps) = demo.unwrap();
        let [hold, kill] = &steps[..] else {
            panic!("{steps:?}");
        };
        assert_eq!(hold.typed.as_deref(), Some("enable"));
        assert_eq!(hold.then, Duration::from_millis(1500));
        assert_eq!(kill.killed.as_deref(), Some("servo-a"));
        assert_eq!(kill.until, None);
    }

    #[test]
    fn mistakes_are_told_with_their_place() {
        for (content, said) in [
            ("", "`step` is missing"),
            ("[[step]]\nseconds = 1\n", "`caption` is missing"),
            ("[[step]]\ncaption = \"\"\n", "`seconds` is missing"),
            (
                "[[step]]\ncaption = \"\"\nseconds = 1\nkill = \"servo-c\"\n",
                "servo-a",
            ),
            (
                "[[step]]\ncaption = \"\"\nseconds = 1\ntype = \"enable\"\n",
                "`type` and `until` need `at`",
            ),
            ("[[step]]\ncaption = \"\"\nseconds = 1\nwait = 1\n", "wait"),
        ] {
            let error = parse(content).unwrap_err();
            assert!(error.contains(said), "{content}: {error}");
        }
    }
}
