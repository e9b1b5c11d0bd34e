//! The command `motion`: motions for a running hand, from a shell.

use std::process::ExitCode;
use std::time::Duration;

use condor_hand::queue::{Answer, Identity, State};
use condor_host::cli::AnyError;
use condor_host::control::Client;
use condor_host::system;
use condor_host::view::View;
use condor_mbox::{MemoryWindow, Messenger, Processor};
use utah_mit_hand::motions::MotionsClient;
use utah_mit_hand::objects;

pub(crate) const ABOUT: &str =
    "Enqueues motions at the master of a running hand, and waits for their end";

const USAGE: &str = "\
Usage: utah-mit-hand motion [--system NAME] [--control] MOTION...

Each MOTION is the name of one, as `motions` lists them at the master's terminal. They run one after
another.

  --system NAME  the name of the system; needed only if several are running
  --control      takes control from another program
";

/// How long the master may take to answer.
const ANSWER: Duration = Duration::from_secs(10);
/// The time between two looks.
const PAUSE: Duration = Duration::from_millis(20);

/// What the arguments ask for.
#[derive(Debug, Default)]
struct Asked {
    system: Option<String>,
    from_other: bool,
    motions: Vec<String>,
}

pub(crate) fn run(arguments: Vec<String>) -> ExitCode {
    let Some(asked) = asked(arguments) else {
        eprint!("{USAGE}");
        return ExitCode::from(2);
    };
    match enqueue(&asked) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("utah-mit-hand motion: {error}");
            ExitCode::FAILURE
        }
    }
}

fn asked(arguments: Vec<String>) -> Option<Asked> {
    let mut asked = Asked::default();
    let mut arguments = arguments.into_iter();
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--system" => asked.system = Some(arguments.next()?),
            "--control" => asked.from_other = true,
            option if option.starts_with('-') => return None,
            _ => asked.motions.push(argument),
        }
    }
    (!asked.motions.is_empty()).then_some(asked)
}

/// Whether all of them were done.
fn enqueue(asked: &Asked) -> Result<bool, AnyError> {
    let directory = system::find(asked.system.as_deref())?;
    let status = Client::connect(&directory)?.status()?;
    let mut view = View::open(&directory, status.window_bytes)?;
    view.join()?;
    let mut found = None;
    for member in &status.processors {
        let number = Processor(member.number);
        let region = view.region(number)?;
        if let Some(blocks) = objects::motions(&region)? {
            found = Some((number, region, blocks));
        }
    }
    let Some((master, region, blocks)) = found else {
        return Err(format!("no processor of `{}` is a master", status.system).into());
    };
    let mut client = MotionsClient::new(view.post(), master, &blocks, &region)?;
    let session = client.open(ANSWER)?;
    let in_control = client.control(session, asked.from_other, ANSWER)?;
    if in_control != session {
        let text = format!("session {in_control} is in control; `--control` takes it");
        return Err(text.into());
    }
    let outcome = run_all(&mut client, view.post(), session, &asked.motions);
    client.give_up_control(session, ANSWER)?;
    outcome
}

/// Runs motions one after another; returns whether all of them were done.
fn run_all<M: Messenger, W: MemoryWindow + Clone>(
    client: &mut MotionsClient<'_, M, W>,
    messenger: &M,
    session: u32,
    motions: &[String],
) -> Result<bool, AnyError> {
    for (number, motion) in (1..).zip(motions) {
        let identity = Identity { session, number };
        let mut answer = client.offer(identity, motion.as_bytes(), ANSWER)?;
        while let Answer::Known(state, _) = answer
            && !state.is_final()
        {
            messenger.serve(PAUSE)?;
            (answer, _) = client.look(identity, ANSWER)?;
        }
        match answer {
            Answer::Known(State::Done, _) => println!("{motion}: done"),
            Answer::Known(state, reason) => {
                println!("{motion}: {state:?}, {reason}");
                return Ok(false);
            }
            other => return Err(format!("{motion}: the master answers {other:?}").into()),
        }
    }
    Ok(true)
}
