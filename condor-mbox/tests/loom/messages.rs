//! Loom on whole mailboxes: messages, replies and sleeping.
//!
//! The bound stands at each model. Measured, release build, two busy cores: streams 1236 to 14 872
//! executions, 2 to 38 s; calls 2005 to 11 777, 2 to 16 s; nested calls 1317 to 8137, 3 to 14 s; two
//! contexts 32 119, 14 s; timeout against reply 50 696, 74 s.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::model::*;
use condor_mbox::{Call, Handler, Messenger};

/// A handler that lives as long as the program; every execution has its own.
fn handler(run: impl Fn(&Call<'_>) -> u32 + Sync + 'static) -> Handler<'static> {
    Box::leak(Box::new(run))
}

/// Two messages more than slots, to a receiver that sleeps, from a sender that sleeps while the
/// ring is full: nothing lost, nothing twice, in order, and nobody sleeps for ever.
fn stream<D: Bell<2>>(name: &str, preemptions: usize) {
    explore(name, preemptions, || {
        let heard = Arc::new(Mutex::new(Vec::new()));
        let log = Arc::clone(&heard);
        let hear = handler(move |call| {
            log.lock().unwrap().push(call.data());
            0
        });
        let system = System::<2>::new();
        let a = Arc::new(system.joined::<D, _>(A, Alone, &[]));
        let b = Arc::new(system.joined::<D, _>(B, Alone, &[(V, hear)]));
        connect(&a, &b);
        let sender = Arc::clone(&a);
        let thread = loom::thread::spawn(move || {
            for data in 1..=4 {
                sender.send(B, V, data, LONG).unwrap();
            }
        });
        let mut served = 0;
        while served < 4 {
            served += b.serve(LONG).unwrap();
        }
        thread.join().unwrap();
        assert_eq!(*heard.lock().unwrap(), [1, 2, 3, 4]);
    });
}

#[test]
fn stream_with_a_futex() {
    stream::<Futex<2>>("stream, futex", 2);
}

#[test]
fn stream_with_a_doorbell_that_remembers() {
    stream::<Pending<2>>("stream, pending", 2);
}

#[test]
fn stream_spinning() {
    stream::<Spinning>("stream, spin", 2);
}

/// Calls with reply, both ends asleep in between.
fn call<D: Bell<2>>(name: &str, preemptions: usize) {
    explore(name, preemptions, || {
        let double = handler(|call| call.data() * 2);
        let system = System::<2>::new();
        let a = Arc::new(system.joined::<D, _>(A, Alone, &[]));
        let b = Arc::new(system.joined::<D, _>(B, Alone, &[(V, double)]));
        connect(&a, &b);
        let sender = Arc::clone(&a);
        let thread = loom::thread::spawn(move || {
            for data in 1..=2 {
                assert_eq!(sender.send_with_reply(B, V, data, LONG), Ok(2 * data));
            }
        });
        let mut served = 0;
        while served < 2 {
            served += b.serve(LONG).unwrap();
        }
        thread.join().unwrap();
    });
}

#[test]
fn call_with_a_futex() {
    call::<Futex<2>>("call, futex", 2);
}

#[test]
fn call_with_a_doorbell_that_remembers() {
    call::<Pending<2>>("call, pending", 2);
}

#[test]
fn call_spinning() {
    call::<Spinning>("call, spin", 2);
}

/// A calls B, whose handler calls A: A serves while it waits.
fn nested<D: Bell<2>>(name: &str, preemptions: usize) {
    explore(name, preemptions, || {
        let ask_back = handler(|call| {
            let asked = call.send_with_reply(A, W, call.data() + 1, LONG);
            asked.unwrap() + 100
        });
        let own = handler(|call| call.data() * 2);
        let system = System::<2>::new();
        let a = Arc::new(system.joined::<D, _>(A, Alone, &[(W, own)]));
        let b = Arc::new(system.joined::<D, _>(B, Alone, &[(V, ask_back)]));
        connect(&a, &b);
        let sender = Arc::clone(&a);
        let thread = loom::thread::spawn(move || {
            assert_eq!(sender.send_with_reply(B, V, 1, LONG), Ok(104));
        });
        while b.serve(LONG).unwrap() == 0 {}
        thread.join().unwrap();
    });
}

#[test]
fn nested_with_a_futex() {
    nested::<Futex<2>>("nested, futex", 2);
}

#[test]
fn nested_with_a_doorbell_that_remembers() {
    nested::<Pending<2>>("nested, pending", 2);
}

/// Two contexts of one processor call at the same time; each gets its own reply.
#[test]
fn two_contexts_of_one_processor() {
    explore("two contexts", 2, || {
        let handled = Arc::new(AtomicU32::new(0));
        let count = Arc::clone(&handled);
        let double = handler(move |call| {
            count.fetch_add(1, Relaxed);
            call.data() * 2
        });
        let system = System::<2>::new();
        let a = Arc::new(system.joined::<Spinning, _>(A, Locked::new(), &[]));
        let b = Arc::new(system.joined::<Spinning, _>(B, Alone, &[(V, double)]));
        connect(&a, &b);
        let contexts = [1, 2].map(|data| {
            let a = Arc::clone(&a);
            loom::thread::spawn(move || {
                let mut ticket = a.begin(B, V, data, Duration::ZERO).unwrap();
                for _ in 0..2 {
                    match ticket.poll().unwrap() {
                        Some(reply) => assert_eq!(reply, 2 * data),
                        None => loom::thread::yield_now(),
                    }
                }
            })
        });
        b.serve(Duration::ZERO).unwrap();
        for context in contexts {
            context.join().unwrap();
        }
        b.serve(Duration::ZERO).unwrap();
        assert_eq!(handled.load(Relaxed), 2);
        // Both cells are free again, or their late replies have come.
        for _ in 0..2 {
            drop(a.begin(B, V, 0, Duration::ZERO).unwrap());
        }
    });
}

/// A caller gives up at any moment: the reply is right or absent, never believed later, and its
/// cell comes free.
#[test]
fn time_out_against_reply() {
    explore("timeout against reply", 3, || {
        let double = handler(|call| call.data() * 2);
        let system = System::<2>::new();
        let a = Arc::new(system.joined::<Spinning, _>(A, Alone, &[]));
        let b = Arc::new(system.joined::<Spinning, _>(B, Alone, &[(V, double)]));
        connect(&a, &b);
        let sender = Arc::clone(&a);
        let thread = loom::thread::spawn(move || {
            for data in 1..=4 {
                // With both slots given up and unanswered there is none.
                let Ok(mut ticket) = sender.begin(B, V, data, Duration::ZERO) else {
                    continue;
                };
                if let Some(reply) = ticket.poll().unwrap() {
                    assert_eq!(reply, 2 * data);
                }
            }
        });
        b.serve(Duration::ZERO).unwrap();
        b.serve(Duration::ZERO).unwrap();
        thread.join().unwrap();
        b.serve(Duration::ZERO).unwrap();
        let mut tickets = [5, 6].map(|data| (data, a.begin(B, V, data, Duration::ZERO).unwrap()));
        b.serve(Duration::ZERO).unwrap();
        for (data, ticket) in &mut tickets {
            assert_eq!(ticket.poll(), Ok(Some(*data * 2)));
        }
    });
}
