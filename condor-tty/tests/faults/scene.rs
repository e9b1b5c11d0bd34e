//! One policy: a processor that lives, and hosts that do not.

use std::fs::File;
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use condor_mbox::Region;
use condor_mbox::linux::LinuxSystem;

use super::board::{Acknowledged, Board};
use super::judge::Account;
use super::{AnyError, HAND, N, Random, WATCHER, child};

const USER_BYTES: u32 = 64 * 1024;
/// The longest incarnation of a host, in microseconds: from before it attaches to some hundred writes.
const INCARNATION: u64 = 15_000;
/// How long the last host and the processor may take to end.
const PATIENCE: Duration = Duration::from_secs(60);

pub(crate) fn play(
    policy: &str,
    kills: u32,
    mut random: Random,
    journal: &Path,
) -> Result<Account, AnyError> {
    let begun = Instant::now();
    let system = LinuxSystem::<N>::family(USER_BYTES)?;
    let claim = system.claim(WATCHER)?;
    let data = claim.windows()[HAND.index()].data.clone();
    let board = Board(Region::users(data)?);
    let seed = random.0.to_string();
    let mut hand = Process(child(&system, &["hand", policy, &seed])?.spawn()?);
    let mut account = Account::default();
    let mut before = Acknowledged::default();
    for _ in 0..kills {
        let mut host = start(&system, journal)?;
        std::thread::sleep(Duration::from_micros(random.below(INCARNATION)));
        host.kill()?;
        let after = board.acknowledged()?;
        account.enter(&std::fs::read(journal)?, before, after);
        account.kills += 1;
        before = after;
    }
    // The last one shows what there is.
    let mut host = start(&system, journal)?;
    board.stop()?;
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(written) = board.written()?
            && board.acknowledged()?.tail == board.head()?
        {
            account.written = written;
            break;
        }
        if let Some(status) = host.0.try_wait()? {
            return Err(format!("the last host ended with {status}").into());
        }
        if Instant::now() > deadline {
            return Err("the processor and the last host do not end".into());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    host.kill()?;
    account.enter(&std::fs::read(journal)?, before, board.acknowledged()?);
    account.lost = board.lost()?;
    account.ignored = board.ignored()?;
    account.took = begun.elapsed();
    let status = hand.0.wait()?;
    if status.success() {
        Ok(account)
    } else {
        Err(format!("the processor ended with {status}").into())
    }
}

/// A host with an empty journal.
fn start(system: &LinuxSystem<N>, journal: &Path) -> Result<Process, AnyError> {
    File::create(journal)?;
    let path = journal.to_str().ok_or("a path that is no text")?;
    Ok(Process(child(system, &["host", path])?.spawn()?))
}

/// A child that does not outlive this one's interest in it.
struct Process(Child);

impl Process {
    /// Kills it at whatever it does; it must not have ended before.
    fn kill(&mut self) -> Result<(), AnyError> {
        if let Some(status) = self.0.try_wait()? {
            return Err(format!("a host ended with {status} before it was killed").into());
        }
        self.0.kill()?;
        self.0.wait()?;
        Ok(())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
