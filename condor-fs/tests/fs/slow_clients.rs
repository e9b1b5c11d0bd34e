//! Who does not say where its table of open files is, or says so late, keeps nobody else waiting.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use crate::support::{CLIENT, N, OTHER, SERVER, disk, system};
use condor_fs::Errno;
use condor_fs::server::{FileServer, ServerOptions};
use condor_fs::wire::{self, FILES, OPEN_FILES, Operation, RequestSlot, Span, slot, state, table};
use condor_mbox::linux::{LinuxDoorbell, LinuxMailbox, LinuxWindow};
use condor_mbox::{
    Allocator, Call, Clock, Doorbell, Evidence, Instant, Mailbox as AnyMailbox, MemoryWindow,
    Messenger, Processor, Region, SingleContext, Waiting, Windows,
};

/// A doorbell that counts how often its mailbox waits.
struct Counting<'c> {
    bell: LinuxDoorbell<N>,
    waits: &'c AtomicU32,
}

impl Clock for Counting<'_> {
    fn now(&self) -> Instant {
        self.bell.now()
    }
}

impl Doorbell for Counting<'_> {
    type Seen = <LinuxDoorbell<N> as Doorbell>::Seen;

    fn ring(&self, processor: Processor) {
        self.bell.ring(processor);
    }

    fn prepare(&self) -> Self::Seen {
        self.bell.prepare()
    }

    fn wait(&self, seen: Self::Seen, until: Instant, whom: Option<Processor>) {
        self.waits.fetch_add(1, Ordering::Relaxed);
        self.bell.wait(seen, until, whom);
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        self.bell.evidence(processor)
    }
}

/// Writes a request to unlink what does not exist, which needs the table, and a table without files.
fn ask_to_unlink(windows: &Windows<LinuxWindow>) -> Asked {
    let own = Region::users(windows.data.clone()).unwrap();
    let mut allocator = Allocator::new(own.size());
    let [slot, table, path] =
        [slot::BYTES, table::BYTES, 8].map(|it| allocator.bytes(it as usize).unwrap());
    own.write(path, b"none").unwrap();
    own.set_word(table, table::MAGIC).unwrap();
    for (at, word) in [(4, 0), (8, 0), (12, wire::block::BYTES)] {
        own.set_word(table + at, word).unwrap();
    }
    let request = RequestSlot {
        session: 7,
        sequence: 1,
        operation: Operation::Unlink as u32,
        path: Span {
            offset: path,
            len: 4,
        },
        ..RequestSlot::default()
    };
    own.set_word(slot + slot::STATE, state::NONE).unwrap();
    for (word, n) in request.to_words().into_iter().zip(0..) {
        own.set_word(slot + 4 * n, word).unwrap();
    }
    Asked { own, slot, table }
}

struct Asked {
    own: Region<LinuxWindow>,
    slot: u32,
    table: u32,
}

#[test]
fn nobody_waits_for_who_does_not_answer() {
    let disk = disk();
    let system = system();
    let waits = AtomicU32::new(0);
    let server = FileServer::new(disk.path(), ServerOptions::default()).unwrap();
    let (windows, bell) = system.claim(SERVER).unwrap().into_parts();
    let requests = [CLIENT, OTHER].map(|client| ask_to_unlink(&windows[client.index()]));
    let handler = |call: &Call<'_>| server.answer(call, &windows);
    let bell = Counting {
        bell,
        waits: &waits,
    };
    let alone = SingleContext::new();
    let mut host = AnyMailbox::<(_, _, _), N>::new(SERVER, windows.clone(), bell, alone).unwrap();
    // Whoever waits is counted at once.
    host.set_waiting(Waiting::Sleep);
    host.set_vector(FILES, &handler, "files").unwrap();
    host.join().unwrap();

    let answers = requests
        .each_ref()
        .map(|request| |_: &Call<'_>| request.table);
    let [silent, quick] = [(CLIENT, 0), (OTHER, 1)].map(|(number, n)| {
        let mut client = system.claim(number).unwrap().mailbox().unwrap();
        client
            .set_vector(OPEN_FILES, &answers[n], "open files")
            .unwrap();
        client.join().unwrap();
        client
    });
    // All of this is one thread: nobody can wait for anybody, and each serves when it is told to.
    let serve = |mailbox: &LinuxMailbox<'_, N>| mailbox.serve(Duration::ZERO).unwrap();
    let send = |client: &LinuxMailbox<'_, N>, n: usize| loop {
        match client.begin(SERVER, FILES, requests[n].slot, Duration::ZERO) {
            Ok(mut ticket) => {
                host.serve(Duration::ZERO).unwrap();
                break ticket.poll().unwrap();
            }
            // They have to notice each other first.
            Err(condor_mbox::MailboxError::NotConnected { .. }) => {
                host.serve(Duration::ZERO).unwrap();
            }
            Err(error) => panic!("{error}"),
        }
    };
    let again = Some(wire::REFUSED | u32::from(Errno::AGAIN.0));
    // It never serves, so that it does not hear the question either.
    assert_eq!(send(&silent, 0), again);
    assert_eq!(send(&quick, 1), again);
    serve(&quick);
    for _ in 0..20 {
        assert_eq!(send(&silent, 0), again);
        // Its answer has come.
        requests[1]
            .own
            .set_word(requests[1].slot + slot::STATE, state::NONE)
            .unwrap();
        assert_eq!(send(&quick, 1), Some(wire::DONE));
        let errno = requests[1]
            .own
            .word(requests[1].slot + slot::ERRNO)
            .unwrap();
        assert_eq!(errno, u32::from(Errno::NOENT.0));
    }
    assert_eq!(waits.load(Ordering::Relaxed), 0, "the server has waited");
    // It has been asked once, and is served as soon as it has answered.
    assert_eq!(serve(&silent), 1);
    assert_eq!(send(&silent, 0), Some(wire::DONE));
}
