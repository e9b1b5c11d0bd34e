//! What processors publish for each other.

use condor_mbox::published::{ReadError, Subscriber};
use condor_mbox::{MemoryWindow, Published, Region};
use condor_rt::Error;
use condor_rt::objects::{self, Kind};
use zerocopy::{FromBytes, IntoBytes};

/// What a processor has published under a name; `None` if it has not yet.
///
/// # Errors
/// The memory's.
pub fn published<T, W>(region: &Region<W>, name: &str) -> Result<Option<T>, Error>
where
    T: FromBytes + IntoBytes,
    W: MemoryWindow + Clone,
{
    let Some(object) = objects::find(region, name, Kind::Other)? else {
        return Ok(None);
    };
    if object.len < Published::<T>::BYTES {
        return Ok(None);
    }
    let subscriber: Subscriber<T, _> = Published::at(object.offset).subscriber(region.clone())?;
    match subscriber.read() {
        Ok(latest) => Ok(Some(latest.value)),
        Err(ReadError::Access(error)) => Err(error.into()),
        Err(_) => Ok(None),
    }
}
