//! Runs a [`System`] by the page, with a thread for each processor and each part of the host.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Mutex, OnceLock};
use std::thread::{self, Thread};

use condor_clock::linux::Futex;
use condor_clock::sync::AtomicU32 as Word;
use condor_clock::{Handover, LINES, LOOPS, LocalClock, NEVER, Page};

use crate::system::{Event, FIRST, HOST, Loop, Program, Request, SERVICE, Step, System, What};

/// What all threads of a run share.
struct Run {
    page: Page,
    events: Mutex<Vec<Event>>,
    /// What was sent to the service: who is to be rung, and whether that is an answer.
    mail: Mutex<VecDeque<(u8, bool)>>,
    answers: [AtomicU32; LINES],
    /// The threads of the parts of the host, once they have begun.
    hosts: [OnceLock<Thread>; LINES],
}

/// Hands the turn over between the threads of a run. A part of the host has a doorbell, for it does not
/// sleep on words of the page.
struct Bells<'r> {
    futex: Futex,
    run: &'r Run,
}

pub(crate) fn run(system: &System) -> Vec<Event> {
    let run = Run {
        page: Page::new(),
        events: Mutex::default(),
        mail: Mutex::default(),
        answers: Default::default(),
        hosts: Default::default(),
    };
    for number in (FIRST..).take(system.processors.len()) {
        run.page.hold(number);
    }
    run.page.serve(SERVICE);
    for (number, request) in (HOST..).zip(&system.requests) {
        run.page.visit(number);
        run.page.request(number, request.at, &run.bells());
    }
    thread::scope(|threads| {
        let run = &run;
        threads.spawn(move || run.serve());
        let start =
            |(number, program)| threads.spawn(move || Processor::new(run, number, program).run());
        let programs: Vec<_> = (FIRST..).zip(&system.processors).map(start).collect();
        for (number, request) in (HOST..).zip(&system.requests) {
            threads.spawn(move || run.request(number, request));
        }
        for program in programs {
            program.join().unwrap();
        }
        run.tell(SERVICE, false);
    });
    run.events.into_inner().unwrap()
}

impl Handover for Bells<'_> {
    fn sleep(&self, word: &Word, seen: u32, most_ns: u64) {
        self.futex.sleep(word, seen, most_ns);
    }

    fn wake(&self, number: u8, word: &Word) {
        self.futex.wake(number, word);
        if self.run.page.needs_bell(number) {
            self.run.unpark(number);
        }
    }

    fn is_own_context(&self) -> bool {
        self.futex.is_own_context()
    }
}

impl Run {
    fn bells(&self) -> Bells<'_> {
        Bells {
            futex: Futex::new(),
            run: self,
        }
    }

    fn unpark(&self, host: u8) {
        if let Some(thread) = self.hosts[usize::from(host)].get() {
            thread.unpark();
        }
    }

    /// Begins the thread of a part of the host.
    fn begin(&self, host: u8) -> Bells<'_> {
        // Who came before this finds nobody to unpark, and is seen by a look that comes after it.
        self.hosts[usize::from(host)]
            .set(thread::current())
            .unwrap();
        self.bells()
    }

    /// Has the service ring `number`, with an answer or not; or end.
    fn tell(&self, number: u8, is_answer: bool) {
        self.mail.lock().unwrap().push_back((number, is_answer));
        self.page.count_ring(SERVICE);
        self.unpark(SERVICE);
    }

    fn note(&self, number: u8, what: What) {
        let event = (self.page.now(), number, what);
        self.events.lock().unwrap().push(event);
    }

    fn serve(&self) {
        let by = self.begin(SERVICE);
        let mut is_last = false;
        while !is_last {
            let seen = self.page.rings(SERVICE);
            while let Some((number, is_answer)) = self.next_message() {
                is_last = number == SERVICE;
                if is_answer {
                    self.answers[usize::from(number)].fetch_add(1, Relaxed);
                }
                if !is_last {
                    self.page.ring(SERVICE, number, &by);
                }
            }
            self.page.consumed(SERVICE, seen, &by);
            if self.page.has_turn(SERVICE) {
                self.page.finish(SERVICE, &by);
            }
            if !is_last {
                thread::park();
            }
        }
        self.page.give_up(SERVICE, &by);
    }

    fn next_message(&self) -> Option<(u8, bool)> {
        self.mail.lock().unwrap().pop_front()
    }

    fn request(&self, number: u8, request: &Request) {
        let by = self.begin(number);
        while !self.page.has_turn(number) {
            thread::park();
        }
        self.note(number, What::Came);
        match request.rings {
            Some(processor) => self.page.count_ring(processor),
            None => self.page.set_stop_at(self.page.now()),
        }
        self.page.finish(number, &by);
    }
}

/// A processor with its background and loops.
struct Processor<'r> {
    run: &'r Run,
    clock: LocalClock<&'r Page, Bells<'r>>,
    program: &'r Program,
    loops: Mutex<Loops>,
}

struct Loops {
    releases: Vec<u64>,
    pending: Vec<bool>,
    /// The rank of what runs; the background has the greatest one.
    running: usize,
}

impl<'r> Processor<'r> {
    fn new(run: &'r Run, number: u8, program: &'r Program) -> Self {
        let mut work = [0; LOOPS];
        for (work, of) in work.iter_mut().zip(&program.loops) {
            *work = of.work;
        }
        let count = program.loops.len();
        Self {
            run,
            clock: LocalClock::new(number, &run.page, run.bells(), work),
            program,
            loops: Mutex::new(Loops {
                releases: Vec::new(),
                pending: vec![false; count],
                running: count,
            }),
        }
    }

    fn note(&self, what: What) {
        self.run.note(self.clock.number(), what);
    }

    fn run(&self) {
        self.clock.announce(self.program.begins_at);
        self.clock.begin();
        self.note(What::Began);
        let now = self.clock.now();
        self.loops.lock().unwrap().releases = vec![now; self.program.loops.len()];
        if !self.program.loops.is_empty() {
            self.clock.arm(now);
        }
        let background = || self.background();
        self.clock
            .with_handler(&|| self.interrupt(), background)
            .unwrap();
        self.note(What::Ended);
        self.clock.leave();
    }

    fn background(&self) {
        let clock = &self.clock;
        let mut seen = clock.rings();
        for step in &self.program.steps {
            match *step {
                Step::Pass(ns) => {
                    clock.pass(ns);
                    self.note(What::Passed);
                }
                Step::Wait(ns) => {
                    clock.wait(seen, clock.now() + ns, None);
                    seen = clock.rings();
                    self.note(What::Waited(seen));
                }
                Step::Ring(number) => clock.ring(number),
                Step::Tell(number) => self.run.tell(number, false),
                Step::Ask => self.ask(),
            }
        }
    }

    fn ask(&self) {
        let number = self.clock.number();
        let answers = &self.run.answers[usize::from(number)];
        let before = answers.load(Relaxed);
        self.run.tell(number, true);
        loop {
            let seen = self.clock.rings();
            if answers.load(Relaxed) != before {
                return;
            }
            self.clock.wait(seen, NEVER, Some(SERVICE));
        }
    }

    /// Releases loops and runs those that are more urgent than what was interrupted.
    fn interrupt(&self) {
        while let Some((rank, interrupted)) = self.next_loop() {
            self.clock.run_loop(rank as u32, || {
                self.note(What::Ran(rank));
                if let Some(number) = self.program.loops[rank].rings {
                    self.clock.ring(number);
                }
            });
            self.loops.lock().unwrap().running = interrupted;
        }
    }

    fn next_loop(&self) -> Option<(usize, usize)> {
        let now = self.clock.now();
        let loops = &mut *self.loops.lock().unwrap();
        let released = loops.releases.iter_mut().zip(&mut loops.pending);
        for ((release, pending), Loop { period, .. }) in released.zip(&self.program.loops) {
            while *release <= now {
                *release += period;
                *pending = true;
            }
        }
        self.clock.arm(*loops.releases.iter().min()?);
        let rank = (0..loops.running).find(|&rank| loops.pending[rank])?;
        loops.pending[rank] = false;
        Some((rank, std::mem::replace(&mut loops.running, rank)))
    }
}
