//! A program that asks its supervisor for what is typed.

use core::time::Duration;

use condor_rt::numbers::{REQUESTS, SUPERVISOR};
use condor_rt::supervisor::{Supervisor, SupervisorError, SupervisorTicket};
use condor_rt::{
    Background, Machine, Messenger as _, Processor, Program, ProgramError, STDIN, Setup,
};

const SOON: Duration = Duration::from_secs(60);

/// Writes `ready`, then obeys lines such as `restart b` and `load b PROGRAM writer other`.
pub(crate) struct Asker;

impl Program for Asker {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let mut setup = Setup::new(machine)?;
        setup.console()?.supervisor()?.background(|background| {
            background.print(format_args!("ready\n"));
            let mut supervisor = background.supervisor()?;
            let (mut stdio, mut line) = (background.stdio(), [0; 256]);
            while !background.is_stopping() {
                let typed = stdio.read_line(STDIN, &mut line, Duration::from_millis(50))?;
                let typed = typed.map(str::trim);
                let Some(typed) = typed.filter(|line| !line.is_empty()) else {
                    continue;
                };
                if let Some(offset) = typed.strip_prefix("offset ") {
                    let offset = offset.parse().unwrap_or(0);
                    let reply = background
                        .mailbox()
                        .send_with_reply(SUPERVISOR, REQUESTS, offset, SOON)?;
                    background.print(format_args!("reply {reply}\n"));
                    continue;
                }
                if let Some(number) = typed.strip_prefix("name ") {
                    let number = Processor(number.parse().unwrap_or(0));
                    match supervisor.name(number) {
                        Ok(Some(name)) => background.print(format_args!("name {name}\n")),
                        _ => background.print(format_args!("no name\n")),
                    }
                    continue;
                }
                match obey(background, &mut supervisor, typed) {
                    Ok(()) => background.print(format_args!("done: {typed}\n")),
                    Err(SupervisorError::Refused) => {
                        background.print(format_args!("error: {}\n", supervisor.reason()));
                    }
                    Err(error) => background.print(format_args!("error: {error}\n")),
                }
            }
            Ok(())
        })
    }
}

fn obey<M: Machine>(
    background: &Background<'_, M>,
    supervisor: &mut Supervisor<'_, M>,
    line: &str,
) -> Result<(), SupervisorError> {
    let mut words = line.split(' ');
    let word = words.next().unwrap_or_default();
    let processor = words.next().unwrap_or_default();
    let order: SupervisorTicket = if word == "restart" {
        supervisor.restart(processor)?
    } else {
        supervisor.load(processor, words.next().unwrap_or_default(), words)?
    };
    while !background.is_stopping() && !supervisor.outcome(order)? {
        // What the memory lacks, the next request finds out.
        let _ = background.serve(Duration::from_millis(50));
    }
    Ok(())
}
