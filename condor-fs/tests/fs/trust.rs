//! What TRUST.md says of processors of which some may only read: everybody writes every `data`.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::support::StopAtEnd;
use condor_fs::server::{FileServer, ProcessorSet, ServerOptions, Step, Steps};
use condor_fs::wire::{self, Operation};
use condor_fs::{Area, Errno, FileError, FileSystem, OpenOptions};
use condor_mbox::linux::{Claim, LinuxMailbox, LinuxSystem, LinuxWindow};
use condor_mbox::{MemoryWindow, Processor, Region};

const SERVER: Processor = Processor(0);
const CLIENT: Processor = Processor(1);
/// May only read.
const GUEST: Processor = Processor(2);
const BYTES: u32 = 16 * 1024;
const TIMEOUT: Duration = Duration::from_secs(60);

type Fs<'m, 'v> = FileSystem<'m, LinuxMailbox<'v, 3>, LinuxWindow, 4>;

fn options() -> ServerOptions {
    ServerOptions {
        read_only_for: ProcessorSet::NONE.with(GUEST),
        ..ServerOptions::default()
    }
}

/// Serves the tree at `root` while `program` runs.
fn served<S: Steps + Send>(system: &LinuxSystem<3>, root: &Path, steps: S, program: impl FnOnce()) {
    let server = FileServer::with_steps(root, options(), steps).unwrap();
    let (claim, stop) = (system.claim(SERVER).unwrap(), AtomicBool::new(false));
    std::thread::scope(|threads| {
        let _ends = StopAtEnd(&stop);
        threads.spawn(|| server.serve(claim, &stop).unwrap());
        program();
    });
}

/// Runs `program` with the `FileSystem` of the processor whose number is claimed.
fn connected(mut claim: Claim<3>, program: impl FnOnce(&Fs<'_, '_>, &Region<LinuxWindow>)) {
    let number = claim.number();
    let own = Region::users(claim.windows()[number.index()].data.clone()).unwrap();
    let area = Area::<4>::new(&mut claim.places().unwrap(), 64, 256).unwrap();
    let handler = area.handler();
    let mut mailbox = claim.mailbox().unwrap();
    mailbox
        .set_vector(wire::OPEN_FILES, &handler, "open files")
        .unwrap();
    mailbox.join().unwrap();
    let files = FileSystem::connect(&mailbox, SERVER, own.clone(), area, TIMEOUT).unwrap();
    program(&files, &own);
}

/// The guest: once the server has copied a request of the client's, puts other paths in its place.
struct Guest {
    client: LinuxWindow,
}

impl Steps for Guest {
    fn reached(&self, _: Operation, step: Step) {
        if step == Step::Taken {
            replace(&self.client, *b"mine", *b"evil");
        }
    }
}

/// Words of a window that are `from` become `to`.
fn replace(window: &LinuxWindow, from: [u8; 4], to: [u8; 4]) {
    let region = Region::users(window).unwrap();
    for at in (0..region.size()).step_by(4) {
        if region.word(at) == Ok(u32::from_le_bytes(from)) {
            region.set_word(at, u32::from_le_bytes(to)).unwrap();
        }
    }
}

fn names(directory: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(directory).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<_> = names.filter(|name| name != ".condor-fs").collect();
    names.sort();
    names
}

#[test]
fn paths_that_are_changed_after_the_server_has_copied_them_are_not_used() {
    let system = LinuxSystem::<3>::family(BYTES).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    std::fs::create_dir(root.join("evil")).unwrap();
    let guest = system.claim(GUEST).unwrap();
    let steps = Guest {
        client: guest.windows()[CLIENT.index()].data.clone(),
    };
    served(&system, root, steps, || {
        connected(system.claim(CLIENT).unwrap(), |files, _| {
            let write = OpenOptions::new().write().create();
            files.make_directory("mine").unwrap();
            assert_eq!(names(root), ["evil", "mine"]);
            files.open("mine/a", write).unwrap();
            files.open("mine/b", write.exclusive()).unwrap();
            assert_eq!(names(&root.join("mine")), ["a", "b"]);
            files.rename("mine/a", "mine/c").unwrap();
            files.unlink("mine/b").unwrap();
            files.make_directory("mine/d").unwrap();
            files.remove_directory("mine/d").unwrap();
            assert_eq!(names(&root.join("mine")), ["c"]);
            assert!(files.status("mine/c").unwrap().is_file());
        });
    });
    assert_eq!(names(&root.join("evil")), [""; 0]);
}

#[test]
fn who_may_only_read_changes_nothing_by_its_own_window() {
    let system = &LinuxSystem::<3>::family(BYTES).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    std::fs::write(root.join("file"), "as it was").unwrap();
    std::fs::create_dir(root.join("empty")).unwrap();
    let refused = Err(FileError::Errno(Errno::ROFS));
    let stops = &[const { AtomicBool::new(false) }; 2];
    std::thread::scope(|threads| {
        let serve = |incarnation: usize| {
            let server = FileServer::new(root, options()).unwrap();
            let claim = system.claim_within(SERVER, TIMEOUT).unwrap();
            threads.spawn(move || server.serve(claim, &stops[incarnation]).unwrap())
        };
        let _ends = stops.each_ref().map(StopAtEnd);
        let first = serve(0);
        connected(system.claim(GUEST).unwrap(), |files, own| {
            let mut file = files.open("file", OpenOptions::new().read()).unwrap();
            let mut bytes = [0; 9];
            assert_eq!(file.read(&mut bytes), Ok(9));
            let write = OpenOptions::new().write();
            for options in [write, write.create(), write.truncate(), write.append()] {
                assert_eq!(files.open("file", options).map(drop), refused);
            }
            assert_eq!(files.open("new", write.exclusive()).map(drop), refused);
            assert_eq!(files.make_directory("new"), refused);
            assert_eq!(files.remove_directory("empty"), refused);
            assert_eq!(files.unlink("file"), refused);
            assert_eq!(files.rename("file", "new"), refused);
            assert!(file.truncate(0).is_err() && file.write(b"x").is_err());
            // The next server believes what the guest says of its open file, but not that.
            stops[0].store(true, Ordering::Relaxed);
            first.join().unwrap();
            let _second = serve(1);
            let mut places = (0..own.size()).step_by(4);
            let at = places
                .find(|&at| own.word(at) == Ok(wire::block::MAGIC))
                .unwrap();
            let flags = wire::open::READ | wire::open::WRITE;
            own.set_word(at + wire::block::FLAGS, flags).unwrap();
            assert_eq!(file.write(b"x").map(drop), refused);
            assert_eq!(file.truncate(0), refused);
        });
    });
    assert_eq!(names(root), ["empty", "file"]);
    assert_eq!(std::fs::read(root.join("file")).unwrap(), b"as it was");
}
