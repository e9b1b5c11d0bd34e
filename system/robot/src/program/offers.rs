//! [`Queue`]: the motion queue of a running master, as programs of the host ask it; and [`Offers`]: motions that people
//! have composed, for that queue.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use condor_host::control::ControlClient;
use condor_host::error::AnyError;
use condor_host::robot::{MotionOutcome, MotionSender};
use condor_host::system::SystemDirectory;
use condor_host::view::{Post, View};
use condor_mbox::Processor;
use condor_mbox::linux::LinuxWindow;
use condor_platform::linux::WholeFile;

use crate::compile::compile_motion;
use crate::motions::MotionsClient;
use crate::objects;
use crate::packet::ClientError;
use crate::queue::{QueueAnswer, RefusalReason, RequestIdentity};

/// The time in which the master must answer a person who waits at a page.
const ANSWER: Duration = Duration::from_secs(5);
/// The prefix of the names of composed motions.
const PREFIX: &str = "view-";
/// The greatest number of composed motions whose outcomes are told.
const REMEMBERED: usize = 32;

/// The queue of the master of a running system.
pub(crate) struct Queue {
    view: View,
    master: Processor,
}

impl Queue {
    /// Finds the master.
    pub(crate) fn find(directory: &SystemDirectory) -> Result<Self, AnyError> {
        let status = ControlClient::connect(directory)?.status()?;
        let mut view = View::open(directory, status.window_bytes)?;
        view.join()?;
        for member in &status.processors {
            let master = Processor(member.number);
            if objects::motions(&view.region(master)?)?.is_some() {
                return Ok(Self { view, master });
            }
        }
        Err(format!(
            "no running processor of `{}` is a master: start the processor of the master",
            status.system
        )
        .into())
    }

    pub(crate) const fn post(&self) -> &Post {
        self.view.post()
    }

    /// Makes the client, of which there may be one at a time.
    pub(crate) fn client(&self) -> Result<MotionsClient<'_, Post, LinuxWindow>, AnyError> {
        let region = self.view.region(self.master)?;
        let blocks = objects::motions(&region)?.ok_or("the program of the master has ended")?;
        Ok(MotionsClient::new(
            self.post(),
            self.master,
            &blocks,
            &region,
        )?)
    }
}

/// Composed motions that are offered to the master, each as a file among the compiled motions.
pub(crate) struct Offers {
    directory: SystemDirectory,
    /// The directory of the compiled motions.
    files: PathBuf,
    joints: Vec<String>,
    /// Found when it is first needed.
    queue: Option<Queue>,
    session: Option<u32>,
    requests: BTreeMap<u64, Request>,
    last: u64,
}

struct Request {
    identity: RequestIdentity,
    /// Its file, which is removed when the master needs it no more.
    file: Option<PathBuf>,
}

impl Offers {
    pub(crate) fn new(directory: &SystemDirectory, files: &Path, joints: Vec<String>) -> Self {
        Self {
            directory: directory.clone(),
            files: files.join("motions"),
            joints,
            queue: None,
            session: None,
            requests: BTreeMap::new(),
            last: 0,
        }
    }

    /// Looks what has become of a motion.
    fn look(&mut self, id: u64) -> Result<MotionOutcome, AnyError> {
        let (Some(request), Some(queue)) = (self.requests.get_mut(&id), &self.queue) else {
            return Err(format!("the master does not know motion {id}, or no longer").into());
        };
        let seen = queue.client()?.look(request.identity, ANSWER)?;
        let (state, reason, is_final) = match seen.answer {
            QueueAnswer::Known(state, reason) => (state.word(), Some(reason), state.is_final()),
            QueueAnswer::New => ("unknown", None, false),
            QueueAnswer::Never => ("refused", None, true),
            QueueAnswer::Forgotten | QueueAnswer::NoSession => ("forgotten", None, true),
        };
        if is_final {
            request.remove();
        }
        let reason = reason.filter(|it| *it != RefusalReason::None);
        Ok(MotionOutcome {
            state: state.into(),
            reason: reason.map(|it| it.to_string()),
            progress: seen.progress,
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
        let image = compile_motion(text, Path::new("motion"), &self.joints)?;
        self.tidy();
        let queue = match self.queue.take() {
            Some(queue) => queue,
            None => Queue::find(&self.directory)?,
        };
        let queue = self.queue.insert(queue);
        let mut client = queue.client()?;
        let number = u32::try_from(self.last + 1)?;
        let mut session = self.session;
        if let Some(own) = session {
            let identity = RequestIdentity {
                session: own,
                number,
            };
            // Other clients may have taken its place, or it is closed.
            session = match client.look(identity, ANSWER)?.answer {
                QueueAnswer::NoSession | QueueAnswer::Never => None,
                _ => Some(own),
            };
        }
        let session = match session {
            Some(session) => session,
            None => client.open(ANSWER)?,
        };
        self.session = Some(session);
        let identity = RequestIdentity { session, number };
        let name = format!("{PREFIX}{session}-{number}");
        let file = self.files.join(format!("{name}.motion"));
        WholeFile::write(&file, &image).map_err(|error| format!("{}: {error}", file.display()))?;
        self.last = number.into();
        let mut request = Request {
            identity,
            file: Some(file),
        };
        if let Err(error) = client.take_control(session, takes_control, ANSWER) {
            request.remove();
            return Err(error.into());
        }
        self.requests.insert(self.last, request);
        let offered = client.offer(identity, name.as_bytes(), ANSWER);
        // An accepted motion runs all the same, and others need not take control away.
        let given_up = client.give_up_control(session, ANSWER);
        let uncertain = |error: ClientError| format!("{error}; the motion may run nevertheless");
        offered.map_err(uncertain)?;
        given_up?;
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
