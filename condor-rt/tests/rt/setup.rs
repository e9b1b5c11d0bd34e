//! Programs that say what they do.
#![cfg(feature = "sim")]

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::time::Duration;

use condor_mbox::published::Subscriber;
use condor_mbox::{Messenger, Processor, Published, Vector};
use condor_mos::{Overrun, Rate};
use condor_rt::directory::{self, Kind};
use condor_rt::{Error, HANDLERS, LOOPS, Machine, Program, Setup, loops, sim, users};

const ADD: Vector = Vector(45);
const ASK: Vector = Vector(46);
const SERVO: Processor = Processor(1);
const HOST: Processor = Processor(11);
const SECOND: Duration = Duration::from_secs(1);
const WINDOW_BYTES: u32 = 65536;

struct Servo;

impl Program for Servo {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), Error> {
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
                assert_eq!(tick.due, u64::from(tick.number) * 2_500_000);
                let _ = angle.publish(&runs);
            })
            .servo_with("slow", Rate::hz(50), Overrun::CatchUp(1), &mut |tick| {
                slow.store(tick.number, Relaxed);
                let _ = tick.send(HOST, ASK, tick.number);
            })
            .background(|background| {
                background.print(format_args!("up\r\n"));
                background.set_rate("slow", Rate::hz(100))?;
                while !background.is_stopping() {
                    background.serve(Duration::from_millis(20))?;
                }
                assert_eq!(background.statistics("servo")?.released, 401);
                assert!(background.statistics("slow")?.released > 90);
                assert!(matches!(background.statistics("none"), Err(Error::Loop(_))));
                assert!(matches!(background.files(), Err(Error::Missing { .. })));
                Ok(())
            })
    }
}

#[test]
fn a_program_is_what_its_setup_says() {
    let mut system = sim::System::new(WINDOW_BYTES).unwrap();
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
            let find = |name| directory::find(&region, name).unwrap().unwrap();
            assert_eq!(find("console").kind, Kind::Terminal);
            let entry = find("loops");
            let (name, counts) = loops::read(&region, &entry, 1)?.unwrap();
            assert_eq!(name.as_str(), "slow");
            assert!(counts.run > 20, "{counts}");
            let angle: Subscriber<u32, _> =
                Published::at(find("angle").offset).subscriber(region.clone())?;
            assert!(angle.read().unwrap().value > 100);
            Ok::<_, Error>(())
        })
        .unwrap();
    system.run_until(1_000_000_000).unwrap();
}

/// The text of the error that a setup ends with.
fn error(window_bytes: u32, set_up: impl Fn(&Sim) -> Result<(), Error> + Sync) -> String {
    let text = std::sync::Mutex::new(String::new());
    let mut system = sim::System::new(window_bytes).unwrap();
    system
        .host(SERVO, |machine| {
            let outcome = set_up(machine);
            *text.lock().unwrap() =
                outcome.map_or_else(|error| error.to_string(), |()| String::new());
            Ok::<_, Error>(())
        })
        .unwrap();
    system.run_until(1_000_000_000).unwrap();
    text.into_inner().unwrap()
}

type Sim = sim::Processor<condor_rt::Silent>;

#[test]
fn what_is_wrong_with_a_setup_is_said_with_its_name() {
    assert_eq!(
        error(4096, |machine| Setup::new(machine)?.console().map(|_| ())),
        "`console` needs 8320 bytes of the window, and 3008 are left: raise `window_bytes` by 5312"
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| Setup::new(machine)?
            .console()?
            .console()
            .map(|_| ())),
        "a program has one console, and this one asked for another"
    );
    assert_eq!(
        error(WINDOW_BYTES, |machine| {
            Setup::new(machine)?
                .on(ADD, "add", &|_| 0)
                .on(ADD, "more", &|_| 0)
                .run()
        }),
        format!("`more` is for {ADD}, which is for something else already")
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
    assert_eq!(
        error(WINDOW_BYTES, |machine| {
            let mut bodies = [(); LOOPS + 1].map(|()| |_: &mut condor_rt::Tick<'_>| ());
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
            let mut body = |_: &mut condor_rt::Tick<'_>| ();
            let mut setup = Setup::new(machine)?;
            setup.servo("quick", Rate::fraction(u32::MAX, 2), &mut body);
            setup.run()
        }),
        "a rate of 4294967295/2 Hz has no grid in ticks of 1000000000 Hz"
    );
}
