//! [`Up`]: the hand and two tellers, brought up for a run.

use std::error::Error;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use condor_host::control::{ControlClient, MemberState, SystemStatus};
use condor_host::services::terminals::type_in;
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_mbox::Processor;
use rustix::process::{Pid, Signal, kill_process};

pub(crate) type Outcome<T> = Result<T, Box<dyn Error>>;

/// The longest time that anything may take on a busy machine.
pub(crate) const DEADLINE: Duration = Duration::from_secs(60);
pub(crate) const LOOK: Duration = Duration::from_millis(10);

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");
const NAME: &str = "kills";
pub(crate) const MASTER: &str = "master";
/// Names and numbers of the tellers.
pub(crate) const TELLERS: [(&str, u8); 2] = [("teller-a", 7), ("teller-b", 8)];

const TELLER: &str = r#"
[[processors]]
number = NUMBER
name = "NAME"
program = "self"
arguments = ["teller", "PARTNER"]
"#;

/// The runs, overruns and worst lateness in us of a loop.
pub(crate) struct Counts {
    pub(crate) loop_name: String,
    pub(crate) runs: u64,
    pub(crate) overruns: u64,
    pub(crate) worst_us: f64,
}

/// A running system, which is killed when this is dropped.
pub(crate) struct Up {
    place: tempfile::TempDir,
    supervisor: Child,
}

impl Up {
    /// Brings it up, and waits until all processors run.
    pub(crate) fn start() -> Outcome<Self> {
        // Windows on a disk would have the loops wait for it.
        let place = tempfile::Builder::new()
            .prefix("condor-kills-")
            .tempdir_in("/dev/shm")?;
        let description = describe(place.path())?;
        let told = File::create(place.path().join("told"))?;
        let supervisor = Command::new(std::env::current_exe()?)
            .arg("up")
            .arg(description)
            .args(["--headless", "--clock=real"])
            .env("XDG_RUNTIME_DIR", place.path())
            .stdin(Stdio::null())
            .stdout(told.try_clone()?)
            .stderr(told)
            .spawn()?;
        let mut up = Self { place, supervisor };
        let deadline = Instant::now() + DEADLINE;
        loop {
            if let Ok(status) = up.status()
                && status.processors.len() > TELLERS.len()
                && all(&status, |state| state == MemberState::Running)
            {
                break;
            }
            if Instant::now() > deadline || up.supervisor.try_wait()?.is_some() {
                return Err(format!("the system does not come up:\n{}", up.told()).into());
            }
            std::thread::sleep(LOOK);
        }
        up.wait_for(MASTER, 0, DEADLINE, |text| {
            text.contains("lists the commands").then_some(())
        })?;
        Ok(up)
    }

    pub(crate) fn directory(&self) -> SystemDirectory {
        SystemDirectory::at(self.place.path().join("condor").join(NAME))
    }

    pub(crate) fn files(&self) -> PathBuf {
        self.place.path().join("files")
    }

    /// A command for this system.
    pub(crate) fn command(&self, word: &str) -> Outcome<Command> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg(word).env("XDG_RUNTIME_DIR", self.place.path());
        Ok(command)
    }

    pub(crate) fn status(&self) -> Outcome<SystemStatus> {
        let mut client = ControlClient::connect(&self.directory())?;
        client.set_timeout(Some(DEADLINE))?;
        Ok(client.status()?)
    }

    /// Returns the lines that the supervisor has written.
    pub(crate) fn told(&self) -> String {
        fs::read_to_string(self.place.path().join("told")).unwrap_or_default()
    }

    /// Types a line at a terminal.
    pub(crate) fn type_line(&self, name: &str, line: &str) -> Outcome<()> {
        Ok(type_in(
            &self.directory(),
            name,
            format!("{line}\n").as_bytes(),
        )?)
    }

    /// Returns the text that a terminal has shown, from a byte of its log on.
    pub(crate) fn shown(&self, name: &str, from: usize) -> Outcome<String> {
        let log = self.directory().terminals().join(format!("{name}.log"));
        let bytes = fs::read(log)?;
        Ok(String::from_utf8_lossy(bytes.get(from..).unwrap_or_default()).into_owned())
    }

    /// Waits until something is found in what a terminal shows.
    pub(crate) fn wait_for<R>(
        &self,
        name: &str,
        from: usize,
        limit: Duration,
        find: impl Fn(&str) -> Option<R>,
    ) -> Outcome<R> {
        let deadline = Instant::now() + limit;
        loop {
            // A log that is not there yet says nothing.
            let text = self.shown(name, from).unwrap_or_default();
            if let Some(found) = find(&text) {
                return Ok(found);
            }
            if Instant::now() > deadline {
                return Err(format!("{name} does not say it within {limit:?}:\n{text}").into());
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Waits until the services run.
    pub(crate) fn wait_for_services(&self) -> Outcome<()> {
        let deadline = Instant::now() + DEADLINE;
        while !self
            .status()?
            .services
            .iter()
            .all(|it| it.state == MemberState::Running)
        {
            if Instant::now() > deadline {
                return Err(format!("the services do not run:\n{}", self.told()).into());
            }
            std::thread::sleep(LOOK);
        }
        Ok(())
    }

    /// The counts of all loops, by processor.
    pub(crate) fn counts(&self) -> Outcome<Vec<(String, Counts)>> {
        let status = self.status()?;
        let view = View::open(&self.directory(), status.window_bytes)?;
        let mut found = Vec::new();
        for member in &status.processors {
            for rates in view.loops(Processor(member.number))?.overall() {
                let counts = Counts {
                    loop_name: rates.name.clone(),
                    runs: rates.runs,
                    overruns: rates.overruns,
                    worst_us: rates.worst_lateness_us,
                };
                found.push((member.name.clone(), counts));
            }
        }
        Ok(found)
    }

    /// Takes it down.
    pub(crate) fn end(mut self) -> Outcome<()> {
        ControlClient::connect(&self.directory())?.down()?;
        let status = self.supervisor.wait()?;
        if status.success() {
            Ok(())
        } else {
            Err(format!("the supervisor ended with {status}:\n{}", self.told()).into())
        }
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        // Both fail if the supervisor has ended already; its children end with it.
        let _ = self.supervisor.kill();
        let _ = self.supervisor.wait();
    }
}

pub(crate) fn kill(process: u32) -> Outcome<()> {
    let process = Pid::from_raw(process.cast_signed()).ok_or("no process")?;
    Ok(kill_process(process, Signal::KILL)?)
}

fn all(status: &SystemStatus, is: impl Fn(MemberState) -> bool) -> bool {
    let members = status.services.iter().chain(&status.processors);
    members.map(|member| member.state).all(is)
}

/// The shipped system under another name, with files of its own and with tellers.
fn describe(place: &Path) -> Outcome<PathBuf> {
    let package = Path::new(PACKAGE);
    let hand = package.join("../../condor-hand/hands/utah-mit.toml");
    let shipped = fs::read_to_string(package.join("system.toml"))?;
    let lines = shipped.lines().map(|line| {
        if line.starts_with("name = \"utah-mit-hand\"") {
            format!("name = \"{NAME}\"\n")
        } else if line.starts_with("robot = ") {
            format!("robot = {:?}\n", hand.display().to_string())
        } else if line.starts_with("headless = ") {
            String::new()
        } else {
            format!("{line}\n")
        }
    });
    let mut text = lines.collect::<Vec<_>>().concat();
    let [(_, a), (_, b)] = TELLERS;
    for ((name, number), partner) in TELLERS.into_iter().zip([b, a]) {
        text += &TELLER
            .replace("NUMBER", &number.to_string())
            .replace("NAME", name)
            .replace("PARTNER", &partner.to_string());
    }
    // However often they are killed, they are not given up.
    text += "\n[services]\nrestarts = 1000000\n";
    std::os::unix::fs::symlink(package.join("motions"), place.join("motions"))?;
    let description = place.join("system.toml");
    fs::write(&description, text)?;
    Ok(description)
}
