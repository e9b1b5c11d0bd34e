//! A small program, and who looks at it from outside: the same text on every machine.

use std::time::Duration;

use condor_mbox::{
    Backend, Call, Clock as _, Mailbox, MemoryWindow, Messenger, Places, Processor, Published,
    Region, Vector,
};
use condor_mos::{LoopId, Overrun, Rate, Statistics};
use condor_rt::directory::{self, Directory, Kind};
use condor_rt::loops::{self, LoopReports};
use condor_rt::{Machine, PROCESSORS, Program, ServoLoop};

pub(crate) const SMALL: Processor = Processor(1);
pub(crate) const VISITOR: Processor = Processor(11);
const ADD: Vector = Vector(5);

/// A loop of 400 Hz that publishes its count, and a handler that adds its argument.
pub(crate) struct Small;

impl Program for Small {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), condor_rt::Error> {
        Self::run_for(machine).map_err(|error| condor_rt::Error::program(&error))
    }
}

impl Small {
    fn run_for<M: Machine>(machine: &M) -> Result<(), Box<dyn std::error::Error>> {
        let number = machine.number();
        let addend: u32 = machine.argument(0).ok_or("no addend")?.parse()?;
        let windows = machine.windows();
        let own = Region::users(windows[number.index()].data.clone())?;
        let mut places = Places::new(own.size());
        let mut directory = Directory::new(own.clone(), &mut places)?;
        let ticks: Published<u32> = places.published()?;
        let mut ticks_out = ticks.publisher(own.clone())?;
        directory.enter(
            "ticks",
            Kind::Other,
            ticks.offset(),
            Published::<u32>::BYTES,
        )?;
        let mut reports = LoopReports::<_, 1>::new(&own, &mut places, &mut directory, ["servo"])?;

        let add = |call: &Call<'_>| call.data() + addend;
        let mut mailbox = machine.mailbox()?;
        mailbox.set_vector(ADD, &add, "add")?;
        mailbox.join()?;

        let (mut count, mut lost) = (0_u32, 0_u32);
        let mut servo = |_| {
            count += 1;
            if ticks_out.publish(&count).is_err() {
                lost += 1;
            }
        };
        let servo = ServoLoop {
            rate: Rate::hz(400),
            overrun: Overrun::Skip,
            body: &mut servo,
        };
        machine.with_loops(&mut [servo], |loops| {
            while !machine.is_stopping() {
                mailbox.serve(Duration::from_millis(20))?;
                reports.publish(0, &loops.statistics(LoopId(0))?)?;
            }
            Ok::<_, Box<dyn std::error::Error>>(())
        })??;
        if lost > 0 {
            Err("memory is gone".into())
        } else {
            Ok(())
        }
    }
}

/// What was seen from outside.
#[derive(Debug, PartialEq)]
pub(crate) struct Seen {
    pub(crate) reply: u32,
    pub(crate) ticks: u32,
    pub(crate) name: String,
    pub(crate) counts: Statistics,
}

/// Looks at the small program until its loop has run 80 times.
pub(crate) fn watch<B: Backend<Window: Clone>>(mut mailbox: Mailbox<'_, B, PROCESSORS>) -> Seen {
    mailbox.join().unwrap();
    let reply = mailbox.send_with_reply(SMALL, ADD, 40, Duration::from_secs(20));
    let region = Region::users(mailbox.windows(SMALL).unwrap().data.clone()).unwrap();
    let until = mailbox.doorbell().now().after(Duration::from_secs(20));
    loop {
        mailbox.serve(Duration::from_millis(20)).unwrap();
        let entry = directory::find(&region, "loops").unwrap().unwrap();
        assert_eq!((entry.kind, loops::count(&entry)), (Kind::Loops, 1));
        assert_eq!(loops::read(&region, &entry, 1).unwrap(), None);
        let is_late = mailbox.doorbell().now() > until;
        match loops::read(&region, &entry, 0).unwrap() {
            Some((name, counts)) if counts.run >= 80 || is_late => {
                let ticks = directory::find(&region, "ticks").unwrap().unwrap();
                let ticks = Published::<u32>::at(ticks.offset).subscriber(&region);
                return Seen {
                    reply: reply.unwrap(),
                    ticks: ticks.unwrap().read().unwrap().value,
                    name: name.as_str().into(),
                    counts,
                };
            }
            _ => assert!(!is_late, "nothing is published"),
        }
    }
}
