//! A small program, and who looks at it from outside: the same text on every machine.

use std::time::Duration;

use condor_mbox::{Backend, Clock as _, Mailbox, Messenger, Processor, Published, Region, Vector};
use condor_mos::{Rate, Statistics};
use condor_rt::objects::{self, ObjectKind};
use condor_rt::{Machine, PROCESSORS, Program, ProgramError, Setup, loops};

pub(crate) const SMALL: Processor = Processor(1);
pub(crate) const VISITOR: Processor = Processor(20);
const ADD: Vector = Vector(5);

/// A loop of 400 Hz that publishes its count, and a handler that adds its argument.
pub(crate) struct Small;

impl Program for Small {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let addend = machine.argument(0).and_then(|text| text.parse().ok());
        let addend: u32 = addend.ok_or_else(|| ProgramError::program(&"no addend"))?;
        let mut setup = Setup::new(machine)?;
        let mut ticks = setup.publish::<u32>("ticks")?;
        let (mut count, mut lost) = (0, 0);
        setup
            .on(ADD, "add", &|call| call.data() + addend)
            .servo("servo", Rate::hz(400), &mut |_| {
                count += 1;
                lost += u32::from(ticks.publish(&count).is_err());
            })
            .run()?;
        assert_eq!(lost, 0, "memory is gone");
        Ok(())
    }
}

/// What was seen from outside.
#[derive(Debug, PartialEq)]
pub(crate) struct Seen {
    pub(crate) reply: u32,
    pub(crate) ticks: u32,
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
        let servo = objects::find(&region, "servo", ObjectKind::Loop)
            .unwrap()
            .unwrap();
        let is_late = mailbox.doorbell().now() > until;
        match loops::read(&region, &servo).unwrap() {
            Some((counts, _)) if counts.run >= 80 || is_late => {
                let ticks = objects::find(&region, "ticks", ObjectKind::Other)
                    .unwrap()
                    .unwrap();
                let ticks = Published::<u32>::at(ticks.offset).subscriber(&region);
                return Seen {
                    reply: reply.unwrap(),
                    ticks: ticks.unwrap().read().unwrap().value,
                    counts,
                };
            }
            _ => assert!(!is_late, "nothing is published"),
        }
    }
}
