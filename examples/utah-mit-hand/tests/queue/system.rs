//! [`Up`]: the system, which is brought up again when it has ended.

use std::error::Error;
use std::fs::{self, File};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use condor_host::control::{ControlClient, SystemStatus};
use condor_host::services::terminals::type_in;
use condor_host::system::SystemDirectory;
use rustix::process::{Pid, Signal, kill_process};
use verdict::log::{CLIENTS, PLACE};
use verdict::observer;

pub(crate) type Outcome<T> = Result<T, Box<dyn Error>>;

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");
const NAME: &str = "queue";
const MASTER: &str = "master";
/// The names of the processes that look after the programs.
pub(crate) const SUPERVISOR: &str = "supervisor";
pub(crate) const KEEPER: &str = "keeper";
/// How often a master whose fingers are loose is told to take them up.
const ENABLE: Duration = Duration::from_millis(100);

/// The clock of the system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Clock {
    /// As fast as it can.
    Simulated,
    Real,
}

impl Clock {
    const fn arguments(self) -> &'static [&'static str] {
        match self {
            Self::Simulated => &["--clock", "simulated", "--speed", "max"],
            Self::Real => &["--clock", "real"],
        }
    }
}

/// The system and its files.
pub(crate) struct Up {
    place: tempfile::TempDir,
    description: PathBuf,
    clock: Clock,
    /// The process that was started: the keeper, of which the supervisor is a child.
    keeper: Child,
    enabled: Instant,
}

impl Up {
    /// Brings it up, with clients that make so many requests together.
    pub(crate) fn new(requests: u64, clock: Clock) -> Outcome<Self> {
        let place = tempfile::Builder::new()
            .prefix("condor-queue-")
            .tempdir_in("/dev/shm")?;
        let description = describe(place.path(), requests)?;
        let keeper = start(place.path(), &description, clock)?;
        Ok(Self {
            place,
            description,
            clock,
            keeper,
            enabled: Instant::now(),
        })
    }

    pub(crate) fn place(&self) -> &Path {
        self.place.path()
    }

    /// What the supervisors have written.
    pub(crate) fn told(&self) -> String {
        fs::read_to_string(self.place().join("told")).unwrap_or_default()
    }

    /// Whether all clients are.
    pub(crate) fn is_done(&self) -> bool {
        let mut logs = CLIENTS.iter().map(|name| self.place().join(name));
        logs.all(|log| fs::read_to_string(log).is_ok_and(|text| text.ends_with("end\n")))
    }

    /// Whether the process that was started has ended.
    pub(crate) fn has_ended(&mut self) -> Outcome<bool> {
        Ok(self.keeper.try_wait()?.is_some())
    }

    fn directory(&self) -> SystemDirectory {
        SystemDirectory::at(self.place().join("condor").join(NAME))
    }

    /// Brings the system up again if it has ended, and takes up fingers that are loose.
    pub(crate) fn look(&mut self) -> Outcome<()> {
        if self.has_ended()? {
            self.keeper = start(self.place(), &self.description, self.clock)?;
        }
        if self.enabled.elapsed() > ENABLE {
            self.enabled = Instant::now();
            if observer::is_loose(self.place()) {
                // There may be no master now.
                let _ = type_in(&self.directory(), MASTER, b"enable\n");
            }
        }
        Ok(())
    }

    /// Returns the state of the system; `None` if nobody answers.
    pub(crate) fn status(&self) -> Option<SystemStatus> {
        let mut client = ControlClient::connect(&self.directory()).ok()?;
        client.set_timeout(Some(Duration::from_secs(5))).ok()?;
        client.status().ok()
    }

    /// Returns the process of a program, of the [`SUPERVISOR`] or of the [`KEEPER`], if there is one.
    pub(crate) fn process(&self, name: &str) -> Option<Pid> {
        let id = match name {
            KEEPER => Some(self.keeper.id()),
            SUPERVISOR => self.status().map(|status| status.pid),
            _ => {
                let status = self.status()?;
                status.members().find(|it| it.name == name)?.pid
            }
        };
        Pid::from_raw(id?.cast_signed())
    }

    /// Kills a program, the supervisor or the keeper. Returns whether it was there.
    pub(crate) fn kill(&self, name: &str) -> bool {
        let victim = self.process(name);
        victim.is_some_and(|victim| kill_process(victim, Signal::KILL).is_ok())
    }

    /// Begins to take it down, as a person does: by `down`, or by an interrupt of `up`.
    pub(crate) fn begin_down(&self, by_signal: bool) -> Outcome<Option<Child>> {
        if by_signal {
            // It may have ended already.
            let _ = kill_process(Pid::from_child(&self.keeper), Signal::INT);
            return Ok(None);
        }
        command(self.place(), &["down", "--system", NAME])?
            .spawn()
            .map(Some)
            .map_err(Into::into)
    }

    /// Returns the processes of the system, whatever they are called and whoever has started them.
    pub(crate) fn processes(&self) -> Outcome<Vec<Pid>> {
        let mark = [PLACE.as_bytes(), b"=", self.place().as_os_str().as_bytes()].concat();
        let mut found = Vec::new();
        for entry in fs::read_dir("/proc")? {
            let entry = entry?;
            let Some(process) = entry
                .file_name()
                .to_str()
                .and_then(|name| name.parse().ok())
            else {
                continue;
            };
            // One that has ended has none any more.
            let environment = fs::read(entry.path().join("environ")).unwrap_or_default();
            if environment
                .split(|byte| *byte == 0)
                .any(|entry| entry == mark)
            {
                found.extend(Pid::from_raw(process));
            }
        }
        Ok(found)
    }

    /// Takes it down. A supervisor whose keeper was killed may answer in the place of the present one,
    /// until it has gone down itself: so this asks until the present one has ended.
    pub(crate) fn end(&mut self, deadline: Instant) -> Outcome<()> {
        while !self.has_ended()? {
            if Instant::now() > deadline {
                return Err(format!("it does not go down:\n{}", self.told()).into());
            }
            if let Ok(client) = ControlClient::connect(&self.directory()) {
                // One that is about to end does not answer.
                let _ = client.down();
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        // It may have ended already; its children end with it.
        let _ = self.keeper.kill();
        let _ = self.keeper.wait();
    }
}

fn start(place: &Path, description: &Path, clock: Clock) -> Outcome<Child> {
    let mut up = command(place, &["up"])?;
    up.arg(description)
        .arg("--headless")
        .args(clock.arguments());
    Ok(up.spawn()?)
}

/// Returns a command of this program; what it writes goes to the file `told`.
fn command(place: &Path, arguments: &[&str]) -> Outcome<Command> {
    let told = File::options()
        .create(true)
        .append(true)
        .open(place.join("told"))?;
    let mut command = Command::new(std::env::current_exe()?);
    command
        .args(arguments)
        .env("XDG_RUNTIME_DIR", place)
        .env(PLACE, place)
        .stdin(Stdio::null())
        .stdout(told.try_clone()?)
        .stderr(told);
    Ok(command)
}

/// The shipped system under another name, with files of its own, clients and an observer.
fn describe(place: &Path, requests: u64) -> Outcome<PathBuf> {
    let package = Path::new(PACKAGE);
    let hand = package.join("../../condor-hand/hands/utah-mit.toml");
    let shipped = fs::read_to_string(package.join("system.toml"))?;
    let mut text = shipped
        .replace("name = \"utah-mit-hand\"", &format!("name = \"{NAME}\""))
        .replace(
            "\"../../condor-hand/hands/utah-mit.toml\"",
            &format!("{:?}", hand.display().to_string()),
        )
        // However often they are killed, they are not given up.
        .replace("name = \"master\"", "name = \"master\"\nrestarts = 1000000")
        .replace(
            "headless = [\"enable\", \"run wave\"]",
            "headless = [\"enable\"]",
        );
    let mut left = requests;
    for (index, name) in CLIENTS.iter().enumerate() {
        let own = left / (CLIENTS.len() - index) as u64;
        left -= own;
        text.extend([format!(
            "\n[[processors]]\nnumber = {}\nname = \"{name}\"\nprogram = \"self\"\n\
             arguments = [\"client\", \"{index}\", \"{own}\"]\nrestarts = 1000000\n",
            7 + index
        )]);
    }
    text += "\n[[processors]]\nnumber = 10\nname = \"observer\"\nprogram = \"self\"\n\
             arguments = [\"observer\"]\n";
    let description = place.join("system.toml");
    fs::write(&description, text)?;
    Ok(description)
}
