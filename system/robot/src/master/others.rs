//! [`Others`]: the table, and the simulated robot if there is one.

use core::time::Duration;

use condor_hand::config::ProcessorKind;
use condor_mbox::exchange::Blocks;
use condor_mbox::{AccessError, Clock as _, Exchange, PeerState, Processor, Region, Vector};
use condor_rt::{Background, Machine, MailboxOf, ProgramError, numbers, users};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::words::Problem;
use crate::packet::{self, ShortPacket};
use crate::plant::CameraObject;
use crate::{RobotDescription, objects, plant, table};

/// The time in which the table or the robot must answer.
const ANSWER: Duration = Duration::from_millis(500);

type FoundServers<M, Q, R> =
    fn(
        &Region<<M as Machine>::Window>,
    ) -> Result<Option<Blocks<ShortPacket<Q>, ShortPacket<R>>>, AccessError>;

/// The exchange of a processor that asks.
type End<'r, M, Q, R> =
    Exchange<'r, MailboxOf<'r, M>, Region<<M as Machine>::Window>, ShortPacket<Q>, ShortPacket<R>>;

/// A processor that answers requests.
struct Remote<'r, M: Machine, Q, R> {
    mailbox: &'r MailboxOf<'r, M>,
    number: u8,
    region: Region<M::Window>,
    vector: Vector,
    find: FoundServers<M, Q, R>,
    /// The incarnation of the processor that the exchange asks.
    incarnation: u32,
    exchange: Option<End<'r, M, Q, R>>,
}

impl<M: Machine, Q, R> Remote<'_, M, Q, R>
where
    Q: Serialize + DeserializeOwned,
    R: Serialize + DeserializeOwned,
{
    fn ask(&mut self, request: &Q) -> Result<R, Problem<'static>> {
        let to = Processor(self.number);
        let absent = Problem::Absent(self.number);
        let PeerState::Up { incarnation, .. } = self.mailbox.peer_state(to)? else {
            return Err(absent);
        };
        if self.incarnation != incarnation {
            self.exchange = None;
        }
        let exchange = if let Some(exchange) = self.exchange.take() {
            exchange
        } else {
            let blocks = (self.find)(&self.region)?.ok_or(absent)?;
            blocks.client(self.mailbox, &self.region)?
        };
        self.incarnation = incarnation;
        let exchange = self.exchange.insert(exchange);
        Ok(packet::ask(exchange, to, self.vector, request, ANSWER)?)
    }
}

/// The programs around the fingers: the table and the simulated robot.
pub(super) struct Others<'r, M: Machine> {
    table: Option<Remote<'r, M, table::TableRequest, table::TableResponse>>,
    plants: heapless::Vec<Remote<'r, M, plant::PlantRequest, plant::PlantResponse>, 8>,
    /// The ball that was put there last, or would be.
    pub(super) ball: Ball,
}

/// A ball, in the axes of the palm: m and kg.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ball {
    pub(super) center: [f64; 3],
    pub(super) radius: f64,
    pub(super) mass: f64,
}

/// The time for which an object may be out of sight.
const SIGHT: Duration = Duration::from_millis(200);
/// The time between two looks for an object.
const NAP: Duration = Duration::from_millis(5);

/// Between the tips of all fingers, after the motion `grasp`.
const BALL: Ball = Ball {
    center: [0.115, 0.0, -0.0605],
    radius: 0.02,
    mass: 0.05,
};

impl<'r, M: Machine> Others<'r, M> {
    pub(super) fn new(
        machine: &M,
        hand: &RobotDescription,
        mailbox: &'r MailboxOf<'r, M>,
    ) -> Result<Self, ProgramError> {
        let mut processors = hand.processors.iter();
        let table = processors.find(|it| it.kind == ProcessorKind::Table);
        let table = match table {
            Some(processor) => Some(Remote {
                mailbox,
                number: processor.number,
                region: users(machine, Processor(processor.number))?,
                vector: table::TABLE,
                find: objects::table::<M::Window> as FoundServers<M, _, _>,
                incarnation: 0,
                exchange: None,
            }),
            None => None,
        };
        let mut plants = heapless::Vec::new();
        for number in numbers::PROGRAMS.filter(|&number| number != machine.number().0) {
            // There are as many places as numbers of programs.
            let _ = plants.push(Remote {
                mailbox,
                number,
                region: users(machine, Processor(number))?,
                vector: plant::PLANT,
                find: objects::plant::<M::Window> as FoundServers<M, _, _>,
                incarnation: 0,
                exchange: None,
            });
        }
        Ok(Self {
            table,
            plants,
            ball: BALL,
        })
    }

    /// Asks the table, which tells its state.
    pub(super) fn table(
        &mut self,
        request: &table::TableRequest,
    ) -> Result<table::TableStatus, Problem<'static>> {
        let table = self.table.as_mut().ok_or(Problem::NoTable)?;
        table.ask(request)?.map_err(Problem::Table)
    }

    /// A bit for each D/A board of the simulated robot that rests; `None` without a robot.
    pub(super) fn resting(&self) -> Option<u64> {
        self.truth().map(|truth| truth.resting)
    }

    /// In how many ticks the simulated robot failed since it was mended; `None` without a robot.
    pub(super) fn failed(&self) -> Option<u64> {
        self.truth().map(|truth| truth.failed)
    }

    fn truth(&self) -> Option<plant::TrueState> {
        let mut truths = self.plants.iter().filter_map(|plant| {
            let state = plant.mailbox.peer_state(Processor(plant.number));
            if !matches!(state, Ok(PeerState::Up { .. })) {
                return None;
            }
            let cell = objects::truth(&plant.region).ok().flatten()?;
            let latest = cell.subscriber(plant.region.clone()).ok()?.read().ok()?;
            Some(latest.value)
        });
        truths.next()
    }

    /// The object in front of the palm, as it is measured next: so it is known that it is seen.
    pub(super) fn see(
        &self,
        background: &Background<'_, M>,
    ) -> Result<CameraObject, Problem<'static>> {
        let mut missing = Problem::NoCamera;
        for plant in &self.plants {
            let state = plant.mailbox.peer_state(Processor(plant.number));
            let Some(cell) = objects::object(&plant.region)? else {
                continue;
            };
            if !matches!(state, Ok(PeerState::Up { .. })) {
                continue;
            }
            let cell = cell.subscriber(plant.region.clone())?;
            let last = || cell.read().ok();
            let before = last().map(|latest| latest.sequence);
            let clock = background.machine().doorbell();
            let deadline = clock.now().after(SIGHT);
            while clock.now() < deadline {
                if let Some(latest) = last().filter(|it| Some(it.sequence) != before) {
                    return Ok(latest.value);
                }
                background.serve(NAP)?;
            }
            missing = Problem::NotSeen;
        }
        Err(missing)
    }

    /// Asks the simulated robot.
    pub(super) fn plant(&mut self, request: &plant::PlantRequest) -> Result<(), Problem<'static>> {
        for plant in &mut self.plants {
            match plant.ask(request) {
                Err(Problem::Absent(_)) => {}
                Err(error) => return Err(error),
                Ok(response) => return response.map_err(Problem::Plant),
            }
        }
        Err(Problem::NoPlant)
    }
}
