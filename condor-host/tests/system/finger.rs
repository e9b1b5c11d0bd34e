//! The program of the processors: a finger of the shipped hand, and a terminal that echoes.

use std::time::Duration;

use condor_hand::config::Hand;
use condor_hand::controller::FingerController;
use condor_hand::message::{BLOCK_BYTES, Identity, SERVO, ServoObject, ServoPlaces};
use condor_hand::monitor::{FingerVariables, MONITOR, MonitorObject, MonitorPlaces, ring_bytes};
use condor_hand::servo::Sensed;
use condor_hand::tendon::Pair;
use condor_mbox::{Call, MemoryWindow, Messenger, Places, Processor, Region, Vector};
use condor_mos::{Clock, EventTable, LoopId, Loops, Overrun, Rate, Scheduler};
use condor_rt::directory::{Directory, Kind};
use condor_rt::loops::LoopReports;
use condor_rt::{Machine, PROCESSORS, Program};
use condor_tty::{Policy, Terminal, Vectors};
use nalgebra::{Vector3, Vector4};

const CAPACITY: u32 = 4096;
const ADD: Vector = Vector(5);
const RATE_HZ: u32 = 100;
const TABLE: EventTable<1, 4> = EventTable::new(
    &[Rate::hz(RATE_HZ)],
    Clock::of::<u64>(Rate::hz(1_000_000_000)),
);

type Variables = FingerVariables<1, 4>;
const COLUMNS: u32 = 8;
const RING_BYTES: u32 = ring_bytes(Variables::COUNT as u32, COLUMNS, 64);

/// A finger whose sensors always say the same.
pub(crate) struct Finger;

impl Program for Finger {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), condor_rt::Error> {
        Self::serve(machine).map_err(|error| condor_rt::Error::program(&error))
    }
}

impl Finger {
    fn serve<M: Machine>(machine: &M) -> Result<(), Box<dyn std::error::Error>> {
        let text = include_str!("../../../condor-hand/hands/utah-mit.toml");
        let hand = Hand::<4, 4>::from_toml(text, "utah-mit.toml")?;
        let entry = &hand.fingers[usize::from(machine.number().0)];
        let own = Region::users(machine.windows()[machine.number().index()].data.clone())?;
        let mut places = Places::new(own.size());
        let mut directory = Directory::new(own.clone(), &mut places)?;
        let terminal =
            Terminal::<_, _, 256>::new(own.clone(), &mut places, CAPACITY, machine.exclusion())?;
        directory.enter("console", Kind::Terminal, terminal.offset(), CAPACITY)?;
        terminal.set_policy(Policy::DropNew)?;
        let mut reports = LoopReports::<_, 1>::new(&own, &mut places, &mut directory, ["servo"])?;

        let points = places.bytes(0)?;
        let servo_places = ServoPlaces::<1, 4>::new(&mut places, PROCESSORS as u8)?;
        let end = servo_places.block(Processor(0)).unwrap() + PROCESSORS as u32 * BLOCK_BYTES;
        directory.enter("servos", Kind::Servos, points, end - points)?;
        let monitor_places = MonitorPlaces::new(&mut places, PROCESSORS as u8, RING_BYTES)?;
        let blocks = monitor_places.block(Processor(0)).unwrap();
        let end = places.bytes(0)?;
        directory.enter("monitor", Kind::Monitor, blocks, end - blocks)?;

        let mechanism = entry.planar().ok_or("no planar finger")?;
        let controller = FingerController::new(&hand, entry, mechanism)?;
        let (mut servos, mut monitor) = (ServoObject::<1, 4>::new(), MonitorObject::new());
        let (asked, mut servo_loop) = servos.split(
            Identity::new(&hand.name, [&entry.name], RATE_HZ),
            &own,
            servo_places,
            machine.exclusion(),
            [controller],
        )?;
        let variables = Variables::new([entry]);
        let (chosen, mut watched) = monitor.split(
            &own,
            monitor_places,
            machine.exclusion(),
            RATE_HZ,
            variables.variables(),
            COLUMNS,
        )?;

        let add = |call: &Call<'_>| call.data().wrapping_add(2);
        let receive = |call: &Call<'_>| terminal.receive(call);
        let asked = |call: &Call<'_>| asked.answer(call);
        let chosen = |call: &Call<'_>| chosen.answer(call);
        let mut mailbox = machine.mailbox()?;
        mailbox.set_vector(ADD, &add, "add")?;
        mailbox.set_vector(SERVO, &asked, "servos")?;
        mailbox.set_vector(MONITOR, &chosen, "monitor")?;
        mailbox.set_vector(Vectors::DEFAULT.input, &receive, "terminal input")?;
        mailbox.set_vector(Vectors::DEFAULT.room, &receive, "terminal room")?;
        mailbox.join()?;

        let scheduler = Scheduler::new(machine.platform(), TABLE);
        let sensed = Sensed {
            position: Vector4::new(0.1, 0.6, 0.8, 0.7),
            tension: [Pair::both(4.0); 4],
        };
        let gravity = Vector3::new(0.0, 0.0, -9.81);
        let mut servo = |_| {
            let tick = servo_loop.tick(0, &sensed, &gravity, 1.0 / f64::from(RATE_HZ));
            if let Some(tick) = tick {
                let (sensed, ticks) = ([sensed], [tick]);
                // Memory that is gone shows in the background.
                let _ = watched.tick(|number| Variables::word(number, &sensed, &ticks));
            }
        };
        scheduler.scope(|scope| {
            scope.assign(LoopId(0), Overrun::Skip, &mut servo)?;
            let background = || {
                let mut console = terminal
                    .console(&mailbox)
                    .with_read_timeout(Duration::from_millis(1));
                let mut line = [0; 64];
                embedded_io::Write::write_all(&mut console, b"hello\r\n")?;
                while !machine.is_stopping() {
                    mailbox.serve(Duration::from_millis(20))?;
                    reports.publish(0, &scheduler.statistics(LoopId(0))?)?;
                    if let Ok(count) = embedded_io::Read::read(&mut console, &mut line) {
                        let typed = String::from_utf8_lossy(&line[..count]).trim().to_owned();
                        let answer = format!("typed {typed}\r\n");
                        embedded_io::Write::write_all(&mut console, answer.as_bytes())?;
                    }
                }
                Ok::<_, Box<dyn std::error::Error>>(())
            };
            scheduler.run(background)?
        })
    }
}
