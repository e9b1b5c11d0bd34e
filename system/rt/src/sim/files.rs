//! The file service in virtual time.

use core::error::Error;
use core::time::Duration;
use std::path::Path;

use condor_dev::Bus;
use condor_fs::server::{FileServer, ServerOptions};
use condor_fs::wire::FILES;
use condor_mbox::{Call, Messenger as _};

use super::processor::SimMachine;
use crate::machine::Machine as _;

/// The time that the service serves before it checks if it must end.
const NAP: Duration = Duration::from_millis(100);

/// Serves `root` until the run is over.
pub(super) fn serve<B: Bus + Clone + Send + Sync>(
    machine: &SimMachine<B>,
    root: &Path,
) -> Result<(), Box<dyn Error>> {
    let server = FileServer::new(root, ServerOptions::default())?;
    let windows = machine.windows();
    server.recover(&windows)?;
    let answer = |call: &Call<'_>| server.answer(call, &windows);
    let mut mailbox = machine.mailbox()?;
    mailbox.set_vector(FILES, &answer, "files")?;
    mailbox.join()?;
    while !machine.is_stopping() {
        mailbox.serve(NAP)?;
    }
    Ok(())
}
