//! The file service: serves the directory of the description to the programs.

use std::path::Path;

use condor_fs::server::{Options, Server};

use super::{ServiceError, claim};
use crate::description::Files;
use crate::signals;
use condor_rt::linux::HostBell;
use condor_rt::numbers::FILES;

/// Serves `root` until SIGTERM.
///
/// # Errors
/// [`ServiceError`] if the directory cannot be served, or the service was not started by a
/// supervisor.
pub fn serve(root: &Path, options: Options) -> Result<(), ServiceError> {
    let stop = signals::flag().map_err(ServiceError::Events)?;
    let server = Server::new(root, options)?;
    let (claim, page) = claim(FILES)?;
    let (windows, doorbell) = claim.into_parts();
    let doorbell = HostBell::of_service(doorbell, page);
    Ok(server.serve_at(FILES, &windows, doorbell, &stop)?)
}

/// The arguments with which the program starts it.
pub(crate) fn arguments(files: &Files) -> Vec<String> {
    let mut arguments: Vec<String> = ["service", "files"].map(Into::into).into();
    if files.read_only {
        arguments.push("--read-only".into());
    }
    let limits = [
        ("--quota-bytes", files.quota_bytes),
        ("--max-file-bytes", files.max_file_bytes),
    ];
    for (option, limit) in limits {
        if let Some(limit) = limit {
            arguments.extend([option.into(), limit.to_string()]);
        }
    }
    arguments.extend(["--".into(), files.root.to_string_lossy().into_owned()]);
    arguments
}
