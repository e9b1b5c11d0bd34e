//! [`Offers`]: motions that people have composed, for the motion queue of a running master.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use condor_host::control::{ControlClient, SystemStatus};
use condor_host::error::AnyError;
use condor_host::robot::{MotionOutcome, MotionSender};
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_platform::linux::WholeFile;

use crate::RobotDescription;
use crate::compile::compile_motion;
use crate::host::{self, QueueSession};
use crate::motions::RequestProgress;
use crate::queue::RequestIdentity;

/// The time in which the master must answer a person who waits at a page.
const ANSWER: Duration = Duration::from_secs(5);
/// The prefix of the names of composed motions.
const PREFIX: &str = "view-";
/// The greatest number of composed motions whose outcomes are told.
const REMEMBERED: usize = 32;

/// Joins a system; returns what a client of its motion queue needs.
pub(crate) fn join(directory: &SystemDirectory) -> Result<(View, SystemStatus), AnyError> {
    let status = ControlClient::connect(directory)?.status()?;
    let mut view = View::open(directory, status.window_bytes)?;
    view.join()?;
    Ok((view, status))
}

/// Composed motions that are offered to the master, each as a file among the compiled motions.
pub(crate) struct Offers {
    directory: SystemDirectory,
    /// The directory of the compiled motions.
    files: PathBuf,
    robot: RobotDescription,
    /// The way to the system, which is found when it is first needed.
    way: Option<(View, SystemStatus)>,
    session: QueueSession,
    requests: BTreeMap<u64, Request>,
    last: u64,
}

struct Request {
    identity: RequestIdentity,
    /// Its file, which is removed when the master needs it no more.
    file: Option<PathBuf>,
}

impl Offers {
    pub(crate) fn new(directory: &SystemDirectory, files: &Path, robot: RobotDescription) -> Self {
        Self {
            directory: directory.clone(),
            files: files.join("motions"),
            robot,
            way: None,
            session: QueueSession::default(),
            requests: BTreeMap::new(),
            last: 0,
        }
    }

    /// Looks what has become of a motion.
    fn look(&mut self, id: u64) -> Result<MotionOutcome, AnyError> {
        let (Some(request), Some((view, status))) = (self.requests.get_mut(&id), &self.way) else {
            return Err(format!("the master does not know motion {id}, or no longer").into());
        };
        let RequestProgress {
            answer, progress, ..
        } = host::connect(view, status)?.look(request.identity, ANSWER)?;
        let is_final = answer.is_final();
        if is_final {
            request.remove();
        }
        Ok(MotionOutcome {
            state: answer.word().into(),
            reason: answer.reason().map(|it| it.to_string()),
            progress,
            is_final,
        })
    }

    /// Removes the files of motions that have ended, and forgets the oldest ones of these.
    fn tidy(&mut self) {
        let pending = self.requests.iter().filter(|(_, it)| it.file.is_some());
        for id in pending.map(|(id, _)| *id).collect::<Vec<_>>() {
            // A client that asks is told about an error.
            let _ = self.look(id);
        }
        let excess = self.requests.len().saturating_sub(REMEMBERED);
        let ended = self.requests.iter().filter(|(_, it)| it.file.is_none());
        for id in ended.map(|(id, _)| *id).take(excess).collect::<Vec<_>>() {
            self.requests.remove(&id);
        }
    }
}

/// Removes the files of motions that were left by programs that were killed.
pub(crate) fn clear(files: &Path) {
    for entry in fs::read_dir(files.join("motions")).into_iter().flatten() {
        let Ok(entry) = entry else { continue };
        if entry.file_name().to_string_lossy().starts_with(PREFIX) {
            // A file that stays is a motion that no request names.
            let _ = fs::remove_file(entry.path());
        }
    }
}

impl MotionSender for Offers {
    fn enqueue(&mut self, text: &str, takes_control: bool) -> Result<u64, AnyError> {
        let image = compile_motion(text, Path::new("motion"), &self.robot)?;
        self.tidy();
        let way = match self.way.take() {
            Some(way) => way,
            None => join(&self.directory)?,
        };
        // After an error the system is looked for anew.
        host::connect(&way.0, &way.1)?;
        let (view, status) = self.way.insert(way);
        let mut client = host::connect(view, status)?;
        let identity = self
            .session
            .take_control(&mut client, takes_control, ANSWER)?;
        let name = format!("{PREFIX}{}-{}", identity.session, identity.number);
        let file = self.files.join(format!("{name}.motion"));
        if let Err(error) = WholeFile::write(&file, &image) {
            client.give_up_control(identity.session, ANSWER)?;
            return Err(format!("{}: {error}", file.display()).into());
        }
        self.last += 1;
        let request = Request {
            identity,
            file: Some(file),
        };
        self.requests.insert(self.last, request);
        host::offer(&mut client, identity, name.as_bytes(), ANSWER)
            .map_err(|error| format!("{error}; the motion may run nevertheless"))?;
        Ok(self.last)
    }

    fn outcome(&mut self, id: u64) -> Result<MotionOutcome, AnyError> {
        self.look(id)
    }
}

impl Request {
    fn remove(&mut self) {
        if let Some(file) = self.file.take() {
            // Somebody may have removed it.
            let _ = fs::remove_file(file);
        }
    }
}

impl Drop for Offers {
    fn drop(&mut self) {
        self.requests.values_mut().for_each(Request::remove);
    }
}
