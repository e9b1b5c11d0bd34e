//! `remote`: how old rows are when clients get them over zenoh, and what the clients cost the hand's loops.

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, ChildStdout, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::WARM_UP;
use super::process::{Running, System, build, build_in};
use crate::Result;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::rounds;
use crate::shuffle::Shuffle;

/// The clients, each a process.
const CLIENTS: [&str; 3] = ["lab", "desk", "night"];
/// The variables: fifty of each of two servo processors, whose loops run at 400 Hz.
const VARIABLES: [&str; 6] = [
    "servo-?:*.position",
    "servo-?:*.velocity",
    "servo-?:*.error",
    "servo-?:*.torque",
    "servo-?:*.tension",
    "servo-?:*.touch",
];
/// The line that a client prints when it receives its streams.
const TAKEN: &str = "2 streams of 100 variables\n";

/// The watchers of the hand in a turn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    Nobody,
    NobodyAgain,
    Clients,
}

/// The results of a round.
#[derive(Clone, Copy, Default)]
struct Round {
    /// Overruns of the turns in the order of [`Way`].
    overruns: [f64; 3],
    /// Percents of a core of the system's processes, in the same order.
    system: [f64; 3],
    /// Percents of a core: of the gateway, and of a client.
    gateway: f64,
    client: f64,
    /// Rows a second that a client gets, and those that were lost of all.
    rows: f64,
    lost: f64,
    /// Ages of rows at the clients, ms.
    median: f64,
    p99: f64,
}

/// The programs, and the configuration of the gateway.
struct Programs {
    gateway: PathBuf,
    client: PathBuf,
    config: PathBuf,
    place: String,
}

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(7, 7);
    let seconds = if options.quick { 1 } else { 5 };
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let program = build(&tree, "utah-mit-hand")?;
    build_in(
        &tree,
        "system/remote",
        &["-p", "condor-remote", "--example", "latency"],
    )?;
    let gateway = ["-p", "condor-gateway", "--bin", "condor-gateway"];
    let release = build_in(&tree, "system/remote", &gateway)?;
    let place = tempfile::tempdir()?;
    let programs = Programs::new(&release, place.path())?;
    let description = tree.join("examples/utah-mit-hand/system.toml");
    let system = System::start(&program, &description, place.path())?;
    let mut order = Shuffle(0);
    let played = rounds::play(rounds, |_| round(&system, &programs, seconds, &mut order))?;
    Ok(report(&played, seconds))
}

impl Programs {
    fn new(release: &Path, place: &Path) -> Result<Self> {
        // The port was free a moment ago.
        let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
        let at = format!("tcp/127.0.0.1:{port}");
        let clients: String = CLIENTS
            .map(|name| format!("[[clients]]\nname = {name:?}\nmay = [\"look\"]\n"))
            .concat();
        let config = place.join("gateway.toml");
        let text = format!(
            "robot = \"hand\"\nlisten = [{at:?}]\nvariables = {VARIABLES:?}\n{clients}"
        );
        fs::write(&config, text)?;
        Ok(Self {
            gateway: release.join("condor-gateway"),
            client: release.join("examples/latency"),
            config,
            place: at,
        })
    }
}

fn round(system: &System, programs: &Programs, seconds: u64, order: &mut Shuffle) -> Result<Round> {
    let mut ways = [Way::Nobody, Way::NobodyAgain, Way::Clients];
    order.shuffle(&mut ways);
    let mut round = Round::default();
    for way in ways {
        let remote = (way == Way::Clients).then(|| Remote::start(system, programs));
        let mut remote = remote.transpose()?;
        let cpu = |remote: &Option<Remote>| remote.as_ref().map_or(Ok([0.0; 2]), Remote::cpu);
        thread::sleep(WARM_UP);
        if let Some(remote) = &mut remote {
            remote.count()?;
        }
        let (begun, overruns) = (Instant::now(), system.overruns()?);
        let (of_system, before) = (system.cpu()?, cpu(&remote)?);
        thread::sleep(Duration::from_secs(seconds));
        let (after, all) = (cpu(&remote)?, system.cpu()? - of_system);
        round.overruns[way as usize] = system.overruns()? - overruns;
        let real = begun.elapsed().as_secs_f64();
        round.system[way as usize] = 100.0 * all / real;
        if let Some(remote) = remote {
            round.gateway = 100.0 * (after[0] - before[0]) / real;
            round.client = 100.0 * (after[1] - before[1]) / real / CLIENTS.len() as f64;
            remote.end(&mut round, real)?;
        }
    }
    Ok(round)
}

/// The gateway with its clients.
struct Remote {
    gateway: Running,
    clients: Vec<Client>,
}

struct Client {
    running: Running,
    go: ChildStdin,
    told: BufReader<ChildStdout>,
}

impl Remote {
    fn start(system: &System, programs: &Programs) -> Result<Self> {
        let mut command = system.other(&programs.gateway);
        command.arg(&programs.config).stdout(Stdio::null());
        let gateway = Running::of(&mut command)?;
        let mut clients = Vec::new();
        for name in CLIENTS {
            let mut command = system.other(&programs.client);
            command.args([&programs.place, name, "hand"]);
            command.stdin(Stdio::piped()).stdout(Stdio::piped());
            let mut running = Running::of(&mut command)?;
            let (go, told) = running.pipes()?;
            let mut told = BufReader::new(told);
            let mut line = String::new();
            told.read_line(&mut line)?;
            if line != TAKEN {
                return Err(format!("a client takes other streams: {line}").into());
            }
            clients.push(Client { running, go, told });
        }
        Ok(Self { gateway, clients })
    }

    /// Has the clients begin to count.
    fn count(&mut self) -> Result<()> {
        for client in &mut self.clients {
            client.go.write_all(b"\n")?;
        }
        Ok(())
    }

    /// Returns the time on a core that the gateway and all clients have had, in s.
    fn cpu(&self) -> Result<[f64; 2]> {
        let clients = self.clients.iter().map(|it| it.running.cpu());
        Ok([self.gateway.cpu()?, clients.sum::<Result<f64>>()?])
    }

    /// Ends it after so many seconds, and adds what the clients had.
    fn end(self, round: &mut Round, seconds: f64) -> Result<()> {
        for client in self.clients {
            let Client {
                running,
                go,
                mut told,
            } = client;
            drop(go);
            let mut line = String::new();
            told.read_line(&mut line)?;
            let answer: Value = serde_json::from_str(&line)?;
            let number = |key: &str| {
                answer[key]
                    .as_f64()
                    .ok_or_else(|| format!("no {key}: {line}"))
            };
            let share = 1.0 / CLIENTS.len() as f64;
            round.rows += share * number("rows")? / seconds;
            round.lost += number("lost")?;
            round.median += share * number("median_us")? / 1000.0;
            round.p99 = round.p99.max(number("p99_us")? / 1000.0);
            drop(running);
        }
        self.gateway.end().map(drop)
    }
}

fn report(played: &[Round], seconds: u64) -> Report {
    let of = |figure: &dyn Fn(&Round) -> f64| Estimate::of(played.iter().map(figure));
    let overruns = |way: Way| move |it: &Round| it.overruns[way as usize];
    let sum = |way: Way| played.iter().map(overruns(way)).sum::<f64>();
    let more = |way: Way| of(&move |it| overruns(way)(it) - overruns(Way::Nobody)(it));
    let (clients, control) = (more(Way::Clients), more(Way::NobodyAgain));
    let system = |way: Way| of(&move |it: &Round| it.system[way as usize]);
    let lost = of(&|it| it.lost);
    let text = format!(
        "{} rounds of three turns of {seconds} s, in an order that changes: the Utah/MIT hand on the real\n\
         clock, with nobody, with nobody again, and with a gateway that streams 100 variables at 400 Hz to\n\
         three clients over zenoh, by TCP on this machine. The age of a row is the time from the release\n\
         of the tick to the row's arrival in the client.\n\n\
         overruns of all loops: nobody {:.0}, nobody again {:.0}, clients {:.0}\n\
         more than with nobody, in a round:    {clients}\n\
         nobody again, more than nobody:       {control}\n\
         rows a second at a client:            {:.0}, lost {lost:.0}\n\
         age of a row, median, ms:             {}\n\
         age of a row, 99th percentile, ms:    {}\n\
         the system, percent of a core:        {}, with nobody {}\n\
         the gateway, percent of a core:       {}\n\
         a client, percent of a core:          {}\n",
        played.len(),
        sum(Way::Nobody),
        sum(Way::NobodyAgain),
        sum(Way::Clients),
        of(&|it| it.rows),
        of(&|it| it.median),
        of(&|it| it.p99),
        system(Way::Clients),
        system(Way::Nobody),
        of(&|it| it.gateway),
        of(&|it| it.client),
    );
    let goals = vec![
        Goal::most(
            "more_overruns_than_control_has",
            clients,
            control.high.max(0.0),
        ),
        Goal::most("rows_lost", lost, 0.0),
    ];
    Report { text, goals }
}
