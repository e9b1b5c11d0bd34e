//! [`LinuxSystem`]: where the memory of *N* processors lies.

use std::ffi::OsString;
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use condor_platform::linux::{LOCK_PATIENCE, while_held};

use super::claim::Claim;
use super::description;
use super::directory::OpenDirectory;
use super::error::SystemError;
use super::family::Family;
use super::lock;
use super::memory::{LOCK_BYTES, Memory, Needs};
use super::objects::{Objects, OpenMemory, file_name};
use super::window::WindowAccess;
use crate::id::Processor;
use crate::layout;

/// The environment variable in which a system is passed to a child.
const VARIABLE: &str = "CONDOR_SYSTEM";
/// The number of times that a claim begins anew because the directory was removed under it.
const ATTEMPTS: u32 = 16;

/// A system of `N` processors (at most [`Processor::MAX_COUNT`]), and the place of their shared
/// memory. The [module](super) lists the possible places.
///
/// A `LinuxSystem` claims no processor number; [`claim`](Self::claim) does.
///
/// ```
/// use condor_mbox::linux::LinuxSystem;
/// use condor_mbox::{Messenger, PeerState, Processor};
///
/// let system = LinuxSystem::<2>::family(4096)?; // of this process and its children
/// let mut host = system.claim(Processor(0))?.mailbox()?;
/// host.join()?;
/// assert!(!matches!(host.peer_state(Processor(1))?, PeerState::Up { .. }));
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct LinuxSystem<const N: usize> {
    place: Home,
    user_bytes: u32,
}

#[derive(Clone, Debug)]
enum Home {
    Directory {
        path: PathBuf,
        own: bool,
        /// The place of the windows, if not in files of the directory; boxed, as most have none.
        memory: Option<Box<Memory>>,
    },
    Family(Arc<Family>),
}

impl<const N: usize> LinuxSystem<N> {
    const MAIL_BYTES: u32 = layout::mail_bytes(N as u32);

    /// Returns the system `name` of this user, for programs that are started independently of each
    /// other.
    ///
    /// The system's files are in `/dev/shm/condor-NAME`; the first program creates them.
    /// `user_bytes` is the size of the users' region of every processor's `data`, in bytes, and
    /// must be the same in all programs.
    ///
    /// # Errors
    /// [`SystemError::BadName`] if `name` cannot be the name of a file,
    /// [`SystemError::BadDataSize`] if `user_bytes` is not a multiple of four or too large,
    /// [`SystemError::WrongOwner`] if the directory belongs to another user,
    /// [`SystemError::OtherSystem`] if the system exists with another number of processors or
    /// another size, [`SystemError::Os`] if the directory cannot be created.
    pub fn named(name: &str, user_bytes: u32) -> Result<Self, SystemError> {
        // 255 bytes for the name of a directory, less what is put around it.
        if name.is_empty() || name.len() > 240 || name.contains(['/', '\0']) {
            return Err(SystemError::BadName { name: name.into() });
        }
        let path = Path::new("/dev/shm").join(format!("condor-{name}"));
        Self::in_directory(path, true, None, user_bytes)
    }

    /// Returns the system whose files are in the directory `path`, which is created if it does not
    /// exist. If the directory names a [memory](Self::in_memory), the windows are in that memory.
    /// `user_bytes` is the size of the users' region of every processor's `data`, in bytes.
    ///
    /// A relative `path` is resolved in the present working directory once; so a child to which the
    /// system is [passed](Self::pass_to) may run in another directory. The last part of `path` must
    /// not be a symbolic link.
    ///
    /// Files get the permissions of the directory, except execution. The filesystem must support
    /// locks, shared mappings and unnamed files (`O_TMPFILE`), as tmpfs and the usual disk
    /// filesystems do.
    ///
    /// # Errors
    /// [`SystemError::BadDataSize`] if `user_bytes` is not a multiple of four or too large,
    /// [`SystemError::WrongKind`] if `path` is a link, [`SystemError::OtherSystem`] if the
    /// directory has a system with another number of processors or another size,
    /// [`SystemError::Os`] if the directory cannot be created.
    pub fn at(path: impl AsRef<Path>, user_bytes: u32) -> Result<Self, SystemError> {
        Self::in_directory(absolute(path.as_ref())?, false, None, user_bytes)
    }

    /// Returns the system whose windows lie in one file, `memory`, which may contain more: for
    /// example the memory of another machine.
    ///
    /// The directory `path`, which is created if it does not exist, has everything else that
    /// processes need: the files that are locked, the doorbells, and a file `system`, which says
    /// where the windows are. From then on [`at`](Self::at) finds the system there, in this process
    /// and in any other. Call this before any program uses `path` by `at`: a system that began with
    /// files of its own keeps them.
    ///
    /// If others may write the directory, a `system` file that names a memory is accepted only if
    /// this user, root or the owner of the directory wrote it, because it tells this process which
    /// file to write.
    ///
    /// The memory must contain zeros, or what programs of this system left there.
    /// [`remove`](Self::remove) does not touch it.
    ///
    /// # Errors
    /// [`SystemError::BadLayout`] if the windows in the memory overlap or are not aligned to words,
    /// [`SystemError::OutsideMemory`] if they lie outside of the file, [`SystemError::OtherSystem`]
    /// if the directory names another memory; otherwise an error of [`at`](Self::at).
    pub fn in_memory(
        path: impl AsRef<Path>,
        user_bytes: u32,
        memory: &Memory,
    ) -> Result<Self, SystemError> {
        let path = absolute(path.as_ref())?;
        Self::in_directory(path, false, Some(Box::new(memory.clone())), user_bytes)
    }

    fn in_directory(
        path: PathBuf,
        own: bool,
        memory: Option<Box<Memory>>,
        user_bytes: u32,
    ) -> Result<Self, SystemError> {
        let system = Self::new(Home::Directory { path, own, memory }, user_bytes)?;
        system.objects()?;
        Ok(system)
    }

    /// Makes a new system for this process and for the processes to which it is
    /// [passed](Self::pass_to). `user_bytes` is the size of the users' region of every processor's
    /// `data`, in bytes.
    ///
    /// The memory is sealed: no process can shrink it, and so make the accesses of another one
    /// fail.
    ///
    /// # Errors
    /// [`SystemError::BadDataSize`] if `user_bytes` is not a multiple of four or too large,
    /// [`SystemError::Os`] if the operating system has no memory or descriptors left.
    pub fn family(user_bytes: u32) -> Result<Self, SystemError> {
        let data_bytes = data_bytes(user_bytes)?;
        let family = Family::new(N, Self::MAIL_BYTES, data_bytes)?;
        Self::new(Home::Family(Arc::new(family)), user_bytes)
    }

    fn new(place: Home, user_bytes: u32) -> Result<Self, SystemError> {
        const {
            assert!(
                N >= 1 && N <= Processor::MAX_COUNT,
                "a system has 1 to 32 processors"
            );
        }
        data_bytes(user_bytes)?;
        Ok(Self { place, user_bytes })
    }

    /// Passes the system to the process that `child` starts; that process, and the processes that
    /// it starts, get the system by [`inherited`](Self::inherited).
    ///
    /// The environment variable `CONDOR_SYSTEM` names the system, so a child can be passed only
    /// one. A child to which a [family](Self::family) was not passed cannot take part in it.
    pub fn pass_to<'a>(&self, child: &'a mut Command) -> &'a mut Command {
        let mut description = OsString::from(format!("{N} {} ", self.user_bytes));
        match &self.place {
            Home::Directory { path, .. } => {
                description.push("at ");
                description.push(path);
            }
            Home::Family(family) => {
                description.push("family");
                for descriptor in family.descriptors() {
                    description.push(format!(" {}", descriptor.as_raw_fd()));
                }
                let family = family.clone();
                let keep = move || family.keep_through_exec().map_err(Into::into);
                // SAFETY: between `fork` and `exec` the closure only calls `fcntl`, which is
                // async-signal-safe, on descriptors that it owns together with `self`.
                unsafe { child.pre_exec(keep) };
            }
        }
        child.env(VARIABLE, description)
    }

    /// Returns the system that the parent, or an ancestor, [passed](Self::pass_to) to this process.
    ///
    /// # Errors
    /// [`SystemError::BadDescription`] if no system was passed, or if it has another number of
    /// processors; other variants if its directory or its memory cannot be opened, as in
    /// [`at`](Self::at).
    pub fn inherited() -> Result<Self, SystemError> {
        let description = std::env::var_os(VARIABLE).unwrap_or_default();
        let refused = |reason| SystemError::BadDescription {
            description: description.to_string_lossy().into_owned(),
            reason,
        };
        let mut fields = description.as_bytes().splitn(4, |&byte| byte == b' ');
        let mut field = || fields.next().ok_or_else(|| refused("it ends too early"));
        let count = parse::<usize>(field()?)
            .ok_or_else(|| refused("it does not begin with a number of processors"))?;
        if count != N {
            return Err(refused("it has another number of processors"));
        }
        let user_bytes = parse(field()?).ok_or_else(|| refused("its data size is not a number"))?;
        let data_bytes = data_bytes(user_bytes)?;
        match field()? {
            b"at" => {
                let path = PathBuf::from(OsString::from_vec(field()?.to_vec()));
                if !path.is_absolute() {
                    return Err(refused("its path is not absolute"));
                }
                Self::at(path, user_bytes)
            }
            b"family" => {
                let descriptors: Option<Vec<RawFd>> =
                    field()?.split(|&byte| byte == b' ').map(parse).collect();
                let descriptors = descriptors
                    .filter(|all| all.len() == 3 * N && all.iter().all(|&one| one >= 0))
                    .ok_or_else(|| refused("it needs three descriptors for every processor"))?;
                let family = Family::inherit(&descriptors, Self::MAIL_BYTES, data_bytes)?;
                Self::new(Home::Family(Arc::new(family)), user_bytes)
            }
            _ => Err(refused("it names the memory by neither `at` nor `family`")),
        }
    }

    /// Returns the size of the users' region of every processor's `data`, in bytes.
    #[must_use]
    pub fn user_bytes(&self) -> u32 {
        self.user_bytes
    }

    /// Takes `number` for this process, until the claim and everything that came from it are
    /// dropped, or the process ends in any way.
    ///
    /// Waits up to [`LOCK_PATIENCE`], which is 1 s, while another claim holds the number. A claim
    /// may outlive the program that made it by some milliseconds: the kernel frees its memory
    /// first, and a child process that the program started keeps the lock until it executes another
    /// program.
    ///
    /// # Errors
    /// [`SystemError::NoSuchProcessor`] if no processor has the number,
    /// [`SystemError::NumberTaken`] if another claim still holds it after that time; other variants
    /// if a file of the system cannot be created, opened or mapped, or has the wrong kind, owner or
    /// size.
    pub fn claim(&self, number: Processor) -> Result<Claim<N>, SystemError> {
        self.claim_within(number, LOCK_PATIENCE)
    }

    /// Takes `number` as [`claim`](Self::claim) does, but waits up to `patience` while another
    /// claim holds it. With a `patience` of zero, it does not wait.
    ///
    /// Use this function with a longer patience to take over from a program that is about to end.
    ///
    /// # Errors
    /// [`SystemError::NumberTaken`] if the other claim holds the number for longer than `patience`;
    /// otherwise an error of [`claim`](Self::claim).
    pub fn claim_within(
        &self,
        number: Processor,
        patience: Duration,
    ) -> Result<Claim<N>, SystemError> {
        while_held(patience, is_taken, || self.try_claim(number))
    }

    fn try_claim(&self, number: Processor) -> Result<Claim<N>, SystemError> {
        if number.index() >= N {
            return Err(SystemError::NoSuchProcessor {
                number,
                processors: N,
            });
        }
        for _ in 0..ATTEMPTS {
            if let Some(claim) = self.claim_from(&self.objects()?, number)? {
                return Ok(claim);
            }
        }
        Err(self.unsteady())
    }

    /// Takes the highest free number, for a program that is not a processor of the robot: for the
    /// others it is then a *virtual* processor. Waits up to [`LOCK_PATIENCE`] while all numbers are
    /// held, for the reasons that [`claim`](Self::claim) states.
    ///
    /// # Errors
    /// [`SystemError::NoFreeNumber`] if all numbers are still held after that time; otherwise an
    /// error of [`claim`](Self::claim) about a file.
    pub fn claim_any(&self) -> Result<Claim<N>, SystemError> {
        let none_is_free =
            |result: &Result<_, _>| matches!(result, Err(SystemError::NoFreeNumber { .. }));
        while_held(LOCK_PATIENCE, none_is_free, || {
            for number in (0..N as u8).rev() {
                match self.try_claim(Processor(number)) {
                    Err(SystemError::NumberTaken { .. }) => {}
                    other => return other,
                }
            }
            Err(SystemError::NoFreeNumber { processors: N })
        })
    }

    /// Removes the files of a named system; the next claim begins a new system. Waits up to
    /// [`LOCK_PATIENCE`], which is 1 s, while a claim holds a number, for the reasons that
    /// [`claim`](Self::claim) states.
    ///
    /// Removing is never necessary: files that are left behind are used again. The call does
    /// nothing for a family, which vanishes with its last process.
    ///
    /// # Errors
    /// [`SystemError::NumberTaken`] if a number is still held after that time,
    /// [`SystemError::ForeignFile`] if the directory has other files (nothing is removed then),
    /// [`SystemError::Os`] if the operating system refuses.
    pub fn remove(self) -> Result<(), SystemError> {
        self.remove_within(LOCK_PATIENCE)
    }

    /// Removes the files of a named system as [`remove`](Self::remove) does, but waits up to
    /// `patience` while a claim holds a number. With a `patience` of zero, it does not wait.
    ///
    /// # Errors
    /// [`SystemError::NumberTaken`] if a number is held for longer than `patience`; otherwise an
    /// error of [`remove`](Self::remove).
    pub fn remove_within(self, patience: Duration) -> Result<(), SystemError> {
        while_held(patience, is_taken, || self.try_remove())
    }

    fn try_remove(&self) -> Result<(), SystemError> {
        let objects = self.objects()?;
        let Objects::Directory { place, memory } = &objects else {
            return Ok(());
        };
        let mails: Vec<_> = (0..N).map(|number| file_name(number, "mail")).collect();
        let mut names = mails.clone();
        names.extend((0..N).map(|number| file_name(number, "data")));
        names.extend((0..N).map(|number| file_name(number, "bell")));
        names.push(description::NAME.into());
        let lock_bytes = memory.as_ref().map_or(Self::MAIL_BYTES, |_| LOCK_BYTES);
        match place.remove(&names, &mails, lock_bytes)? {
            None => Ok(()),
            Some((number, mail)) => Err(objects.taken(Processor(number as u8), &mail)),
        }
    }

    /// `None` if the directory was removed meanwhile.
    fn claim_from(
        &self,
        objects: &Objects<'_>,
        number: Processor,
    ) -> Result<Option<Claim<N>>, SystemError> {
        let own = number.index();
        let Some(held) = objects.lock(own, Self::MAIL_BYTES, WindowAccess::ReadWrite)? else {
            return Ok(None);
        };
        if !lock::take(&held).map_err(SystemError::os("lock", objects.path(own, "mail")))? {
            return Err(objects.taken(number, &held));
        }
        // From here on nobody removes the directory; but somebody may have done so before.
        if !objects.is_current()? {
            return Ok(None);
        }
        Claim::new(
            number,
            held,
            objects,
            Self::MAIL_BYTES,
            data_bytes(self.user_bytes)?,
        )
    }

    fn objects(&self) -> Result<Objects<'_>, SystemError> {
        match &self.place {
            Home::Family(family) => Ok(Objects::Family(family)),
            Home::Directory { path, own, memory } => {
                for _ in 0..ATTEMPTS {
                    let Some(place) = OpenDirectory::open(path)? else {
                        continue;
                    };
                    if *own {
                        place.expect_own()?;
                    }
                    let wanted = memory.as_deref();
                    if let Some(wanted) = wanted {
                        wanted.check(self.needs()?)?;
                    }
                    let text = description::text_of(N, self.user_bytes, wanted);
                    let Some((text, stat)) = place.text_or(description::NAME, &text)? else {
                        continue;
                    };
                    let path = place.path_of(description::NAME);
                    let found = description::memory_of(&text, &path, N, self.user_bytes)?;
                    if wanted.is_some() && wanted != found.as_ref() {
                        let reason = format!("its memory is {found:?}, expected {wanted:?}");
                        return Err(SystemError::OtherSystem { path, reason });
                    }
                    if found.is_some() {
                        place.expect_trusted(description::NAME, &stat)?;
                    }
                    let memory = found.map(|memory| self.opened(memory)).transpose()?;
                    return Ok(Objects::Directory { place, memory });
                }
                Err(self.unsteady())
            }
        }
    }

    fn opened(&self, memory: Memory) -> Result<OpenMemory, SystemError> {
        let file = memory.open(self.needs()?)?;
        Ok(OpenMemory { memory, file })
    }

    fn needs(&self) -> Result<Needs, SystemError> {
        Ok(Needs {
            processors: N,
            mail_bytes: Self::MAIL_BYTES,
            data_bytes: data_bytes(self.user_bytes)?,
        })
    }

    fn unsteady(&self) -> SystemError {
        let path = match &self.place {
            Home::Directory { path, .. } => path.clone(),
            Home::Family(_) => PathBuf::new(),
        };
        SystemError::Unsteady {
            path,
            times: ATTEMPTS,
        }
    }
}

fn is_taken<T>(result: &Result<T, SystemError>) -> bool {
    matches!(result, Err(SystemError::NumberTaken { .. }))
}

/// The path from the root, wherever the working directory is later.
fn absolute(path: &Path) -> Result<PathBuf, SystemError> {
    let absolute = std::path::absolute(path).map_err(SystemError::os("find", path))?;
    Ok(absolute.components().collect())
}

/// Size of `data` with the doorbell's line.
fn data_bytes(user_bytes: u32) -> Result<u32, SystemError> {
    let total = user_bytes.checked_add(layout::BELL_BYTES);
    total
        .filter(|total| total.is_multiple_of(4))
        .ok_or(SystemError::BadDataSize { user_bytes })
}

fn parse<T: std::str::FromStr>(text: &[u8]) -> Option<T> {
    std::str::from_utf8(text).ok()?.parse().ok()
}
