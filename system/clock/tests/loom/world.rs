//! A page, a futex and participants for loom.

use std::ops::Deref;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};

use condor_clock::sync::{AtomicU32, Killed, kill_before, step};
use condor_clock::{Handover, Page, Until};
use loom::cell::UnsafeCell;
use loom::sync::{Arc, Condvar, Mutex};

/// Takes part in nothing; it makes the page and buries the dead.
pub(crate) const SUPERVISOR: u8 = 0xf0;

/// Explores `model` with at most `preemptions` and says how many executions there were.
pub(crate) fn explore(name: &str, preemptions: usize, model: impl Fn() + Sync + Send + 'static) {
    let begun = std::time::Instant::now();
    let executions = executions(preemptions, model);
    println!("{name}: {executions} executions in {:.1?}", begun.elapsed());
}

/// Explores `model` with a death before the first access, before the second one, and so on until nobody
/// lives to make so many. The model is told the number and returns true if somebody was killed.
pub(crate) fn explore_kills(
    name: &str,
    preemptions: usize,
    model: impl Fn(u32) -> bool + Copy + Sync + Send + 'static,
) {
    let begun = std::time::Instant::now();
    let (mut all, mut access) = (0, 0);
    loop {
        access += 1;
        let died = std::sync::Arc::new(AtomicBool::new(false));
        let told = died.clone();
        all += executions(preemptions, move || {
            if model(access) {
                told.store(true, Relaxed);
            }
        });
        if !died.load(Relaxed) {
            break;
        }
    }
    let accesses = access - 1;
    assert!(accesses > 0, "nobody was killed");
    println!(
        "{name}: killed before each of {accesses} accesses, {all} executions in {:.1?}",
        begun.elapsed()
    );
}

fn executions(preemptions: usize, model: impl Fn() + Sync + Send + 'static) -> usize {
    let executions = std::sync::Arc::new(AtomicUsize::new(0));
    let counted = executions.clone();
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(preemptions);
    builder.max_branches = 20_000;
    builder.check(move || {
        counted.fetch_add(1, Relaxed);
        model();
    });
    executions.load(Relaxed)
}

/// Runs `body`, which is killed before its access number `access`; returns true if it was.
pub(crate) fn mortal(access: u32, body: impl FnOnce()) -> bool {
    kill_before(access);
    let ended = catch_unwind(AssertUnwindSafe(body));
    kill_before(0);
    match ended {
        Ok(()) => false,
        Err(payload) if payload.is::<Killed>() => true,
        Err(payload) => resume_unwind(payload),
    }
}

/// All that participants share.
pub(crate) struct World<const N: usize> {
    page: Page<N>,
    beds: [Bed; N],
    /// The turns that there were: instant and number. Loom finds two who write it at a time.
    turns: UnsafeCell<Vec<(u64, u8)>>,
}

/// Where one participant sleeps.
struct Bed {
    /// The address of the word on which it sleeps, and whether its next sleep takes too long: the
    /// kernel holds its queue while it compares and while it wakes, and remembers no wake.
    queue: Mutex<(Option<usize>, bool)>,
    woken: Condvar,
    mail: Mutex<Mail>,
    bell: Condvar,
}

/// What a service gets.
#[derive(Default)]
struct Mail {
    messages: u32,
    /// Whether its doorbell was rung since it looked last.
    is_rung: bool,
    is_last: bool,
}

impl<const N: usize> World<N> {
    /// Makes a world in which all of `processors` have to enter before anybody goes on.
    pub(crate) fn new(processors: &[u8]) -> Arc<Self> {
        let world = Self {
            page: Page::new(),
            beds: std::array::from_fn(|_| Bed {
                queue: Mutex::new((None, false)),
                woken: Condvar::new(),
                mail: Mutex::new(Mail::default()),
                bell: Condvar::new(),
            }),
            turns: UnsafeCell::new(Vec::new()),
        };
        for &number in processors {
            world.page.hold(number);
        }
        Arc::new(world)
    }

    /// Makes a world in which all of `processors` have entered, and the first one has the turn.
    pub(crate) fn entered(processors: &[u8]) -> Arc<Self> {
        let world = Self::new(processors);
        for &number in processors {
            world.announce(number, 0);
        }
        world.kick(SUPERVISOR, &Player::new(&world, SUPERVISOR));
        world
    }

    /// Returns all turns; nobody takes part any more.
    pub(crate) fn turns(&self) -> Vec<(u64, u8)> {
        self.turns.with_mut(|turns| {
            // SAFETY: loom checks that nobody else uses it.
            unsafe { std::mem::take(&mut *turns) }
        })
    }

    /// Lets the sleep of everybody take too long, or the next one of who is awake.
    pub(crate) fn time_out(&self) {
        for bed in &self.beds {
            let mut queue = bed.queue.lock().unwrap();
            if queue.0.take().is_some() {
                bed.woken.notify_all();
            } else {
                queue.1 = true;
            }
        }
    }
}

impl<const N: usize> Deref for World<N> {
    type Target = Page<N>;

    fn deref(&self) -> &Page<N> {
        &self.page
    }
}

/// One participant.
pub(crate) struct Player<const N: usize> {
    pub(crate) world: Arc<World<N>>,
    pub(crate) me: u8,
}

impl<const N: usize> Player<N> {
    pub(crate) fn new(world: &Arc<World<N>>, me: u8) -> Self {
        Self {
            world: world.clone(),
            me,
        }
    }

    /// Notes that it has the turn, and returns the instant.
    pub(crate) fn note(&self) -> u64 {
        let now = self.world.now();
        self.world.turns.with_mut(|turns| {
            // SAFETY: loom checks that nobody else uses it.
            unsafe { (*turns).push((now, self.me)) };
        });
        now
    }

    pub(crate) fn enter(&self, at: u64) {
        self.world.announce(self.me, at);
        self.world.kick(self.me, self);
        self.world.first_turn(self.me, self);
        assert!(self.note() >= at, "too early");
    }

    /// Waits for the first turn after it has entered.
    pub(crate) fn begin(&self) {
        self.world.first_turn(self.me, self);
        self.note();
    }

    /// Waits until `at`, when nothing else may end the wait.
    pub(crate) fn until(&self, at: u64) {
        let told = self.world.turn(self.me, at, Until::Instant, self);
        assert_eq!((self.note(), told), (at, at));
    }

    /// Waits until it is rung, or until `at`; returns when.
    pub(crate) fn until_rung(&self, seen: u32, at: u64) -> u64 {
        self.world.turn(self.me, at, Until::Ring { seen }, self);
        self.note()
    }

    pub(crate) fn rings(&self) -> u32 {
        self.world.rings(self.me)
    }

    /// Rings `number` with the turn.
    pub(crate) fn ring(&self, number: u8) {
        self.world.count_ring(number);
    }

    /// Sends a message to the service `number`, whose doorbell is rung at last.
    pub(crate) fn tell(&self, number: u8) {
        let bed = &self.world.beds[usize::from(number)];
        bed.mail.lock().unwrap().messages += 1;
        self.world.count_ring(number);
        step();
        bed.mail.lock().unwrap().is_rung = true;
        bed.bell.notify_all();
    }

    /// Tells the service `number` that nobody tells it anything any more.
    pub(crate) fn dismiss(&self, number: u8) {
        let bed = &self.world.beds[usize::from(number)];
        bed.mail.lock().unwrap().is_last = true;
        bed.bell.notify_all();
    }

    /// Becomes a service that has looked for messages already.
    pub(crate) fn begin_service(&self) {
        self.world.serve(self.me);
        self.finish();
    }

    /// Is a service: calls `handler` for each message, until it is [dismissed](Self::dismiss).
    pub(crate) fn serve(&self, handler: impl Fn()) {
        let bed = &self.world.beds[usize::from(self.me)];
        loop {
            let seen = self.rings();
            while bed.mail.lock().unwrap().messages > 0 {
                handler();
                bed.mail.lock().unwrap().messages -= 1;
            }
            self.world.consumed(self.me, seen, self);
            if self.world.has_turn(self.me) {
                self.finish();
            }
            let mut mail = bed.mail.lock().unwrap();
            while !mail.is_rung && !mail.is_last {
                mail = bed.bell.wait(mail).unwrap();
            }
            if !mail.is_rung {
                return;
            }
            mail.is_rung = false;
        }
    }

    pub(crate) fn leave(&self) {
        self.world.leave(self.me, self);
    }

    /// Asks for a turn at `at` and waits for it.
    pub(crate) fn request(&self, at: u64) -> u64 {
        self.world.request(self.me, at, self);
        while !self.world.await_request(self.me, 0, self) {}
        self.note()
    }

    pub(crate) fn finish(&self) {
        self.world.finish(self.me, self);
    }
}

impl<const N: usize> Handover for Player<N> {
    fn sleep(&self, word: &AtomicU32, seen: u32, _: u64) {
        step();
        let bed = &self.world.beds[usize::from(self.me)];
        let mut queue = bed.queue.lock().unwrap();
        if word.0.load(loom::sync::atomic::Ordering::Relaxed) != seen
            || std::mem::take(&mut queue.1)
        {
            return;
        }
        queue.0 = Some(std::ptr::from_ref(word).addr());
        while queue.0.is_some() {
            queue = bed.woken.wait(queue).unwrap();
        }
    }

    fn wake(&self, number: u8, word: &AtomicU32) {
        step();
        let bed = &self.world.beds[usize::from(number)];
        let mut queue = bed.queue.lock().unwrap();
        if queue.0 == Some(std::ptr::from_ref(word).addr()) {
            queue.0 = None;
            bed.woken.notify_all();
        }
        drop(queue);
        if self.world.is_service(number) {
            bed.mail.lock().unwrap().is_rung = true;
            bed.bell.notify_all();
        }
    }
}
