//! Files in virtual time: the server is a host's end, the client a processor.
#![cfg(feature = "sim")]

use std::time::Duration;

use condor_fs::wire::OPEN_FILES;
use condor_fs::{Area, FileSystem, OpenOptions};
use condor_mbox::{Allocator, Call, MemoryWindow as _, Processor, Region};
use condor_rt::{Machine, numbers, sim};

const CLIENT: Processor = Processor(2);
const SECOND: Duration = Duration::from_secs(1);

type AnyError = Box<dyn std::error::Error>;

/// Writes a file and reads it again, with handlers running all the time.
fn write_and_read<M: Machine>(machine: &M) -> Result<Vec<u8>, AnyError> {
    let windows = machine.windows();
    let own = Region::users(windows[machine.number().index()].data.clone())?;
    let area = Area::<4>::new(&mut Allocator::new(own.size()), 100, 512)?;
    let open_files = |call: &Call<'_>| area.handler()(call);
    let mut mailbox = machine.mailbox()?;
    mailbox.set_vector(OPEN_FILES, &open_files, "open files")?;
    mailbox.join()?;
    let files = FileSystem::connect(&mailbox, numbers::FILES, own, area, SECOND)?;
    let motion: Vec<u8> = (0..2000_u32).map(|at| (at * at) as u8).collect();
    let mut file = files.open("motion", OpenOptions::new().write().create())?;
    let mut left = &motion[..];
    while !left.is_empty() {
        let written = file.write(left)?;
        left = &left[written..];
    }
    file.close()?;
    let mut file = files.open("motion", OpenOptions::new().read())?;
    let mut read = Vec::new();
    let mut part = [0; 300];
    loop {
        let count = file.read(&mut part)?;
        if count == 0 {
            break;
        }
        read.extend_from_slice(&part[..count]);
    }
    file.close()?;
    assert_eq!(read, motion);
    Ok(read)
}

fn files_of_a_run() -> u64 {
    let root = tempfile::tempdir().unwrap();
    let mut ended_at = 0;
    let mut system = sim::VirtualSystem::new(16384).unwrap();
    system.files(root.path()).unwrap();
    system
        .host(CLIENT, |machine| {
            let read = write_and_read(machine).map_err(|error| error.to_string())?;
            ended_at = machine.now();
            let there = std::fs::read(root.path().join("motion")).unwrap();
            assert_eq!(there, read);
            Ok::<_, String>(())
        })
        .unwrap();
    system.run_until(500_000_000).unwrap();
    ended_at
}

#[test]
fn a_file_is_written_and_read_in_no_virtual_time() {
    assert_eq!(files_of_a_run(), 0);
}
