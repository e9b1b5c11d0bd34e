//! The hand as processes in simulated time: the same outputs to the last bit, whatever else the machine
//! does.
//!
//! Each way of disturbing is tried once; with `CONDOR_RUNS=10` in the environment, ten times.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use condor_host::control::{ControlClient, SystemStatus};
use condor_host::system::SystemDirectory;
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");
const NAME: &str = "simulated";
const SERVICES: [&str; 2] = ["files", "terminals"];

/// What is compared: the terminal of the master, how well the joints followed, and the hash of all their
/// positions.
fn outcome(output: &str) -> String {
    let lines = output.lines();
    let lines = lines.skip_while(|line| !line.starts_with("terminal of "));
    let lines = lines.take_while(|line| !line.starts_with("processor  "));
    // The log of the terminal marks with times of the day where programs began; the supervisor tells
    // what it does in between.
    let lines = lines.filter(|line| !line.starts_with(['[', '2']));
    lines.collect::<Vec<_>>().join("\n")
}

/// The shipped system in `file` with a name and files of its own, whose services may be killed as often as one likes.
pub(crate) fn describe(file: &str, place: &Path, name: &str) -> PathBuf {
    let package = Path::new(PACKAGE);
    let text = fs::read_to_string(package.join(file)).unwrap();
    let (comment, rest) = text.split_once("\nname = \"").unwrap();
    let (_, rest) = rest.split_once('"').unwrap();
    let root = package.join("../..").display().to_string();
    let rest = rest.replace("\"../..", &format!("\"{root}"));
    let text = format!("{comment}\nname = \"{name}\"{rest}");
    let motions = package.join("motions");
    std::os::unix::fs::symlink(motions, place.join("motions")).unwrap();
    let description = place.join("system.toml");
    fs::write(&description, text + "\n[services]\nrestarts = 1000000\n").unwrap();
    description
}

/// A run that has been started.
struct Run {
    place: TempDir,
    supervisor: Child,
}

impl Run {
    fn start(clock: &[&str]) -> Self {
        let place = tempfile::tempdir_in("/dev/shm").unwrap();
        let file = fs::File::create(place.path().join("output")).unwrap();
        let supervisor = Command::new(env!("CARGO_BIN_EXE_utah-mit-hand"))
            .arg("up")
            .arg(describe("system.toml", place.path(), NAME))
            .args(["--headless", "--for", "10s"])
            .args(clock)
            .env("XDG_RUNTIME_DIR", place.path())
            .stdin(Stdio::null())
            .stdout(file)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self { place, supervisor }
    }

    fn status(&self) -> Option<SystemStatus> {
        let directory = self.place.path().join("condor").join(NAME);
        let client = ControlClient::connect(&SystemDirectory::at(directory));
        client.ok()?.status().ok()
    }

    fn members(&self) -> Vec<(String, Pid)> {
        let status = self.status();
        let members = status.iter().flat_map(SystemStatus::members);
        let of = |pid: u32| Pid::from_raw(i32::try_from(pid).ok()?);
        let members = members.filter_map(|it| Some((it.name.clone(), it.pid.and_then(of)?)));
        members.collect()
    }

    /// Calls `meddle` with the processes, again and again until they have ended; gives what is compared.
    fn end(mut self, mut meddle: impl FnMut(&[(String, Pid)])) -> String {
        let status = loop {
            if let Some(status) = self.supervisor.try_wait().unwrap() {
                break status;
            }
            meddle(&self.members());
        };
        let output = fs::read_to_string(self.place.path().join("output")).unwrap();
        // A service that has just been killed is a failure at the end.
        let killed = output
            .lines()
            .any(|line| line.ends_with("killed by SIGKILL"));
        assert!(status.success() || killed, "{output}");
        outcome(&output)
    }
}

/// Numbers that look random, the same ones in each run.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }
}

fn runs() -> u64 {
    let runs = std::env::var("CONDOR_RUNS").ok();
    runs.map_or(1, |runs| runs.parse().expect("CONDOR_RUNS is a number"))
}

fn pause(ms: u64) {
    std::thread::sleep(Duration::from_millis(ms));
}

/// Runs it while eight threads compute.
fn busy() -> String {
    let over = AtomicBool::new(false);
    std::thread::scope(|threads| {
        for _ in 0..8 {
            threads.spawn(|| {
                while !over.load(Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let outcome = Run::start(&["--speed", "max"]).end(|_| pause(10));
        over.store(true, Relaxed);
        outcome
    })
}

/// How often processes are disturbed at least, in as many runs as that takes.
const DISTURBANCES: usize = 4;

/// Runs it while processes are stopped for 1 to 500 ms, the supervisor's too. Returns how often.
fn stopped(random: &mut Random) -> (String, usize) {
    let mut stops = 0;
    let run = Run::start(&["--speed", "max"]);
    let supervisor = Pid::from_child(&run.supervisor);
    let outcome = run.end(|members| {
        let other = ("supervisor".to_owned(), supervisor);
        let all: Vec<_> = members.iter().chain([&other]).collect();
        let (_, process) = all[random.below(all.len() as u64) as usize];
        // It may have ended.
        let _ = kill_process(*process, Signal::STOP);
        pause(1 + random.below(500));
        let _ = kill_process(*process, Signal::CONT);
        pause(100 + random.below(400));
        stops += 1;
    });
    (outcome, stops)
}

/// Runs it while services are killed. Returns how often.
fn killed(random: &mut Random) -> (String, usize) {
    let mut kills = 0;
    let outcome = Run::start(&["--speed", "max"]).end(|members| {
        let mut services = members.iter();
        let name = SERVICES[random.below(2) as usize];
        if members.len() > SERVICES.len()
            && let Some((_, process)) = services.find(|(found, _)| *found == name)
        {
            let _ = kill_process(*process, Signal::KILL);
            kills += 1;
        }
        pause(50 + random.below(250));
    });
    (outcome, kills)
}

#[test]
fn the_hand_moves_alike_to_the_last_bit_however_it_is_disturbed() {
    let quiet = Run::start(&["--speed", "max"]).end(|_| pause(10));
    assert!(quiet.contains("wave is done"), "{quiet}");
    assert!(quiet.contains("joint positions over 10.0000 s"), "{quiet}");
    for seed in 1..=runs() {
        assert_eq!(busy(), quiet, "beside eight busy threads");
        let random = &mut Random(seed);
        for disturbed in [stopped, killed] {
            let mut times = 0;
            while times < DISTURBANCES {
                let (outcome, more) = disturbed(random);
                assert_eq!(
                    outcome, quiet,
                    "stopped or killed {more} times, seed {seed}"
                );
                times += more;
            }
        }
    }
}
