//! A processor copies a tree of the host's files through the file service, while the server is killed
//! every 50 ms.
//!
//! `cargo run --release -p condor-fs --features linux --example copy [-- DIRECTORY]`
//!
//! DIRECTORY, the temporary directory if not given, gets a tree of its own, which is removed at the end.

mod serving;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use condor_fs::{Buffer, OpenOptions};
use condor_mbox::linux::{LinuxSystem, LinuxWindow};
use condor_mbox::{Allocator, Processor, Region};
use serving::{AnyError, BYTES, Files, N, ServerProcess, on_processor, served};

const COPIER: Processor = Processor(1);
const PERIOD: Duration = Duration::from_millis(50);
/// The number of files to copy.
const COUNT: u64 = 1500;
/// Bytes that are moved at a time.
const CHUNK: u32 = 64 * 1024;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), AnyError> {
    if served()? {
        return Ok(());
    }
    let place = std::env::args_os()
        .nth(1)
        .map_or_else(std::env::temp_dir, PathBuf::from);
    let root = tempfile::tempdir_in(place)?;
    plant(&root.path().join("source"))?;

    let system = LinuxSystem::<N>::family(BYTES)?;
    let done = AtomicBool::new(false);
    let begun = Instant::now();
    let (kills, copied) = std::thread::scope(|threads| {
        let copier = threads.spawn(|| {
            let copied = on_processor(&system, COPIER, |files, own, allocator| {
                copy_tree(files, own, allocator, "source", "copy")
            });
            done.store(true, Ordering::SeqCst);
            copied
        });
        let kills = kill_until(&done, &system, root.path());
        let outcome = copier.join().map_err(|_| "the copier panicked")?;
        Ok::<_, AnyError>((kills?, outcome?))
    })?;
    let seconds = begun.elapsed().as_secs_f64();
    println!("copied {copied} bytes in {seconds:.2} s; the server was killed {kills} times");

    let (source, copy) = (
        checksum(&root.path().join("source"))?,
        checksum(&root.path().join("copy"))?,
    );
    println!("source {source:016x}\ncopy   {copy:016x}");
    if source == copy {
        Ok(())
    } else {
        Err("the copy differs".into())
    }
}

/// Kills a server every 50 ms and starts another one; returns the number of killed servers.
fn kill_until(done: &AtomicBool, system: &LinuxSystem<N>, root: &Path) -> Result<u32, AnyError> {
    let mut kills = 0;
    loop {
        let server = ServerProcess::start(system, root)?;
        let killed_at = Instant::now() + PERIOD;
        while Instant::now() < killed_at {
            if done.load(Ordering::SeqCst) {
                return Ok(kills);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        server.kill()?;
        kills += 1;
    }
}

/// Copies all files, as the program of the processor; returns the number of copied bytes.
fn copy_tree(
    files: &Files<'_, '_>,
    own: &Region<LinuxWindow>,
    allocator: &mut Allocator,
    from: &str,
    to: &str,
) -> Result<u64, AnyError> {
    let mut buffer = Buffer::new(own, allocator, CHUNK)?;
    let mut copied = 0;
    let mut left = vec![String::new()];
    files.make_directory(to)?;
    while let Some(path) = left.pop() {
        let mut directory = files.open_directory(format!("{from}{path}"))?;
        let mut name = [0; 255];
        while let Some(entry) = directory.next(&mut name)? {
            let path = format!("{path}/{}", std::str::from_utf8(entry.name)?);
            if entry.is_directory() {
                files.make_directory(format!("{to}{path}"))?;
                left.push(path);
                continue;
            }
            let mut source = files.open(format!("{from}{path}"), OpenOptions::new().read())?;
            // Not by offset: a chunk that were appended twice would be seen.
            let append = OpenOptions::new().append().exclusive();
            let mut copy = files.open(format!("{to}{path}"), append)?;
            loop {
                let (read, filled) = source.read_buffer(buffer, CHUNK)?;
                buffer = filled;
                if read == 0 {
                    break;
                }
                let (written, emptied) = copy.write_buffer(buffer, u32::try_from(read)?)?;
                buffer = emptied;
                if written != read {
                    return Err("the disk is full".into());
                }
                copied += written as u64;
            }
            source.close()?;
            copy.close()?;
        }
        directory.close()?;
    }
    Ok(copied)
}

/// Makes a tree of files of many sizes.
fn plant(root: &Path) -> Result<(), AnyError> {
    let mut random = 0x9e37_79b9_7f4a_7c15_u64;
    for number in 0..COUNT {
        let directory = root.join(format!("{}/{}", number % 7, number % 3));
        std::fs::create_dir_all(&directory)?;
        let size = (number * number * 37) % 300_000;
        let words = (0..size.div_ceil(8)).flat_map(|_| {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            random.to_le_bytes()
        });
        let mut data: Vec<u8> = words.collect();
        data.truncate(usize::try_from(size)?);
        std::fs::write(directory.join(format!("file {number}")), data)?;
    }
    Ok(())
}

/// FNV-1a of all paths and contents, in order.
fn checksum(root: &Path) -> Result<u64, AnyError> {
    let mut paths = Vec::new();
    let mut left = vec![root.to_owned()];
    while let Some(directory) = left.pop() {
        for entry in std::fs::read_dir(&directory)? {
            let path = entry?.path();
            if path.is_dir() {
                left.push(path.clone());
            }
            paths.push(path);
        }
    }
    paths.sort();
    let mut sum = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bytes: &[u8]| {
        for byte in bytes {
            sum = (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for path in paths {
        add(path.strip_prefix(root)?.as_os_str().as_encoded_bytes());
        if path.is_file() {
            add(&std::fs::read(&path)?);
        }
    }
    Ok(sum)
}
