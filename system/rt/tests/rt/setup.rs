//! Programs that say what they do.
#![cfg(feature = "sim")]

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::time::Duration;

use condor_dev::InterruptEntry;
use condor_mbox::published::Subscriber;
use condor_mbox::{AccessError, Published, Region, Vector, Windows};
use condor_mbox::{Allocator, Clock as _, Doorbell as _, MemoryWindow as _, Messenger, Processor};
use condor_mos::{Loops, Overrun, Rate};
use condor_rt::objects;
use condor_rt::{HANDLERS, LOOPS, Machine, PROCESSORS, Program, ProgramError, ServoLoop, Setup};
use condor_rt::{loops, sim, users};
use condor_vars::{
    AnyValue, Cell, Param, RequestError, VARS, ValueKind, Var, VariableClient, VariableTable, Vars,
    cell_struct,
};
use zerocopy::{FromBytes, Immutable, IntoBytes};

const ADD: Vector = Vector(1);
const ASK: Vector = Vector(2);
const SERVO: Processor = Processor(1);
const HOST: Processor = Processor(20);
const SECOND: Duration = Duration::from_secs(1);
const WINDOW_BYTES: u32 = 65536;

struct Servo;

impl Program for Servo {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let mut setup = Setup::new(machine)?;
        let mut angle = setup.publish::<u32>("angle")?;
        let (mut runs, slow) = (0, AtomicU32::new(0));
        setup
            .console()?
            .on(ADD, "add", &|call| {
                call.print(format_args!("adds to {}\r\n", call.data()));
                let asked = call.send_with_reply(call.sender(), ASK, 7, SECOND);
                call.data() + asked.unwrap_or(1000)
            })
            .servo("servo", Rate::hz(400), &mut |tick| {
                runs += 1;
                // In the middle of a period.
                let due_ns = 1_250_000 + u64::from(tick.number) * 2_500_000;
                assert_eq!(tick.due.as_ns(), due_ns);
                let _ = angle.publish(&runs);
            })
            .servo_with("slow", Rate::hz(100), Overrun::CatchUp(1), &mut |tick| {
                slow.store(tick.number, Relaxed);
                let _ = tick.send(HOST, ASK, tick.number);
            })
            .background(|background| {
                background.print(format_args!("up\r\n"));
                while !background.is_stopping() {
                    background.serve(Duration::from_millis(20))?;
                }
                assert_eq!(background.statistics("servo")?.released, 400);
                assert!(background.statistics("slow")?.released > 90);
                assert!(matches!(
                    background.statistics("none"),
                    Err(ProgramError::Loop(_))
                ));
                assert!(matches!(
                    background.files(),
                    Err(ProgramError::Missing { .. })
                ));
                Ok(())
            })
    }
}

static HEARD: Mutex<Vec<(Processor, Vector, u32)>> = Mutex::new(Vec::new());

struct Adder;

impl Program for Adder {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?
            .on(ADD, "add", &|call| call.data() + 1)
            .run()
    }
}

/// Hears the messages to the servo, which begins later.
struct Observer;

impl Program for Observer {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?
            .on(ADD, "own", &|_| {
                unreachable!("the message is for another one")
            })
            .listen(SERVO, &|call| {
                let message = (call.sender(), call.vector(), call.data());
                HEARD.lock().unwrap().push(message);
            })
            .background(|background| {
                while !background.is_stopping() {
                    background.serve(Duration::from_millis(20))?;
                }
                assert_eq!(background.mailbox().missed(HOST)?, 0);
                Ok(())
            })
    }
}

#[test]
fn a_program_hears_the_messages_to_another_one() {
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    system.spawn(Processor(0), &Observer).unwrap();
    system.begin_at(SERVO, 200_000_000).unwrap();
    system.spawn(SERVO, &Adder).unwrap();
    system
        .host(HOST, |machine| {
            let mut mailbox = machine.mailbox()?;
            mailbox.join()?;
            machine.work(400_000_000);
            for data in 0..20 {
                assert_eq!(mailbox.send_with_reply(SERVO, ADD, data, SECOND)?, data + 1);
            }
            // Nobody handles it, and it is heard.
            mailbox.send(SERVO, Vector(63), 20, SECOND)?;
            machine.work(100_000_000);
            Ok::<_, ProgramError>(())
        })
        .unwrap();
    system.run_until(600_000_000).unwrap();
    let expected = (0..20).map(|data| (HOST, ADD, data));
    let expected: Vec<_> = expected.chain([(HOST, Vector(63), 20)]).collect();
    assert_eq!(*HEARD.lock().unwrap(), expected);
}

#[test]
fn a_program_is_what_its_setup_says() {
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    system.spawn(SERVO, &Servo).unwrap();
    system
        .host(HOST, |machine| {
            let asked = AtomicU32::new(0);
            let ask = |call: &condor_mbox::Call<'_>| {
                asked.fetch_add(1, Relaxed);
                call.data()
            };
            let mut mailbox = machine.mailbox()?;
            mailbox.set_vector(ASK, &ask, "ask")?;
            mailbox.join()?;
            assert_eq!(mailbox.send_with_reply(SERVO, ADD, 41, SECOND)?, 48);
            let end = mailbox.now().after(Duration::from_millis(500));
            while mailbox.now() < end {
                mailbox.serve(Duration::from_millis(10))?;
            }
            assert!(asked.load(Relaxed) > 20);

            let region = users(machine, SERVO)?;
            let find = |name, kind| objects::find(&region, name, kind).unwrap().unwrap();
            find("console", objects::ObjectKind::Terminal);
            let slow = find("slow", objects::ObjectKind::Loop);
            let (counts, times) = loops::read(&region, &slow)?.unwrap();
            assert!(counts.run > 20, "{counts}");
            assert!(times.runs.total() > 20);
            let angle: Subscriber<u32, _> =
                Published::at(find("angle", objects::ObjectKind::Other).offset)
                    .subscriber(region.clone())?;
            assert!(angle.read().unwrap().value > 100);
            Ok::<_, ProgramError>(())
        })
        .unwrap();
    system.run_until(1_000_000_000).unwrap();
}

/// A joint that is stiffer or softer as others wish.
struct Joint;

#[derive(FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Contact {
    force: f32,
    fingers: u32,
}

cell_struct!(Contact {
    "force": force, "N";
    "fingers": fingers, "";
});

impl Program for Joint {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let position = Var::new("joint.position", "rad");
        let torques = Vars::<u32, 2>::numbered("torque", "mN m");
        let stiffness = Param::new("joint.stiffness", "N m/rad", 2.0, 0.0..=50.0);
        let beats = Var::<u64>::new("beats", "");
        let mut angle = 0.0;
        let mut setup = Setup::new(machine)?;
        let mut contact = setup.publish_fields::<Contact>("contact")?;
        setup
            .fixed()
            .servo("silent", Rate::hz(100), &mut |_| ())
            .watch(&position)
            .watch(&torques)
            .tune(&stiffness)
            .servo("servo", Rate::hz(400), &mut |tick| {
                angle += 1e-3 * stiffness.get();
                position.set(angle);
                torques.set_at(1, tick.number);
                let (force, fingers) = (1.5, 3);
                let _ = contact.publish(&Contact { force, fingers });
            })
            .rates(0.0..=800.0)
            .servo("rest", Rate::hz(100), &mut |_| ())
            .fixed()
            .watch(&beats)
            .servo("slow", Rate::hz(10), &mut |tick| {
                beats.set(tick.number.into());
            })
            .run()
    }
}

/// A machine that listens to its mailbox interrupt long after the mailbox has joined.
struct Late<'m, M>(&'m M);

impl<M: Machine> Machine for Late<'_, M> {
    type Window = M::Window;
    type Doorbell = M::Doorbell;
    type Exclusion = M::Exclusion;
    type Bus = M::Bus;
    type TestAndSet = M::TestAndSet;
    type Controller = M::Controller;

    fn number(&self) -> Processor {
        self.0.number()
    }

    fn windows(&self) -> [Windows<M::Window>; PROCESSORS] {
        self.0.windows()
    }

    fn doorbell(&self) -> M::Doorbell {
        self.0.doorbell()
    }

    fn test_and_set(
        &self,
        memory: Region<M::Window>,
        offset: u32,
    ) -> Result<M::TestAndSet, AccessError> {
        self.0.test_and_set(memory, offset)
    }

    fn exclusion(&self) -> M::Exclusion {
        self.0.exclusion()
    }

    fn timer_frequency(&self) -> Rate {
        self.0.timer_frequency()
    }

    fn bus(&self) -> M::Bus {
        self.0.bus()
    }

    fn interrupt_controller(&self) -> M::Controller {
        self.0.interrupt_controller()
    }

    fn with_interrupts<R>(
        &self,
        entry: &dyn InterruptEntry,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        self.0.with_interrupts(entry, background)
    }

    fn argument(&self, index: usize) -> Option<&str> {
        self.0.argument(index)
    }

    fn is_stopping(&self) -> bool {
        self.0.is_stopping()
    }

    fn mail_interrupts(&self) -> bool {
        true
    }

    fn with_mail<R>(
        &self,
        serve: impl Fn() -> usize + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        let bell = self.doorbell();
        let begin = bell.now().after(Duration::from_millis(100));
        while bell.now() < begin {
            bell.wait(bell.prepare(), begin, None);
        }
        let mut heard = bell.prepare();
        let result = background();
        let end = begin.after(Duration::from_millis(100));
        loop {
            // It ends with a ring, or too late.
            bell.wait(heard, end, None);
            if bell.now() >= end {
                return Ok(result);
            }
            heard = bell.prepare();
            serve();
        }
    }

    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        ahead: Duration,
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, ProgramError> {
        self.0.with_loops(loops, ahead, background)
    }
}

struct Answers;

impl Program for Answers {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(&Late(machine))?
            .on(ADD, "add", &|call| call.data() + 1)
            .background(|_| Ok(()))
    }
}

#[test]
fn who_rings_before_the_mailbox_interrupt_is_connected_is_answered() {
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    system.spawn(SERVO, &Answers).unwrap();
    system
        .host(HOST, |machine| {
            let mut mailbox = machine.mailbox()?;
            mailbox.join()?;
            assert_eq!(mailbox.send_with_reply(SERVO, ADD, 41, SECOND)?, 42);
            Ok::<_, ProgramError>(())
        })
        .unwrap();
    system.run().unwrap();
}

#[test]
fn what_loops_show_is_watched_and_set() {
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    system.spawn(SERVO, &Joint).unwrap();
    system
        .host(HOST, |machine| {
            let mut mailbox = machine.mailbox()?;
            mailbox.join()?;
            mailbox.wait_for_peer(SERVO, None, SECOND)?;
            let own = users(machine, HOST)?;
            let joint = users(machine, SERVO)?;
            let mut tables = Vec::new();
            for entry in objects::all(&joint)? {
                let entry = entry?;
                if entry.kind == objects::ObjectKind::Variables {
                    tables.push((entry.name.as_str().to_owned(), entry.offset));
                }
            }
            let [contact, servo, rest, slow] = &tables[..] else {
                panic!("{tables:?}");
            };
            let names = [contact, servo, rest, slow].map(|table| table.0.as_str());
            assert_eq!(names, ["contact", "servo", "rest", "slow"]);
            let table = VariableTable::open(&joint, servo.1).unwrap();
            let mut allocator = Allocator::new(own.size());
            let mut client = VariableClient::new(&mailbox, own, &mut allocator, SERVO, VARS)?;
            let stiffness = table.find("joint.stiffness").unwrap().unwrap();
            let (two, three) = (AnyValue::F64(2.0), AnyValue::F64(3.0));
            client.set(&table, &stiffness, two, three, SECOND).unwrap();
            let torque = table.find("torque.1").unwrap().unwrap();
            let mut watcher = client.claim(&table, SECOND).unwrap();
            let chosen = [0, torque.number, stiffness.number];
            client.select(&mut watcher, &chosen, 4, SECOND).unwrap();
            let (mut rows, mut values) = (Vec::new(), [0; 5]);
            while rows.len() < 20 {
                mailbox.serve(Duration::from_millis(10))?;
                while let Some(row) = watcher.read(&mut values).unwrap() {
                    let (stiffness, _) = ValueKind::F64.split(&values[3..]).unwrap();
                    assert_eq!((u64::from(values[2]), stiffness), (row.tick, three));
                    assert_eq!(row.released.as_ns(), 1_250_000 + row.tick * 2_500_000);
                    rows.push(row.tick);
                }
            }
            assert!(
                rows.windows(2).all(|pair| pair[1] == pair[0] + 4),
                "{rows:?}"
            );
            client.release(&mut watcher, SECOND).unwrap();

            let counts = || {
                let rest = objects::find(&joint, "rest", objects::ObjectKind::Loop).unwrap();
                loops::read(&joint, &rest.unwrap()).unwrap().unwrap().0
            };
            let mut now = 100.0;
            // The table has no room for 400 Hz and 59.94 Hz, so their instants are computed.
            for hz in [800.0, 59.94, 0.0, 0.5, 200.0] {
                let table = VariableTable::open(&joint, rest.1).unwrap();
                let rest_hz = table.find("rest.hz").unwrap().unwrap();
                let (from, to) = (AnyValue::F64(now), AnyValue::F64(hz));
                client.set(&table, &rest_hz, from, to, SECOND).unwrap();
                let is_followed = || {
                    let counts = counts();
                    let same = (counts.rate.as_hz() - hz).abs() < 1e-9;
                    if hz < 0.1 {
                        !counts.enabled
                    } else {
                        counts.enabled && same
                    }
                };
                while !is_followed() {
                    mailbox.serve(Duration::from_millis(10))?;
                }
                assert_eq!(counts().computed, hz < 800.0);
                let released = counts().released;
                while hz > 1.0 && counts().released < released + 20 {
                    mailbox.serve(Duration::from_millis(10))?;
                }
                now = hz;
            }
            let table = VariableTable::open(&joint, rest.1).unwrap();
            let rest_hz = table.find("rest.hz").unwrap().unwrap();
            let (from, to) = (AnyValue::F64(now), AnyValue::F64(801.0));
            let refused = client.set(&table, &rest_hz, from, to, SECOND);
            assert!(
                matches!(refused, Err(RequestError::OutOfBounds { .. })),
                "{refused:?}"
            );

            let cell = Cell::open(&joint, contact.1).unwrap();
            let mut bytes = [0; 8];
            cell.read(&mut bytes).unwrap();
            let force = cell.table().find("force").unwrap().unwrap();
            assert_eq!(force.of_cell(&bytes), Some(AnyValue::F32(1.5)));
            Ok::<_, ProgramError>(())
        })
        .unwrap();
    system.run_until(6_000_000_000).unwrap();
}

/// The text of the error that a setup ends with.
fn error(window_bytes: u32, set_up: impl Fn(&Sim) -> Result<(), ProgramError> + Sync) -> String {
    let text = std::sync::Mutex::new(String::new());
    let mut system = sim::VirtualSystem::new(window_bytes).unwrap();
    system
        .host(SERVO, |machine| {
            let outcome = set_up(machine);
            *text.lock().unwrap() =
                outcome.map_or_else(|error| error.to_string(), |()| String::new());
            Ok::<_, ProgramError>(())
        })
        .unwrap();
    system.run_until(1_000_000_000).unwrap();
    text.into_inner().unwrap()
}

type Sim = sim::SimMachine<condor_rt::Silent>;

#[test]
fn what_is_wrong_with_a_setup_is_said_with_its_name() {
    assert_eq!(
        error(4096, |machine| Setup::new(machine)?.console().map(|_| ())),
        "`console` needs 8320 bytes of the processor's window, but 4032 are left: raise `window_bytes` by 4288"
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| Setup::new(machine)?
            .console()?
            .console()
            .map(|_| ())),
        "a program can have only one console, and this one sets up a second"
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| {
            Setup::new(machine)?
                .on(ADD, "add", &|_| 0)
                .on(ADD, "more", &|_| 0)
                .run()
        }),
        format!(
            "`more` cannot have {ADD}, which belongs to another handler of the program; choose another vector"
        )
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| Setup::new(machine)?
            .on(VARS, "mine", &|_| 0)
            .run()),
        format!(
            "`mine` cannot have {VARS}, which belongs to variables and parameters; choose another vector"
        )
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| {
            let mut setup = Setup::new(machine)?;
            for number in 0..=HANDLERS as u8 {
                setup.on(Vector(number), "one of many", &|_| 0);
            }
            setup.run()
        }),
        format!("`one of many` is one too many: a program has at most {HANDLERS} handlers")
    );
    let itself = error(WINDOW_BYTES, |machine| {
        Setup::new(machine)?.listen(SERVO, &|_| ()).run()
    });
    assert!(itself.contains("its own number"), "{itself}");
    let (spare, soft) = (
        Var::<u32>::new("spare", ""),
        Param::new("soft", "", 1.5, 0.0..=1.0),
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| {
            let mut body = |_: &mut condor_rt::LoopTick<'_>| ();
            let mut setup = Setup::new(machine)?;
            setup.servo("servo", Rate::hz(1), &mut body);
            setup.watch(&spare).run()
        }),
        "the variable or parameter `spare` belongs to no servo loop, so nobody can see it: call `servo` after `watch`, `tune`, `rates` and `fixed`"
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| {
            let mut body = |_: &mut condor_rt::LoopTick<'_>| ();
            let mut setup = Setup::new(machine)?;
            setup.servo("servo", Rate::hz(1), &mut body).fixed().run()
        }),
        "the variable or parameter `hz` belongs to no servo loop, so nobody can see it: call `servo` after `watch`, `tune`, `rates` and `fixed`"
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| {
            let mut setup = Setup::new(machine)?;
            setup
                .tune(&soft)
                .servo("servo", Rate::hz(1), &mut |_| ())
                .run()
        }),
        "cannot show the variables of `servo`: the initial value of parameter 0, counted from 0, is out of its bounds"
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| {
            let mut bodies = [(); LOOPS + 1].map(|()| |_: &mut condor_rt::LoopTick<'_>| ());
            let mut setup = Setup::new(machine)?;
            for body in &mut bodies {
                setup.servo("loop", Rate::hz(1), body);
            }
            setup.run()
        }),
        format!("`loop` is one too many: a program has at most {LOOPS} loops")
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| {
            let mut body = |_: &mut condor_rt::LoopTick<'_>| ();
            let mut setup = Setup::new(machine)?;
            setup.servo("quick", Rate::fraction(u32::MAX, 2), &mut body);
            setup.run()
        }),
        "the rate 4294967295/2 Hz does not suit a clock of 1000000000 Hz: its period is shorter than a tick of the \
         clock, or has too fine a fraction of one; choose a lower or a rounder rate"
    );
}
