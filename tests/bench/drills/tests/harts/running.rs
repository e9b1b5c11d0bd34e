//! A system with harts that runs for a test.

use std::io::{BufRead as _, BufReader, Read as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use condor_host::control::{ControlClient, ControlEvents, ControlRequest, Member, MemberState};
use condor_host::system::SystemDirectory;

/// How long anything may take on a machine that has much else to do.
const DEADLINE: Duration = Duration::from_secs(120);
pub(crate) const DRILLS: &str = env!("CARGO_BIN_EXE_drills");
const ALL_STARTED: &str = " have been started";

/// Returns the path of an image of the workspace of the harts.
pub(crate) fn image(name: &str) -> String {
    let images = "../../firmware/target/riscv64gc-unknown-none-elf/release";
    format!("{}/{images}/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// Returns the path of another program that was built with this one.
pub(crate) fn host_program(name: &str) -> PathBuf {
    Path::new(DRILLS).with_file_name(name)
}

/// A program that shows the messages to a processor.
pub(crate) struct Observer {
    child: Child,
    lines: BufReader<ChildStdout>,
    told: BufReader<ChildStderr>,
}

impl Observer {
    /// Returns the next line that has this text; the terminal service sends messages, too.
    pub(crate) fn line(&mut self, text: &str) -> String {
        let mut line = String::new();
        while !line.contains(text) {
            line.clear();
            assert!(self.lines.read_line(&mut line).unwrap() > 0, "no {text}");
        }
        line
    }

    /// Waits until it ends by itself, and returns the rest of what it told.
    pub(crate) fn end(mut self) -> String {
        let mut told = String::new();
        self.told.read_to_string(&mut told).unwrap();
        assert!(self.child.wait().unwrap().success(), "{told}");
        told
    }
}

/// A running `drills up`, which is killed with its children when the test ends.
pub(crate) struct Up {
    place: tempfile::TempDir,
    child: Child,
}

impl Up {
    pub(crate) fn start(processors: &str, needs: &str) -> Self {
        Self::prepared(DRILLS.as_ref(), "", processors, needs, |_| {})
    }

    /// Has `condor`, which is a program with this name or another, bring up a system with these keys and
    /// processors, and waits until all have been started.
    pub(crate) fn prepared(
        condor: &Path,
        keys: &str,
        processors: &str,
        needs: &str,
        prepare: impl FnOnce(&Path),
    ) -> Self {
        assert!(Path::new(&image("monitor")).is_file(), "needs {needs}");
        let place = tempfile::tempdir().unwrap();
        std::fs::create_dir(place.path().join("files")).unwrap();
        prepare(place.path());
        let text = format!(
            "name = \"tested\"\nwindow_bytes = 524288\n{keys}[files]\nroot = \"files\"\n\
             [machine]\nmemory_bytes = 67108864\nmonitor = {:?}\n{processors}",
            image("monitor"),
        );
        std::fs::write(place.path().join("tested.toml"), text).unwrap();
        let mut child = Command::new(condor)
            .env("XDG_RUNTIME_DIR", place.path())
            .arg("up")
            .arg(place.path().join("tested.toml"))
            .arg("--headless")
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap());
        let mut told = String::new();
        while !told.contains(ALL_STARTED) {
            let before = told.len();
            lines.read_line(&mut told).unwrap();
            assert!(told.len() > before, "it ended:\n{told}");
        }
        // Lets it write on.
        std::thread::spawn(move || std::io::copy(&mut lines, &mut std::io::sink()));
        Self { place, child }
    }

    pub(crate) fn place(&self) -> &Path {
        self.place.path()
    }

    pub(crate) fn directory(&self) -> SystemDirectory {
        SystemDirectory::at(self.place.path().join("condor/tested"))
    }

    pub(crate) fn client(&self) -> ControlClient {
        let mut client = ControlClient::connect(&self.directory()).unwrap();
        client.set_timeout(Some(DEADLINE)).unwrap();
        client
    }

    pub(crate) fn events(&self) -> ControlEvents {
        self.client().events().unwrap()
    }

    pub(crate) fn member(&self, name: &str) -> Member {
        let mut processors = self.client().status().unwrap().processors.into_iter();
        processors.find(|member| member.name == name).unwrap()
    }

    /// Waits until a processor has a state.
    pub(crate) fn wait_for(&self, name: &str, state: MemberState) {
        let begun = Instant::now();
        loop {
            let member = self.member(name);
            if member.state == state {
                return;
            }
            assert!(begun.elapsed() < DEADLINE, "{name} is {}", member.state);
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Returns the values that change when a program is started anew.
    pub(crate) fn pid_and_state(&self, name: &str) -> (Option<u32>, MemberState, u32) {
        let member = self.member(name);
        (member.pid, member.state, member.restarts)
    }

    /// Has a processor run the image that it has, with other arguments.
    pub(crate) fn load(&self, name: &str, arguments: &[&str]) {
        let request = ControlRequest::Load {
            processor: name.into(),
            program: self.member(name).program,
            arguments: arguments.iter().map(|&one| one.into()).collect(),
        };
        self.client().ask(&request).unwrap();
    }

    /// Sends a message to a processor that answers with what comes next.
    pub(crate) fn ask(&self, number: u8, value: u32) -> u32 {
        let output = Command::new(DRILLS)
            .env("XDG_RUNTIME_DIR", self.place.path())
            .args(["send", "--reply", "--json"])
            .args([number.to_string(), "12".into(), value.to_string()])
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        let error = String::from_utf8_lossy(&output.stderr);
        let digits = text.rsplit_once("\"reply\":").map_or("", |(_, rest)| rest);
        let digits = digits.trim_start();
        let end = digits.find(|letter: char| !letter.is_ascii_digit());
        let digits = &digits[..end.unwrap_or(digits.len())];
        digits
            .parse()
            .unwrap_or_else(|_| panic!("{number}: {text}{error}"))
    }

    /// Starts a program that shows the messages to a processor, and waits until it hears them.
    pub(crate) fn hearing(&self, name: &str) -> Observer {
        let mut child = Command::new(DRILLS)
            .env("XDG_RUNTIME_DIR", self.place.path())
            .args(["vectors", name, "--follow", "--json"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        let mut told = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        told.read_line(&mut line).unwrap();
        assert!(line.contains("hears the messages"), "{line}");
        Observer { child, lines, told }
    }

    /// Reads a terminal until `text` has come, and returns all that came.
    pub(crate) fn read_terminal(&self, name: &str, text: &str) -> String {
        let mut stream = UnixStream::connect(self.directory().terminal(name)).unwrap();
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        let mut all = Vec::new();
        let mut piece = [0; 4096];
        while !String::from_utf8_lossy(&all).contains(text) {
            let count = stream.read(&mut piece).unwrap_or_else(|error| {
                panic!("{error}, not {text:?}: {}", String::from_utf8_lossy(&all))
            });
            assert!(count > 0, "no {text:?}: {}", String::from_utf8_lossy(&all));
            all.extend_from_slice(&piece[..count]);
        }
        String::from_utf8_lossy(&all).into_owned()
    }

    /// Waits until a program has ended by itself.
    pub(crate) fn wait_for_end(&self, name: &str, limit: Duration) {
        let deadline = Instant::now() + limit;
        loop {
            let member = self.member(name);
            match member.state {
                MemberState::Stopped => return,
                MemberState::Failed => panic!("{name}: {:?}\n{}", member.last_exit, self.log()),
                _ => assert!(Instant::now() < deadline, "{name} does not end"),
            }
            std::thread::yield_now();
        }
    }

    /// Returns the last lines of the log, in which programs that fail say why.
    pub(crate) fn log(&self) -> String {
        let log = self.client().ask(&ControlRequest::Log { lines: 20 });
        log.unwrap().lines.unwrap().join("\n")
    }

    /// Takes it down, which must succeed.
    pub(crate) fn end(mut self) {
        self.client().ask(&ControlRequest::Down {}).unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Waits until a processor has come into a state.
pub(crate) fn wait(events: &mut ControlEvents, name: &str, state: MemberState) {
    let mut told = String::new();
    for event in events.by_ref() {
        let event = event.unwrap_or_else(|error| panic!("{error}; before:\n{told}"));
        if event.source == name && event.state == Some(state) {
            return;
        }
        told += &event.to_string();
        told.push('\n');
    }
    panic!("the system ended:\n{told}");
}
