//! `remote`: how old rows are when clients get them over zenoh, and what the clients cost the hand's loops.

use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use serde_json::Value;

use super::{Figures, Played, System, Watchers, Way, tree};
use crate::Result;
use crate::build::programs;
use crate::measure::{Goal, Report};
use crate::options::Options;
use crate::process::{Asked, Running};

/// The clients, each a process.
const CLIENTS: [&str; 3] = ["lab", "desk", "night"];
/// The variables: fifty of each of two servo processors, whose loops run at 400 Hz.
const VARIABLES: [&str; 6] = [
    "servo-?:*.position",
    "servo-?:*.velocity",
    "servo-?:*.error",
    "servo-?:*.torque",
    "servo-?:*.effort",
    "servo-?:*.touch",
];
/// The line that a client prints when it receives its streams.
const TAKEN: &str = "2 streams of 100 variables\n";

/// The programs, and the configuration of the gateway.
struct Programs {
    gateway: PathBuf,
    client: PathBuf,
    config: PathBuf,
    place: String,
}

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let seconds = if options.quick { 1 } else { 5 };
    let workspace = tree().join("system/remote");
    programs(&workspace, &["-p", "condor-remote", "--example", "latency"])?;
    let gateway = ["-p", "condor-gateway", "--bin", "condor-gateway"];
    let release = programs(&workspace, &gateway)?;
    let place = tempfile::tempdir()?;
    let programs = Programs::new(&release, place.path())?;
    let start = |system: &System| -> Result<Box<dyn Watchers>> {
        Ok(Box::new(Remote::start(system, &programs)?))
    };
    let played = Played::new(options, seconds, start)?;
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
        let text =
            format!("robot = \"hand\"\nlisten = [{at:?}]\nvariables = {VARIABLES:?}\n{clients}");
        fs::write(&config, text)?;
        Ok(Self {
            gateway: release.join("condor-gateway"),
            client: release.join("examples/latency"),
            config,
            place: at,
        })
    }
}

/// The gateway with its clients.
struct Remote {
    gateway: Running,
    clients: Vec<Asked>,
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
            let mut client = Asked::of(&mut command)?;
            let line = client.line()?;
            if line != TAKEN {
                return Err(format!("a client takes other streams: {line}").into());
            }
            clients.push(client);
        }
        Ok(Self { gateway, clients })
    }
}

impl Watchers for Remote {
    fn count(&mut self) -> Result<()> {
        self.clients.iter_mut().try_for_each(|it| it.tell(""))
    }

    fn cpu(&self) -> Result<[f64; 2]> {
        let clients = self.clients.iter().map(|it| it.running.cpu());
        Ok([self.gateway.cpu()?, clients.sum::<Result<f64>>()?])
    }

    fn end(self: Box<Self>, seconds: f64) -> Result<Figures> {
        let mut all = Figures::default();
        for mut client in self.clients {
            client.end_input();
            let line = client.line()?;
            let answer: Value = serde_json::from_str(&line)?;
            let number = |key: &str| {
                let number = answer[key].as_f64();
                number.ok_or_else(|| format!("no {key}: {line}"))
            };
            let share = 1.0 / CLIENTS.len() as f64;
            all.got += share * number("rows")? / seconds;
            all.lost += number("lost")?;
            all.median += share * number("median_us")? / 1000.0;
            all.p99 = all.p99.max(number("p99_us")? / 1000.0);
        }
        self.gateway.end()?;
        Ok(all)
    }
}

fn report(played: &Played, seconds: u64) -> Report {
    let system = |way: Way| played.of(|it| it.system[way as usize]);
    let lost = played.of(|it| it.watchers.lost);
    let text = format!(
        "{} rounds of three turns of {seconds} s, in an order that changes: the Utah/MIT hand on the real\n\
         clock, with nobody, with nobody again, and with a gateway that streams 100 variables at 400 Hz to\n\
         three clients over zenoh, by TCP on this machine. The age of a row is the time from the release\n\
         of the tick to the row's arrival in the client.\n\n\
         {}\
         rows a second at a client:            {:.0}, lost {lost:.0}\n\
         age of a row, median, ms:             {}\n\
         age of a row, 99th percentile, ms:    {}\n\
         the system, percent of a core:        {}, with nobody {}\n\
         the gateway, percent of a core:       {}\n\
         a client, percent of a core:          {}\n",
        played.0.len(),
        played.overruns("clients"),
        played.of(|it| it.watchers.got),
        played.of(|it| it.watchers.median),
        played.of(|it| it.watchers.p99),
        system(Way::Watchers),
        system(Way::Nobody),
        played.of(|it| it.cpu[0]),
        played.of(|it| it.cpu[1] / CLIENTS.len() as f64),
    );
    let goals = vec![played.goal(), Goal::most("rows_lost", lost, 0.0)];
    Report { text, goals }
}
