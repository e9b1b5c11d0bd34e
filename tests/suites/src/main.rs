//! Mounts a tree that a file server of condor-fs serves, runs a command on it, and kills the server at
//! random steps meanwhile.

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

use clap::Parser;
use condor_mbox::linux::LinuxSystem;
use fuser::{Config, SessionACL};
use server::Supervisor;

type AnyError = Box<dyn Error + Send + Sync>;

/// The server and the mounted processor.
const N: usize = 2;
/// Bytes of data of each processor.
const BYTES: u32 = 8 * 1024 * 1024;

/// Mounts a tree that a file server of condor-fs serves, runs a command on it, and kills the server at
/// random steps meanwhile
#[derive(Parser)]
struct Arguments {
    /// Seed of the steps at which the server dies; another number each time if not given
    #[arg(long)]
    seed: Option<u64>,
    /// The server dies at one of so many steps; at none if 0
    #[arg(long, default_value_t = 400)]
    steps: u64,
    /// Directory on a disk in which the tree is made
    directory: PathBuf,
    /// Program to run, and its arguments, in which `{}` stands for the mount point
    #[arg(required = true, trailing_var_arg = true, allow_hyphen_values = true)]
    command: Vec<String>,
}

fn main() -> ExitCode {
    match run() {
        Ok(status) => status,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<ExitCode, AnyError> {
    if server::served()? {
        return Ok(ExitCode::SUCCESS);
    }
    let arguments = Arguments::parse();
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?;
    let seed = arguments.seed.unwrap_or(since.subsec_nanos().into());
    println!("seed {seed} (repeat with --seed)");
    let place = tempfile::tempdir_in(&arguments.directory)?;
    let tree = place.path().join("tree");
    std::fs::create_dir(&tree)?;
    // Every user of the suites can enter this directory, whoever may read `arguments.directory`.
    let open = std::fs::Permissions::from_mode(0o755);
    let mount_point = tempfile::Builder::new().permissions(open).tempdir()?;
    let mounted = mount_point.path();

    let begun = Instant::now();
    let system: &'static LinuxSystem<N> = Box::leak(Box::new(LinuxSystem::family(BYTES)?));
    let supervisor = Supervisor::start(system, &tree, seed, arguments.steps);
    let mut config = Config::default();
    // The suites have several users. What one may do is for the server to say.
    config.acl = SessionACL::All;
    let session = fuser::spawn_mount(mount::Mount::new(system), mounted, &config)?;
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
