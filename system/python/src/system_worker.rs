//! [`SystemWorker`]: the thread that visits a system. It reads what is watched, so that no row waits for Python.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use condor_host::control::{ControlClient, SystemStatus};
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_host::watching::{Clients, Rows, VariableCatalog};
use condor_mbox::Messenger as _;
use condor_robot::host::QueueSession;
use pyo3::prelude::*;

use crate::failure::Failure;
use crate::watch::{SLICE, WatchState};

/// The time between two looks for rows.
const LOOK: Duration = Duration::from_millis(5);
/// The time between two looks for messages while nothing is watched.
const BEAT: Duration = Duration::from_millis(250);
/// The time that an answer may take beyond its own waits: other threads may have asked before.
const PATIENCE: Duration = Duration::from_secs(15);

type Job = Box<dyn for<'s, 'v> FnOnce(&'s mut WorkerState<'v>) + Send>;

/// A handle of the thread that visits a system. The thread ends when this value is closed or dropped.
pub(crate) struct SystemWorker {
    jobs: Mutex<Option<Sender<Job>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// The state of the thread that visits a system, which jobs from Python use.
pub(crate) struct WorkerState<'v> {
    pub(crate) status: SystemStatus,
    pub(crate) view: &'v View,
    pub(crate) session: QueueSession,
    watches: Vec<(Arc<WatchState>, Rows<'v>)>,
    /// Clients that are not in use. They are kept because each has blocks of the visitor's memory that are never
    /// returned.
    spare: Vec<Clients<'v>>,
}

impl SystemWorker {
    /// Starts the thread, and waits until it has joined the system.
    pub(crate) fn open(directory: SystemDirectory, timeout: Duration) -> Result<Self, Failure> {
        let mut client = ControlClient::connect(&directory)?;
        client.set_timeout(Some(timeout.max(Duration::from_millis(1))))?;
        let status = client.status()?;
        let (jobs, received) = channel();
        let (teller, opened) = channel();
        let thread = std::thread::spawn(move || {
            let view = View::open(&directory, status.window_bytes);
            let joined = view.and_then(|mut view| view.join().map(drop).map(|()| view));
            match joined {
                // Nobody may wait any more, in both cases.
                Err(error) => drop(teller.send(Err(error.into()))),
                Ok(view) => {
                    let _ = teller.send(Ok(()));
                    WorkerState::new(status, &view).work(&received);
                }
            }
        });
        let ready = opened.recv_timeout(timeout.max(LOOK));
        ready.unwrap_or_else(|_| {
            let after = timeout.as_secs_f64();
            Err(Failure::timed_out(format!(
                "the system could not be joined within {after} s"
            )))
        })?;
        Ok(Self {
            jobs: Mutex::new(Some(jobs)),
            thread: Mutex::new(Some(thread)),
        })
    }

    /// Has the thread run a job that takes `timeout` at most, and waits for its result. Other threads of Python run
    /// meanwhile.
    pub(crate) fn ask<T: Send + 'static>(
        &self,
        py: Python<'_>,
        timeout: Duration,
        job: impl FnOnce(&mut WorkerState<'_>) -> Result<T, Failure> + Send + 'static,
    ) -> PyResult<T> {
        let (answer, answered) = channel();
        let job: Job = Box::new(move |state| {
            // The thread that asked may have been interrupted.
            let _ = answer.send(job(state));
        });
        let sent = match &*self.jobs.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(jobs) => jobs.send(job).is_ok(),
            None => {
                return Err(Failure::new_other("the connection to the system was closed").into());
            }
        };
        if !sent {
            return Err(Failure::new_other(ENDED).into());
        }
        let begun = Instant::now();
        let mut answered = answered;
        loop {
            let (back, got) = py.detach(move || {
                let got = answered.recv_timeout(SLICE);
                (answered, got)
            });
            answered = back;
            match got {
                Ok(answer) => return Ok(answer?),
                Err(RecvTimeoutError::Disconnected) => return Err(Failure::new_other(ENDED).into()),
                Err(RecvTimeoutError::Timeout) if begun.elapsed() > timeout + PATIENCE => {
                    let after = begun.elapsed().as_secs();
                    let text = format!("the system did not answer within {after} s");
                    return Err(Failure::timed_out(text).into());
                }
                Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            }
        }
    }

    /// Leaves the system, and ends the thread.
    pub(crate) fn close(&self) {
        drop(take(&self.jobs));
        if let Some(thread) = take(&self.thread) {
            // A panic was told on standard error.
            let _ = thread.join();
        }
    }
}

const ENDED: &str = "the thread that exchanges messages with the system has ended";

fn take<T>(from: &Mutex<Option<T>>) -> Option<T> {
    from.lock().unwrap_or_else(PoisonError::into_inner).take()
}

impl Failure {
    pub(crate) fn new_other(text: impl Into<String>) -> Self {
        Self::new(crate::failure::Kind::Other, text)
    }
}

impl Drop for SystemWorker {
    fn drop(&mut self) {
        // The thread ends by itself: nobody waits for it here, since this may have the GIL.
        drop(take(&self.jobs));
    }
}

impl<'v> WorkerState<'v> {
    fn new(status: SystemStatus, view: &'v View) -> Self {
        Self {
            status,
            view,
            session: QueueSession::default(),
            watches: Vec::new(),
            spare: Vec::new(),
        }
    }

    fn work(mut self, jobs: &Receiver<Job>) {
        loop {
            let pause = if self.watches.is_empty() { BEAT } else { LOOK };
            match jobs.recv_timeout(pause) {
                Ok(job) => job(&mut self),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            // If something is wrong, the next request says so.
            let _ = self.view.post().serve(Duration::ZERO);
            for (shared, rows) in &mut self.watches {
                shared.fill(rows);
            }
            self.tidy();
        }
    }

    /// Reads the names of all variables that the system has now.
    pub(crate) fn known(&self) -> Result<VariableCatalog, Failure> {
        Ok(VariableCatalog::all(self.view, &self.status.processors)?)
    }

    /// Stops reading the rows that Python does not want any more, so that their slots are free.
    fn tidy(&mut self) {
        let ended = |(shared, _): &mut (Arc<WatchState>, Rows<'v>)| shared.is_closed();
        let ended: Vec<_> = self.watches.extract_if(.., ended).collect();
        self.spare
            .extend(ended.into_iter().map(|(_, rows)| rows.end()));
    }

    /// Calls `work` with clients that wait for an answer for `timeout` at most.
    pub(crate) fn with_clients<T>(
        &mut self,
        timeout: Duration,
        work: impl FnOnce(&mut Clients<'v>) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let mut clients = self.clients(timeout);
        let done = work(&mut clients);
        self.spare.push(clients);
        done
    }

    fn clients(&mut self, timeout: Duration) -> Clients<'v> {
        let spare = self.spare.pop();
        let mut clients = spare.unwrap_or_else(|| Clients::new(self.view));
        clients.set_timeout(timeout);
        clients
    }

    /// Begins to read the rows of the variables that `patterns` name, one every `every` ticks, until the result is
    /// closed. Keeps up to `most` rows of each loop for Python.
    pub(crate) fn watch(
        &mut self,
        patterns: &[String],
        every: u32,
        most: usize,
        timeout: Duration,
    ) -> Result<Arc<WatchState>, Failure> {
        let known = self.known()?;
        let columns = known.matching(patterns).map_err(Failure::not_found)?;
        let labels = known.labels(&columns);
        self.tidy();
        let rows = Rows::with(self.clients(timeout), &columns, every)?;
        let shared = Arc::new(WatchState::new(&rows, &columns, &labels, most));
        self.watches.push((shared.clone(), rows));
        Ok(shared)
    }
}
