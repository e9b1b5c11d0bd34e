//! [`Orders`]: requests of processors to the supervisor. They come as messages; the supervisor carries
//! them out each time before it looks at its members.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use condor_mbox::exchange::answer;
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Call, Processor, Region, Windows};
use condor_rt::numbers::PROCESSORS;
use condor_rt::supervisor::{self as wire, SupervisorResponse, operation, state};

use super::Supervisor;
use super::requests::Asker;
use crate::control::ControlRequest;
use crate::description::{MayAsk, ProcessorEntry, ProgramEntry, SystemDescription};
use crate::paths::{beside, find_program};

/// The requests of processors. Each processor has the outcome of its latest request alone, so what
/// it sends takes no more room.
pub(super) struct Orders<'d> {
    /// The file of the description, and the processors there.
    file: &'d Path,
    processors: &'d [ProcessorEntry],
    /// The users' region of each processor, in which its request lies.
    data: Vec<Option<Region<LinuxWindow>>>,
    latest: Mutex<[Latest; PROCESSORS]>,
}

/// The latest request of a processor.
#[derive(Default)]
struct Latest {
    number: u32,
    stage: Stage,
}

/// The stage that a request has reached.
#[derive(Default)]
enum Stage {
    /// There was none.
    #[default]
    None,
    /// The request waits for the supervisor's turn.
    Asked(ControlRequest),
    Begun,
    Done,
    Failed(String),
}

impl<'d> Orders<'d> {
    pub(super) fn new(
        description: &'d SystemDescription,
        windows: &[Windows<LinuxWindow>],
    ) -> Self {
        let data = windows
            .iter()
            .map(|windows| Region::users(windows.data.clone()).ok());
        Self {
            file: &description.file,
            processors: &description.processors,
            data: data.collect(),
            latest: Mutex::default(),
        }
    }

    /// Does all the work of the handler: it copies a request out of the sender's memory, and notes
    /// it if the description allows it.
    pub(super) fn receive(&self, call: &Call<'_>) -> u32 {
        let sender = call.sender();
        let data = self.data.get(sender.index());
        let data = data.and_then(Option::as_ref);
        data.map_or(0, |data| {
            answer(call, data, |request| self.respond(sender, &request))
        })
    }

    fn respond(&self, sender: Processor, request: &wire::SupervisorRequest) -> SupervisorResponse {
        if request.operation == operation::NAME {
            let mut processors = self.processors.iter();
            let entry = processors.find(|entry| u32::from(entry.number) == request.number);
            let state = entry.map_or(state::UNKNOWN, |_| state::DONE);
            let name = entry.map_or("", |entry| entry.name.as_str());
            return SupervisorResponse::new(state, request.number, name);
        }
        let mut latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(latest) = latest.get_mut(sender.index()) else {
            return SupervisorResponse::new(state::UNKNOWN, 0, "");
        };
        if request.operation == operation::OUTCOME {
            if latest.number != request.number {
                return SupervisorResponse::new(state::UNKNOWN, request.number, "");
            }
            let (state, text) = match &latest.stage {
                Stage::None => (state::UNKNOWN, ""),
                Stage::Asked(_) | Stage::Begun => (state::PENDING, ""),
                Stage::Done => (state::DONE, ""),
                Stage::Failed(error) => (state::REFUSED, error.as_str()),
            };
            return SupervisorResponse::new(state, request.number, text);
        }
        match self.read(sender, request) {
            Err(error) => SupervisorResponse::new(state::REFUSED, 0, &error),
            Ok(_) if matches!(latest.stage, Stage::Asked(_)) => SupervisorResponse::new(
                state::REFUSED,
                0,
                "the request before this one has not begun",
            ),
            Ok(request) => {
                latest.number = latest.number.wrapping_add(1);
                latest.stage = Stage::Asked(request);
                SupervisorResponse::new(state::PENDING, latest.number, "")
            }
        }
    }

    /// Returns what is asked, if it can be understood and the description allows it.
    fn read(
        &self,
        sender: Processor,
        request: &wire::SupervisorRequest,
    ) -> Result<ControlRequest, String> {
        let operation = match request.operation {
            operation::RESTART => MayAsk::Restart,
            operation::LOAD => MayAsk::Load,
            other => return Err(format!("there is no request with the number {other}")),
        };
        let mut processors = self.processors.iter();
        let entry = processors.find(|entry| entry.number == sender.0);
        if !entry.is_some_and(|entry| entry.may_ask.contains(&operation)) {
            let name = entry.map_or_else(|| sender.to_string(), |it| format!("`{}`", it.name));
            return Err(format!(
                "the description does not let {name} ask for a {operation}: \
                 its processor needs `may_ask = [\"{operation}\"]`"
            ));
        }
        let mut words = request.words().into_iter().flatten().map(String::from);
        let (processor, program) = (words.next(), words.next());
        let arguments: Vec<_> = words.collect();
        let processor = processor.ok_or("the request names no processor")?;
        match (operation, program) {
            (MayAsk::Restart, None) => Ok(ControlRequest::Restart {
                processor,
                held: false,
            }),
            (MayAsk::Load, Some(word)) => {
                let program = self.named(&word).ok_or_else(|| {
                    format!(
                        "a processor may load `self` and the programs that the description names, \
                         not `{word}`; the command `load` may"
                    )
                })?;
                Ok(ControlRequest::Load {
                    processor,
                    program,
                    arguments,
                })
            }
            (MayAsk::Restart, Some(word)) => Err(format!("`{word}` is one word too many")),
            (MayAsk::Load, None) => Err("the request names no program".into()),
        }
    }

    /// Returns the program of the description that `word` names, by its path or by the name of its file. A processor
    /// gets no other file of the host to run.
    fn named(&self, word: &str) -> Option<String> {
        if word == "self" {
            return Some(word.to_owned());
        }
        let beside = beside(self.file, word);
        let found = [Some(beside), find_program(self.file, word).ok()];
        let files = self.processors.iter().filter_map(|it| match &it.program {
            ProgramEntry::File(path) => Some(path),
            ProgramEntry::Own => None,
        });
        let mut exact = files.clone();
        let exact = exact.find(|path| found.iter().flatten().any(|it| it == *path));
        let mut alike = files.filter(|path| path.file_name().is_some_and(|name| name == word));
        // A name that two programs have says neither.
        let alike = || {
            let first = alike.next()?;
            alike.all(|other| other == first).then_some(first)
        };
        Some(exact.or_else(alike)?.to_str()?.to_owned())
    }

    /// Returns a request that has not begun, and notes that it begins.
    fn next(&self) -> Option<(Asker, ControlRequest)> {
        let mut latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        for (sender, latest) in (0..).zip(latest.iter_mut()) {
            match core::mem::replace(&mut latest.stage, Stage::Begun) {
                Stage::Asked(request) => {
                    let order = latest.number;
                    let number = Processor(sender);
                    return Some((Asker::Processor { number, order }, request));
                }
                other => latest.stage = other,
            }
        }
        None
    }

    /// Notes the outcome of the request `order` of `asker`, unless a later one has taken its place.
    pub(super) fn finish(&self, asker: Processor, order: u32, outcome: Result<(), String>) {
        let mut latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        let latest = latest.get_mut(asker.index());
        if let Some(latest) = latest.filter(|latest| latest.number == order) {
            latest.stage = match outcome {
                Ok(()) => Stage::Done,
                Err(error) => Stage::Failed(error),
            };
        }
    }
}

impl Supervisor<'_> {
    /// Begins what processors have asked for since the last turn.
    pub(super) fn carry_out_orders(&mut self) {
        while let Some((asker, request)) = self.orders.next() {
            self.request(asker, request);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::application::Programs;

    /// Of the processors, `boss` may restart and load, `nurse` may restart, and `rest` nothing.
    fn description() -> SystemDescription {
        let this = std::env::current_exe().unwrap();
        let processor = |number: u8, name: &str, may: &str| {
            format!(
                "[[processors]]\nnumber = {number}\nname = \"{name}\"\nprogram = {this:?}\n{may}\n"
            )
        };
        let text = [
            "name = \"tested\"\nwindow_bytes = 4096\n".to_owned(),
            processor(0, "boss", "may_ask = [\"restart\", \"load\"]"),
            processor(1, "nurse", "may_ask = [\"restart\"]"),
            processor(2, "rest", ""),
        ];
        SystemDescription::from_toml(
            &text.concat(),
            Path::new("/x/tested.toml"),
            &Programs::default(),
        )
        .unwrap()
    }

    fn ask<'w>(
        orders: &Orders<'_>,
        from: u8,
        operation: u32,
        words: impl IntoIterator<Item = &'w str>,
    ) -> SupervisorResponse {
        let request = wire::SupervisorRequest::new(operation, 0, words).unwrap();
        orders.respond(Processor(from), &request)
    }

    fn outcome(orders: &Orders<'_>, from: u8, number: u32) -> SupervisorResponse {
        let request = wire::SupervisorRequest::new(operation::OUTCOME, number, []).unwrap();
        orders.respond(Processor(from), &request)
    }

    #[test]
    fn what_the_description_does_not_allow_is_refused() {
        let description = description();
        let orders = Orders::new(&description, &[]);
        let this = std::env::current_exe().unwrap();
        let this = this.to_str().unwrap();
        for (from, operation, words, why) in [
            (
                2,
                operation::RESTART,
                vec!["boss"],
                "`rest` ask for a restart",
            ),
            (
                1,
                operation::LOAD,
                vec!["boss", this],
                "`nurse` ask for a load",
            ),
            (20, operation::RESTART, vec!["boss"], "processor 20 ask for"),
            (0, operation::LOAD, vec!["rest", "/bin/sh"], "not `/bin/sh`"),
            (0, operation::LOAD, vec!["rest", "sh"], "not `sh`"),
            (0, operation::LOAD, vec!["rest"], "no program"),
            (
                0,
                operation::RESTART,
                vec!["rest", "x"],
                "`x` is one word too many",
            ),
            (0, operation::RESTART, vec![], "no processor"),
            (0, 77, vec!["rest"], "the number 77"),
        ] {
            let response = ask(&orders, from, operation, words);
            assert_eq!(response.state, state::REFUSED, "{why}");
            assert!(response.text().contains(why), "{}", response.text());
        }
        assert!(orders.next().is_none());
        let loaded = ask(&orders, 0, operation::LOAD, ["rest", this, "fast"]);
        assert_eq!((loaded.state, loaded.number), (state::PENDING, 1));
        let (_, name) = this.rsplit_once('/').unwrap();
        let asked = orders.next().map(|(_, asked)| asked);
        let named = ask(&orders, 0, operation::LOAD, ["rest", name, "fast"]);
        assert_eq!((named.state, named.number), (state::PENDING, 2));
        let restarted = ask(&orders, 1, operation::RESTART, ["files"]);
        assert_eq!((restarted.state, restarted.number), (state::PENDING, 1));
        let begun: Vec<_> = core::iter::from_fn(|| orders.next()).collect();
        assert_eq!(begun.len(), 2);
        for asked in [asked.as_ref(), Some(&begun[0].1)] {
            assert!(matches!(
                asked,
                Some(ControlRequest::Load { processor, program, arguments })
                    if processor == "rest" && program == this && *arguments == ["fast"]
            ));
        }
    }

    #[test]
    fn each_processor_knows_the_outcome_of_its_latest_request() {
        let description = description();
        let orders = Orders::new(&description, &[]);
        assert_eq!(outcome(&orders, 1, 0).state, state::UNKNOWN);
        let first = ask(&orders, 1, operation::RESTART, ["rest"]).number;
        let soon = ask(&orders, 1, operation::RESTART, ["rest"]);
        assert_eq!(soon.state, state::REFUSED, "the first has not begun");
        assert!(orders.next().is_some());
        assert_eq!(outcome(&orders, 1, first).state, state::PENDING);
        assert_eq!(outcome(&orders, 0, first).state, state::UNKNOWN);
        let second = ask(&orders, 1, operation::RESTART, ["rest"]).number;
        assert!(orders.next().is_some());
        orders.finish(Processor(1), first, Ok(()));
        assert_eq!(outcome(&orders, 1, first).state, state::UNKNOWN);
        assert_eq!(outcome(&orders, 1, second).state, state::PENDING);
        orders.finish(Processor(1), second, Err("it fails".into()));
        let failed = outcome(&orders, 1, second);
        assert_eq!((failed.state, failed.text()), (state::REFUSED, "it fails"));
        assert_eq!(outcome(&orders, 31, 0).state, state::UNKNOWN);
        assert_eq!(outcome(&orders, 200, 0).state, state::UNKNOWN);
    }

    #[test]
    fn whatever_lies_in_the_block_is_answered() {
        let description = description();
        let orders = Orders::new(&description, &[]);
        let mut bits = 1_u32;
        for round in 0..100_000_u32 {
            let mut request = wire::SupervisorRequest::new(operation::LOAD, 0, []).unwrap();
            let mut random = || {
                bits ^= bits << 13;
                bits ^= bits >> 17;
                bits ^= bits << 5;
                bits
            };
            request.operation = random() % 5;
            request.number = random() % 3;
            request.len = if round % 3 == 0 {
                random()
            } else {
                random() % 370
            };
            let printed = round % 2 == 0;
            for byte in &mut request.words {
                let [any, ..] = random().to_le_bytes();
                *byte = if printed {
                    b"a\0sel-f/."[usize::from(any) % 9]
                } else {
                    any
                };
            }
            let from = (random() % 256) as u8;
            let response = orders.respond(Processor(from), &request);
            assert!(matches!(response.state, state::PENDING..=state::UNKNOWN));
            assert!(response.state != state::PENDING || from < 2, "{from}");
            if round % 7 == 0 {
                while orders.next().is_some() {}
            }
        }
    }
}
