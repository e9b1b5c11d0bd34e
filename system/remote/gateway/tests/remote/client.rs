//! A client that has motions run, and writes down what it is told.
//!
//! It writes each motion into its log before it sends the motion, and the outcome of the motion once the outcome is
//! known. A later incarnation of the client reads in the log for which motions it must still ask.

use std::fs::File;
use std::path::Path;
use std::time::Duration;

use condor_hand::trajectory::image::append;
use condor_hand::trajectory::{Pace, Primitive, Profile, Target};
use condor_remote::{Id, Network, Remote, RemoteAccess, RemoteError, RemoteOutcome, RemoteState};
use verdict::log::{self, CLIENTS, JOINTS, Line, PLACE, read, target};

use crate::system;

/// The name of the robot.
pub(crate) const ROBOT: &str = "hand";
/// How long a client asks before it asks anew.
const ANSWER: Duration = Duration::from_secs(3);
/// How long a client waits after its first motion that is refused; then twice as long each time.
const ENABLED: Duration = Duration::from_millis(200);

/// The password of a user.
pub(crate) fn password(user: &str) -> String {
    format!("of-{user}")
}

/// A motion of one joint.
pub(crate) fn motion(joint: usize, target: f64, seconds: f64) -> system::Outcome<Vec<u8>> {
    let motion = Primitive::<16>::new(Pace::Duration(seconds), Profile::MinimumJerk);
    let motion = motion.with(joint, Target::Absolute(target))?;
    let mut image = vec![0; 480];
    let length = append(16, &motion, &mut image, 0)?;
    image.truncate(length);
    Ok(image)
}

/// Returns how many motions clients were told of that were done.
pub(crate) fn count_done(place: &Path) -> usize {
    let told = CLIENTS.iter().flat_map(|name| read(&place.join(name)));
    told.filter(|line| matches!(line, Line::Told(_, outcome) if outcome.starts_with("Done")))
        .count()
}

struct Worker {
    remote: Remote,
    log: File,
    joint: usize,
    /// How many motions were refused without another one between them.
    refused: u32,
}

/// Runs the client; the arguments are its index, the number of its motions, and the place of the router.
pub(crate) fn run(arguments: &[String]) -> system::Outcome<()> {
    let [client, all, router] = arguments else {
        return Err("expected an index, a number of motions, and a router".into());
    };
    let (client, all): (usize, u32) = (client.parse()?, all.parse()?);
    let name = CLIENTS.get(client).ok_or("no such client")?;
    let place = std::env::var_os(PLACE).ok_or("no place")?;
    let path = Path::new(&place).join(name);
    let lines = read(&path);
    let access = RemoteAccess {
        password: Some(password(name)),
        ..RemoteAccess::to(router)
    };
    let network = loop {
        match Network::open(&access, name, ANSWER) {
            Ok(network) => break network,
            // The router was killed just now.
            Err(error) => eprintln!("{error}"),
        }
    };
    let mut worker = Worker {
        remote: Remote::new(&network, ROBOT)?,
        log: File::options().create(true).append(true).open(&path)?,
        joint: JOINTS[client],
        refused: 0,
    };
    // What a former incarnation has not been told.
    let (mut open, mut next) = (Vec::new(), 0);
    for line in lines {
        match line {
            Line::Offers(index, session, number) => {
                let (session, number) = (session.try_into()?, number.try_into()?);
                open.push((index, Id { session, number }));
                next = index + 1;
            }
            Line::Told(index, _) => open.retain(|(it, _)| *it != index),
        }
    }
    for (index, id) in open {
        // It may be on its way still.
        until(|| worker.remote.withdraw(id, ANSWER));
        worker.settle(index, id)?;
    }
    for index in next..all {
        let id = until(|| worker.remote.next_id(ANSWER));
        let Id { session, number } = id;
        log::append(
            &worker.log,
            format_args!("offers {index} {session} {number}"),
        )?;
        let motion = motion(worker.joint, target(index), 0.12)?;
        // Some are sent twice at once, and of some the client does not wait for the answer.
        let remote = &worker.remote;
        std::thread::scope(|threads| {
            let offer = || remote.offer(id, &motion, false, ANSWER);
            let twice = index.is_multiple_of(3).then(|| threads.spawn(offer));
            if index % 7 == 5 {
                let _ = remote.offer(id, &motion, false, Duration::from_millis(1));
                until(|| remote.withdraw(id, ANSWER));
            } else {
                until(offer);
            }
            twice.map(std::thread::ScopedJoinHandle::join);
        });
        worker.settle(index, id)?;
    }
    log::append(&worker.log, format_args!("end"))?;
    Ok(())
}

/// Asks until there is an answer.
fn until<T>(mut ask: impl FnMut() -> Result<T, RemoteError>) -> T {
    loop {
        match ask() {
            Ok(answer) => return answer,
            Err(error) => eprintln!("{error}"),
        }
    }
}

impl Worker {
    /// Waits for the end of a motion.
    fn settle(&mut self, index: u32, id: Id) -> system::Outcome<()> {
        let RemoteOutcome { state, reason, .. } = until(|| self.remote.wait(id, ANSWER));
        let word = match state {
            // In the words of the verdict.
            RemoteState::Refused if reason == "it was withdrawn" => "Never".to_owned(),
            state => format!("{state:?}"),
        };
        let why = if reason.is_empty() { "None" } else { &reason };
        log::append(&self.log, format_args!("told {index} {word} {why}"))?;
        if word == "Refused" {
            // Until somebody has enabled the hand, which takes long on a machine that has much else to do.
            std::thread::sleep(ENABLED * (1 << self.refused.min(4)));
            self.refused += 1;
        } else {
            self.refused = 0;
        }
        Ok(())
    }
}
