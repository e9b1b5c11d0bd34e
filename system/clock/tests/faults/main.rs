//! Kills and stops programs of one simulated time, many times.
//!
//! `cargo test --release -p condor-clock --features linux --test faults -- --kills 10000 --stops 100 [--seed N]`
//!
//! Without arguments it is short; those of libtest count for nothing.
//!
//! Three processors and a service, each a process, have a page in shared memory. The processors wait for
//! instants and for rings, ring each other, have the service ring, and ask it. One of the four is killed with
//! SIGKILL at a random moment, buried, and started again, before or after the others have gone on; or it is
//! stopped for 1 to 500 ms, in which time stands, and it is said for whom. Whoever has the turn checks that
//! nobody else has it, that time has not gone back, and that all others are due later, by a list in which each
//! says when it is due. One check that fails, or ten seconds in which time does not go on, and the program
//! fails.

mod member;
mod process;
mod shared;

use std::process::ExitCode;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

use condor_clock::Obstacle;
use condor_clock::linux::Futex;
use interrupt_injector::{argument, seed};
use rustix::process::Signal;

use process::Process;
use shared::{Memory, PROCESSORS, Random, SERVICE, Shared};

type AnyError = Box<dyn std::error::Error>;

/// The number of the parent, which has no line.
const SUPERVISOR: u8 = 0xf0;
/// Until then something happens unless it never does.
const DEADLINE: Duration = Duration::from_secs(10);

fn main() -> ExitCode {
    let outcome = process::part().and_then(|part| match part {
        Some([number, descriptor, seed]) => {
            let memory = Memory::of_parent(descriptor)?;
            member::play(memory.shared(), number as u8, seed)
        }
        None => direct(),
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("faults: {error}");
            ExitCode::FAILURE
        }
    }
}

/// What the parent does.
fn direct() -> Result<(), AnyError> {
    let (kills, stops) = (argument("--kills", 500)?, argument("--stops", 8)?);
    let begun = Instant::now();
    let memory = Memory::new()?;
    let mut scene = Scene::new(&memory, seed()?)?;
    for _ in 0..kills {
        scene.kill()?;
    }
    for _ in 0..stops {
        scene.stop()?;
    }
    let turns = scene.turns();
    drop(scene);
    let faults = memory.shared().board.faults.load(SeqCst);
    println!(
        "{kills} kills, {stops} stops, {turns} turns, {faults} faults in {:.1?}",
        begun.elapsed()
    );
    if faults > 0 {
        return Err(format!("{faults} checks failed").into());
    }
    Ok(())
}

/// The processes and who watches them.
struct Scene<'m> {
    memory: &'m Memory,
    random: Random,
    by: Futex,
    /// By their numbers; all but one that was killed.
    members: [Option<Process>; SERVICE as usize + 1],
}

impl<'m> Scene<'m> {
    fn new(memory: &'m Memory, seed: u64) -> Result<Self, AnyError> {
        let mut scene = Self {
            memory,
            random: Random(seed),
            by: Futex::new(),
            members: Default::default(),
        };
        let page = &memory.shared().page;
        page.reset(0);
        // Its program enters later; time waits for it from now on.
        page.serve(SERVICE);
        for number in 0..PROCESSORS {
            page.hold(number);
        }
        for number in 0..=SERVICE {
            scene.start(number)?;
        }
        scene.go_on()?;
        Ok(scene)
    }

    fn start(&mut self, number: u8) -> Result<(), AnyError> {
        let seed = self.random.next();
        let member = Process::start([number.into(), self.memory.descriptor(), seed])?;
        self.members[usize::from(number)] = Some(member);
        Ok(())
    }

    fn member(&mut self, number: u8) -> Result<&mut Process, AnyError> {
        let member = self.members[usize::from(number)].as_mut();
        Ok(member.ok_or("it was killed")?)
    }

    fn turns(&self) -> u64 {
        self.memory.shared().board.turns.load(SeqCst)
    }

    fn any_member(&mut self) -> u8 {
        self.random.below(u64::from(SERVICE) + 1) as u8
    }

    /// Lets the members go on for a moment, which ends anywhere.
    fn pause(&mut self) {
        let end = Instant::now() + Duration::from_nanos(self.random.below(400_000));
        while Instant::now() < end {
            std::hint::spin_loop();
        }
    }

    fn kill(&mut self) -> Result<(), AnyError> {
        let number = self.any_member();
        let is_held = number != SERVICE && self.random.below(2) == 0;
        loop {
            self.pause();
            self.member(number)?.kill()?;
            self.members[usize::from(number)] = None;
            self.bury(number, is_held);
            if number != SERVICE && !is_held {
                self.go_on()?;
            }
            self.start(number)?;
            // Now and then it dies again before it has entered.
            if self.random.below(4) > 0 {
                break;
            }
        }
        self.until("it has entered", |scene| {
            number == SERVICE || scene.memory.shared().page.is_alive(number)
        })?;
        self.go_on()
    }

    fn bury(&mut self, number: u8, is_held: bool) {
        let Shared { page, board } = self.memory.shared();
        if number == SERVICE {
            // It gets the turn, so that time stands until its next incarnation has looked.
            return page.request(SERVICE, 0, &self.by);
        }
        board.forget(number);
        if is_held {
            page.hold(number);
        }
        page.bury(number, SUPERVISOR, &self.by);
    }

    fn stop(&mut self) -> Result<(), AnyError> {
        self.pause();
        let number = self.any_member();
        self.member(number)?.stop()?;
        self.until("time stands for it", |scene| scene.stands_for(number))?;
        let stood_at = self.memory.shared().page.now();
        let span = Duration::from_millis(1 + self.random.below(500));
        std::thread::sleep(span);
        let stands_at = self.memory.shared().page.now();
        if stands_at != stood_at || !self.stands_for(number) {
            let error = format!("{number} stood at {stood_at}, and after {span:?} at {stands_at}");
            return Err(error.into());
        }
        self.member(number)?.signal(Signal::CONT)?;
        self.go_on()
    }

    fn stands_for(&self, number: u8) -> bool {
        match self.memory.shared().page.standing(&self.by) {
            Obstacle::Turn {
                asks: Some(asked), ..
            } => asked == number,
            Obstacle::Turn { holder, asks: None } => holder == number,
            Obstacle::Service { number: service } => service == number,
            _ => false,
        }
    }

    /// Waits until all processors have had turns, as far as chance goes.
    fn go_on(&mut self) -> Result<(), AnyError> {
        let end = self.turns() + 20;
        self.until("time goes on", |scene| scene.turns() > end)
    }

    fn until(&mut self, what: &str, is_true: impl Fn(&Self) -> bool) -> Result<(), AnyError> {
        let deadline = Instant::now() + DEADLINE;
        while !is_true(self) {
            for member in self.members.iter_mut().flatten() {
                if let Some(status) = member.ended()? {
                    return Err(format!("a member ended with {status}").into());
                }
            }
            if Instant::now() > deadline {
                let page = &self.memory.shared().page;
                let (now, standing) = (page.now(), page.standing(&self.by));
                let error = format!("not in ten seconds: {what}; at {now}, waiting for {standing}");
                return Err(error.into());
            }
            std::thread::yield_now();
        }
        Ok(())
    }
}
