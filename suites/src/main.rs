//! Mounts a tree that a file server of condor-fs serves, runs a command on it, and kills the server at
//! random steps meanwhile.
//!
//! `condor-suites [--seed N] [--steps N] DIRECTORY COMMAND…`
//!
//! The tree and the mount point are made in DIRECTORY, which must be on a disk, and `{}` in a word of
//! COMMAND stands for the mount point. The server dies at one of `--steps` steps, 400 if not given; at
//! none if 0. The exit status is that of the command.

mod client;
mod mount;
mod nodes;
mod server;

use std::error::Error;
use std::io::ErrorKind;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::time::{Instant, SystemTime};

use condor_mbox::linux::System;
use fuser::{Config, SessionACL};
use server::Supervisor;

type AnyError = Box<dyn Error + Send + Sync>;

/// The server and the mounted processor.
const N: usize = 2;
/// Bytes of data of each processor.
const BYTES: u32 = 8 * 1024 * 1024;

struct Arguments {
    seed: u64,
    steps: u64,
    directory: PathBuf,
    command: Vec<String>,
}

fn main() -> Result<ExitCode, AnyError> {
    if server::served()? {
        return Ok(ExitCode::SUCCESS);
    }
    let arguments = parse(std::env::args().skip(1))?;
    println!("seed {} (repeat with --seed)", arguments.seed);
    let place = tempfile::tempdir_in(&arguments.directory)?;
    let tree = place.path().join("tree");
    std::fs::create_dir(&tree)?;
    // Where every user of the suites can go, whoever may read the directory.
    let open = std::fs::Permissions::from_mode(0o755);
    let mount_point = tempfile::Builder::new().permissions(open).tempdir()?;
    let mounted = mount_point.path();

    let begun = Instant::now();
    let system: &'static System<N> = Box::leak(Box::new(System::family(BYTES)?));
    let supervisor = Supervisor::start(system, &tree, arguments.seed, arguments.steps);
    let mut config = Config::default();
    // The suites have several users. What one may do is for the server to say.
    config.acl = SessionACL::All;
    let session = fuser::spawn_mount(mount::Mount::new(system, &tree)?, mounted, &config)?;
    let words = arguments.command.iter();
    let mut words = words.map(|word| word.replace("{}", &mounted.to_string_lossy()));
    let program = words.next().unwrap_or_default();
    let status = Command::new(program).args(words).status();
    match session.umount_and_join() {
        // The kernel had something to ask that it no longer wants to know.
        Err(error) if error.kind() == ErrorKind::ConnectionAborted => {}
        outcome => outcome?,
    }
    println!(
        "the server was killed {} times in {:.1} s",
        supervisor.kills()?,
        begun.elapsed().as_secs_f64()
    );
    let code = status?.code().and_then(|code| u8::try_from(code).ok());
    Ok(code.map_or(ExitCode::FAILURE, ExitCode::from))
}

fn parse(mut words: impl Iterator<Item = String>) -> Result<Arguments, AnyError> {
    const USAGE: &str = "usage: condor-suites [--seed N] [--steps N] DIRECTORY COMMAND…";
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?;
    let (mut seed, mut steps) = (u64::from(since.subsec_nanos()), 400);
    let directory = loop {
        match words.next().ok_or(USAGE)?.as_str() {
            "--seed" => seed = words.next().ok_or(USAGE)?.parse()?,
            "--steps" => steps = words.next().ok_or(USAGE)?.parse()?,
            word => break word.into(),
        }
    };
    let command: Vec<String> = words.collect();
    if command.is_empty() {
        return Err(USAGE.into());
    }
    Ok(Arguments {
        seed,
        steps,
        directory,
        command,
    })
}
