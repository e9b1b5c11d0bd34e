//! [`System`]: a running system, as a visitor sees it.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use condor_host::control::{ControlClient, ControlRequest};
use condor_host::system::{self, SystemDirectory};
use condor_mbox::Messenger as _;
use pyo3::prelude::*;
use serde_json::json;

use crate::failure::{Failure, seconds};
use crate::motions::{Outcome, Ticket};
use crate::published::Latest;
use crate::system_worker::SystemWorker;
use crate::terminal::Terminal;
use crate::values::{PythonValue, described};
use crate::watch::Watch;

/// The time between two looks for a service.
const LOOK: Duration = Duration::from_millis(20);

/// Returns the names of the running systems of this user.
#[pyfunction]
pub(crate) fn running(py: Python<'_>) -> PyResult<Vec<String>> {
    let running = py.detach(|| system::running().map_err(Failure::from))?;
    Ok(running.iter().map(SystemDirectory::name).collect())
}

/// A running system that this process has joined as a visitor.
#[pyclass(frozen)]
pub(crate) struct System {
    directory: SystemDirectory,
    worker: SystemWorker,
}

#[pymethods]
impl System {
    /// Joins the system called `name`, or that in `directory`; without both, the only system that runs.
    #[new]
    fn new(
        py: Python<'_>,
        name: Option<&str>,
        directory: Option<PathBuf>,
        timeout: f64,
    ) -> PyResult<Self> {
        let timeout = seconds("timeout", timeout)?;
        let joined = py.detach(|| {
            let directory = match directory {
                Some(directory) => SystemDirectory::at(directory),
                None => system::find(name)?,
            };
            let worker = SystemWorker::open(directory.clone(), timeout)?;
            Ok::<_, Failure>(Self { directory, worker })
        });
        Ok(joined?)
    }

    /// Leaves the system.
    fn close(&self, py: Python<'_>) {
        py.detach(|| self.worker.close());
    }

    /// Sends a request to the supervisor, and waits for the answer. Both are JSON.
    fn request(&self, py: Python<'_>, request: &str, timeout: f64) -> PyResult<String> {
        let timeout = seconds("timeout", timeout)?;
        let answer = py.detach(|| {
            let request: ControlRequest = serde_json::from_str(request)?;
            let mut client = ControlClient::connect(&self.directory)?;
            client.set_timeout(Some(timeout.max(Duration::from_millis(1))))?;
            Ok::<_, Failure>(serde_json::to_string(&client.ask(&request)?)?)
        });
        Ok(answer?)
    }

    /// Returns the mailbox, the loops and the vectors of a processor or service, as JSON.
    fn member(&self, py: Python<'_>, processor: String, timeout: f64) -> PyResult<String> {
        self.worker
            .ask(py, seconds("timeout", timeout)?, move |state| {
                let number = state.status.member(&processor)?.processor();
                Ok(serde_json::to_string(&json!({
                    "heart": state.view.heart(number)?,
                    "loops": state.view.loops(number)?.overall(),
                    "vectors": state.view.vectors(number)?,
                }))?)
            })
    }

    /// Returns the present time on the clock of the system, in seconds.
    fn now(&self, py: Python<'_>, timeout: f64) -> PyResult<f64> {
        self.worker.ask(py, seconds("timeout", timeout)?, |state| {
            let now = Duration::from_nanos(state.view.now().as_ns());
            Ok(now.as_secs_f64())
        })
    }

    /// Returns descriptions of the variables, parameters and fields that `patterns` name, as JSON.
    fn variables(&self, py: Python<'_>, patterns: Vec<String>, timeout: f64) -> PyResult<String> {
        self.worker
            .ask(py, seconds("timeout", timeout)?, move |state| {
                let known = state.known()?;
                let chosen = known.matching(&patterns).map_err(Failure::not_found)?;
                let labels = known.labels(&chosen);
                let all = chosen.iter().zip(&labels);
                let all: Vec<_> = all.map(|(one, name)| described(one, name)).collect();
                Ok(serde_json::to_string(&all)?)
            })
    }

    /// Returns the present value of a parameter or of a field of a published cell; `None` for a variable, whose values
    /// are only in rows.
    fn get(&self, py: Python<'_>, name: String, timeout: f64) -> PyResult<Option<PythonValue>> {
        let timeout = seconds("timeout", timeout)?;
        self.worker.ask(py, timeout, move |state| {
            let known = state.known()?;
            let one = known.find(&name).map_err(Failure::not_found)?;
            let value = state.with_clients(timeout, |clients| Ok(clients.value(one)?))?;
            Ok(value.map(|value| PythonValue::of(&one.of, value)))
        })
    }

    /// Sets a parameter to `value`, and returns its previous value. With `expected`, sets it only if it has that value.
    fn set(
        &self,
        py: Python<'_>,
        name: String,
        value: String,
        expected: Option<String>,
        timeout: f64,
    ) -> PyResult<PythonValue> {
        let timeout = seconds("timeout", timeout)?;
        self.worker.ask(py, timeout, move |state| {
            let known = state.known()?;
            known.find(&name).map_err(Failure::not_found)?;
            let one = known.parameter(&name).map_err(Failure::refused)?;
            let parse = |text: &str| one.of.parse(text).map_err(Failure::refused);
            let new = parse(&value)?;
            let from = expected.as_deref().map(parse).transpose()?;
            let before =
                state.with_clients(timeout, |clients| Ok(clients.set(&name, one, from, new)?))?;
            Ok(PythonValue::of(&one.of, before))
        })
    }

    /// Returns the latest value of the published cell `name`, field by field.
    fn published(&self, py: Python<'_>, name: String, timeout: f64) -> PyResult<Latest> {
        self.worker
            .ask(py, seconds("timeout", timeout)?, move |state| {
                state.published(&name)
            })
    }

    /// Begins to read rows of the variables that `patterns` name: one every `every` ticks. Keeps `capacity` rows of
    /// each loop until Python reads them.
    fn watch(
        &self,
        py: Python<'_>,
        patterns: Vec<String>,
        every: u32,
        capacity: usize,
        timeout: f64,
    ) -> PyResult<Watch> {
        let timeout = seconds("timeout", timeout)?;
        if every == 0 || capacity == 0 {
            let text =
                format!("`every` and `capacity` must be 1 or more, not {every} and {capacity}");
            return Err(Failure::refused(text).into());
        }
        self.worker.ask(py, timeout, move |state| {
            let shared = state.watch(&patterns, every, capacity, timeout)?;
            Ok(Watch { shared })
        })
    }

    /// Sends a message with the word `data`. With `replies`, waits for the reply and returns it; otherwise returns
    /// `None`.
    fn send(
        &self,
        py: Python<'_>,
        processor: String,
        vector: String,
        data: u32,
        replies: bool,
        timeout: f64,
    ) -> PyResult<Option<u32>> {
        let timeout = seconds("timeout", timeout)?;
        self.worker.ask(py, timeout, move |state| {
            let member = state.status.member(&processor)?;
            let to = member.processor();
            let vector = state.view.vector(member, &vector)?;
            let post = state.view.post();
            if replies {
                return Ok(Some(post.send_with_reply(to, vector, data, timeout)?));
            }
            post.send(to, vector, data, timeout)?;
            Ok(None)
        })
    }

    /// Enqueues a motion. `motions` is the name of a motion file, or the bytes of compiled motions.
    fn enqueue(
        &self,
        py: Python<'_>,
        motions: Vec<u8>,
        takes_control: bool,
        timeout: f64,
    ) -> PyResult<Ticket> {
        let timeout = seconds("timeout", timeout)?;
        self.worker.ask(py, timeout, move |state| {
            state.enqueue(&motions, takes_control, timeout)
        })
    }

    /// Returns the present state of an enqueued motion.
    fn outcome(&self, py: Python<'_>, motion: Ticket, timeout: f64) -> PyResult<Outcome> {
        let timeout = seconds("timeout", timeout)?;
        self.worker
            .ask(py, timeout, move |state| state.outcome(motion, timeout))
    }

    /// Ends the motion that runs, and all that wait. If another program is in control of the robot, this needs
    /// `takes_control`.
    fn abort(&self, py: Python<'_>, takes_control: bool, timeout: f64) -> PyResult<()> {
        let timeout = seconds("timeout", timeout)?;
        self.worker.ask(py, timeout, move |state| {
            state.abort(takes_control, timeout)
        })
    }

    /// Opens the terminal of a processor. While the terminal service is not ready for it, tries again for `timeout`.
    fn terminal(&self, py: Python<'_>, processor: String, timeout: f64) -> PyResult<Terminal> {
        let timeout = seconds("timeout", timeout)?;
        let begun = Instant::now();
        let name = self.worker.ask(py, timeout, move |state| {
            Ok(state.status.processor(&processor)?.name.clone())
        })?;
        loop {
            match Terminal::open(self.directory.clone(), name.clone()) {
                Err(_) if begun.elapsed() < timeout => {
                    py.detach(|| std::thread::sleep(LOOK));
                    py.check_signals()?;
                }
                opened => return Ok(opened?),
            }
        }
    }
}
