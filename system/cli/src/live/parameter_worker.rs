//! [`ParameterWorker`]: a thread that asks the programs for parameters, so that rows never wait for an answer.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::Scope;
use std::time::{Duration, Instant};

use condor_mbox::exchange::ExchangeError;
use condor_vars::{AnyValue, RequestError, ValueKind};
use serde_json::Value as Json;

use super::protocol::Parameter;
use super::session::Ask;
use condor_host::control::Member;
use condor_host::error::AnyError;
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_host::watching::{CatalogEntry, Clients, Type, VariableCatalog};

/// The time between two looks whether others have set parameters.
const LOOK: Duration = Duration::from_millis(250);
/// The time for which a processor that has not answered is left alone.
const SILENCE: Duration = Duration::from_secs(5);

/// A message to the thread.
enum Order {
    /// Answers a client.
    Ask { client: u64, ask: Ask },
    /// Tells changes of these parameters from now on.
    Watch(BTreeSet<usize>),
}

/// A message from the thread.
pub(super) enum WorkerMessage {
    Answer {
        client: u64,
        parameters: Vec<Parameter>,
        id: Option<String>,
        troubles: Vec<String>,
    },
    Changed {
        place: usize,
        parameter: Parameter,
    },
}

/// The way to the thread, which ends when this is dropped.
pub(super) struct ParameterWorker {
    orders: Sender<Order>,
    messages: Receiver<WorkerMessage>,
    /// Whether it has a question that is not answered yet.
    is_asked: bool,
    /// Ends the thread before its next parameter.
    is_over: Arc<AtomicBool>,
}

impl ParameterWorker {
    /// Starts the thread. `names` are the parameters of the processors `members`; `directory` is that
    /// of the system, in which the thread is a visitor of its own.
    pub(super) fn open<'scope>(
        scope: &'scope Scope<'scope, '_>,
        directory: SystemDirectory,
        window_bytes: u32,
        members: Vec<Member>,
        names: Vec<String>,
    ) -> Result<Self, AnyError> {
        let (orders, received) = channel();
        let (teller, messages) = channel();
        let (opener, ready) = channel();
        let is_over = Arc::new(AtomicBool::new(false));
        let ends = is_over.clone();
        scope.spawn(move || {
            let view = View::open(&directory, window_bytes);
            let view = view.and_then(|mut view| view.join().map(drop).map(|()| view));
            let view = match view {
                Ok(view) => view,
                Err(error) => {
                    let _ = opener.send(Err(error.to_string()));
                    return;
                }
            };
            // The other end waits for it.
            let _ = opener.send(Ok(()));
            let mut clerk = Clerk {
                view: &view,
                clients: Clients::new(&view),
                members,
                names,
                watched: BTreeSet::new(),
                last: BTreeMap::new(),
                silent: BTreeMap::new(),
                ends,
                teller,
            };
            clerk.work(&received);
        });
        ready.recv()??;
        Ok(Self {
            orders,
            messages,
            is_asked: false,
            is_over,
        })
    }

    /// Returns whether all questions are answered. The next one waits with its client, so that it
    /// goes when the client does.
    pub(super) const fn is_free(&self) -> bool {
        !self.is_asked
    }

    pub(super) fn ask(&mut self, client: u64, ask: Ask) {
        self.is_asked = true;
        self.order(Order::Ask { client, ask });
    }

    /// Sets the places of the parameters of which changes are told.
    pub(super) fn watch(&self, places: BTreeSet<usize>) {
        self.order(Order::Watch(places));
    }

    fn order(&self, order: Order) {
        // The thread receives as long as `self` exists.
        let _ = self.orders.send(order);
    }

    /// Returns what the thread has told since the last call.
    pub(super) fn messages(&mut self) -> impl Iterator<Item = WorkerMessage> {
        let is_asked = &mut self.is_asked;
        let messages = self.messages.try_iter();
        messages.inspect(|message| *is_asked &= !matches!(message, WorkerMessage::Answer { .. }))
    }
}

impl Drop for ParameterWorker {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

/// The thread.
struct Clerk<'v> {
    view: &'v View,
    clients: Clients<'v>,
    members: Vec<Member>,
    /// The names of the parameters, each of which no other has.
    names: Vec<String>,
    watched: BTreeSet<usize>,
    /// The values that were seen last.
    last: BTreeMap<usize, AnyValue>,
    /// Processors that did not answer, and when.
    silent: BTreeMap<u8, Instant>,
    ends: Arc<AtomicBool>,
    teller: Sender<WorkerMessage>,
}

impl Clerk<'_> {
    fn work(&mut self, orders: &Receiver<Order>) {
        let mut looked = Instant::now();
        while !self.is_over() {
            if looked.elapsed() >= LOOK {
                self.look();
                looked = Instant::now();
            }
            let left = LOOK.saturating_sub(looked.elapsed());
            match orders.recv_timeout(left) {
                Ok(Order::Ask { client, ask }) => self.answer(client, ask),
                Ok(Order::Watch(places)) => self.watched = places,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    /// Reads all tables: programs may have been restarted since the last time.
    fn known(&self) -> Result<VariableCatalog, String> {
        VariableCatalog::all(self.view, &self.members).map_err(|error| error.to_string())
    }

    fn answer(&mut self, client: u64, ask: Ask) {
        let (parameters, id, troubles) = match ask {
            Ask::Get { wanted, id } => {
                let (parameters, troubles) = self.get(wanted);
                (parameters, id, troubles)
            }
            Ask::Set { wanted, id } => {
                let mut troubles = self.set(&wanted);
                let wanted = wanted.into_iter().map(|(name, place, _)| (name, place));
                // Whether that succeeded or not, the client gets the present values.
                let (parameters, more) = self.get(wanted);
                troubles.extend(more);
                (parameters, id, troubles)
            }
        };
        self.tell(WorkerMessage::Answer {
            client,
            parameters,
            id,
            troubles,
        });
    }

    fn tell(&self, message: WorkerMessage) {
        // Nobody listens any more at the end.
        let _ = self.teller.send(message);
    }

    /// Gets values; says which it cannot get.
    fn get(
        &mut self,
        wanted: impl IntoIterator<Item = (String, usize)>,
    ) -> (Vec<Parameter>, Vec<String>) {
        let known = match self.known() {
            Ok(known) => known,
            Err(trouble) => return (Vec::new(), vec![trouble]),
        };
        let (mut parameters, mut troubles) = (Vec::new(), Vec::new());
        for (name, place) in wanted {
            if self.is_over() {
                break;
            }
            match self.value(&known, place) {
                Ok(value) => parameters.push(Parameter { name, ..value }),
                Err(trouble) => troubles.push(format!("`{name}`: {trouble}")),
            }
        }
        (parameters, troubles)
    }

    /// Returns the present value of a parameter, and tells whether it has changed.
    fn value(&mut self, known: &VariableCatalog, place: usize) -> Result<Parameter, String> {
        let one = self.find(known, place)?;
        let number = one.member.number;
        self.check(one)?;
        let value = self.clients.value(one);
        let value = value.map_err(|error| self.failed(number, &error))?;
        self.silent.remove(&number);
        let value = value.ok_or_else(|| "it is not a parameter any more".to_owned())?;
        let is_float = matches!(one.of.kind, ValueKind::F32 | ValueKind::F64);
        let parameter = Parameter {
            name: String::new(),
            // JSON has no infinity.
            value: Some(one.of.json(value)).filter(|json| !json.is_null()),
            kind: is_float.then(|| "float64".to_owned()),
        };
        let before = self.last.insert(place, value);
        if before.is_some_and(|before| before != value) {
            let parameter = parameter.clone();
            self.tell(WorkerMessage::Changed { place, parameter });
        }
        Ok(parameter)
    }

    /// Refuses to ask a processor that has not answered a short time ago.
    fn check(&self, one: &CatalogEntry) -> Result<(), String> {
        let since = self.silent.get(&one.member.number);
        if since.is_some_and(|since| since.elapsed() < SILENCE) {
            return Err(format!("{} has not answered", one.member.name));
        }
        Ok(())
    }

    /// Returns the text of an error, and notes that the processor is silent if that is the error.
    fn failed(&mut self, number: u8, error: &AnyError) -> String {
        if is_silence(error) {
            self.silent.insert(number, Instant::now());
        }
        error.to_string()
    }

    fn is_over(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }

    fn find<'k>(
        &self,
        known: &'k VariableCatalog,
        place: usize,
    ) -> Result<&'k CatalogEntry, String> {
        let name = self.names.get(place).map(String::as_str);
        known.find(name.unwrap_or_default())
    }

    /// Sets values; says which it cannot set.
    fn set(&mut self, wanted: &[(String, usize, Option<Json>)]) -> Vec<String> {
        let known = match self.known() {
            Ok(known) => known,
            Err(trouble) => return vec![trouble],
        };
        let mut troubles = Vec::new();
        for (name, place, value) in wanted {
            if self.is_over() {
                break;
            }
            let Some(value) = value else { continue };
            let one = self.find(&known, *place);
            let set = one.and_then(|one| {
                let new = parse(&one.of, value)?;
                self.check(one)?;
                let set = self.clients.set(name, one, None, new);
                set.map_err(|error| self.failed(one.member.number, &error))
            });
            troubles.extend(set.err());
        }
        troubles
    }

    /// Looks whether watched parameters have changed.
    fn look(&mut self) {
        if self.watched.is_empty() {
            return;
        }
        // The programs may be about to start; the next look tells.
        let Ok(known) = self.known() else { return };
        for place in self.watched.clone() {
            if self.is_over() {
                return;
            }
            // Nobody has asked.
            let _ = self.value(&known, place);
        }
    }
}

/// Returns whether a processor did not answer in time.
fn is_silence(error: &AnyError) -> bool {
    use condor_mbox::MailboxError::{Stalled, TimedOut};
    let Some(error) = error.downcast_ref() else {
        return false;
    };
    matches!(
        error,
        RequestError::Busy { .. }
            | RequestError::Exchange(
                ExchangeError::InDoubt | ExchangeError::Mailbox(TimedOut { .. } | Stalled { .. })
            )
    )
}

/// Reads a value of JSON. A text is the label of a choice.
fn parse(of: &Type, value: &Json) -> Result<AnyValue, String> {
    match value {
        Json::String(label) if of.kind == ValueKind::Choice => of.parse(label),
        value => of.parse(&value.to_string()),
    }
}
