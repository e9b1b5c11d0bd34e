//! [`Up`]: the hand with a gateway, which is brought up again when it has ended.

use std::error::Error;
use std::fs::{self, File};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use condor_host::control::ControlClient;
use condor_host::services::terminals::type_in;
use condor_host::system::SystemDirectory;
use rustix::process::{Pid, Signal, kill_process};
use verdict::log::PLACE;
use verdict::observer;

pub(crate) type Outcome<T> = Result<T, Box<dyn Error>>;

/// The package of the hand.
const PACKAGE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../../examples/utah-mit-hand"
);
const NAME: &str = "remote";
/// How often a master whose fingers are loose is told to take them up.
const ENABLE: Duration = Duration::from_millis(100);

/// The system and its files.
pub(crate) struct Up {
    place: tempfile::TempDir,
    description: PathBuf,
    speed: &'static str,
    namespace: Option<String>,
    supervisor: Child,
    enabled: Instant,
}

impl Up {
    /// Brings it up with a gateway of this configuration, with these passwords, at a speed of the simulated time, in a
    /// network namespace.
    pub(crate) fn new(
        config: &str,
        passwords: &str,
        speed: &'static str,
        namespace: Option<String>,
    ) -> Outcome<Self> {
        let place = tempfile::Builder::new()
            .prefix("condor-remote-")
            .tempdir_in("/dev/shm")?;
        let description = describe(place.path())?;
        fs::write(place.path().join("gateway.toml"), config)?;
        let file = place.path().join("passwords");
        fs::write(&file, passwords)?;
        fs::set_permissions(&file, fs::Permissions::from_mode(0o600))?;
        let supervisor = start(place.path(), &description, speed, namespace.as_deref())?;
        Ok(Self {
            place,
            description,
            speed,
            namespace,
            supervisor,
            enabled: Instant::now(),
        })
    }

    pub(crate) fn place(&self) -> &Path {
        self.place.path()
    }

    /// What the supervisors have written: the log, too.
    pub(crate) fn told(&self) -> String {
        fs::read_to_string(self.place().join("told")).unwrap_or_default()
    }

    fn directory(&self) -> SystemDirectory {
        SystemDirectory::at(self.place().join("condor").join(NAME))
    }

    /// Brings the system up again if it has ended, and takes up fingers that are loose.
    pub(crate) fn look(&mut self) -> Outcome<()> {
        if self.supervisor.try_wait()?.is_some() {
            let namespace = self.namespace.as_deref();
            self.supervisor = start(self.place(), &self.description, self.speed, namespace)?;
        }
        if self.enabled.elapsed() > ENABLE {
            self.enabled = Instant::now();
            if observer::is_loose(self.place()) {
                // There may be no master now.
                let _ = type_in(&self.directory(), "master", b"enable\n");
            }
        }
        Ok(())
    }

    /// Kills a program, a service, or the supervisor. Returns true if it was there.
    pub(crate) fn kill(&self, name: &str) -> Outcome<bool> {
        let Ok(mut client) = ControlClient::connect(&self.directory()) else {
            return Ok(false);
        };
        client.set_timeout(Some(Duration::from_secs(5)))?;
        let Ok(status) = client.status() else {
            return Ok(false);
        };
        let mut members = status.members();
        let pid = if name == "supervisor" {
            Some(status.pid)
        } else {
            members.find(|it| it.name == name).and_then(|it| it.pid)
        };
        Ok(pid.is_some_and(kill))
    }

    /// Takes it down.
    pub(crate) fn end(&mut self, deadline: Instant) -> Outcome<()> {
        while self.supervisor.try_wait()?.is_none() {
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
        let _ = self.supervisor.kill();
        let _ = self.supervisor.wait();
    }
}

/// Kills a process by its id; returns true if it was there.
pub(crate) fn kill(pid: u32) -> bool {
    let pid = Pid::from_raw(pid.cast_signed());
    pid.is_some_and(|pid| kill_process(pid, Signal::KILL).is_ok())
}

/// Returns a command that is this program in another role, and perhaps in a network namespace.
pub(crate) fn own(place: &Path, namespace: Option<&str>) -> Outcome<Command> {
    let told = File::options()
        .create(true)
        .append(true)
        .open(place.join("told"))?;
    let program = std::env::current_exe()?;
    let mut command = match namespace {
        Some(namespace) => {
            let mut ip = Command::new("ip");
            ip.args(["netns", "exec", namespace]).arg(program);
            ip
        }
        None => Command::new(program),
    };
    command
        .env("XDG_RUNTIME_DIR", place)
        .env(PLACE, place)
        .stdin(Stdio::null())
        .stdout(told.try_clone()?)
        .stderr(told);
    Ok(command)
}

fn start(place: &Path, description: &Path, speed: &str, namespace: Option<&str>) -> Outcome<Child> {
    let mut command = own(place, namespace)?;
    command
        .arg("up")
        .arg(description)
        .args(["--headless", "--speed", speed]);
    Ok(command.spawn()?)
}

/// Returns a port that was free a moment ago.
pub(crate) fn free_port() -> Outcome<u16> {
    Ok(TcpListener::bind("127.0.0.1:0")?.local_addr()?.port())
}

/// The shipped system for clients on other machines under another name, with files of its own, an observer and this
/// gateway.
fn describe(place: &Path) -> Outcome<PathBuf> {
    let package = Path::new(PACKAGE);
    let hand = package.join("../../condor-hand/hands/utah-mit.toml");
    let shipped = fs::read_to_string(package.join("remote.toml"))?;
    let mut text = shipped
        .replace(
            "name = \"utah-mit-hand-remote\"",
            &format!("name = \"{NAME}\""),
        )
        .replace(
            "\"../../condor-hand/hands/utah-mit.toml\"",
            &format!("{:?}", hand.display().to_string()),
        )
        // However often they are killed, they are not given up.
        .replace("name = \"master\"", "name = \"master\"\nrestarts = 1000000");
    let gateway = env!("CARGO_BIN_EXE_condor-gateway");
    text += "\n[[processors]]\nnumber = 10\nname = \"observer\"\nprogram = \"self\"\narguments = [\"observer\"]\n";
    let own = format!("\nprogram = {gateway:?}\n\n[services]\nrestarts = 1000000\n");
    text = text.replace(
        "\nconfig = \"gateway.toml\"\n",
        &format!("\nconfig = \"gateway.toml\"{own}"),
    );
    std::os::unix::fs::symlink(package.join("motions"), place.join("motions"))?;
    let description = place.join("system.toml");
    fs::write(&description, text)?;
    Ok(description)
}
