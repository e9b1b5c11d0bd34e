//! The requests that others make of the supervisor.

use condor_mbox::Processor;

use super::member::{Member, NextStep, Phase};
use super::time::Change;
use super::{Supervisor, plan};
use crate::control::server::From;
use crate::control::{ControlAnswer, ControlRequest, MemberState};
use crate::error::me;

/// A request that is answered when it has been carried out.
pub(super) struct Promise {
    to: Asker,
    /// Which of the members.
    member: usize,
    what: Wish,
}

/// The client or processor that gets the answer to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asker {
    Client(From),
    /// A processor, with the number of its request.
    Processor {
        number: Processor,
        order: u32,
    },
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Wish {
    Runs,
    /// The program waits for a debugger before it runs.
    Held,
    Ended,
}

impl Supervisor<'_> {
    pub(super) fn request(&mut self, from: Asker, request: ControlRequest) {
        let answer = match request {
            ControlRequest::Status {} => Ok(Some(ControlAnswer {
                status: Some(self.status()),
                ..done()
            })),
            ControlRequest::Log { lines } => {
                let lines = self.journal.last_lines(lines);
                lines.map_err(|error| error.to_string()).map(|lines| {
                    Some(ControlAnswer {
                        lines: Some(lines),
                        ..done()
                    })
                })
            }
            ControlRequest::Events {} => {
                if let Asker::Client(client) = from {
                    self.server.follow(client);
                }
                Ok(Some(done()))
            }
            ControlRequest::Down {} => {
                self.go_down("a request");
                self.down_asked_by.push(from);
                Ok(None)
            }
            ControlRequest::Pause {} => self.change_clock(&Change::Pause),
            ControlRequest::Step { ns } => self.change_clock(&Change::Step { ns }),
            ControlRequest::Resume {} => self.change_clock(&Change::Resume),
            ControlRequest::Speed { thousandths } => {
                self.change_clock(&Change::Speed { thousandths })
            }
            _ if self.down.is_some() => {
                Err("the system is going down, so this was not done".to_owned())
            }
            ControlRequest::Stop { processor } => self.stop(from, &processor),
            ControlRequest::Start { processor } => self.start(from, &processor),
            ControlRequest::Restart { processor, held } => self.restart(from, &processor, held),
            ControlRequest::Load {
                processor,
                program,
                arguments,
            } => self.load(from, &processor, program, arguments, false),
        };
        match answer {
            Ok(Some(answer)) => self.answer(from, answer),
            // The request is answered later.
            Ok(None) => {}
            Err(error) => self.answer(from, refused(error)),
        }
    }

    /// Tells all who asked for it that the system has ended, and which programs were killed.
    pub(super) fn answer_down(&mut self, killed: &[String]) {
        for asker in core::mem::take(&mut self.down_asked_by) {
            let killed = killed.to_vec();
            self.answer(asker, ControlAnswer { killed, ..done() });
        }
    }

    fn answer(&mut self, to: Asker, answer: ControlAnswer) {
        match to {
            Asker::Client(client) => self.server.answer(client, &answer),
            Asker::Processor { number, order } => {
                let outcome = answer.error.map_or(Ok(()), Err);
                self.orders.finish(number, order, outcome);
            }
        }
    }

    fn change_clock(&self, change: &Change) -> Result<Option<ControlAnswer>, String> {
        if self.down.is_some() {
            return Err("the system is going down, so the clock was not changed".into());
        }
        if !self.is_up {
            return Err("time has not begun: not all programs run yet".into());
        }
        let changed = self.mailbox.change_clock(change, self.options.duration);
        changed.map(|()| Some(done()))
    }

    fn find(&self, wanted: &str) -> Result<usize, String> {
        let is_it = |member: &Member| {
            member.plan.name == wanted || member.plan.number.0.to_string() == wanted
        };
        self.members.iter().position(is_it).ok_or_else(|| {
            let names: Vec<_> = self
                .members
                .iter()
                .map(|member| member.plan.name.as_str())
                .collect();
            format!(
                "there is no processor or service `{wanted}`; there are {}",
                names.join(", ")
            )
        })
    }

    fn promise(&mut self, to: Asker, member: usize, what: Wish) {
        if let Asker::Processor { number, .. } = to {
            // Nobody waits for its former request any more.
            self.promises.retain(
                |it| !matches!(it.to, Asker::Processor { number: asker, .. } if asker == number),
            );
        }
        self.promises.push(Promise { to, member, what });
    }

    /// Refuses to end a program while somebody has paused the time: it could not notice that it is to end.
    fn check_can_end(&self, place: usize) -> Result<(), String> {
        let member = self.members.get(place);
        // A process that is held is killed, and need not notice anything.
        let is_killed = |it: &Member| it.state() == MemberState::Held && it.plan.runs_here;
        let waits =
            member.is_some_and(|it| it.is_alive() && !it.plan.is_service() && !is_killed(it));
        if waits && self.mailbox.is_paused() {
            let (system, me) = (&self.description.name, me());
            return Err(format!(
                "the simulated time is paused, and no program ends until it goes on: \
                 `{me} clock --system {system} resume`"
            ));
        }
        Ok(())
    }

    fn stop(&mut self, from: Asker, processor: &str) -> Result<Option<ControlAnswer>, String> {
        let place = self.find(processor)?;
        self.check_can_end(place)?;
        if let Some(member) = self.members.get_mut(place) {
            member.end(NextStep::Stop, &self.mailbox, &mut self.journal);
        }
        self.promise(from, place, Wish::Ended);
        Ok(None)
    }

    fn start(&mut self, from: Asker, processor: &str) -> Result<Option<ControlAnswer>, String> {
        let place = self.find(processor)?;
        if let Some(member) = self.members.get_mut(place) {
            match member.phase {
                Phase::Stopped | Phase::Failed => member.wish(),
                Phase::Ending { .. } => {
                    member.end(NextStep::Start, &self.mailbox, &mut self.journal);
                }
                Phase::Waiting { .. } | Phase::Starting | Phase::Pausing { .. } => {}
                Phase::Up { .. } => {
                    let name = &member.plan.name;
                    return Err(format!(
                        "`{name}` is running already; `restart` ends it first"
                    ));
                }
            }
        }
        self.promise(from, place, Wish::Runs);
        Ok(None)
    }

    fn restart(
        &mut self,
        from: Asker,
        processor: &str,
        held: bool,
    ) -> Result<Option<ControlAnswer>, String> {
        let place = self.find(processor)?;
        if let Some(member) = self.members.get(place).map(|it| &it.plan)
            && !member.is_service()
        {
            // Its file may be another one now.
            let (program, arguments) = (member.program.clone(), member.arguments.clone());
            return self.load(from, processor, program, arguments, held);
        }
        if matches!(from, Asker::Processor { .. }) {
            return Err(format!(
                "`{processor}` is a service, which a person alone restarts"
            ));
        }
        self.run_again(from, place, Wish::Runs);
        Ok(None)
    }

    fn load(
        &mut self,
        from: Asker,
        processor: &str,
        program: String,
        arguments: Vec<String>,
        held: bool,
    ) -> Result<Option<ControlAnswer>, String> {
        let place = self.find(processor)?;
        self.check_can_end(place)?;
        let Some(member) = self.members.get_mut(place) else {
            return Ok(None);
        };
        if member.plan.is_service() {
            return Err(format!(
                "`{}` is a service; no other program can be loaded",
                member.plan.name
            ));
        }
        let mut image = plan::reload(
            self.description,
            member,
            &program,
            &arguments,
            &self.options.own,
        )?;
        if held && !member.plan.runs_here {
            return Err(format!(
                "the program of `{processor}` does not run on this machine; `{} gdb {processor} --start` holds it",
                me()
            ));
        }
        image.environment.hold_at_start = held;
        if let Asker::Processor { number, .. } = from {
            let text = format!("`{program}` is started at the request of {number}");
            self.journal.tell(&member.plan.name, text, None);
        }
        member.replace(image, program, arguments);
        let wish = if held { Wish::Held } else { Wish::Runs };
        self.run_again(from, place, wish);
        Ok(None)
    }

    /// Ends a program if it runs, and starts the one that was loaded last.
    fn run_again(&mut self, from: Asker, place: usize, wish: Wish) {
        if let Some(member) = self.members.get_mut(place) {
            if matches!(member.phase, Phase::Stopped | Phase::Failed) {
                member.wish();
            } else {
                member.end(NextStep::Start, &self.mailbox, &mut self.journal);
            }
        }
        self.promise(from, place, wish);
    }

    /// Answers what has been carried out.
    pub(super) fn keep_promises(&mut self) {
        for promise in core::mem::take(&mut self.promises) {
            let Some(member) = self.members.get(promise.member) else {
                continue;
            };
            let outcome = match (promise.what, self.down) {
                (Wish::Ended, _) => (!member.is_alive()).then_some(Ok(())),
                (Wish::Runs | Wish::Held, Some(_)) => Some(Err("the system is going down".into())),
                (Wish::Runs, None) => member.outcome(self.mailbox.is_paused()),
                (Wish::Held, None) => member.is_held_at_start(),
            };
            match outcome {
                Some(Ok(())) => self.answer(promise.to, done()),
                Some(Err(error)) => self.answer(promise.to, refused(error)),
                None => self.promises.push(promise),
            }
        }
    }
}

fn done() -> ControlAnswer {
    ControlAnswer {
        ok: true,
        ..ControlAnswer::default()
    }
}

fn refused(error: String) -> ControlAnswer {
    ControlAnswer {
        error: Some(error),
        ..ControlAnswer::default()
    }
}
