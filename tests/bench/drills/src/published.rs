//! Reading of values that processors publish for each other.

use condor_mbox::published::{PublishedReadError, Subscriber};
use condor_mbox::{MemoryWindow, Published, Region};
use condor_rt::ProgramError;
use condor_rt::objects::{self, ObjectKind};
use zerocopy::{FromBytes, IntoBytes};

/// Returns the value that a processor has published under a name; `None` if it has not published one yet.
///
/// # Errors
/// Returns the error of the memory if an access fails.
pub fn published<T, W>(region: &Region<W>, name: &str) -> Result<Option<T>, ProgramError>
where
    T: FromBytes + IntoBytes,
    W: MemoryWindow + Clone,
{
    let Some(object) = objects::find(region, name, ObjectKind::Other)? else {
        return Ok(None);
    };
    if object.len < Published::<T>::BYTES {
        return Ok(None);
    }
    let subscriber: Subscriber<T, _> = Published::at(object.offset).subscriber(region.clone())?;
    match subscriber.read() {
        Ok(latest) => Ok(Some(latest.value)),
        Err(PublishedReadError::Access(error)) => Err(error.into()),
        Err(_) => Ok(None),
    }
}
