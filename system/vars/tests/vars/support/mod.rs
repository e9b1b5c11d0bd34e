//! An owner with a loop, and those who watch it, in one simulated system.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use condor_mbox::layout::header::INCARNATION;
use condor_mbox::sim::{SimMailbox, SimSystem, SimWindow};
use condor_mbox::{
    Allocator, Call, CriticalSection, Doorbell, Evidence, Exchange, Instant, LoadOrder,
    MemoryWindow, Messenger, Processor, Region,
};
use condor_vars::{
    Catalog, Respond, Sampler, Selections, VARS, VariableClient, VariableServer, VariableSettings,
    VariableTable, answer,
};

pub(crate) const OWNER: Processor = Processor(0);
pub(crate) const PROCESSORS: usize = 4;
pub(crate) const SLOTS: usize = 2;
const CAPACITY: usize = 8;
pub(crate) const TIMEOUT: Duration = Duration::from_millis(5);
const BYTES: u32 = 1 << 14;

pub(crate) type Window = SimWindow;
pub(crate) type Post = SimMailbox<'static, PROCESSORS>;
pub(crate) type Asker<'m> = VariableClient<'m, Post, Window>;
pub(crate) type Loop = Sampler<'static, Window, CAPACITY>;
type Handler = VariableServer<'static, Window, CriticalSection, CAPACITY>;

/// A system in virtual time. What its owner's mailbox borrows is never freed.
pub(crate) struct Rig {
    pub(crate) system: SimSystem<PROCESSORS>,
    server: &'static Mutex<Option<&'static Handler>>,
    lives: &'static (dyn Fn(Processor) -> u32 + Sync),
}

impl Rig {
    pub(crate) fn new() -> Self {
        let system = SimSystem::in_virtual_time(BYTES);
        let server: &Mutex<Option<&'static Handler>> = Box::leak(Box::default());
        let data = system.windows(OWNER);
        let data = data.map(|windows| Region::users(windows.data).unwrap());
        let handler = Box::leak(Box::new(move |call: &Call<'_>| {
            let server = *server.lock().unwrap_or_else(PoisonError::into_inner);
            let servers = server.map(|server| server as &dyn Respond);
            answer(call, &data[call.sender().index()], servers.as_slice())
        }));
        let mut owner = system.mailbox(OWNER).unwrap();
        owner.set_vector(VARS, handler, "variables").unwrap();
        owner.join().unwrap();
        system.while_waiting(OWNER, move || {
            owner.serve(Duration::ZERO).unwrap();
        });
        let mails = system.windows(OWNER).map(|windows| windows.mail);
        let bell = system.doorbell(OWNER);
        let lives = Box::leak(Box::new(move |processor: Processor| {
            if bell.evidence(processor) == Evidence::Dead {
                return 0;
            }
            let mail = &mails[processor.index()];
            mail.load(INCARNATION, LoadOrder::Acquire).unwrap()
        }));
        Self {
            system,
            server,
            lives,
        }
    }

    pub(crate) fn users(&self) -> Region<Window> {
        let [windows, ..] = self.system.windows(OWNER);
        Region::users(windows.data).unwrap()
    }

    /// Starts the owner's program, or starts it anew.
    pub(crate) fn start(&self, catalog: Catalog<'static>, rows: u32) -> Loop {
        let own = self.users();
        let mut allocator = Allocator::new(own.size());
        let selections = Box::leak(Box::new(Selections::new()));
        let rate = (400, 1);
        let watchers = SLOTS as u32;
        let settings = VariableSettings {
            rate,
            rows,
            watchers,
        };
        let (server, sampler) = selections
            .open(
                catalog,
                &own,
                &mut allocator,
                &settings,
                CriticalSection,
                self.lives,
            )
            .unwrap();
        assert_eq!(server.offset(), 0);
        *self.server.lock().unwrap() = Some(Box::leak(Box::new(server)));
        sampler
    }

    pub(crate) fn table(&self) -> VariableTable<Window> {
        VariableTable::open(&self.users(), 0).unwrap()
    }

    /// The mailbox of a watcher that has just started.
    pub(crate) fn join(&self, number: Processor) -> Post {
        let mut mailbox = self.system.mailbox(number).unwrap();
        mailbox.join().unwrap();
        mailbox.wait_for_peer(OWNER, None, TIMEOUT).unwrap();
        mailbox
    }

    pub(crate) fn client<'m>(&self, mailbox: &'m Post) -> Asker<'m> {
        let windows = self.system.windows(mailbox.number());
        let own = Region::users(windows[mailbox.number().index()].data.clone()).unwrap();
        let mut allocator = Allocator::new(own.size());
        VariableClient::new(mailbox, own, &mut allocator, OWNER, VARS).unwrap()
    }
}

/// Asks with words of one's own choice.
pub(crate) fn ask(mailbox: &Post, request: [u32; 8]) -> [u32; 8] {
    let own = mailbox.region(mailbox.number()).unwrap();
    let mut allocator = Allocator::new(own.size());
    let mut exchange = Exchange::new(mailbox, own, &mut allocator).unwrap();
    exchange.call(OWNER, VARS, &request, TIMEOUT).unwrap()
}

/// A whole tick without a body.
pub(crate) fn tick(sampler: &mut Loop, number: u64) {
    sampler.begin().unwrap();
    sampler.end(number, released(number)).unwrap();
}

/// When a tick is released.
pub(crate) const fn released(tick: u64) -> Instant {
    Instant::from_ns(2_500_000 * tick)
}
