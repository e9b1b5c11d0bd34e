//! Operations that are awaited, asked for again after a timeout, and asked for by several contexts.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::pin::pin;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use crate::support::{
    CLIENT, FILES, Fs, Mail, OTHER, SERVER, Supervisor, TIMEOUT, disk, system, with_client,
};
use condor_fs::server::Step;
use condor_fs::wire::{OPEN_FILES, Operation};
use condor_fs::{Area, Errno, FileError, FileSystem, OpenOptions, OperationResult, Receipt};
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Call, Messenger, Region, Vector};

const SHORT: Duration = Duration::from_millis(20);
const READ: OpenOptions = OpenOptions::new().read();
const NEW: OpenOptions = OpenOptions::new().read().write().exclusive();

#[track_caller]
fn receipt<T>(outcome: Result<T, FileError>) -> Receipt {
    match outcome.err() {
        Some(FileError::TimedOut { receipt, .. }) => receipt,
        other => panic!("{other:?}"),
    }
}

/// Neither status nor handle nor data is lost, though others have waited for the end before.
#[test]
fn what_timed_out_is_asked_for_again() {
    let root = disk();
    std::fs::write(root.path().join("data"), b"0123456789").unwrap();
    let system = system();
    let mut server = Some(Supervisor::start(&system, root.path(), None, ""));
    with_client(&system, CLIENT, |fs, _, _, _| {
        let mut data = fs.open("data", READ).unwrap();
        // With no server the call times out; with a new one, others wait for the end first.
        let mut late = |call: &mut dyn FnMut() -> Receipt, between: bool| {
            server = None;
            fs.set_timeout(SHORT);
            let receipt = call();
            let early = fs.ticket(receipt, &mut []).wait(SHORT);
            assert!(
                matches!(early, Err(FileError::TimedOut { receipt: same, .. }) if same == receipt)
            );
            fs.set_timeout(TIMEOUT);
            server = Some(Supervisor::start(&system, root.path(), None, ""));
            if between {
                fs.space().unwrap();
                fs.settle(TIMEOUT).unwrap();
            }
            receipt
        };
        for between in [false, true] {
            let asked = late(&mut || receipt(fs.status("data")), between);
            let answer = fs.ticket(asked, &mut []).wait(TIMEOUT).unwrap();
            assert!(matches!(answer, OperationResult::Status(status) if status.size == 10));
            let again = fs.ticket(asked, &mut []).wait(TIMEOUT).err();
            assert_eq!(
                again,
                Some(FileError::Errno(Errno::INVAL)),
                "it was returned"
            );

            let asked = late(&mut || receipt(data.read_at(&mut [0; 5], 3)), between);
            let mut short = [0; 4];
            let refused = fs.ticket(asked, &mut short).wait(TIMEOUT).err();
            assert_eq!(
                refused,
                Some(FileError::Errno(Errno::INVAL)),
                "it has no room"
            );
            let mut bytes = [0; 5];
            let answer = fs.ticket(asked, &mut bytes).wait(TIMEOUT).unwrap();
            assert!(matches!(answer, OperationResult::Number(5)) && &bytes == b"34567");
            assert_eq!(data.position(), Ok(0));

            let name = if between { "one" } else { "two" };
            let asked = late(&mut || receipt(fs.open(name, NEW)), between);
            // Places that are free are taken first.
            let others = [(); 2].map(|()| fs.open("data", READ).unwrap());
            let Ok(OperationResult::File(mut file)) = fs.ticket(asked, &mut []).wait(TIMEOUT)
            else {
                panic!("the handle was lost");
            };
            file.write(b"mine").unwrap();
            assert_eq!(file.status().unwrap().size, 4);
            file.close().unwrap();
            for other in others {
                other.close().unwrap();
            }

            let asked = late(&mut || receipt(fs.unlink("none")), between);
            let answer = fs.ticket(asked, &mut []).wait(TIMEOUT).err();
            assert_eq!(answer, Some(FileError::Errno(Errno::NOENT)));
            let asked = late(&mut || receipt(fs.open_directory(".")), between);
            let Ok(OperationResult::Directory(mut directory)) =
                fs.ticket(asked, &mut []).wait(TIMEOUT)
            else {
                panic!("the handle was lost");
            };
            assert!(directory.next(&mut [0; 64]).unwrap().is_some());
            directory.close().unwrap();
        }
        // A read that nobody asks for gives up its bytes when the buffer is used.
        let asked = late(&mut || receipt(data.read(&mut [0; 2])), true);
        assert_eq!(data.position(), Ok(2));
        data.read(&mut [0; 1]).unwrap();
        let gone = fs.ticket(asked, &mut [0; 2]).wait(TIMEOUT).err();
        assert_eq!(gone, Some(FileError::Errno(Errno::INVAL)));
        // And a file that nobody asks for gives up its place when it is needed.
        fs.open("data", READ).unwrap().close().unwrap(); // Closes what was dropped.
        let asked = late(&mut || receipt(fs.open("three", NEW)), true);
        let all: Vec<_> = (1..FILES)
            .map(|_| fs.open("three", READ).unwrap())
            .collect();
        let gone = fs.ticket(asked, &mut []).wait(TIMEOUT).err();
        assert_eq!(gone, Some(FileError::Errno(Errno::INVAL)));
        drop(all);
    });
}

/// Polls both, in turn, and serves, until both have ended.
fn join<A, B>(
    mail: &Mail<'_>,
    one: impl Future<Output = A>,
    two: impl Future<Output = B>,
) -> (A, B) {
    let (mut one, mut two) = (pin!(one), pin!(two));
    let (mut a, mut b) = (None, None);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if a.is_none()
            && let Poll::Ready(found) = one.as_mut().poll(&mut context)
        {
            a = Some(found);
        }
        if b.is_none()
            && let Poll::Ready(found) = two.as_mut().poll(&mut context)
        {
            b = Some(found);
        }
        if let (Some(_), Some(_)) = (&a, &b) {
            return (a.unwrap(), b.unwrap());
        }
        mail.serve(Duration::from_micros(100)).unwrap();
    }
}

/// A program of tasks: makes a file, writes it, and reads it back by two ways.
async fn task(fs: &Fs<'_, '_>, name: &str) -> Result<(), FileError> {
    let moved = format!("{name}.moved");
    let mut file = fs.begin_open(name, NEW).await?;
    for n in 0..20_u8 {
        assert_eq!(file.begin_write(&[n; 10]).await?, 10);
    }
    assert_eq!(file.begin_write_at(b"!", 5).await?, 1);
    let mut bytes = [0; 10];
    assert_eq!(file.begin_read_at(&mut bytes, 1).await?, 10);
    assert_eq!(bytes, [0, 0, 0, 0, b'!', 0, 0, 0, 0, 1]);
    assert_eq!(file.begin_read(&mut bytes).await?, 0, "it is at the end");
    file.begin_truncate(100).await?;
    assert_eq!(file.begin_status().await?.size, 100);
    fs.begin_rename(name, &moved).await?;
    assert_eq!(fs.begin_status(&moved).await?.size, 100);
    file.begin_sync().await?;
    file.begin_close().await?;
    let failed = fs.begin_unlink(name).await;
    assert_eq!(failed, Err(FileError::Errno(Errno::NOENT)));
    fs.begin_unlink(&moved).await
}

#[test]
fn tasks_await_their_tickets_over_deaths_of_the_server() {
    for kill in [
        None,
        Some((Operation::Write, Step::Part, 7)),
        Some((Operation::Open, Step::Moved, 2)),
        Some((Operation::Close, Step::Acted, 1)),
        Some((Operation::Rename, Step::Moved, 2)),
    ] {
        let root = disk();
        let system = system();
        let supervisor = Supervisor::start(&system, root.path(), kill, "");
        with_client(&system, CLIENT, |fs, _, _, mail| {
            let both = join(mail, task(fs, "a"), task(fs, "b"));
            assert_eq!(both, (Ok(()), Ok(())), "{kill:?}");
            // Dropped while it waits: the next call finds what came of it.
            let mut dropped = Box::pin(fs.begin_make_directory("d", None));
            let first = dropped
                .as_mut()
                .poll(&mut Context::from_waker(Waker::noop()));
            assert!(first.is_pending());
            assert_eq!(
                fs.unlink("x"),
                Err(FileError::Errno(Errno::BUSY)),
                "it is its turn"
            );
            let receipt = dropped.receipt().expect("it was begun");
            drop(dropped);
            assert!(fs.status("d").unwrap().is_directory());
            assert!(fs.ticket(receipt, &mut []).wait(TIMEOUT).is_ok());
            assert_eq!(fs.begin_unlink("x").receipt(), None);
        });
        assert_eq!(supervisor.deaths(), u32::from(kill.is_some()));
    }
}

#[test]
fn threads_share_files() {
    const ROUNDS: u64 = 200;
    let root = disk();
    let system = system();
    let supervisor = Supervisor::start(&system, root.path(), None, "");
    let (done, rounds) = (AtomicBool::new(false), AtomicU32::new(0));
    with_client(&system, CLIENT, |fs, _, _, _| {
        fs.wait_for_turn(TIMEOUT);
        let shared = &fs.open("shared", NEW).unwrap();
        let (done, rounds, supervisor) = (&done, &rounds, &supervisor);
        std::thread::scope(|threads| {
            let writers = [0_u8, 1, 2].map(|number| {
                threads.spawn(move || {
                    let own = format!("own{number}");
                    let append = OpenOptions::new().append().create();
                    for round in 0..ROUNDS {
                        let at = 30 * round + 10 * u64::from(number);
                        assert_eq!(shared.write_at(&[b'a' + number; 10], at), Ok(10));
                        let mut back = [0; 10];
                        assert_eq!(shared.read_at(&mut back, at), Ok(10));
                        assert_eq!(back, [b'a' + number; 10]);
                        let mut log = fs.open(&own, append).unwrap();
                        assert_eq!(log.write(&[number]), Ok(1));
                        rounds.fetch_add(1, Ordering::Relaxed);
                        if round % 2 == 0 {
                            log.close().unwrap(); // Else somebody's open closes it.
                        }
                    }
                })
            });
            threads.spawn(move || {
                while !done.load(Ordering::Relaxed) {
                    // Each server gets something done: no request meets two that die.
                    let before = rounds.load(Ordering::Relaxed);
                    while rounds.load(Ordering::Relaxed) < before + 10
                        && !done.load(Ordering::Relaxed)
                    {
                        std::thread::yield_now();
                    }
                    supervisor.kill();
                }
            });
            let ended = writers.map(std::thread::ScopedJoinHandle::join);
            done.store(true, Ordering::Relaxed);
            for outcome in ended {
                outcome.unwrap();
            }
        });
    });
    let found = std::fs::read(root.path().join("shared")).unwrap();
    let expected = [[b'a'; 10], [b'b'; 10], [b'c'; 10]].concat();
    assert_eq!(found, expected.repeat(usize::try_from(ROUNDS).unwrap()));
    for number in 0..3_u8 {
        let own = std::fs::read(root.path().join(format!("own{number}"))).unwrap();
        assert_eq!(own, vec![number; usize::try_from(ROUNDS).unwrap()]);
    }
}

const ASK: Vector = Vector(7);
const REFUSED: u32 = 1000;

/// A handler uses the files of its background, and gets EBUSY in the middle of what that asks.
#[test]
fn background_and_handlers_share_files() {
    type Leaked = FileSystem<'static, Mail<'static>, LinuxWindow, FILES>;
    static SHARED: OnceLock<Leaked> = OnceLock::new();
    let root = disk();
    std::fs::write(root.path().join("data"), b"*").unwrap();
    let system = system();
    let first = Supervisor::start(&system, root.path(), None, "");
    let mut claim = system.claim(CLIENT).unwrap();
    let own = Region::users(claim.windows()[CLIENT.index()].data.clone()).unwrap();
    let area = Area::<FILES>::new(&mut claim.places().unwrap(), 300, 4096).unwrap();
    let table: &'static _ = Box::leak(Box::new(area.handler()));
    let mailbox = Box::leak(Box::new(claim.mailbox().unwrap()));
    let asked: &'static AtomicU32 = Box::leak(Box::default());
    let handler = |_: &Call<'_>| {
        asked.fetch_add(1, Ordering::Relaxed);
        let byte = || {
            let file = SHARED.get().ok_or(Errno::AGAIN)?.open("data", READ)?;
            let mut byte = [0];
            file.read_at(&mut byte, 0)?;
            file.close()?;
            Ok::<_, FileError>(byte[0])
        };
        match byte() {
            Ok(byte) => byte.into(),
            Err(FileError::Errno(errno)) => REFUSED + u32::from(errno.0),
            Err(_) => REFUSED,
        }
    };
    mailbox.set_vector(OPEN_FILES, table, "open files").unwrap();
    mailbox
        .set_vector(ASK, Box::leak(Box::new(handler)), "ask")
        .unwrap();
    mailbox.join().unwrap();
    let mailbox: &'static Mail<'static> = mailbox;
    let files = FileSystem::connect(mailbox, SERVER, own, area, TIMEOUT).unwrap();
    let files = SHARED.get_or_init(|| files);

    let mut other = system.claim(OTHER).unwrap().mailbox().unwrap();
    other.join().unwrap();
    let ask = || other.send_with_reply(CLIENT, ASK, 0, TIMEOUT).unwrap();
    std::thread::scope(|threads| {
        let asking = threads.spawn(ask);
        while !asking.is_finished() {
            mailbox.serve(SHORT).unwrap();
        }
        assert_eq!(asking.join().unwrap(), u32::from(b'*'));
        // In the middle of the background's operation, whose server is dead.
        drop(first);
        let waiting = threads.spawn(move || files.status("data"));
        while !files.in_doubt() {
            std::thread::yield_now();
        }
        assert_eq!(ask(), REFUSED + u32::from(Errno::BUSY.0));
        let _second = Supervisor::start(&system, root.path(), None, "");
        assert_eq!(waiting.join().unwrap().unwrap().size, 1);
    });
    assert_eq!(asked.load(Ordering::Relaxed), 2);
}
