//! A machine of harts: QEMU, the numbers of the harts, and the link on which both sides ring.
//!
//! The machine runs as long as the service, which also holds the numbers of its harts: to peers, that is
//! the evidence that a hart is alive. The service joins when all harts have come up.
//!
//! The link is the serial line of the machine. Each byte on it is the number of a processor that is
//! rung: from here that of a hart, from there that of a process. Nothing else is sent.

mod bridge;

pub use bridge::Bridge;

use std::os::fd::AsFd;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::time::{Duration, Instant};

use condor_mbox::linux::{LinuxDoorbell, LinuxMailbox};
use condor_mbox::{Messenger, Processor, SingleContext};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::io::Errno;

use condor_host::error::AnyError;
use condor_host::supervisor::{
    ChildProcess, EndSignals, Launch, ProgramImage, RunState, StopMethod,
};
use condor_host::system::SystemWindows;

use crate::{HartState, MachineMemory, Qemu};
use condor_rt::linux::{Environment, MappedPage};
use condor_rt::numbers::PROCESSORS;

/// The time between two beats of this service's own heart.
const BEAT: Duration = Duration::from_millis(500);
/// The time between two looks at harts that have not come up.
const LOOK: Duration = Duration::from_millis(10);
/// After this, harts that have not come up are named.
const COMING_UP: Duration = Duration::from_secs(4);
/// The time that QEMU may take to end.
const END: Duration = Duration::from_secs(1);
/// The time for which a number may be held by a former incarnation of this service, or by a visitor.
const SUCCESSION: Duration = Duration::from_secs(5);

/// Runs QEMU and serves its machine until SIGTERM comes or QEMU ends. `memory` is the file that is the memory of the
/// machine. `link` is the path of the socket that this call makes; through it the harts and the processes of the host
/// ring each other's doorbells.
///
/// # Errors
/// Returns an error whose text says why the machine cannot be served, or how QEMU ended if it ended without
/// SIGTERM.
pub fn serve(memory: &Path, link: &Path, qemu: &Qemu) -> Result<(), AnyError> {
    let mut signals = EndSignals::new()?;
    let environment = Environment::read()?;
    let memory = MachineMemory::open(memory)?;
    let page = environment
        .clock
        .as_ref()
        .map(MappedPage::open)
        .transpose()?;
    let system = SystemWindows::at(&environment.system, environment.window_bytes)?;
    let mut mailbox = system
        .claim_within(environment.processor, SUCCESSION)?
        .mailbox_with(SingleContext::new())?;
    let doorbells = hold(&system, &memory)?;
    memory.reset()?;

    match std::fs::remove_file(link) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(at("remove", link)(error));
        }
        _ => {}
    }
    let listener = UnixListener::bind(link).map_err(at("listen at", link))?;
    listener
        .set_nonblocking(true)
        .map_err(at("listen at", link))?;
    let mut machine = ChildProcess::new();
    let arguments = qemu.arguments(&memory, Some(link));
    let image = ProgramImage::new(qemu.command.clone(), arguments, environment);
    machine.load(&image)?;
    machine.start()?;

    let begun = Instant::now();
    let bell = mailbox.doorbell().pollable();
    // The bridge ends with the machine.
    let mut bridge = None;
    let (mut is_up, mut is_late) = (false, false);
    loop {
        machine.output(&mut |line| eprintln!("{line}"));
        if let RunState::Ended(exit) = machine.state() {
            machine.output(&mut |line| eprintln!("{line}"));
            return Err(format!("the machine ended: {exit}").into());
        }
        if signals.taken() > 0 {
            return end(&mut machine, mailbox);
        }
        if bridge.is_none()
            && let Some(stream) = accepted(&listener, link)?
        {
            let started = Bridge::start(stream, doorbells.clone(), page.clone());
            bridge = Some(started?);
        }
        bell.drain();
        if is_up {
            mailbox.serve(Duration::ZERO)?;
        } else {
            let missing = not_up(&memory)?;
            if missing.is_empty() {
                mailbox.join()?;
                mailbox.ring_always(true)?;
                is_up = true;
            } else if !is_late && begun.elapsed() >= COMING_UP {
                is_late = true;
                eprintln!(
                    "these harts have not started: {missing:?}; is {} the monitor, the program that harts run first?",
                    qemu.monitor.display()
                );
            }
        }
        wait(&machine, &signals, &bell, if is_up { BEAT } else { LOOK })?;
    }
}

/// Says what was tried with a file.
fn at(doing: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> AnyError + use<> {
    let path = path.display().to_string();
    move |error| format!("cannot {doing} {path}: {error}").into()
}

/// Waits until something happens.
fn wait(
    machine: &ChildProcess,
    signals: &EndSignals,
    bell: &impl AsFd,
    most: Duration,
) -> Result<(), AnyError> {
    let limit = Timespec::try_from(most).unwrap_or_default();
    let mut polled = vec![
        PollFd::new(bell, PollFlags::IN),
        PollFd::from_borrowed_fd(signals.descriptor(), PollFlags::IN),
    ];
    for descriptor in machine.ended().into_iter().chain(machine.has_output()) {
        polled.push(PollFd::from_borrowed_fd(descriptor, PollFlags::IN));
    }
    match rustix::event::poll(&mut polled, Some(&limit)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

type Post = LinuxMailbox<'static, PROCESSORS, SingleContext>;

/// Switches the machine off.
fn end(machine: &mut ChildProcess, mut mailbox: Post) -> Result<(), AnyError> {
    machine.stop(StopMethod::Ask)?;
    let begun = Instant::now();
    while machine.state() == RunState::Runs && begun.elapsed() < END {
        std::thread::sleep(LOOK);
    }
    // A machine that has not ended is killed as it is dropped.
    Ok(mailbox.leave()?)
}

/// Takes the numbers of all harts, whose former incarnations ended when the machine was switched off.
fn hold(
    system: &SystemWindows,
    memory: &MachineMemory,
) -> Result<Vec<(Processor, LinuxDoorbell<PROCESSORS>)>, AnyError> {
    let mut doorbells = Vec::new();
    for &number in &memory.map().numbers {
        let number = Processor(number);
        let (windows, doorbell) = system.claim_within(number, SUCCESSION)?.into_parts();
        if let Some(own) = windows.get(number.index()) {
            // A number under which nothing has ever joined needs no declaration.
            let _ = Post::declare_stopped(number, own);
        }
        doorbells.push((number, doorbell));
    }
    Ok(doorbells)
}

/// The machine's end of the link, once it has connected.
fn accepted(listener: &UnixListener, link: &Path) -> Result<Option<UnixStream>, AnyError> {
    match listener.accept() {
        Ok((stream, _)) => {
            // Not inherited from the listener on Linux, and not relied on.
            stream
                .set_nonblocking(false)
                .map_err(at("take a connection at", link))?;
            Ok(Some(stream))
        }
        Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => Ok(None),
        Err(error) => Err(at("take a connection at", link)(error)),
    }
}

/// The harts that are not in their monitor yet.
fn not_up(memory: &MachineMemory) -> Result<Vec<u32>, AnyError> {
    let mut missing = Vec::new();
    for hart in 0..memory.map().harts() {
        let state = memory.control(hart)?.state().map_err(memory.at())?;
        if state == HartState::Off {
            missing.push(hart);
        }
    }
    Ok(missing)
}
