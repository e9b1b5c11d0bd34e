//! The command `motion`: motions for a running hand, from a shell.

use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use std::time::Duration;

use condor_host::control::ControlClient;
use condor_host::error::{AnyError, me};
use condor_host::system::{self, SystemDirectory};
use condor_mbox::{MemoryWindow, Messenger};
use condor_platform::linux::read_text;

use super::offers::join;
use super::points::Points;
use crate::host;
use crate::motions::{MotionsClient, RequestProgress, SentPoints};
use crate::packet::ClientError;
use crate::queue::{InControl, QueueAnswer, RequestIdentity, RequestState};

pub(crate) const ABOUT: &str = "Runs motions at the master of a robot, and waits for their end";

const USAGE: &str = "\
Usage: PROGRAM motion [--system NAME] [--control] MOTION...
       PROGRAM motion [--system NAME] [--control] --stream FILE

Each MOTION is the name of one, as `motions` lists them at the master's terminal. They run one after
another. A stream moves joints through the points of a table while it is sent.

  --stream FILE  the table: a line such as `time,14,15` with the numbers of joints, then lines of times
                 (s, from 0 on) and positions (rad)
  --system NAME  the name of the system; needed only if several are running
  --control      takes control from another program
";

/// The time in which the master must answer.
const ANSWER: Duration = Duration::from_secs(10);
/// The time between two looks.
const PAUSE: Duration = Duration::from_millis(20);

fn usage() -> String {
    USAGE.replace("PROGRAM", &me())
}

/// The parsed arguments.
#[derive(Debug, Default)]
struct MotionArguments {
    system: Option<String>,
    from_other: bool,
    stream: Option<String>,
    motions: Vec<String>,
}

pub(crate) fn run(arguments: Vec<String>) -> ExitCode {
    if arguments.iter().any(|it| it == "--help" || it == "-h") {
        print!("{}", usage());
        return ExitCode::SUCCESS;
    }
    let Some(asked) = asked(arguments) else {
        eprint!("{}", usage());
        return ExitCode::from(2);
    };
    match enqueue(&asked) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{} motion: {error}", me());
            ExitCode::FAILURE
        }
    }
}

fn asked(arguments: Vec<String>) -> Option<MotionArguments> {
    let mut asked = MotionArguments::default();
    let mut arguments = arguments.into_iter();
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--system" => asked.system = Some(arguments.next()?),
            "--control" => asked.from_other = true,
            "--stream" => asked.stream = Some(arguments.next()?),
            option if option.starts_with('-') => return None,
            _ => asked.motions.push(argument),
        }
    }
    (asked.motions.is_empty() == asked.stream.is_some()).then_some(asked)
}

/// Returns true if all motions were done.
fn enqueue(asked: &MotionArguments) -> Result<bool, AnyError> {
    let points = match &asked.stream {
        Some(file) => {
            let text = read_text(file).map_err(|error| format!("{file}: {error}"))?;
            Some(Points::read(&text).map_err(|error| format!("{file}: {error}"))?)
        }
        None => None,
    };
    let directory = system::find(asked.system.as_deref())?;
    tell_if_paused(&directory)?;
    let (view, status) = join(&directory)?;
    let mut client = host::connect(&view, &status)?;
    let session = client.open(ANSWER)?;
    client
        .take_control(session, asked.from_other, ANSWER)
        .map_err(|error| match error {
            ClientError::NotInControl(who) if who != InControl::Nobody => {
                format!("{who}; `--control` takes control from it").into()
            }
            error => AnyError::from(error),
        })?;
    let outcome = match &points {
        Some(points) => run_stream(&mut client, view.post(), session, points),
        None => run_all(&mut client, view.post(), session, &asked.motions),
    };
    client.give_up_control(session, ANSWER)?;
    outcome
}

/// Says so if the simulated time is paused: the master answers only when it goes on.
fn tell_if_paused(directory: &SystemDirectory) -> Result<(), AnyError> {
    let status = ControlClient::connect(directory)?.status()?;
    if status.clock.is_some_and(|clock| clock.paused) {
        eprintln!(
            "{me} motion: the motion waits, since the simulated time is paused; `{me} clock resume` or `step` \
             continues it",
            me = me()
        );
    }
    Ok(())
}

/// Shows on a terminal how far a motion is, in a line that the next one overwrites.
fn show(motion: &str, seen: &RequestProgress) {
    let mut terminal = std::io::stderr();
    if !terminal.is_terminal() {
        return;
    }
    let what = match seen.answer {
        QueueAnswer::Known(RequestState::Started, _) => match seen.progress {
            Some(progress) => format!("{:3.0} %", 100.0 * progress),
            None => "runs".to_owned(),
        },
        QueueAnswer::Known(RequestState::Accepted, _) => format!("waits for {}", seen.before),
        _ => String::new(),
    };
    // A progress line that cannot be shown is not needed.
    let _ = write!(terminal, "\r\x1b[K{motion}: {what}\r");
}

/// Runs motions one after another; returns whether all of them were done.
fn run_all<M: Messenger, W: MemoryWindow + Clone>(
    client: &mut MotionsClient<'_, M, W>,
    messenger: &M,
    session: u32,
    motions: &[String],
) -> Result<bool, AnyError> {
    for (number, motion) in (1..).zip(motions) {
        let identity = RequestIdentity { session, number };
        client.offer(identity, motion.as_bytes(), ANSWER)?;
        if !is_done(client, messenger, identity, motion)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Runs a stream; returns whether it was done.
fn run_stream<M: Messenger, W: MemoryWindow + Clone>(
    client: &mut MotionsClient<'_, M, W>,
    messenger: &M,
    session: u32,
    points: &Points,
) -> Result<bool, AnyError> {
    let identity = RequestIdentity { session, number: 1 };
    client.stream(identity, points.mask, ANSWER)?;
    for batch in points.batches() {
        let sent = loop {
            match client.points(identity, points.mask, &batch, ANSWER) {
                // Other motions run first, or there is no room before the next points are passed.
                Err(ClientError::TimedOut { .. }) => {}
                sent => break sent,
            }
        };
        match sent {
            Ok(SentPoints::Until(_)) => {}
            Ok(SentPoints::Ended(_)) => break,
            Err(error) => {
                let first = batch.points.first().map_or(0.0, |point| point.time);
                return Err(format!("cannot send the points from {first} s on: {error}").into());
            }
        }
    }
    is_done(client, messenger, identity, "stream")
}

/// Waits for the end of a request, and prints it; returns whether it was done.
fn is_done<M: Messenger, W: MemoryWindow + Clone>(
    client: &mut MotionsClient<'_, M, W>,
    messenger: &M,
    identity: RequestIdentity,
    motion: &str,
) -> Result<bool, AnyError> {
    loop {
        let seen = client.look(identity, ANSWER)?;
        show(motion, &seen);
        match seen.answer {
            QueueAnswer::Known(RequestState::Done, _) => {
                println!("{motion}: done");
                return Ok(true);
            }
            QueueAnswer::Known(state, reason) if state.is_final() => {
                println!("{motion}: {state}, {reason}");
                return Ok(false);
            }
            QueueAnswer::Known(..) => {
                messenger.serve(PAUSE)?;
            }
            other => return Err(format!("{motion}: {other}").into()),
        }
    }
}
