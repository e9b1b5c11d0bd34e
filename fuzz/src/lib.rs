//! What the fuzz targets share with the property tests of the crates: scenarios out of bytes.

#[path = "../../condor-dev/tests/hostile/mod.rs"]
mod devices;
mod progress;
#[path = "../../condor-mbox/tests/hostile/mod.rs"]
mod scenario;

/// Two honest processors keep every promise while a third writes whatever it can.
///
/// # Panics
/// If a promise of the mailbox was broken.
pub fn hostile_mailbox(bytes: &[u8]) {
    progress::report("hostile_mailbox", scenario::run(bytes));
}

/// Regions, published values and locks bear any words in their memory.
///
/// # Panics
/// If one of them broke a promise.
pub fn regions(bytes: &[u8]) {
    progress::report("regions", scenario::regions::run(bytes));
}

/// Drivers bear boards whose registers say anything, a bus that fails anywhere, and any interrupts.
///
/// # Panics
/// If one of them broke a promise.
pub fn drivers(bytes: &[u8]) {
    devices::run(bytes);
}
