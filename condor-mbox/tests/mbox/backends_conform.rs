//! Every backend of this crate passes the suites that a backend of one's own would run.
#![cfg(feature = "conformance")]

use condor_mbox::sim::{SimDoorbell, SimSystem, SimWindow};
use condor_mbox::window::CompareExchange;
use condor_mbox::{Doorbell, Processor, Region, StaticMemory, conformance};

const ME: Processor = Processor(0);
const OTHER: Processor = Processor(1);

/// Two views of the same memory, for reading and writing.
fn windows_conform<W: CompareExchange>(one: &W, other: &W) {
    conformance::window(one).unwrap();
    if one.is_coherent() {
        conformance::compare_exchange(one).unwrap();
    }
    conformance::shared(one, other).unwrap();
}

#[test]
fn static_memory() {
    static MEMORY: StaticMemory<64> = StaticMemory::new();
    windows_conform(&MEMORY.window(), &MEMORY.window());
}

#[test]
fn a_region_of_a_window() {
    static MEMORY: StaticMemory<64> = StaticMemory::new();
    let users = Region::users(MEMORY.window()).unwrap();
    let middle = users.part(64, 64).unwrap();
    windows_conform(&users, &users);
    windows_conform(&middle, &middle);
}

#[test]
fn simulated_memory() {
    let window = SimWindow::new(128);
    windows_conform(&window, &window.clone());
    conformance::read_only(&window.read_only()).unwrap();
}

#[test]
fn simulated_processors() {
    let system = SimSystem::<2>::in_virtual_time(64);
    let (mine, others) = (system.windows(ME), system.windows(OTHER));
    for owner in [ME, OTHER] {
        let (mine, others) = (&mine[owner.index()], &others[owner.index()]);
        windows_conform(&mine.data, &others.data);
    }
    conformance::window(&mine[0].mail).unwrap();
    conformance::read_only(&mine[1].mail).unwrap();
    conformance::window(&others[1].mail).unwrap();
    conformance::read_only(&others[0].mail).unwrap();
}

fn rung_from_a_thread(mine: &SimDoorbell, other: &SimDoorbell) {
    conformance::doorbell(mine, ME, || {
        std::thread::scope(|threads| {
            threads.spawn(|| other.ring(ME));
        });
    })
    .unwrap();
}

#[test]
fn the_simulated_doorbell() {
    for system in [
        SimSystem::<2>::in_virtual_time(64),
        SimSystem::<2>::in_real_time(64),
    ] {
        rung_from_a_thread(&system.doorbell(ME), &system.doorbell(OTHER));
        system.repeat_rings(ME, u32::MAX);
        rung_from_a_thread(&system.doorbell(ME), &system.doorbell(OTHER));
    }
}

#[cfg(feature = "linux")]
mod linux {
    use std::fs::File;

    use condor_mbox::linux::{LinuxSystem, LinuxWindow, Memory, ObjectPositions, WindowAccess};
    use condor_mbox::{Doorbell, conformance};

    use super::{ME, OTHER, windows_conform};

    /// Memory and doorbells of two claims of one system.
    fn claims_conform(system: &LinuxSystem<2>) {
        let mine = system.claim(ME).unwrap();
        let others = system.claim(OTHER).unwrap();
        for owner in 0..2 {
            windows_conform(&mine.windows()[owner].data, &others.windows()[owner].data);
        }
        windows_conform(&mine.windows()[0].mail, &mine.windows()[0].mail);
        conformance::read_only(&others.windows()[0].mail).unwrap();
        conformance::read_only(&mine.windows()[1].mail).unwrap();
        let ring = || others.doorbell().ring(ME);
        conformance::doorbell(mine.doorbell(), ME, ring).unwrap();
        // Now rings go to the pipe too.
        let bell = mine.doorbell().pollable();
        conformance::doorbell(mine.doorbell(), ME, || {
            std::thread::scope(|threads| {
                threads.spawn(ring);
            });
        })
        .unwrap();
        assert!(bell.try_drain());
    }

    #[test]
    fn a_family() {
        claims_conform(&LinuxSystem::family(64).unwrap());
    }

    #[test]
    fn a_system_of_files() {
        let directory = tempfile::tempdir().unwrap();
        claims_conform(&LinuxSystem::at(directory.path().join("system"), 64).unwrap());
    }

    #[test]
    fn a_system_in_one_memory() {
        for offset in [0, 4096, 4100] {
            let directory = tempfile::tempdir().unwrap();
            let file = directory.path().join("ram");
            File::create(&file).unwrap().set_len(1 << 17).unwrap();
            let run = |offset, stride| ObjectPositions { offset, stride };
            let memory = Memory {
                file,
                mail: run(offset, 1 << 15),
                data: run(offset + (1 << 16), 132),
            };
            let path = directory.path().join("system");
            claims_conform(&LinuxSystem::in_memory(path, 64, &memory).unwrap());
        }
    }

    #[test]
    fn a_named_system() {
        let name = format!("conformance-{}", std::process::id());
        let system = LinuxSystem::named(&name, 64).unwrap();
        claims_conform(&system);
        system
            .remove_within(std::time::Duration::from_secs(60))
            .unwrap();
    }

    #[test]
    fn a_mapped_file() {
        let file = tempfile::NamedTempFile::new().unwrap();
        file.as_file().set_len(3 * 4096).unwrap();
        let map = |file: &File, access| LinuxWindow::map(file, 4100, 4096, access).unwrap();
        let again = file.reopen().unwrap();
        let (one, other) = (
            map(file.as_file(), WindowAccess::ReadWrite),
            map(&again, WindowAccess::ReadWrite),
        );
        windows_conform(&one, &other);
        conformance::read_only(&map(&again, WindowAccess::ReadOnly)).unwrap();
        let unwritable = File::open(file.path()).unwrap();
        conformance::read_only(&map(&unwritable, WindowAccess::ReadOnly)).unwrap();
    }
}
