//! [`Up`]: the system, which is brought up again when it has ended.

use std::error::Error;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use condor_host::control::Client;
use condor_host::services::terminals::type_in;
use condor_host::system::SystemDirectory;
use rustix::process::{Pid, Signal, kill_process};

use crate::client::CLIENTS;
use crate::observer;

pub(crate) type Outcome<T> = Result<T, Box<dyn Error>>;

pub(crate) const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");
/// The variable with the directory of the run, for the programs.
pub(crate) const PLACE: &str = "UTAH_QUEUE_PLACE";
const NAME: &str = "queue";
const MASTER: &str = "master";
/// How often a master whose fingers are loose is told to take them up.
const ENABLE: Duration = Duration::from_millis(100);

/// The system and its files.
pub(crate) struct Up {
    place: tempfile::TempDir,
    description: PathBuf,
    supervisor: Child,
    enabled: Instant,
}

impl Up {
    /// Brings it up, with clients that make so many requests together.
    pub(crate) fn new(requests: u64) -> Outcome<Self> {
        let place = tempfile::Builder::new()
            .prefix("condor-queue-")
            .tempdir_in("/dev/shm")?;
        let description = describe(place.path(), requests)?;
        let supervisor = start(place.path(), &description)?;
        Ok(Self {
            place,
            description,
            supervisor,
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

    fn directory(&self) -> SystemDirectory {
        SystemDirectory::at(self.place().join("condor").join(NAME))
    }

    /// Brings the system up again if it has ended, and takes up fingers that are loose.
    pub(crate) fn look(&mut self) -> Outcome<()> {
        if self.supervisor.try_wait()?.is_some() {
            self.supervisor = start(self.place.path(), &self.description)?;
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

    /// Kills a program, or the supervisor or its keeper. Returns whether it was there.
    pub(crate) fn kill(&self, name: &str, keeper: bool) -> Outcome<bool> {
        let Ok(mut client) = Client::connect(&self.directory()) else {
            return Ok(false);
        };
        client.set_timeout(Some(Duration::from_secs(5)))?;
        let Ok(status) = client.status() else {
            return Ok(false);
        };
        let pid = if name != "supervisor" {
            let mut members = status.members();
            members.find(|it| it.name == name).and_then(|it| it.pid)
        } else if keeper {
            Some(self.supervisor.id())
        } else {
            Some(status.pid)
        };
        let Some(pid) = pid.and_then(|pid| Pid::from_raw(pid.cast_signed())) else {
            return Ok(false);
        };
        Ok(kill_process(pid, Signal::KILL).is_ok())
    }

    /// Takes it down. A supervisor whose keeper was killed may answer in the place of the present one,
    /// until it has gone down itself: so this asks until the present one has ended.
    pub(crate) fn end(&mut self, deadline: Instant) -> Outcome<()> {
        while self.supervisor.try_wait()?.is_none() {
            if Instant::now() > deadline {
                return Err(format!("it does not go down:\n{}", self.told()).into());
            }
            if let Ok(client) = Client::connect(&self.directory()) {
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
        let _ = self.supervisor.kill();
        let _ = self.supervisor.wait();
    }
}

fn start(place: &Path, description: &Path) -> Outcome<Child> {
    let told = File::options()
        .create(true)
        .append(true)
        .open(place.join("told"))?;
    Ok(Command::new(std::env::current_exe()?)
        .arg("up")
        .arg(description)
        .args(["--headless", "--speed", "max"])
        .env("XDG_RUNTIME_DIR", place)
        .env(PLACE, place)
        .stdin(Stdio::null())
        .stdout(told.try_clone()?)
        .stderr(told)
        .spawn()?)
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
