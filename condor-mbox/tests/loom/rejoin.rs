//! Loom on lives: a processor restarts while the other one sends, calls or serves.
//!
//! The bound stands at each model. Measured, release build: 7612 to 82 302 executions, 2 to 26 s
//! each, 59 s for all five.

use std::mem::forget;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::model::*;
use condor_mbox::{Call, Handler, MailboxError, Messenger};

type Log = Arc<Mutex<Vec<(u32, u32)>>>;

/// Notes (incarnation, data) of every message, and replies 100 times the incarnation plus the data.
fn noting(log: &Log, incarnation: u32) -> Handler<'static> {
    let log = Arc::clone(log);
    Box::leak(Box::new(move |call: &Call<'_>| {
        log.lock().unwrap().push((incarnation, call.data()));
        100 * incarnation + call.data()
    }))
}

/// Each message once, in order, and the lives in order, too.
fn check(log: &Log) {
    let log = log.lock().unwrap();
    assert!(log.is_sorted(), "{log:?}");
    assert!(log.windows(2).all(|two| two[0].1 < two[1].1), "{log:?}");
}

/// B is killed or leaves and begins another incarnation while A calls it without waiting. Every request
/// runs at most once, every reply is that of who ran it, and nobody is said to have broken the
/// protocol.
fn receiver_restarts(name: &str, leaves: bool) {
    explore(name, 2, move || {
        let log = Log::default();
        let (old, new) = (noting(&log, 1), noting(&log, 2));
        let system = System::<2>::new();
        let a = Arc::new(system.joined::<Spinning, _>(A, Alone, &[]));
        let b = system.joined::<Spinning, _>(B, Alone, &[(V, old)]);
        connect(&a, &b);
        // So far that the count of a new incarnation is out of reach.
        for data in 1..=4 {
            a.send(B, V, data, Duration::ZERO).unwrap();
            b.serve(Duration::ZERO).unwrap();
        }
        let (sender, seen) = (Arc::clone(&a), Arc::clone(&log));
        let thread = loom::thread::spawn(move || {
            for data in 5..=7 {
                let mut ticket = match sender.begin(B, V, data, Duration::ZERO) {
                    Ok(ticket) => ticket,
                    Err(MailboxError::NotConnected { .. } | MailboxError::NoSlot { .. }) => {
                        continue;
                    }
                    Err(error) => panic!("{error}"),
                };
                match ticket.poll() {
                    Ok(Some(reply)) => {
                        let ran = (reply / 100, reply % 100);
                        assert_eq!(ran.1, data);
                        assert!(seen.lock().unwrap().contains(&ran));
                    }
                    Ok(None) => loom::thread::yield_now(),
                    Err(MailboxError::PeerRestarted { .. }) => {}
                    Err(MailboxError::PeerLeft { .. }) if leaves => {}
                    Err(error) => panic!("{error}"),
                }
            }
        });
        b.serve(Duration::ZERO).unwrap();
        if leaves {
            drop(b);
        } else {
            forget(b);
        }
        let b = system.joined::<Spinning, _>(B, Alone, &[(V, new)]);
        b.serve(Duration::ZERO).unwrap();
        b.serve(Duration::ZERO).unwrap();
        thread.join().unwrap();
        connect(&b, &a);
        check(&log);
        let mut ticket = a.begin(B, V, 9, Duration::ZERO).unwrap();
        b.serve(Duration::ZERO).unwrap();
        assert_eq!(ticket.poll(), Ok(Some(209)));
    });
}

#[test]
fn receiver_is_killed_and_rejoins() {
    receiver_restarts("receiver killed", false);
}

#[test]
fn receiver_leaves_and_rejoins() {
    receiver_restarts("receiver leaves", true);
}

/// A is killed and begins another incarnation while B serves it: no request of its former incarnation runs
/// after one of its present incarnation, and none twice.
#[test]
fn sender_is_killed_and_rejoins() {
    explore("sender killed", 2, || {
        let log = Log::default();
        let hear = noting(&log, 0);
        let system = System::<2>::new();
        let a = system.joined::<Spinning, _>(A, Alone, &[]);
        let b = Arc::new(system.joined::<Spinning, _>(B, Alone, &[(V, hear)]));
        connect(&a, &b);
        let server = Arc::clone(&b);
        let thread = loom::thread::spawn(move || {
            for _ in 0..3 {
                server.serve(Duration::ZERO).unwrap();
                loom::thread::yield_now();
            }
        });
        for data in 1..=2 {
            a.send(B, V, data, Duration::ZERO).unwrap();
        }
        forget(a);
        let a = system.joined::<Spinning, _>(A, Alone, &[]);
        for data in 3..=5 {
            match a.send(B, V, data, Duration::ZERO) {
                Ok(()) | Err(MailboxError::NotConnected { .. } | MailboxError::NoSlot { .. }) => {}
                Err(error) => panic!("{error}"),
            }
            loom::thread::yield_now();
        }
        thread.join().unwrap();
        connect(&a, &b);
        check(&log);
        let mut ticket = a.begin(B, V, 9, Duration::ZERO).unwrap();
        b.serve(Duration::ZERO).unwrap();
        assert_eq!(ticket.poll(), Ok(Some(9)));
    });
}

/// A sleeps for a reply, or for B to join, while B leaves and begins another incarnation: it is woken.
fn sleeping_caller<D: Bell<2>>(name: &str) {
    explore(name, 1, || {
        let log = Log::default();
        let (old, new) = (noting(&log, 1), noting(&log, 2));
        let system = System::<2>::new();
        let a = Arc::new(system.joined::<D, _>(A, Alone, &[]));
        let b = system.joined::<D, _>(B, Alone, &[(V, old)]);
        connect(&a, &b);
        let sender = Arc::clone(&a);
        let thread = loom::thread::spawn(move || {
            match sender.send_with_reply(B, V, 5, LONG) {
                Ok(205)
                | Err(MailboxError::PeerLeft { .. } | MailboxError::PeerRestarted { .. }) => {}
                outcome => panic!("{outcome:?}"),
            }
            assert_eq!(sender.send_with_reply(B, V, 6, LONG), Ok(206));
        });
        drop(b);
        let b = system.joined::<D, _>(B, Alone, &[(V, new)]);
        while !log.lock().unwrap().contains(&(2, 6)) {
            b.serve(LONG).unwrap();
        }
        thread.join().unwrap();
        check(&log);
    });
}

#[test]
fn sleeping_caller_with_a_futex() {
    sleeping_caller::<Futex<2>>("caller sleeps, futex");
}

#[test]
fn sleeping_caller_with_a_doorbell_that_remembers() {
    sleeping_caller::<Pending<2>>("caller sleeps, pending");
}
