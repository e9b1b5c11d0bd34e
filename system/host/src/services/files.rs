//! The file service: serves the directory of the description to the programs.

use condor_fs::server::{FileServer, ServerOptions};

use super::{ServiceError, claim};
use crate::description::Files;
use crate::signals;
use condor_rt::linux::HostBell;
use condor_rt::numbers::FILES;

/// Serves the directory of a description until SIGTERM.
///
/// # Errors
/// [`ServiceError`] if the directory cannot be served, or the service was not started by a
/// supervisor.
pub(super) fn serve(files: &Files) -> Result<(), ServiceError> {
    let stop = signals::flag().map_err(ServiceError::Events)?;
    let options = ServerOptions {
        read_only: files.read_only,
        quota_bytes: files.quota_bytes,
        max_file_bytes: files.max_file_bytes,
        ..ServerOptions::default()
    };
    let server = FileServer::new(&files.root, options)?;
    let (claim, page) = claim(FILES)?;
    let (windows, doorbell) = claim.into_parts();
    let doorbell = HostBell::of_service(doorbell, page);
    Ok(server.serve_at(FILES, &windows, doorbell, &stop)?)
}
