//! Memory that no hardware keeps coherent: what the simulated caches do not show by chance.
//!
//! All other tests of simulated systems run behind caches, too, if `CONDOR_SIM_CACHES` has a seed:
//! `CONDOR_SIM_CACHES=1 cargo test -p condor-mbox --test mbox`.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use condor_mbox::exchange::answer;
use condor_mbox::layout::LINE;
use condor_mbox::sim::{SimSystem, SimWindow};
use condor_mbox::spin_lock::{Bakery, Incarnations, LockOwner, NativeSwap};
use condor_mbox::window::{WindowError, WindowErrorKind};
use condor_mbox::{
    AccessError, Allocator, Call, CriticalSection, Exchange, LoadOrder, Mailbox, MemoryWindow,
    Messenger, Offset, Processor, Published, Region, SingleContext, SpinLock, StoreOrder, Vector,
    Windows,
};

const A: Processor = Processor(0);
const B: Processor = Processor(1);
const V: Vector = Vector(5);
const GENEROUS: Duration = Duration::from_secs(100);
const MESSAGES: u32 = 400;

/// Who wrote which lines: of an object, by its name.
type Writers = Arc<Mutex<BTreeMap<(String, u32), BTreeSet<u8>>>>;

/// A window that notes what its processor writes.
#[derive(Clone)]
struct Noting {
    inner: SimWindow,
    name: String,
    by: Processor,
    writers: Writers,
}

impl Noting {
    fn note(&self, offset: u32) {
        let mut writers = self.writers.lock().unwrap();
        let line = writers.entry((self.name.clone(), offset / LINE));
        line.or_default().insert(self.by.0);
    }
}

impl MemoryWindow for Noting {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.inner.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        self.inner.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.note(offset);
        self.inner.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.inner.check(offset, len)
    }
}

fn noting(system: &SimSystem<2>, by: Processor, writers: &Writers) -> [Windows<Noting>; 2] {
    let mut owner = 0;
    system.windows(by).map(|windows| {
        let noting = |object: &str, inner| Noting {
            inner,
            name: format!("{owner}.{object}"),
            by,
            writers: Arc::clone(writers),
        };
        let windows = Windows {
            mail: noting("mail", windows.mail),
            data: noting("data", windows.data),
        };
        owner += 1;
        windows
    })
}

/// Everybody lives.
struct All;

impl Incarnations for All {
    fn is_current(&self, _: LockOwner) -> bool {
        true
    }
}

#[test]
fn no_line_has_two_writers() {
    let writers = Writers::default();
    let system = SimSystem::<2>::in_virtual_time(8192).with_caches(7);
    let open = |by| {
        let (windows, bell) = (noting(&system, by, &writers), system.doorbell(by));
        Mailbox::<(_, _, _), 2>::new(by, windows, bell, CriticalSection).unwrap()
    };
    let data = noting(&system, B, &writers).map(|windows| Region::users(windows.data).unwrap());
    let double = |call: &Call<'_>| answer(call, &data[call.sender().index()], |q: u32| q * 2);
    let (mut a, mut b) = (open(A), open(B));
    b.set_vector(V, &double, "double").unwrap();
    b.join().unwrap();
    a.join().unwrap();
    a.set_waiting(condor_mbox::Waiting::Sleep);
    std::thread::scope(|threads| {
        let b = &b;
        let server = threads.spawn(move || {
            let mut served = 0;
            while served < 20 {
                served += b.serve(Duration::ZERO).unwrap();
                std::thread::yield_now();
            }
        });
        let own = a.region(A).unwrap();
        let mut allocator = Allocator::new(own.size());
        let mut exchange = Exchange::<_, _, u32, u32>::new(&a, own, &mut allocator).unwrap();
        for value in 0..20 {
            assert_eq!(exchange.call(B, V, &value, GENEROUS).unwrap(), value * 2);
        }
        server.join().unwrap();
    });

    let windows = noting(&system, A, &writers);
    let cell = Published::<[u32; 40]>::at(4096);
    let own = Region::users(windows[0].data.clone()).unwrap();
    let mut publisher = cell.publisher(own).unwrap();
    let theirs = Region::users(noting(&system, B, &writers)[0].data.clone()).unwrap();
    let subscriber = cell.subscriber(theirs).unwrap();
    for value in 1..10 {
        publisher.publish(&[value; 40]).unwrap();
        assert_eq!(subscriber.read().unwrap().value, [value; 40]);
    }

    // Its first line is handed over with the lock.
    let mut owner_line = None;
    for by in [A, B, A] {
        let window = noting(&system, by, &writers)[0].data.clone();
        let lock = SpinLock::new(Bakery::new(window, 6144, 2, SingleContext::new()).unwrap());
        let me = LockOwner::new(by, 1).unwrap();
        lock.try_lock(me, &All).unwrap().release().unwrap();
        owner_line = Some(("0.data".to_string(), 6144 / LINE));
    }
    for (line, by) in writers.lock().unwrap().iter() {
        assert!(
            by.len() == 1 || Some(line) == owner_line.as_ref(),
            "{line:?}: {by:?}"
        );
    }
}

#[test]
fn a_lock_of_one_word_is_refused() {
    let system = SimSystem::<2>::in_virtual_time(64).with_caches(1);
    let [windows, _] = system.windows(A);
    let refused = NativeSwap::new(windows.data, 0).map(drop).unwrap_err();
    assert_eq!(refused.kind, WindowErrorKind::NotCoherent);
    assert_eq!(refused.kind(), WindowErrorKind::NotCoherent);
}

/// Two threads behind caches of their own: a line that both wrote would lose what one of them wrote.
#[test]
#[cfg_attr(miri, ignore = "hours")]
fn threads_behind_caches_keep_the_promises() {
    for seed in 0..8 {
        let system = SimSystem::<2>::in_real_time(8192).with_caches(seed);
        let heard = Mutex::new(Vec::new());
        let number = |call: &Call<'_>| {
            heard.lock().unwrap().push(call.data());
            call.data() + 1
        };
        let mut b = system.mailbox(B).unwrap();
        b.set_vector(V, &number, "number").unwrap();
        b.join().unwrap();
        let mut a = system.mailbox(A).unwrap();
        a.join().unwrap();
        let counter = Offset::<u32>::at(4096);
        let count = |by: Processor| {
            let [windows, _] = system.windows(by);
            let ram = Region::users(windows.data).unwrap();
            let bakery = Bakery::new(&ram, 6080, 2, SingleContext::new()).unwrap();
            let lock = SpinLock::new(bakery);
            let me = LockOwner::new(by, 1).unwrap();
            let clock = system.doorbell(by);
            for _ in 0..100 {
                let guard = lock.lock(me, &All, &clock, GENEROUS).unwrap();
                let value = ram.get(counter).unwrap();
                ram.set(counter, &(value + 1)).unwrap();
                guard.release().unwrap();
            }
        };
        std::thread::scope(|threads| {
            let (b, count) = (&b, &count);
            threads.spawn(move || {
                let mut served = 0;
                while served < MESSAGES as usize {
                    served += b.serve(GENEROUS).unwrap();
                }
                count(B);
            });
            for data in 0..MESSAGES {
                if data % 2 == 0 {
                    a.send(B, V, data, GENEROUS).unwrap();
                } else {
                    let reply = a.send_with_reply(B, V, data, GENEROUS);
                    assert_eq!(reply, Ok(data + 1));
                }
            }
            count(A);
        });
        assert!(heard.lock().unwrap().iter().copied().eq(0..MESSAGES));
        let [windows, _] = system.windows(A);
        let ram = Region::users(windows.data).unwrap();
        assert_eq!(ram.get(counter), Ok(200), "seed {seed}");
    }
}
