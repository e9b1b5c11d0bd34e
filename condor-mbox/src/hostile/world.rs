//! [`World`]: shared memory, time and the doorbells, and the choice of the next program.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use crate::error::MemoryObject;
use crate::sim::{SimSystem, SimWindow};
use crate::{
    Instant, LoadOrder, Mailbox, MemoryWindow, Messenger, Processor, SingleContext, StoreOrder,
    Windows, layout,
};

use super::Tally;
use super::attack::Attack;
use super::memory::{Bell, Watched};
use super::model::Model;

/// The number of processors of the system; number [`HOSTILE`] is the hostile one.
pub(super) const N: usize = 3;
pub(super) const HOSTILE: usize = 1;
/// The size in bytes of the users' part of each `data`.
pub(super) const USER_BYTES: u32 = 512;

/// The time by which the clock moves when a program reads it.
const TICK_NS: u64 = 100;
/// The number of readings of the clock without a sleep after which the other programs get a turn.
const MOST_BUSY_TICKS: u32 = 64;
/// The greatest number of programs that run inside of each other.
const MOST_NESTED: u32 = 3;
/// The number of accesses that no program may reach between two readings of the clock.
const MOST_ACCESSES_PER_TICK: u64 = 10_000;
/// The time by which a call may return late, apart from the time for which the others ran on the same thread:
/// the call's own last poll, with the returns of the handlers that are nested in it.
const SLICE_NS: u64 = 200 * TICK_NS;

pub(super) type HonestMailbox = Mailbox<'static, (Watched, Bell, SingleContext), N>;

pub(super) struct World {
    /// The memory as the honest processors access it, behind caches in some runs.
    system: SimSystem<N>,
    /// The memory as the hostile processor accesses it.
    mails: [SimWindow; N],
    datas: [SimWindow; N],
    lost_mail: Cell<bool>,
    lost_data: Cell<bool>,
    ns: Cell<u64>,
    /// The time for which programs of others, which share the thread, ran past the end of a sleep.
    overrun_ns: Cell<u64>,
    /// The number of readings of the clock since a program slept. `in_background` is true while others run
    /// because of them.
    busy_ticks: Cell<u32>,
    in_background: Cell<bool>,
    nested: Cell<u32>,
    rings: [Cell<u64>; N],
    accesses: Cell<u64>,
    accesses_at_tick: Cell<u64>,
    attack: RefCell<Attack>,
    pub(super) model: RefCell<Model>,
    boxes: RefCell<[Option<Rc<RefCell<HonestMailbox>>>; N]>,
}

impl World {
    pub(super) fn new(attack: Attack, caches: Option<u64>) -> Rc<Self> {
        let system = SimSystem::in_virtual_time(USER_BYTES);
        let windows = system.windows(Processor(HOSTILE as u8));
        let system = match caches {
            Some(seed) => system.with_caches(seed),
            None => system,
        };
        Rc::new(Self {
            system,
            mails: windows.each_ref().map(|windows| windows.mail.clone()),
            datas: windows.map(|windows| windows.data),
            lost_mail: Cell::new(false),
            lost_data: Cell::new(false),
            ns: Cell::new(0),
            overrun_ns: Cell::new(0),
            busy_ticks: Cell::new(0),
            in_background: Cell::new(false),
            nested: Cell::new(0),
            rings: core::array::from_fn(|_| Cell::new(0)),
            accesses: Cell::new(0),
            accesses_at_tick: Cell::new(0),
            attack: RefCell::new(attack),
            model: RefCell::new(Model::new()),
            boxes: RefCell::default(),
        })
    }

    pub(super) fn tally(&self) -> Tally {
        let (handled, handled_of_hostile) = self.model.borrow().handled_in_all();
        Tally {
            states: self.attack.borrow().moves(),
            accesses: self.accesses.get(),
            handled,
            handled_of_hostile,
        }
    }

    pub(super) fn windows(self: &Rc<Self>, user: usize) -> [Windows<Watched>; N] {
        let mut owner = 0;
        self.system.windows(Processor(user as u8)).map(|windows| {
            let number = owner;
            owner += 1;
            let watched = |object, inner: SimWindow| Watched {
                world: Rc::clone(self),
                user,
                owner: number,
                object,
                inner,
            };
            Windows {
                mail: watched(MemoryObject::Mail, windows.mail),
                data: watched(MemoryObject::Data, windows.data),
            }
        })
    }

    pub(super) fn bell(self: &Rc<Self>, user: usize) -> Bell {
        let world = Rc::clone(self);
        Bell { world, user }
    }

    /// Puts `mailbox` in the place of `number`: its program runs whenever another one sleeps.
    pub(super) fn put_mailbox(&self, number: usize, mailbox: Option<HonestMailbox>) {
        let seated = mailbox.map(|mailbox| Rc::new(RefCell::new(mailbox)));
        let former = core::mem::replace(&mut self.boxes.borrow_mut()[number], seated);
        drop(former);
    }

    pub(super) fn mailbox(&self, number: usize) -> Rc<RefCell<HonestMailbox>> {
        let seated = self.boxes.borrow()[number].clone();
        seated.expect("the script only uses processors that are there")
    }

    /// Lets the program of `number` serve its messages once, unless it is inside of an exclusive call.
    pub(super) fn run_program(&self, number: usize) -> usize {
        let Some(seated) = self.boxes.borrow()[number].clone() else {
            return 0;
        };
        let Ok(mailbox) = seated.try_borrow() else {
            return 0;
        };
        // Each program may run while the other one sleeps, and a full ring of handlers sleeps each time.
        let nested = self.nested.get();
        if nested >= MOST_NESTED {
            return 0;
        }
        self.nested.set(nested + 1);
        let served = mailbox
            .serve(Duration::ZERO)
            .expect("who serves is not harmed by others");
        self.nested.set(nested);
        served
    }

    // The memory that the hostile processor can reach.

    pub(super) fn mail_word(&self, owner: usize, offset: u32) -> u32 {
        let loaded = self.mails[owner].load(offset, LoadOrder::Relaxed);
        loaded.expect("inside")
    }

    pub(super) fn set_mail_word(&self, offset: u32, value: u32) {
        let stored = self.mails[HOSTILE].store(offset, value, StoreOrder::Relaxed);
        stored.expect("inside");
    }

    pub(super) fn set_data_word(&self, owner: usize, offset: u32, value: u32) {
        let stored = self.datas[owner].store(offset, value, StoreOrder::Relaxed);
        stored.expect("inside");
    }

    pub(super) fn lose(&self, object: MemoryObject, lost: bool) {
        match object {
            MemoryObject::Mail => self.lost_mail.set(lost),
            MemoryObject::Data => self.lost_data.set(lost),
        }
    }

    pub(super) fn is_lost(&self, owner: usize, object: MemoryObject) -> bool {
        owner == HOSTILE
            && match object {
                MemoryObject::Mail => self.lost_mail.get(),
                MemoryObject::Data => self.lost_data.get(),
            }
    }

    /// Stops the moves of the hostile processor, or lets them go on.
    pub(super) fn pause_attack(&self, pause: bool) {
        self.attack.borrow_mut().pause(pause);
    }

    pub(super) fn stop_attack(&self) {
        self.pause_attack(true);
        self.lose(MemoryObject::Mail, false);
        self.lose(MemoryObject::Data, false);
    }

    /// Lets the hostile processor begin as if it were honest.
    pub(super) fn behave_first(&self) {
        Attack::behave(self);
    }

    /// Clears the hostile `mail` before an honest program takes its number; keeps the number of its latest
    /// incarnation if `keep_incarnation`.
    pub(super) fn wipe_hostile_mail(&self, keep_incarnation: bool) {
        for offset in (0..layout::mail_bytes(N as u32)).step_by(4) {
            if !(keep_incarnation && offset == layout::header::LAST_INCARNATION) {
                self.set_mail_word(offset, 0);
            }
        }
    }

    /// Counts an access that an honest processor is about to make, and lets the hostile one move.
    pub(super) fn step(&self) {
        self.accesses.set(self.accesses.get() + 1);
        assert!(
            self.accesses.get() - self.accesses_at_tick.get() < MOST_ACCESSES_PER_TICK,
            "a look does not end"
        );
        self.attack.borrow_mut().step(self);
    }

    pub(super) fn stored(&self, owner: usize, offset: u32, value: u32, order: StoreOrder) {
        let mut model = self.model.borrow_mut();
        model.stored(owner, offset, value, order, |word| {
            self.mail_word(owner, word)
        });
    }

    // Time and doorbells.

    pub(super) fn tick(&self, user: usize) -> Instant {
        self.accesses_at_tick.set(self.accesses.get());
        self.ns.set(self.ns.get() + TICK_NS);
        let ticks = self.busy_ticks.get() + 1;
        self.busy_ticks.set(ticks % MOST_BUSY_TICKS);
        // A program that is kept busy does not keep the others from running; but they do not nest because of
        // it.
        if ticks == MOST_BUSY_TICKS && !self.in_background.replace(true) {
            let begun = self.ns.get();
            self.run_others(user);
            let passed = self.ns.get() - begun;
            self.overrun_ns.set(self.overrun_ns.get() + passed);
            self.in_background.set(false);
        }
        Instant::from_ns(self.ns.get())
    }

    fn run_others(&self, user: usize) {
        for other in (0..N).filter(|other| *other != user) {
            self.run_program(other);
        }
    }

    pub(super) fn ring(&self, number: usize) {
        if let Some(rings) = self.rings.get(number) {
            rings.set(rings.get() + 1);
        }
    }

    pub(super) fn rings(&self, number: usize) -> u64 {
        self.rings[number].get()
    }

    pub(super) fn sleep(&self, user: usize, seen: u64, until: Instant) {
        if self.rings(user) != seen {
            return;
        }
        self.step();
        self.run_others(user);
        self.busy_ticks.set(0);
        let late = self.ns.get().saturating_sub(until.as_ns());
        self.overrun_ns.set(self.overrun_ns.get() + late);
        if self.rings(user) == seen {
            self.ns.set(self.ns.get().max(until.as_ns()));
        }
    }

    /// Checks that `call` returns at `timeout` from now, or at `enclosing`, at the latest.
    pub(super) fn within<R>(
        &self,
        timeout: Duration,
        enclosing: Instant,
        call: impl FnOnce() -> R,
    ) -> R {
        let begun = self.ns.get();
        let overrun = self.overrun_ns.get();
        let outcome = call();
        let deadline = Instant::from_ns(begun).after(timeout).min(enclosing);
        let excused = self.overrun_ns.get() - overrun + SLICE_NS;
        let late = self.ns.get().saturating_sub(deadline.as_ns().max(begun));
        assert!(
            late <= excused,
            "returned {late} ns after its deadline, of which {excused} are excused"
        );
        outcome
    }
}
