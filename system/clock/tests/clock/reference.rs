//! Says what a [`System`] is to do: a list of all processors, of which the first one goes on.

use crate::system::{Event, FIRST, HOST, Program, Step, System, What};

pub(crate) fn run(system: &System) -> Vec<Event> {
    let machine = |program| Machine {
        program,
        incarnation: Incarnation::Unborn,
        contexts: Vec::new(),
        step: 0,
        seen: 0,
        releases: Vec::new(),
        pending: vec![false; program.loops.len()],
        running: program.loops.len(),
    };
    let mut machines: Vec<_> = system.processors.iter().map(machine).collect();
    let mut requests = system.requests.clone();
    let mut world = World {
        now: 0,
        stop_at: u64::MAX,
        rings: vec![0; machines.len()],
        events: Vec::new(),
    };
    let mut hosts: Vec<u8> = (HOST..).take(requests.len()).collect();
    loop {
        let processors = machines.iter().enumerate().filter_map(|(number, machine)| {
            let due = machine.due(number, &world)?;
            Some((due.max(world.now), false, number))
        });
        let host = requests.iter().enumerate();
        let host = host.map(|(index, request)| (request.at.max(world.now), true, index));
        let Some((now, is_host, index)) = processors.chain(host).min() else {
            return world.events;
        };
        world.now = now;
        if is_host {
            world.note(hosts.remove(index), What::Came);
            match requests.remove(index).rings {
                Some(number) => world.ring(number),
                None => world.stop_at = now,
            }
        } else if machines[index].go_on(index, &mut world) {
            for (number, machine) in machines.iter().enumerate() {
                if matches!(machine.incarnation, Incarnation::Alive) {
                    world.ring(FIRST + number as u8);
                }
            }
        }
    }
}

struct World {
    now: u64,
    stop_at: u64,
    rings: Vec<u32>,
    events: Vec<Event>,
}

impl World {
    fn note(&mut self, number: u8, what: What) {
        self.events.push((self.now, number, what));
    }

    fn ring(&mut self, number: u8) {
        if let Some(rings) = self.rings.get_mut(usize::from(number - FIRST)) {
            *rings += 1;
        }
    }
}

enum Incarnation {
    Unborn,
    Alive,
    Over,
}

struct Machine<'s> {
    program: &'s Program,
    incarnation: Incarnation,
    /// What was interrupted, and at last what runs.
    contexts: Vec<Context>,
    /// The next step of the background.
    step: usize,
    seen: u32,
    releases: Vec<u64>,
    pending: Vec<bool>,
    /// The rank of what runs.
    running: usize,
}

#[derive(Clone, Copy)]
enum Context {
    /// It computes for so long from then on.
    Work {
        left: u64,
        since: u64,
    },
    Wait {
        until: u64,
        was_stopping: bool,
    },
    /// It runs loops while something of this rank is interrupted.
    Interrupt {
        interrupted: usize,
    },
}

impl Machine<'_> {
    /// When it goes on next.
    fn due(&self, number: usize, world: &World) -> Option<u64> {
        match (&self.incarnation, self.contexts.last()) {
            (Incarnation::Unborn, _) => Some(self.program.begins_at),
            (Incarnation::Over, _) => None,
            (Incarnation::Alive, Some(Context::Work { left, since })) => {
                Some(self.release().min(since + left))
            }
            (Incarnation::Alive, Some(&Context::Wait { .. }))
                if world.rings[number] != self.seen =>
            {
                Some(world.now)
            }
            (
                Incarnation::Alive,
                Some(Context::Wait {
                    until,
                    was_stopping,
                }),
            ) => {
                let stop_at = if *was_stopping {
                    u64::MAX
                } else {
                    world.stop_at
                };
                Some(self.release().min(*until).min(stop_at))
            }
            (Incarnation::Alive, _) => unreachable!("it goes on until time is to pass"),
        }
    }

    /// The next interrupt of its timer.
    fn release(&self) -> u64 {
        self.releases.iter().copied().min().unwrap_or(u64::MAX)
    }

    /// Goes on until time is to pass, or others may go on before it; returns true if it has ended.
    fn go_on(&mut self, number: usize, world: &mut World) -> bool {
        let me = FIRST + number as u8;
        if matches!(self.incarnation, Incarnation::Unborn) {
            self.incarnation = Incarnation::Alive;
            self.seen = world.rings[number];
            self.releases = vec![world.now; self.program.loops.len()];
            world.note(me, What::Began);
        }
        loop {
            let Some(context) = self.contexts.last().copied() else {
                if self.program.steps.len() == self.step {
                    world.note(me, What::Ended);
                    self.incarnation = Incarnation::Over;
                    return true;
                }
                if self.begin_step(me, world) {
                    return false;
                }
                continue;
            };
            self.contexts.pop();
            match context {
                Context::Work { left, since } if self.release() <= since + left => {
                    let left = left - (world.now - since);
                    self.contexts.push(Context::Work { left, since });
                    self.interrupt();
                }
                // The background has computed.
                Context::Work { .. } if self.contexts.is_empty() => world.note(me, What::Passed),
                Context::Work { .. } => {}
                Context::Wait {
                    until,
                    was_stopping,
                } => {
                    let is_stopping = world.now >= world.stop_at;
                    if self.release() <= world.now {
                        self.contexts.push(context);
                        self.interrupt();
                    } else if world.now >= until
                        || world.rings[number] != self.seen
                        || (is_stopping && !was_stopping)
                    {
                        self.seen = world.rings[number];
                        world.note(me, What::Waited(self.seen));
                    } else {
                        self.contexts.push(context);
                        return false;
                    }
                }
                Context::Interrupt { interrupted } => {
                    // A loop has ended, or none has begun.
                    self.running = interrupted;
                    if self.run_loop(me, world) {
                        return false;
                    }
                    // What computes goes on after others that are due at this instant.
                    if let Some(Context::Work { since, .. }) = self.contexts.last_mut() {
                        *since = world.now;
                        return false;
                    }
                }
            }
        }
    }

    /// Begins the next step of the background; returns true if that takes a turn.
    fn begin_step(&mut self, me: u8, world: &mut World) -> bool {
        let step = self.program.steps[self.step];
        self.step += 1;
        let since = world.now;
        match step {
            Step::Pass(left) => self.contexts.push(Context::Work { left, since }),
            Step::Wait(ns) => self.contexts.push(Context::Wait {
                until: since + ns,
                was_stopping: since >= world.stop_at,
            }),
            Step::Ring(number) | Step::Tell(number) => {
                world.ring(number);
                return false;
            }
            Step::Ask => {
                world.ring(me);
                return false;
            }
        }
        true
    }

    fn interrupt(&mut self) {
        let interrupted = self.running;
        self.contexts.push(Context::Interrupt { interrupted });
    }

    /// Runs loops that are more urgent than what was interrupted, until one computes; returns true if
    /// one does.
    fn run_loop(&mut self, me: u8, world: &mut World) -> bool {
        let loops = &self.program.loops;
        for (rank, release) in self.releases.iter_mut().enumerate() {
            while *release <= world.now {
                *release += loops[rank].period;
                self.pending[rank] = true;
            }
        }
        while let Some(rank) = (0..self.running).find(|&rank| self.pending[rank]) {
            self.pending[rank] = false;
            world.note(me, What::Ran(rank));
            if let Some(number) = loops[rank].rings {
                world.ring(number);
            }
            let (left, since) = (loops[rank].work, world.now);
            if left > 0 {
                self.interrupt();
                self.running = rank;
                self.contexts.push(Context::Work { left, since });
                return true;
            }
        }
        false
    }
}
