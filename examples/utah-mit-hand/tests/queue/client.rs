//! [`Client`]: a program that enqueues motions, and writes down what it is told.
//!
//! It writes each request into its log before it sends it, and its outcome once it knows it. So its next
//! incarnation knows which outcomes are still to be asked for.

use std::fs::File;
use std::path::Path;
use std::time::Duration;

use condor_hand::trajectory::image::append;
use condor_hand::trajectory::{Pace, Primitive, Profile, Target};
use condor_robot::motions::MotionsClient;
use condor_robot::objects;
use condor_robot::packet::ClientError;
use condor_robot::queue::{InControl, QueueAnswer, RefusalReason, RequestIdentity, RequestState};
use condor_rt::{Background, Machine, MailboxOf, Program, ProgramError, Setup, users};
use verdict::log::{self, CLIENTS, JOINTS, Line, MASTER, PLACE, read, target};

/// While a file of this name is there, the clients enqueue nothing new.
pub(crate) const ENOUGH: &str = "enough";
/// How many requests a client enqueues before it lets others be in control.
const TURN: u32 = 3;
const ANSWER: Duration = Duration::from_millis(300);
const PAUSE: Duration = Duration::from_millis(20);

type Failed = Box<dyn std::error::Error>;
type Asks<'m, M> = MotionsClient<'m, MailboxOf<'m, M>, <M as Machine>::Window>;

/// The program; its arguments are its index, and how many requests it makes.
pub(crate) struct Client;

impl Program for Client {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?.background(|background| {
            work(background).map_err(|error| ProgramError::program(&error))
        })
    }
}

struct Worker<'b, M: Machine> {
    background: &'b Background<'b, M>,
    log: File,
    joint: usize,
    session: Option<u32>,
    number: u32,
}

fn work<M: Machine>(background: &Background<'_, M>) -> Result<(), Failed> {
    let machine = background.machine();
    let argument = |index| machine.argument(index).ok_or("an argument is missing");
    let (client, all): (usize, u32) = (argument(0)?.parse()?, argument(1)?.parse()?);
    let place = std::env::var_os(PLACE).ok_or("no place")?;
    let place = Path::new(&place);
    let path = place.join(CLIENTS.get(client).ok_or("no such client")?);
    let lines = read(&path);
    let log = File::options().create(true).append(true).open(&path)?;
    let mut worker = Worker {
        background,
        log,
        joint: JOINTS[client],
        session: None,
        number: 0,
    };
    // What a former incarnation has not been told.
    let mut open = Vec::new();
    let mut next = 0;
    for line in lines {
        match line {
            Line::Offers(index, session, number) => {
                let (session, number) = (session as u32, number as u32);
                open.push((index, RequestIdentity { session, number }));
                next = index + 1;
            }
            Line::Told(index, _) => open.retain(|(it, _)| *it != index),
        }
    }
    for (index, identity) in open {
        worker.settle(index, identity)?;
    }
    let is_enough = || place.join(ENOUGH).exists();
    while next < all && !is_enough() && !background.is_stopping() {
        next = worker.turn(next, all)?;
    }
    if next >= all || is_enough() {
        log::append(&worker.log, format_args!("end"))?;
    }
    while !background.is_stopping() {
        background.serve(PAUSE)?;
    }
    Ok(())
}

impl<M: Machine> Worker<'_, M> {
    /// Asks until there is an answer; a master that has just begun has its blocks perhaps elsewhere.
    fn ask<R>(
        &self,
        mut question: impl FnMut(&mut Asks<'_, M>) -> Result<R, ClientError>,
    ) -> Result<Option<R>, Failed> {
        while !self.background.is_stopping() {
            let region = users(self.background.machine(), MASTER)?;
            if let Some(blocks) = objects::motions(&region)? {
                let mailbox = self.background.mailbox();
                let mut asks = MotionsClient::new(mailbox, MASTER, &blocks, &region)?;
                match question(&mut asks) {
                    Ok(answer) => return Ok(Some(answer)),
                    Err(error @ (ClientError::NotYours | ClientError::Length { .. })) => {
                        return Err(error.into());
                    }
                    Err(_) => {}
                }
            }
            self.background.serve(PAUSE)?;
        }
        Ok(None)
    }

    /// Enqueues some motions, and waits for their ends. Returns the index of the next one.
    fn turn(&mut self, first: u32, all: u32) -> Result<u32, Failed> {
        let Some(session) = self.session else {
            self.session = self.ask(|asks| asks.open(ANSWER))?;
            self.number = 0;
            return Ok(first);
        };
        let in_control = self.ask(|asks| match asks.take_control(session, false, ANSWER) {
            Ok(()) => Ok(InControl::Session(session)),
            // It is gone.
            Err(ClientError::NotYours) => Ok(InControl::Nobody),
            Err(ClientError::NotInControl(other)) => Ok(other),
            Err(error) => Err(error),
        })?;
        if in_control == Some(InControl::Nobody) {
            self.session = None;
        }
        if in_control != Some(InControl::Session(session)) {
            self.background.serve(PAUSE)?;
            return Ok(first);
        }
        let mut open = Vec::new();
        let end = all.min(first + TURN);
        for index in first..end {
            self.number += 1;
            let identity = RequestIdentity {
                session,
                number: self.number,
            };
            let number = self.number;
            log::append(&self.log, format_args!("offers {index} {session} {number}"))?;
            open.push((index, identity));
            self.offer(index, identity)?;
        }
        for (index, identity) in open {
            self.settle(index, identity)?;
        }
        self.ask(|asks| match asks.give_up_control(session, ANSWER) {
            Err(ClientError::NotYours) => Ok(()),
            answer => answer,
        })?;
        Ok(end)
    }

    fn offer(&self, index: u32, identity: RequestIdentity) -> Result<Option<QueueAnswer>, Failed> {
        let motion = Primitive::<16>::new(Pace::Duration(0.12), Profile::MinimumJerk);
        let motion = motion.with(self.joint, Target::Absolute(target(index)))?;
        let mut image = [0; 480];
        let len = append(16, &motion, &mut image, 0)?;
        self.ask(|asks| match asks.offer(identity, &image[..len], ANSWER) {
            // A former incarnation's that the master has not got, and does not take any more.
            Err(ClientError::NotYours) => Ok(QueueAnswer::New),
            answer => answer,
        })
    }

    /// Waits for the end of a request, which it sends again if the master has not got it.
    fn settle(&mut self, index: u32, identity: RequestIdentity) -> Result<(), Failed> {
        while !self.background.is_stopping() {
            let Some(seen) = self.ask(|asks| asks.look(identity, ANSWER))? else {
                return Ok(());
            };
            let answer = match seen.answer {
                QueueAnswer::New => self.offer(index, identity)?.unwrap_or(QueueAnswer::New),
                answer => answer,
            };
            match answer {
                QueueAnswer::Known(state, reason) if state.is_final() => {
                    log::append(&self.log, format_args!("told {index} {state:?} {reason:?}"))?;
                    if (state, reason) == (RequestState::Refused, RefusalReason::NotReady) {
                        // Until somebody has enabled the hand.
                        self.background.serve(Duration::from_millis(500))?;
                    }
                    return Ok(());
                }
                QueueAnswer::Known(..) | QueueAnswer::New => self.background.serve(PAUSE)?,
                QueueAnswer::Never | QueueAnswer::Forgotten | QueueAnswer::NoSession => {
                    log::append(&self.log, format_args!("told {index} {answer:?}"))?;
                    if self.session == Some(identity.session) {
                        self.session = None;
                    }
                    return Ok(());
                }
            }
        }
        Ok(())
    }
}
