//! `condor-remote`: the commands of `condor` for robots that are elsewhere.

mod config;
mod plot;
mod show;
mod watch;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::{Parser, Subcommand};
use condor_remote::{Id, Network, Remote, RemoteError, RemoteOutcome, RemoteState};
use serde_json::Value as Json;

use config::RemoteConfig;
use watch::{WatchedStream, duration, seconds};

type AnyError = Box<dyn std::error::Error>;

/// Looks at, tunes and moves robots that run Condor on other machines, over the network library zenoh
#[derive(Debug, Parser)]
#[command(name = "condor-remote", version)]
struct Line {
    /// The name of the robot; needed only if the file of robots (see --robots) has several
    #[arg(long, global = true)]
    robot: Option<String>,
    /// The address of the robot's gateway or of a router of zenoh, such as tcp/192.168.0.2:7447; by default from the
    /// file of robots
    #[arg(long, global = true, value_name = "PLACE")]
    connect: Vec<String>,
    /// The name of this client, by which robots tell the motions of clients apart; by default from the file of robots
    #[arg(long, global = true, value_name = "NAME")]
    client: Option<String>,
    /// The file of robots (TOML): their names and addresses, and the name of this client; by default
    /// `~/.config/condor/remote.toml`
    #[arg(long, global = true, value_name = "FILE")]
    robots: Option<PathBuf>,
    /// The longest time to wait for an answer, in seconds
    #[arg(long, global = true, default_value = "10", value_name = "SECONDS", value_parser = seconds)]
    timeout: Duration,
    /// Prints JSON, for scripts
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Lists the robots whose gateways can be reached
    Robots,
    /// Shows the state of processors and services
    Ps,
    /// Lists the topics (streams of values) that the gateway publishes, with the types of their messages
    Topics,
    /// Shows variables and parameters; sets parameters
    #[command(subcommand)]
    Vars(Vars),
    /// Draws variables of the streams over time, as text
    Plot {
        /// The names of variables; in a name, * stands for any characters, and ? for one
        #[arg(required = true)]
        names: Vec<String>,
        /// The length of time to draw, such as 10s
        #[arg(long, default_value = "10s", value_name = "TIME", value_parser = duration)]
        span: Duration,
    },
    /// Sends a message to a vector (a numbered handler) of a processor, and prints the reply
    Send {
        /// The name of the processor
        processor: String,
        /// The name or the number of the vector
        vector: String,
        /// The data of the message: a whole number from 0 to 4294967295
        data: u32,
    },
    /// Runs motions one after another, and waits until each has ended
    Run {
        /// The names of the motions
        #[arg(required = true)]
        motions: Vec<String>,
        /// Takes control of the robot if another program has it
        #[arg(long)]
        control: bool,
    },
    /// Shows the state of a motion
    Outcome {
        /// The identity of the motion, such as 1.3; `run` prints it
        #[arg(value_parser = identity)]
        id: Id,
    },
    /// Withdraws a motion: if the robot has not received it yet, it never runs. Prints the state of the motion
    Withdraw {
        /// The identity of the motion, such as 1.3; `run` prints it
        #[arg(value_parser = identity)]
        id: Id,
    },
    /// Stops all motion of the robot
    Stop,
}

#[derive(Debug, Subcommand)]
enum Vars {
    /// Lists variables, parameters (which can be set) and fields of published cells
    List {
        /// The name of a processor; all of them by default
        processor: Option<String>,
    },
    /// Shows the present values of variables, parameters and fields of published cells (values that programs share)
    Get {
        /// The names of variables, parameters or fields
        #[arg(required = true)]
        names: Vec<String>,
    },
    /// Sets a parameter
    Set {
        /// The name of the parameter
        name: String,
        /// The new value: a number, true, false, or a label
        #[arg(allow_negative_numbers = true)]
        value: String,
        /// Sets the parameter only if this is its present value
        #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
        from: Option<String>,
    },
    /// Prints rows of the streams, until Ctrl-C
    Watch {
        /// The names of variables or topics; in a name, * stands for any characters, and ? for one
        #[arg(required = true)]
        names: Vec<String>,
        /// Ends after this number of rows
        #[arg(long)]
        rows: Option<u64>,
        /// Ends after this time, such as 10s
        #[arg(long = "for", value_name = "TIME", value_parser = duration)]
        limit: Option<Duration>,
    },
}

fn identity(text: &str) -> Result<Id, String> {
    let parts = text.split_once('.');
    let id = parts.and_then(|(session, number)| {
        Some(Id {
            session: session.parse().ok()?,
            number: number.parse().ok()?,
        })
    });
    id.ok_or_else(|| {
        "a motion's identity is two numbers with a dot between them, such as 1.3".into()
    })
}

fn main() -> ExitCode {
    match run(&Line::parse()) {
        Ok(code) => code,
        Err(error) => {
            let is_pipe = error.downcast_ref::<std::io::Error>();
            if is_pipe.is_some_and(|it| it.kind() == std::io::ErrorKind::BrokenPipe) {
                // The reader of the output has seen enough of it.
                return ExitCode::SUCCESS;
            }
            eprintln!("condor-remote: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(line: &Line) -> Result<ExitCode, AnyError> {
    let timeout = line.timeout;
    let known = RemoteConfig::find(line.robots.as_deref())?;
    let choice = known.choose(line.robot.as_deref(), &line.connect, line.client.as_deref())?;
    let network = Network::open(&choice.access, &choice.client, timeout)?;
    if let Command::Robots = line.command {
        let robots = network.robots(timeout)?;
        show::values(line.json, robots.into_iter().map(Json::from).collect())?;
        return Ok(ExitCode::SUCCESS);
    }
    let robot = match choice.robot {
        Some(robot) => robot,
        None => only(network.robots(timeout)?)?,
    };
    let remote = Remote::new(&network, &robot)?;
    match &line.command {
        Command::Robots => {}
        Command::Ps => show::status(line.json, &remote.status(timeout)?)?,
        Command::Topics => show::topics(line.json, &remote.topics(timeout)?)?,
        Command::Vars(vars) => return self::vars(line, vars, &remote, timeout),
        Command::Plot { names, span } => {
            plot::run(WatchedStream::find(&remote, names, timeout)?, *span)?;
        }
        Command::Send {
            processor,
            vector,
            data,
        } => {
            let reply = remote.send(processor, vector, *data, timeout)?;
            show::values(line.json, vec![reply.into()])?;
        }
        Command::Run { motions, control } => {
            for motion in motions {
                if run_one(&remote, motion, *control, timeout)? != RemoteState::Done {
                    return Ok(ExitCode::FAILURE);
                }
            }
        }
        Command::Outcome { id } => print(&id.to_string(), &remote.outcome(*id, timeout)?),
        Command::Withdraw { id } => print(&id.to_string(), &remote.withdraw(*id, timeout)?),
        Command::Stop => remote.stop(timeout)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn only(mut robots: Vec<String>) -> Result<String, AnyError> {
    match (robots.pop(), robots.is_empty()) {
        (Some(only), true) => Ok(only),
        (None, _) => Err(
            "no robot was found: is its gateway running, and does --connect have the right address?".into()),
        (Some(last), false) => {
            robots.push(last);
            let there = robots.join(", ");
            Err(format!("there are several robots; name one with --robot: {there}").into())
        }
    }
}

fn vars(
    line: &Line,
    vars: &Vars,
    remote: &Remote,
    timeout: Duration,
) -> Result<ExitCode, AnyError> {
    match vars {
        Vars::List { processor } => {
            let mut rows = remote.variables(&[], timeout)?;
            if let Some(processor) = processor {
                rows.retain(|row| row["processor"] == processor.as_str());
            }
            show::variables(line.json, rows)?;
        }
        Vars::Get { names } => show::variables(line.json, remote.variables(names, timeout)?)?,
        Vars::Set { name, value, from } => {
            let (from, value) = (from.as_deref().map(value_of), value_of(value));
            let before = remote.set(name, from, value.clone(), timeout)?;
            show::change(line.json, name, &before, &value)?;
        }
        Vars::Watch { names, rows, limit } => {
            let watched = WatchedStream::find(remote, names, timeout)?;
            watch::print(line.json, watched, *rows, *limit, timeout)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// A number or a boolean; anything else is a label.
fn value_of(text: &str) -> Json {
    let value = serde_json::from_str(text).ok();
    let value = value.filter(|it: &Json| it.is_number() || it.is_boolean());
    value.unwrap_or_else(|| text.into())
}

/// Has a motion run, however long it takes once it was accepted.
fn run_one(
    remote: &Remote,
    motion: &str,
    control: bool,
    timeout: Duration,
) -> Result<RemoteState, AnyError> {
    let id = remote.next_id(timeout)?;
    eprintln!("{motion}: `outcome {id}` shows what has become of it");
    let uncertain = |error: RemoteError| {
        format!(
            "{error}; the motion may run: `outcome {id}` shows its state, `withdraw {id}` prevents it if it has \
                 not arrived"
        )
    };
    let mut outcome = remote
        .offer(id, motion.as_bytes(), control, timeout)
        .map_err(uncertain)?;
    let mut heard = Instant::now();
    while !outcome.state.is_final() {
        match remote.wait(id, Duration::from_secs(1)) {
            Ok(end) => outcome = end,
            Err(RemoteError::NoAnswer { .. }) => {
                // The motion still runs, or the robot is away.
                match remote.outcome(id, timeout) {
                    Ok(now) => (outcome, heard) = (now, Instant::now()),
                    Err(error) if heard.elapsed() > timeout => return Err(uncertain(error).into()),
                    Err(_) => {}
                }
            }
            Err(error) => return Err(uncertain(error).into()),
        }
    }
    print(motion, &outcome);
    Ok(outcome.state)
}

fn print(what: &str, outcome: &RemoteOutcome) {
    let RemoteOutcome { state, reason, .. } = outcome;
    let comma = if reason.is_empty() { "" } else { ", " };
    println!("{what}: {state}{comma}{reason}");
}
