//! The programs of processors, by the supervisor: `restart` and `load`.

use core::fmt::Write as _;

use condor_rt::Machine;
use condor_rt::supervisor::{Supervisor, SupervisorError, SupervisorTicket};

use super::super::words::{Problem, Words};
use super::{Commands, ERROR};

/// The orders of this terminal to the supervisor.
pub(in super::super) struct Processors<'r, M: Machine> {
    pub(in super::super) supervisor: Supervisor<'r, M>,
    /// The request that is being carried out, and what was typed of it.
    order: Option<(SupervisorTicket, heapless::String<48>)>,
}

impl<'r, M: Machine> Processors<'r, M> {
    pub(in super::super) const fn new(supervisor: Supervisor<'r, M>) -> Self {
        let order = None;
        Self { supervisor, order }
    }
}

impl<M: Machine> Commands<'_, '_, M> {
    pub(super) fn restart<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let processor = words.word("a processor, by its number or name")?;
        words.end()?;
        self.check_no_order()?;
        let asked = self.processors.supervisor.restart(processor);
        self.await_order(asked, "restart", processor)
    }

    pub(super) fn load<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let processor = words.word("a processor, by its number or name")?;
        let program = words.word("a program")?;
        self.check_no_order()?;
        let supervisor = &mut self.processors.supervisor;
        let asked = supervisor.load(processor, program, words.rest());
        self.await_order(asked, "load", processor)
    }

    fn check_no_order(&self) -> Result<(), Problem<'static>> {
        match &self.processors.order {
            Some((_, name)) => Err(Problem::Ordered(name.clone())),
            None => Ok(()),
        }
    }

    fn await_order(
        &mut self,
        asked: Result<SupervisorTicket, SupervisorError>,
        word: &str,
        processor: &str,
    ) -> Result<(), Problem<'static>> {
        let order = match asked {
            Err(SupervisorError::Refused) => {
                self.complain(&self.processors.supervisor.reason());
                return Ok(());
            }
            asked => asked?,
        };
        let mut name = heapless::String::new();
        // A text that does not fit is cut off.
        let _ = write!(name, "{word} {processor}");
        self.processors.order = Some((order, name));
        Ok(())
    }

    /// Says how the supervisor has carried out what was asked, once it has.
    pub(in super::super) fn follow_order(&mut self) {
        let Some((order, name)) = self.processors.order.take() else {
            return;
        };
        match self.processors.supervisor.outcome(order) {
            Ok(false) => self.processors.order = Some((order, name)),
            Ok(true) => self.say(format_args!("{name}: done")),
            Err(SupervisorError::Refused) => {
                let reason = self.processors.supervisor.reason();
                self.say(format_args!("{ERROR}{name}: {reason}"));
            }
            Err(error) => self.say(format_args!("{ERROR}{name}: {error}")),
        }
    }
}
