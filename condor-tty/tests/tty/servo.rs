//! A 400 Hz loop that writes to a terminal is never late for one, whatever its host does: on a
//! processor in virtual time, in which every access to memory takes a tick, so that the loop
//! interrupts the background in the middle of all that it does.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use condor_mbox::sim::{SimSystem, SimWindow};
use condor_mbox::{
    AccessError, Allocator, Call, Clock, Doorbell, Exclusion, Instant, LoadOrder, Mailbox,
    MemoryWindow, Messenger, Region, StoreOrder, Waiting, Windows,
};
use condor_mos::sim::SimPlatform;
use condor_mos::{EventTable, LoopId, Loops, Overrun, Rate, Scheduler, Statistics, Timer};
use condor_tty::{
    ConsoleError, Policy, Terminal, TerminalReader, TerminalSettings, TerminalVectors,
};
use embedded_io::Write;

const HOST: condor_mbox::Processor = condor_mbox::Processor(0);
const HAND: condor_mbox::Processor = condor_mbox::Processor(1);

const TICKS: Rate = Rate::hz(10_000_000);
const TICK_NS: u64 = 100;
const PERIOD: u64 = 25_000;
const SERVO: LoopId = LoopId(0);

/// How long the background writes.
const RUN: u64 = 20_000_000;
const TIMEOUT: Duration = Duration::from_millis(300);
const LINE: &[u8] = b"joint 3 is at 0.250 rad\n";

/// Memory whose accesses take a tick each.
#[derive(Clone)]
struct Slow {
    memory: SimWindow,
    processor: SimPlatform,
}

impl MemoryWindow for Slow {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.memory.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        self.processor.work(1);
        self.memory.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.processor.work(1);
        self.memory.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.memory.check(offset, len)
    }
}

/// Sections in which no interrupt comes.
#[derive(Clone)]
struct Masked {
    processor: SimPlatform,
    depth: Arc<AtomicU32>,
    /// Ticks of the longest one.
    longest: Arc<AtomicU64>,
}

impl Exclusion for Masked {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        if self.depth.fetch_add(1, Relaxed) > 0 {
            let result = body();
            self.depth.fetch_sub(1, Relaxed);
            return result;
        }
        let begun = Timer::now(&self.processor);
        self.processor.hold_interrupts(u64::MAX / 2);
        let result = body();
        let took = Timer::now(&self.processor) - begun;
        self.longest.fetch_max(took, Relaxed);
        self.depth.fetch_sub(1, Relaxed);
        self.processor.hold_interrupts(0);
        result
    }
}

/// A doorbell that nobody rings: the processor sleeps until its time is over.
struct Quiet(SimPlatform);

impl Clock for Quiet {
    fn now(&self) -> Instant {
        Instant::from_ns(Timer::now(&self.0) * TICK_NS)
    }
}

impl Doorbell for Quiet {
    type Seen = ();

    fn ring(&self, _: condor_mbox::Processor) {}

    fn prepare(&self) {}

    fn wait(&self, (): (), until: Instant, _: Option<condor_mbox::Processor>) {
        self.0.run_until(until.as_ns().div_ceil(TICK_NS));
    }
}

/// What became of the host before the loop began.
#[derive(Clone, Copy, Debug)]
enum HostWas {
    NeverThere,
    Killed,
}

/// Who writes in the loop.
#[derive(Clone, Copy)]
enum Loop {
    Poster,
    Console,
}

struct Outcome {
    servo: Statistics,
    /// Ticks from the start to the end.
    took: u64,
    /// Ticks of the longest section in which no interrupt came.
    longest_masked: u64,
    /// Writes of the background that gave up.
    timed_out: u32,
}

/// Runs the loop for two seconds beside a background that writes all the time.
fn run(policy: Policy, host: HostWas, writer: Loop) -> Outcome {
    let processor = SimPlatform::new(TICKS);
    let masked = Masked {
        processor: processor.clone(),
        depth: Arc::default(),
        longest: Arc::default(),
    };
    let system = SimSystem::<2>::in_virtual_time(1024);
    let windows = system.windows(HAND).map(|Windows { mail, data }| {
        let slow = |memory| Slow {
            memory,
            processor: processor.clone(),
        };
        Windows {
            mail: slow(mail),
            data: slow(data),
        }
    });
    let ram = Region::users(windows[HAND.index()].data.clone()).unwrap();
    let mut allocator = Allocator::new(ram.size());
    let terminal =
        Terminal::<_, _, 16>::new(ram.clone(), &mut allocator, 512, masked.clone()).unwrap();
    terminal.configure(&TerminalSettings::RAW).unwrap();
    terminal.set_policy(policy).unwrap();
    let receive = |call: &Call<'_>| terminal.receive(call);
    let doorbell = Quiet(processor.clone());
    let mut mailbox =
        Mailbox::<(_, _, _), 2>::new(HAND, windows, doorbell, masked.clone()).unwrap();
    mailbox.set_waiting(Waiting::Sleep);
    mailbox
        .set_vector(TerminalVectors::DEFAULT.input, &receive, "terminal input")
        .unwrap();
    mailbox
        .set_vector(TerminalVectors::DEFAULT.room, &receive, "terminal room")
        .unwrap();
    mailbox.join().unwrap();

    let [_, seen] = system.windows(HOST);
    let seen = Region::users(seen.data).unwrap();
    if matches!(host, HostWas::Killed) {
        let mut hosts = system.mailbox(HOST).unwrap();
        hosts
            .set_vector(TerminalVectors::DEFAULT.output, &|_| 0, "terminal output")
            .unwrap();
        hosts.join().unwrap();
        // Its words say that it is there, and nobody is behind them.
        TerminalReader::attach(seen.clone(), 0, HOST).unwrap();
    }

    let scheduler = Scheduler::new(
        processor.clone(),
        EventTable::<1, 1>::new(&[Rate::hz(400)], condor_mos::ClockSpec::of::<u64>(TICKS)),
    );
    let offered = AtomicU32::new(0);
    let mut timed_out = 0;
    let mut servo = |_| {
        processor.work(2_000);
        offered.fetch_add(LINE.len() as u32, Relaxed);
        match writer {
            Loop::Poster => drop(terminal.poster(&mailbox).post(LINE).unwrap()),
            Loop::Console => drop(terminal.console(&mailbox).write_all(LINE)),
        }
    };
    let (servo, took) = scheduler.scope(|scope| {
        scope.assign(SERVO, Overrun::Skip, &mut servo).unwrap();
        processor.with_handler(
            || scheduler.on_timer(),
            || {
                let begun = Timer::now(&processor);
                scheduler.start().unwrap();
                let mut console = terminal.console(&mailbox);
                while Timer::now(&processor) - begun < RUN {
                    offered.fetch_add(100, Relaxed);
                    match console.write_all(&[b'-'; 100]) {
                        Ok(()) => mailbox.serve(Duration::from_millis(3)).map(drop).unwrap(),
                        Err(ConsoleError::TimedOut { .. }) => timed_out += 1,
                        Err(error) => panic!("{error}"),
                    }
                }
                let took = Timer::now(&processor) - begun;
                (scheduler.statistics(SERVO).unwrap(), took)
            },
        )
    });

    // A host that comes now finds what is left, and who counted the rest.
    let mut reader = TerminalReader::attach(seen, 0, HOST).unwrap();
    let fetched = reader.fetch(&mut [0; 1024]).unwrap();
    reader.acknowledge(fetched.len).unwrap();
    let status = reader.status().unwrap();
    assert_eq!(
        fetched.len as u32 + status.overwritten + status.lost,
        offered.into_inner(),
        "{status:?}"
    );
    assert_eq!(status.lost, terminal.lost());
    assert_eq!(fetched.len, 512);
    Outcome {
        servo,
        took,
        longest_masked: masked.longest.load(Relaxed),
        timed_out,
    }
}

/// The loop ran at each of its instants, and started as late as the longest masked section at most.
fn assert_on_time(outcome: &Outcome) {
    let servo = outcome.servo;
    assert_eq!(servo.skipped, 0, "{servo}");
    assert_eq!(servo.run, outcome.took.div_ceil(PERIOD));
    assert_eq!(servo.run, servo.released);
    assert!(u64::from(servo.worst_lateness) <= outcome.longest_masked);
    assert!(outcome.longest_masked < 100, "{}", outcome.longest_masked);
}

const BLOCK: Policy = Policy::Block { timeout: TIMEOUT };

#[test]
fn a_dead_host_that_is_waited_for_delays_no_loop() {
    let outcome = run(BLOCK, HostWas::Killed, Loop::Poster);
    assert_on_time(&outcome);
    // The background did nothing but wait.
    assert!(outcome.timed_out >= 6, "{}", outcome.timed_out);
}

#[test]
fn a_full_terminal_that_blocks_delays_no_loop() {
    let outcome = run(BLOCK, HostWas::NeverThere, Loop::Poster);
    assert_on_time(&outcome);
    assert_eq!(outcome.timed_out, 0);
}

#[test]
fn a_full_terminal_that_drops_new_output_delays_no_loop() {
    for host in [HostWas::NeverThere, HostWas::Killed] {
        assert_on_time(&run(Policy::DropNew, host, Loop::Poster));
    }
}

#[test]
fn a_full_terminal_that_drops_old_output_delays_no_loop() {
    for host in [HostWas::NeverThere, HostWas::Killed] {
        assert_on_time(&run(Policy::DropOld, host, Loop::Poster));
    }
}

/// So the tests above can fail.
#[test]
fn a_loop_that_waits_overruns() {
    let outcome = run(BLOCK, HostWas::Killed, Loop::Console);
    assert!(outcome.servo.skipped > 100, "{}", outcome.servo);
}
