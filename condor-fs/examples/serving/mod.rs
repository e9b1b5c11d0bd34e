//! A file server in a process of its own that does not live long, and a processor that uses it.

use std::error::Error;
use std::path::Path;
use std::process::{Child, Command};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use condor_fs::server::{FileServer, ServerOptions};
use condor_fs::wire::OPEN_FILES;
use condor_fs::{Area, FileSystem};
use condor_mbox::linux::{LinuxMailbox, LinuxSystem, LinuxWindow};
use condor_mbox::{Allocator, Processor, Region};

pub(crate) type AnyError = Box<dyn Error + Send + Sync>;

/// The server and two more.
pub(crate) const N: usize = 3;
pub(crate) const SERVER: Processor = Processor(0);
/// Bytes of data of each processor.
pub(crate) const BYTES: u32 = 512 * 1024;
/// The number of files that a processor can have open.
pub(crate) const FILES: usize = 8;
/// A server that is killed every few milliseconds may not get far each time.
const TIMEOUT: Duration = Duration::from_secs(60);

pub(crate) type Files<'m, 'v> = FileSystem<'m, LinuxMailbox<'v, N>, LinuxWindow, FILES>;

/// The server process; killed when it is dropped.
pub(crate) struct ServerProcess(Child);

impl ServerProcess {
    /// Starts this program again, to serve `root`.
    pub(crate) fn start(system: &LinuxSystem<N>, root: &Path) -> Result<Self, AnyError> {
        let mut command = Command::new(std::env::current_exe()?);
        Ok(Self(
            system.pass_to(command.arg("server").arg(root)).spawn()?,
        ))
    }

    /// Kills it at whatever it does.
    pub(crate) fn kill(mut self) -> Result<(), AnyError> {
        self.0.kill()?;
        self.0.wait()?;
        Ok(())
    }
}

impl Drop for ServerProcess {
    fn drop(&mut self) {
        // Both fail if the server was killed already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Is the server if the arguments say so; whether they did.
pub(crate) fn served() -> Result<bool, AnyError> {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let [part, root] = &arguments[..] else {
        return Ok(false);
    };
    if part != "server" {
        return Ok(false);
    }
    let parent = rustix::process::getppid();
    rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL))?;
    if parent != rustix::process::getppid() {
        return Err("the parent has ended".into());
    }
    // The example kills the server so often that no request can be blamed for it.
    let options = ServerOptions {
        incarnations: u32::MAX,
        ..ServerOptions::default()
    };
    let server = FileServer::new(root, options)?;
    let claim = LinuxSystem::<N>::inherited()?.claim(SERVER)?;
    server.serve(claim, &AtomicBool::new(false))?;
    Ok(true)
}

/// Runs `program` on a processor.
pub(crate) fn on_processor<R>(
    system: &LinuxSystem<N>,
    number: Processor,
    program: impl FnOnce(&Files<'_, '_>, &Region<LinuxWindow>, &mut Allocator) -> Result<R, AnyError>,
) -> Result<R, AnyError> {
    let mut claim = system.claim(number)?;
    let own = Region::users(claim.windows()[number.index()].data.clone())?;
    let mut allocator = claim.places()?;
    let area = Area::<FILES>::new(&mut allocator, 256, 4096)?;
    let handler = area.handler();
    let mut mailbox = claim.mailbox()?;
    mailbox.set_vector(OPEN_FILES, &handler, "open files")?;
    mailbox.join()?;
    let files = FileSystem::connect(&mailbox, SERVER, own.clone(), area, TIMEOUT)?;
    program(&files, &own, &mut allocator)
}
