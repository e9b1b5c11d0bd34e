//! The processes: the system, and what looks at it.

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use tungstenite::Message;
use tungstenite::client::IntoClientRequest as _;

use crate::Result;

/// The time that anything may take to come up.
const PATIENCE: Duration = Duration::from_secs(30);
/// The time between two looks whether it has.
const LOOK: Duration = Duration::from_millis(20);

/// A system on the real clock.
pub(super) struct System {
    program: PathBuf,
    /// The directory of its socket and of the recordings.
    place: PathBuf,
    up: Running,
}

/// A process, which is ended with its owner.
pub(super) struct Running {
    child: Child,
    /// Counts what the process serves.
    client: Option<JoinHandle<f64>>,
}

impl System {
    pub(super) fn start(program: &Path, description: &Path, place: &Path) -> Result<Self> {
        let mut command = Command::new(program);
        command.env("XDG_RUNTIME_DIR", place).arg("up");
        command
            .arg(description)
            .args(["--headless", "--clock", "real"]);
        let log = File::create(place.join("log"))?;
        command.stdout(log.try_clone()?).stderr(log);
        let system = Self {
            program: program.into(),
            place: place.into(),
            up: Running::of(&mut command)?,
        };
        system.await_it("the system", || system.overruns().is_ok())?;
        Ok(system)
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = self.other(&self.program);
        command.args(arguments);
        command
    }

    /// Returns a command for another program, which finds the system.
    pub(super) fn other(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        command.env("XDG_RUNTIME_DIR", &self.place);
        command
    }

    /// Returns the time on a core that the supervisor and the processors have had, in s.
    pub(super) fn cpu(&self) -> Result<f64> {
        let output = self.command(&["ps", "--json"]).output()?;
        let answer: Value = serde_json::from_slice(&output.stdout)?;
        let processors = answer["processors"].as_array().into_iter().flatten();
        let pids = processors.filter_map(|it| it["pid"].as_u64());
        let times = pids.chain([u64::from(self.up.child.id())]).map(cpu_of);
        times.sum()
    }

    fn await_it(&self, what: &str, is_there: impl Fn() -> bool) -> Result<()> {
        let begun = Instant::now();
        while !is_there() {
            if begun.elapsed() > PATIENCE {
                let told = fs::read_to_string(self.place.join("log"))?;
                return Err(format!("{what} does not come up: {told}").into());
            }
            thread::sleep(LOOK);
        }
        Ok(())
    }

    /// Returns the overruns of all loops since they began.
    pub(super) fn overruns(&self) -> Result<f64> {
        let output = self.command(&["top", "--once", "--json"]).output()?;
        let answer: Value = serde_json::from_slice(&output.stdout)?;
        let loops = answer["loops"].as_array().filter(|it| !it.is_empty());
        let loops = loops.ok_or_else(|| format!("no loop: {answer}"))?;
        let overruns = loops.iter().map(|it| it["overruns"].as_f64());
        let sum = overruns.sum::<Option<f64>>();
        sum.ok_or_else(|| format!("a loop without overruns: {answer}").into())
    }

    /// Starts the live server with a client that takes the channels for which `is_taken` returns true, at a
    /// pace.
    pub(super) fn server(&self, query: &str, is_taken: impl Fn(&Value) -> bool) -> Result<Running> {
        let mut command = self.command(&["view", "--port", "0"]);
        command.stderr(Stdio::null());
        let mut running = Running::of(command.stdout(Stdio::piped()))?;
        let told = running.child.stdout.take().ok_or("no standard output")?;
        let mut line = String::new();
        let mut told = BufReader::new(told);
        told.read_line(&mut line)?;
        let address = line.split(' ').next().unwrap_or_default();
        let address = address.replacen("http:", "ws:", 1) + query;
        let mut request = address.into_client_request()?;
        let protocol = "foxglove.websocket.v1".parse()?;
        request
            .headers_mut()
            .insert("Sec-WebSocket-Protocol", protocol);
        let (mut socket, _) = tungstenite::connect(request)?;
        loop {
            let message: Value = match socket.read()? {
                Message::Text(text) => serde_json::from_str(&text)?,
                _ => continue,
            };
            let channels = message["channels"].as_array().into_iter().flatten();
            let ids: Vec<_> = channels
                .filter(|it| is_taken(it))
                .map(|it| json!({"id": it["id"], "channelId": it["id"]}))
                .collect();
            if message["op"] == "advertise" && !ids.is_empty() {
                let wish = json!({"op": "subscribe", "subscriptions": ids});
                socket.send(Message::text(wish.to_string()))?;
                break;
            }
        }
        running.client = Some(thread::spawn(move || {
            let mut samples = 0.0;
            while let Ok(message) = socket.read() {
                // Other messages, such as of the time, are texts or have another first byte.
                samples +=
                    f64::from(message.is_binary() && message.into_data().first() == Some(&1));
            }
            // The server may write to its output as long as it runs.
            drop(told);
            samples
        }));
        Ok(running)
    }
}

impl Running {
    pub(super) fn of(command: &mut Command) -> Result<Self> {
        let child = command.spawn()?;
        let client = None;
        Ok(Self { child, client })
    }

    /// Returns the time on a core that the process has had, in s.
    pub(super) fn cpu(&self) -> Result<f64> {
        cpu_of(self.child.id().into())
    }

    /// Takes the standard input and output of the process, which are pipes.
    pub(super) fn pipes(&mut self) -> Result<(ChildStdin, ChildStdout)> {
        let pipes = (self.child.stdin.take(), self.child.stdout.take());
        match pipes {
            (Some(input), Some(output)) => Ok((input, output)),
            _ => Err("no pipes".into()),
        }
    }

    fn interrupt(&self) -> Result<()> {
        let pid = Pid::from_raw(self.child.id().try_into()?).ok_or("no process")?;
        Ok(kill_process(pid, Signal::INT)?)
    }

    /// Ends it as ^C does; returns what its client had.
    pub(super) fn end(mut self) -> Result<f64> {
        self.interrupt()?;
        let status = self.child.wait()?;
        if !status.success() {
            return Err(format!("a watcher ends with {status}").into());
        }
        match self.client.take().map(JoinHandle::join) {
            None => Ok(0.0),
            Some(counted) => counted.map_err(|_| "a client has panicked".into()),
        }
    }
}

/// Returns the time on a core that a process has had, in s.
fn cpu_of(pid: u64) -> Result<f64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat"))?;
    // The name of the program is in parentheses, and may contain anything.
    let (_, fields) = stat.rsplit_once(')').ok_or("no name in stat")?;
    let times = fields.split_whitespace().skip(11).take(2);
    let ticks: Vec<u64> = times
        .map(str::parse)
        .collect::<std::result::Result<_, _>>()?;
    Ok(ticks.iter().sum::<u64>() as f64 / rustix::param::clock_ticks_per_second() as f64)
}

impl Drop for Running {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) && self.interrupt().is_ok() {
            // The process has ended, whatever its status is.
            let _ = self.child.wait();
        }
    }
}
