//! A processor that looks only when its doorbell rings is rung for every request.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use condor_mbox::layout::SLOTS;
use condor_mbox::sim::{SimMailbox, SimSystem};
use condor_mbox::{Call, Doorbell, Messenger, Processor, Vector};

const A: Processor = Processor(0);
const B: Processor = Processor(1);
const V: Vector = Vector(7);

fn pair() -> (SimMailbox<'static, 2>, SimMailbox<'static, 2>) {
    let system = SimSystem::<2>::in_virtual_time(4096);
    let mut a = system.mailbox(A).unwrap();
    let mut b = system.mailbox(B).unwrap();
    b.set_vector(V, &|_| 0, "nothing").unwrap();
    a.join().unwrap();
    b.join().unwrap();
    b.serve(Duration::ZERO).unwrap();
    // Both have noticed each other, which rings too.
    a.send(B, V, 0, Duration::ZERO).unwrap();
    assert_eq!(b.serve(Duration::ZERO), Ok(1));
    (a, b)
}

fn rings(mailbox: &SimMailbox<'_, 2>) -> u64 {
    mailbox.doorbell().prepare()
}

#[test]
fn what_was_sent_before_rings_were_wanted_is_rung_for() {
    let (a, mut b) = pair();
    a.send(B, V, 0, Duration::ZERO).unwrap();
    let before = rings(&b);
    b.ring_always(true).unwrap();
    assert!(rings(&b) > before);
    b.ring_always(false).unwrap();
    let before = rings(&b);
    b.serve(Duration::ZERO).unwrap();
    assert_eq!(rings(&b), before);
}

#[test]
fn what_one_service_leaves_is_rung_for() {
    static FROM: OnceLock<SimMailbox<'static, 2>> = OnceLock::new();
    // Whoever serves is sent another message: there is no end.
    fn refill(_: &Call<'_>) -> u32 {
        u32::from(FROM.get().unwrap().send(B, V, 0, Duration::ZERO).is_ok())
    }
    let (a, mut b) = pair();
    b.clear_vector(V).unwrap();
    b.set_vector(V, &refill, "refill").unwrap();
    b.ring_always(true).unwrap();
    let before = rings(&b);
    a.send(B, V, 0, Duration::ZERO).unwrap();
    assert!(FROM.set(a).is_ok());
    let most = SLOTS;
    assert_eq!(b.serve(Duration::ZERO), Ok(most as usize));
    // One for each message that was sent, and one for the message that is left.
    assert_eq!(rings(&b), before + u64::from(1 + most) + 1);
}

#[test]
fn what_the_depth_refused_is_rung_for() {
    static DEEP: OnceLock<SimMailbox<'static, 2>> = OnceLock::new();
    static REFUSED: AtomicBool = AtomicBool::new(false);
    // An interrupt in each handler, which serves the next request or is refused.
    fn dive(call: &Call<'_>) -> u32 {
        let b = DEEP.get().unwrap();
        if call.data() < Call::MAX_DEPTH {
            b.send(B, V, call.data() + 1, Duration::ZERO).unwrap();
            let served = b.serve(Duration::ZERO).unwrap();
            REFUSED.fetch_or(served == 0, Ordering::Relaxed);
        }
        0
    }
    let (_a, mut b) = pair();
    b.clear_vector(V).unwrap();
    b.set_vector(V, &dive, "dive").unwrap();
    b.ring_always(true).unwrap();
    let before = rings(&b);
    b.send(B, V, 0, Duration::ZERO).unwrap();
    assert!(DEEP.set(b).is_ok());
    let b = DEEP.get().unwrap();
    b.serve(Duration::ZERO).unwrap();
    assert!(REFUSED.load(Ordering::Relaxed));
    let sent = u64::from(Call::MAX_DEPTH) + 1;
    assert!(rings(b) > before + sent);
}
