//! A peer that rewrites and truncates its real files, while two others call each other.
#![cfg(all(feature = "linux", not(miri)))]

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;
use std::time::Duration;

use condor_mbox::layout::{self, header};
use condor_mbox::linux::{LinuxDoorbell, LinuxSystem, LinuxWindow};
use condor_mbox::{CriticalSection, Mailbox, Messenger, Processor, Vector};

type Linux<'v> = Mailbox<'v, (LinuxWindow, LinuxDoorbell<3>, CriticalSection), 3>;

const HOST: Processor = Processor(0);
const HOSTILE: Processor = Processor(1);
const OTHER: Processor = Processor(2);
const V: Vector = Vector(12);
const AMPLE: Duration = Duration::from_secs(60);
const CALLS: u32 = 300;
const ROUNDS: u32 = 8;

fn join(system: &LinuxSystem<3>, number: Processor) -> Linux<'static> {
    let (windows, doorbell) = system.claim(number).unwrap().into_parts();
    let mut mailbox = Mailbox::new(number, windows, doorbell, CriticalSection).unwrap();
    mailbox
        .set_vector(V, &|call| !call.data(), "inverts")
        .unwrap();
    mailbox.join().unwrap();
    mailbox
}

/// Numbers that look like anything (xorshift).
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }
}

/// Rewrites words of `mail` and `data`, and takes parts of them away if `truncate`.
fn scribble(files: &[File; 2], truncate: bool, noise: &mut Noise) {
    let mail_bytes = layout::mail_bytes(3);
    let offset = match noise.next() % 4 {
        0 => header::INCARNATION,
        1 => layout::acknowledged(3, 0) + noise.next() % 128 / 4 * 4,
        _ => noise.next() % mail_bytes / 4 * 4,
    };
    let word = match noise.next() % 3 {
        0 => noise.next(),
        1 => noise.next() % 4,
        _ => u32::MAX,
    };
    // It may lie behind the end by now; then the file grows again, with a hole.
    files[0]
        .write_at(&word.to_le_bytes(), offset.into())
        .unwrap();
    files[1]
        .write_at(&word.to_le_bytes(), u64::from(offset % 64))
        .unwrap();
    if truncate {
        let file = &files[(noise.next() % 2) as usize];
        file.set_len(u64::from(noise.next() % (2 * mail_bytes)))
            .unwrap();
    }
}

fn round(number: u32) {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("system");
    let system = LinuxSystem::<3>::at(&place, 4096).unwrap();
    // It joined once, so that the others believe in it.
    let hostile = join(&system, HOSTILE);
    let (host, other) = (join(&system, HOST), join(&system, OTHER));
    host.serve(Duration::ZERO).unwrap();
    hostile.serve(Duration::ZERO).unwrap();
    let files = ["1.mail", "1.data"].map(|name| {
        let mut options = File::options();
        options
            .read(true)
            .write(true)
            .open(place.join(name))
            .unwrap()
    });
    let calls = AtomicU32::new(0);
    let done = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut noise = Noise(number + 1);
            while !done.load(Ordering::Relaxed) {
                let late = calls.load(Ordering::Relaxed) > CALLS / 2;
                scribble(&files, late, &mut noise);
                thread::yield_now();
            }
        });
        let other = scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                other.serve(Duration::from_millis(10)).unwrap();
            }
        });
        let caller = scope.spawn(|| {
            let wrong = (0..CALLS).find_map(|data| {
                // Whatever these give, they give it at once.
                let _ = host.send(HOSTILE, V, data, Duration::ZERO);
                let _ = host.peer_state(HOSTILE);
                calls.store(data, Ordering::Relaxed);
                let outcome = host.send_with_reply(OTHER, V, data, AMPLE);
                (outcome != Ok(!data)).then_some((data, outcome))
            });
            done.store(true, Ordering::Relaxed);
            wrong
        });
        assert_eq!(caller.join().unwrap(), None, "of round {number}");
        other.join().unwrap();
    });
    drop(hostile);
}

#[test]
fn honest_processors_are_not_harmed_by_a_truncated_file() {
    for number in 0..ROUNDS {
        round(number);
    }
}
