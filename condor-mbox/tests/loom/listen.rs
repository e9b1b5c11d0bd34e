//! Loom on listening: a third processor takes part in a stream.

use std::mem::forget;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::model::*;
use condor_mbox::{Call, Handler, Messenger, Processor};

const C: Processor = Processor(2);

type Log = Arc<Mutex<Vec<(u32, u32)>>>;

fn noting(log: &Log) -> Handler<'static> {
    let log = Arc::clone(log);
    Box::leak(Box::new(move |call: &Call<'_>| {
        log.lock()
            .unwrap()
            .push((u32::from(call.vector().0), call.data()));
        0
    }))
}

/// C hears A's messages to B, which A sends without waiting for it, so that it is overrun: what it
/// hears is whole, in order and at most once, and what it does not hear it is told of.
/// Bound 1: 9205 executions, 9 s (bound 3 does not end in four minutes).
#[test]
fn an_overrun_listener_knows_what_it_missed() {
    explore("overrun listener", 1, || {
        let log = Log::default();
        let (hear, ignore): (_, Handler<'static>) = (noting(&log), &|_| 0);
        let system = System::<3>::new();
        let a = system.joined::<Spinning, _>(A, Alone, &[]);
        let b = system.joined::<Spinning, _>(B, Alone, &[(V, ignore), (W, ignore)]);
        let mut c = system.joined::<Helped, _>(C, Alone, &[]);
        c.set_listener(hear);
        connect(&a, &b);
        let b = Arc::new(b);
        let holder = Arc::clone(&b);
        c.doorbell().by(Some(Box::new(move || {
            holder.serve(Duration::ZERO).unwrap();
        })));
        c.listen(Some(B), LONG).unwrap();
        c.doorbell().by(None);
        let c = Arc::new(c);
        let listener = Arc::clone(&c);
        let thread = loom::thread::spawn(move || {
            for _ in 0..2 {
                listener.serve(Duration::ZERO).unwrap();
                loom::thread::yield_now();
            }
        });
        for data in 1..=5 {
            // Odd ones to V, even ones to W.
            let vector = if data % 2 == 1 { V } else { W };
            a.send(B, vector, data, Duration::ZERO).unwrap();
            b.serve(Duration::ZERO).unwrap();
        }
        thread.join().unwrap();
        c.serve(Duration::ZERO).unwrap();
        let log = log.lock().unwrap();
        assert!(log.windows(2).all(|two| two[0].1 < two[1].1), "{log:?}");
        assert!(
            log.iter().all(|&(vector, data)| vector == 1 - data % 2),
            "{log:?}"
        );
        assert_eq!(
            log.len() as u32 + c.missed(A).unwrap(),
            5,
            "{log:?} {:?}",
            c.missed(A)
        );
    });
}

/// A is killed and begins another incarnation while C listens to B and hears the former one: what C hears
/// is whole and at most once. Bound 3: 15 796 executions, 23 s.
#[test]
fn a_sender_that_restarts_is_heard_once() {
    explore("listener, sender restarts", 3, || {
        let log = Log::default();
        let (hear, ignore): (_, Handler<'static>) = (noting(&log), &|_| 0);
        let system = System::<3>::new();
        let a = system.joined::<Spinning, _>(A, Alone, &[]);
        let b = system.joined::<Spinning, _>(B, Alone, &[(V, ignore), (W, ignore)]);
        let mut c = system.joined::<Helped, _>(C, Alone, &[]);
        c.set_listener(hear);
        connect(&a, &b);
        let b = Arc::new(b);
        let holder = Arc::clone(&b);
        c.doorbell().by(Some(Box::new(move || {
            holder.serve(Duration::ZERO).unwrap();
        })));
        c.listen(Some(B), LONG).unwrap();
        c.doorbell().by(None);
        let c = Arc::new(c);
        a.send(B, V, 1, Duration::ZERO).unwrap();
        let listener = Arc::clone(&c);
        let thread = loom::thread::spawn(move || {
            listener.serve(Duration::ZERO).unwrap();
        });
        forget(a);
        let a = system.joined::<Spinning, _>(A, Alone, &[]);
        connect(&a, &b);
        // The first of this incarnation, with the other vector.
        a.send(B, W, 2, Duration::ZERO).unwrap();
        thread.join().unwrap();
        c.serve(Duration::ZERO).unwrap();
        let log = log.lock().unwrap();
        assert!(matches!(log[..], [(0, 1), (1, 2)] | [(1, 2)]), "{log:?}");
    });
}
