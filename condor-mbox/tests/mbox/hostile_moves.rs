//! Single moves of a hostile peer that once did harm, each with the promise that it broke.

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use condor_mbox::exchange::ExchangeError;
use condor_mbox::layout::{self, SLOTS, entry, header};
use condor_mbox::sim::{SimMailbox, SimSystem, SimWindow};
use condor_mbox::{
    Allocator, Clock, Exchange, LoadOrder, MailboxError, MemoryWindow, Messenger, Processor,
    StoreOrder, Vector,
};

const HOST: Processor = Processor(0);
const HOSTILE: Processor = Processor(1);
const OTHER: Processor = Processor(2);
const V: Vector = Vector(12);
const MILLISECOND: Duration = Duration::from_millis(1);
const SECOND: Duration = Duration::from_secs(1);
const SEND: u32 = 1 << 8;
const LISTEN: u32 = 3 << 8;

/// The hostile processor's own `mail`, and what it reads in those of the others.
struct Hostile {
    mails: [SimWindow; 3],
}

impl Hostile {
    fn of(system: &SimSystem<3>) -> Self {
        let mails = system.windows(HOSTILE).map(|windows| windows.mail);
        Self { mails }
    }

    fn set(&self, offset: u32, word: u32) {
        let stored = self.mails[1].store(offset, word, StoreOrder::Release);
        stored.unwrap();
    }

    fn word(&self, of: Processor, offset: u32) -> u32 {
        let loaded = self.mails[of.index()].load(offset, LoadOrder::Acquire);
        loaded.unwrap()
    }

    /// Looks joined, in `incarnation`, to everybody who looks.
    fn live(&self, incarnation: u32) {
        let data_bytes = layout::BELL_BYTES + 4096;
        for (offset, word) in [
            (header::MAGIC, layout::MAGIC),
            (header::VERSION, layout::VERSION),
            (header::PROCESSORS, 3),
            (header::NUMBER, 1),
            (header::SLOTS, SLOTS),
            (header::VECTORS, layout::VECTORS as u32),
            (header::DATA_SIZE, data_bytes),
            (header::INCARNATION, incarnation),
        ] {
            self.set(offset, word);
        }
        for peer in [HOST, OTHER] {
            let acknowledged = layout::acknowledged(3, u32::from(peer.0));
            self.set(acknowledged, self.word(peer, header::INCARNATION));
        }
    }

    /// Writes a request to `to` into its ring.
    fn request(&self, to: Processor, sequence: u32, epoch: u32, kind: u32) {
        let slot = layout::slot(3, u32::from(to.0), sequence);
        self.set(slot + entry::VALUE, 0);
        self.set(slot + entry::EPOCH, epoch);
        self.set(slot + entry::KIND, kind);
        self.set(slot + entry::SEQUENCE, sequence);
    }

    /// Makes everything zero, as a cleared file is.
    fn wipe(&self) {
        for offset in (0..layout::mail_bytes(3)).step_by(4) {
            self.set(offset, 0);
        }
    }
}

fn joined(system: &SimSystem<3>, number: Processor) -> SimMailbox<'static, 3> {
    let mut mailbox = system.mailbox(number).unwrap();
    mailbox.set_vector(V, &|call| call.data(), "echo").unwrap();
    mailbox.join().unwrap();
    mailbox
}

/// Runs a mailbox while others wait, until it is dropped.
struct Attended {
    system: SimSystem<3>,
    number: Processor,
}

impl Drop for Attended {
    fn drop(&mut self) {
        // The program holds its mailbox, and that the system.
        self.system.kill(self.number);
    }
}

fn attend(system: &SimSystem<3>, mailbox: SimMailbox<'static, 3>) -> Attended {
    let attended = Attended {
        system: system.clone(),
        number: mailbox.number(),
    };
    system.while_waiting(mailbox.number(), move || {
        mailbox.serve(Duration::ZERO).unwrap();
    });
    attended
}

fn system() -> SimSystem<3> {
    SimSystem::in_virtual_time(4096)
}

#[test]
fn epoch_zero_is_no_epoch() {
    static RAN: AtomicU32 = AtomicU32::new(0);
    let system = system();
    let mut host = system.mailbox(HOST).unwrap();
    host.set_vector(V, &|_| RAN.fetch_add(1, Ordering::Relaxed), "counts")
        .unwrap();
    host.join().unwrap();
    // Nobody has joined there, and there is not even a layout.
    Hostile::of(&system).request(HOST, 1, 0, SEND | u32::from(V.0));
    assert_eq!(host.serve(Duration::ZERO), Ok(0));
    assert_eq!(RAN.load(Ordering::Relaxed), 0);
}

#[test]
fn a_request_to_listen_is_no_message() {
    let system = system();
    let host = joined(&system, HOST);
    let hostile = Hostile::of(&system);
    hostile.live(1);
    host.serve(Duration::ZERO).unwrap();
    let epoch = layout::epoch(1, hostile.word(HOST, header::INCARNATION));
    hostile.request(HOST, 1, epoch, LISTEN | u32::from(V.0));
    assert_eq!(host.serve(Duration::ZERO), Ok(1));
    let statistics = host.vector_statistics(HOST, V).unwrap();
    assert_eq!((statistics.handled, statistics.worst_ns), (0, 0));
}

#[test]
fn lost_memory_of_one_does_not_keep_others_from_listening() {
    let system = system();
    let host = joined(&system, HOST);
    let _attended = attend(&system, joined(&system, OTHER));
    system.windows(HOSTILE)[1].mail.lose();
    assert_eq!(host.listen(Some(OTHER), SECOND), Ok(()));
}

#[test]
fn listen_ends_by_its_timeout_as_a_whole() {
    let system = system();
    let host = joined(&system, HOST);
    let hostile = Hostile::of(&system);
    hostile.live(1);
    host.serve(Duration::ZERO).unwrap();
    // Its ring is full, so nothing can even be asked.
    for _ in 0..SLOTS {
        host.send(HOSTILE, V, 0, Duration::ZERO).unwrap();
    }
    // Half of the time later there is room, but nobody admits us.
    let begun = host.doorbell().now();
    let taken = layout::taken(3, 0);
    let moves = Hostile::of(&system);
    let clock = system.doorbell(HOSTILE);
    system.while_waiting(HOSTILE, move || {
        if clock.now() >= begun.after(MILLISECOND / 2) {
            moves.set(taken, SLOTS);
        }
    });
    host.listen(Some(HOSTILE), MILLISECOND).unwrap_err();
    system.kill(HOSTILE);
    let passed = host.doorbell().now().ns_since(begun);
    assert!(passed < 1_100_000, "{passed} ns");
}

#[test]
fn cleared_memory_does_not_begin_an_incarnation_that_others_hold_for_current() {
    let system = system();
    let host = joined(&system, HOST);
    let former = joined(&system, HOSTILE);
    for _ in 0..2 {
        host.serve(Duration::ZERO).unwrap();
        former.serve(Duration::ZERO).unwrap();
    }
    for _ in 0..2 * SLOTS {
        host.send(HOSTILE, V, 0, Duration::ZERO).unwrap();
        former.serve(Duration::ZERO).unwrap();
    }
    drop(former);
    Hostile::of(&system).wipe();
    let _attended = attend(&system, joined(&system, HOSTILE));
    // Nobody looked meanwhile.
    assert_eq!(host.send_with_reply(HOSTILE, V, 5, SECOND), Ok(5));
}

#[test]
fn an_incarnation_that_comes_back_finds_nothing_of_its_own() {
    let system = system();
    let host = joined(&system, HOST);
    let hostile = Hostile::of(&system);
    hostile.live(7);
    host.serve(Duration::ZERO).unwrap();
    host.send(HOSTILE, V, 0, Duration::ZERO).unwrap();
    hostile.live(9);
    host.serve(Duration::ZERO).unwrap();
    hostile.wipe();
    hostile.set(header::LAST_INCARNATION, 6);
    let honest = joined(&system, HOSTILE);
    assert_eq!(hostile.word(HOSTILE, header::INCARNATION), 7);
    assert_eq!(honest.serve(Duration::ZERO), Ok(0));
}

#[test]
fn a_listener_that_falls_behind_on_purpose_costs_no_reply() {
    let system = system();
    let host = joined(&system, HOST);
    let other = joined(&system, OTHER);
    let hostile = Hostile::of(&system);
    hostile.live(1);
    other.serve(Duration::ZERO).unwrap();
    let epoch = layout::epoch(1, hostile.word(OTHER, header::INCARNATION));
    hostile.request(OTHER, 1, epoch, LISTEN);
    assert_eq!(other.serve(Duration::ZERO), Ok(1));
    let _attended = attend(&system, other);
    let lives = [HOST, OTHER].map(|number| hostile.word(number, header::INCARNATION));
    let listen = layout::listen(u32::from(HOST.0));
    hostile.set(listen, layout::epoch(lives[0], lives[1]));
    for round in 0..30 {
        // In time now and then, so that it is waited for again.
        hostile.set(listen + 4, if round % 2 == 0 { round } else { 0 });
        assert_eq!(host.send_with_reply(OTHER, V, 3, MILLISECOND), Ok(3));
    }
}

#[test]
fn an_exchange_that_was_refused_is_not_in_doubt() {
    let system = system();
    let host = joined(&system, HOST);
    let _attended = attend(&system, joined(&system, OTHER));
    let region = host.region(HOST).unwrap();
    let mut exchange =
        Exchange::<_, _, u32, u32>::new(&host, region, &mut Allocator::new(region.size())).unwrap();
    let missing = Vector(3);
    for _ in 0..2 {
        assert_eq!(
            exchange.call(OTHER, missing, &1, SECOND),
            Err(ExchangeError::Mailbox(MailboxError::NoHandler {
                to: OTHER,
                vector: missing
            }))
        );
    }
}
