//! What all drills begin with.

use condor_mbox::published::{ReadError, Subscriber};
use condor_mbox::{Call, MemoryWindow, Places, Published, Region, Windows};
use condor_rt::directory::{Directory, Kind};
use condor_rt::{Machine, MailboxOf, directory};
use condor_tty::{Terminal, Vectors};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::failure::Failure;

/// Bytes of a terminal's ring, and characters that can be typed ahead.
const SHOWN_BYTES: u32 = 4096;
const TYPED: usize = 16;

/// The terminal of a drill.
pub type Console<M> = Terminal<<M as Machine>::Window, <M as Machine>::Exclusion, TYPED>;

/// What a drill has before it has a mailbox.
pub struct Ground<M: Machine> {
    /// What users have of this processor's `data`.
    pub own: Region<M::Window>,
    /// What is still free of it.
    pub places: Places,
    /// What is where.
    pub directory: Directory<M::Window>,
    /// The terminal, whose vectors [`mailbox`] sets.
    pub terminal: Console<M>,
}

impl<M: Machine> Ground<M> {
    /// Makes the directory, and a terminal.
    ///
    /// # Errors
    /// The memory is too small for that.
    pub fn new(machine: &M) -> Result<Self, Failure> {
        let own = users(machine, machine.number().0)?;
        let mut places = Places::new(own.size());
        let mut directory = Directory::new(own.clone(), &mut places)?;
        let terminal = Terminal::new(own.clone(), &mut places, SHOWN_BYTES, machine.exclusion())?;
        directory.enter("console", Kind::Terminal, terminal.offset(), SHOWN_BYTES)?;
        Ok(Self {
            own,
            places,
            directory,
            terminal,
        })
    }

    /// A cell of a name for others to read, with [`published`].
    ///
    /// # Errors
    /// The memory is too small for that.
    pub fn publish<T>(
        &mut self,
        name: &str,
    ) -> Result<condor_mbox::published::Publisher<T, Region<M::Window>>, Failure>
    where
        T: FromBytes + IntoBytes + Immutable,
    {
        let cell = self.places.published::<T>()?;
        // What a former program has left there is none of ours.
        for word in (0..Published::<T>::BYTES).step_by(4) {
            self.own.set_word(cell.offset() + word, 0)?;
        }
        self.directory
            .enter(name, Kind::Other, cell.offset(), Published::<T>::BYTES)?;
        Ok(cell.publisher(self.own.clone())?)
    }
}

/// The users' region of a processor's `data`.
pub(crate) fn users<M: Machine>(machine: &M, number: u8) -> Result<Region<M::Window>, Failure> {
    let mut windows = machine.windows().into_iter();
    let Some(Windows { data, .. }) = windows.nth(number.into()) else {
        return Err(Failure::Late { processor: number });
    };
    Ok(Region::users(data)?)
}

/// A mailbox that has not joined, with the vectors of a terminal.
///
/// # Errors
/// [`Failure::Mailbox`].
pub fn mailbox<'v, M: Machine>(
    machine: &M,
    typed: &'v (dyn Fn(&Call<'_>) -> u32 + Sync),
) -> Result<MailboxOf<'v, M>, Failure> {
    let mut mailbox = machine.mailbox()?;
    mailbox.set_vector(Vectors::DEFAULT.input, typed, "terminal input")?;
    mailbox.set_vector(Vectors::DEFAULT.room, typed, "terminal room")?;
    Ok(mailbox)
}

/// What a processor has published under a name; `None` if it has not yet.
///
/// # Errors
/// The memory's.
pub fn published<T, W>(region: &Region<W>, name: &str) -> Result<Option<T>, Failure>
where
    T: FromBytes + IntoBytes,
    W: MemoryWindow + Clone,
{
    let Some(entry) = directory::find(region, name)? else {
        return Ok(None);
    };
    if entry.len < Published::<T>::BYTES {
        return Ok(None);
    }
    let subscriber: Subscriber<T, _> = Published::at(entry.offset).subscriber(region.clone())?;
    match subscriber.read() {
        Ok(latest) => Ok(Some(latest.value)),
        Err(ReadError::Access(error)) => Err(error.into()),
        Err(_) => Ok(None),
    }
}
