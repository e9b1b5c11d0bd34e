//! [`System`]: where the memory of *N* processors lies.

use std::ffi::OsString;
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use super::claim::Claim;
use super::description;
use super::directory::OpenDirectory;
use super::error::SystemError;
use super::family::Family;
use super::lock;
use super::memory::{LOCK_BYTES, Memory, Needs};
use super::objects::{Objects, Opened, file_name};
use super::window::Access;
use crate::id::Processor;
use crate::layout;

/// The environment variable in which a system is passed to a child.
const VARIABLE: &str = "CONDOR_SYSTEM";
/// How often a claim begins anew because the directory was removed under it.
const ATTEMPTS: u32 = 16;

/// A system of `N` processors, at most [`Processor::MAX_COUNT`], and where its memory lies.
///
/// It holds no number itself; see the [module](super) for the choice of place.
#[derive(Clone, Debug)]
pub struct System<const N: usize> {
    place: Home,
    user_bytes: u32,
}

#[derive(Clone, Debug)]
enum Home {
    Directory {
        path: PathBuf,
        own: bool,
        /// Where the windows are, if not in files of the directory; boxed, as most have none.
        memory: Option<Box<Memory>>,
    },
    Family(Arc<Family>),
}

impl<const N: usize> System<N> {
    const MAIL_BYTES: u32 = layout::mail_bytes(N as u32);

    /// The system `name` of this user, for programs that need not know each other.
    ///
    /// Its files are in `/dev/shm/condor-NAME`; whoever comes first creates them. The users' part
    /// of every processor's `data` has `user_bytes` bytes, and all programs must agree in it.
    ///
    /// # Errors
    /// The name cannot be one, the size is not one of whole words, the directory cannot be created,
    /// or it belongs to another user; [`SystemError::OtherSystem`] if it has another number of
    /// processors or another size.
    pub fn named(name: &str, user_bytes: u32) -> Result<Self, SystemError> {
        // 255 bytes for the name of a directory, less what is put around it.
        if name.is_empty() || name.len() > 240 || name.contains(['/', '\0']) {
            return Err(SystemError::BadName { name: name.into() });
        }
        let path = Path::new("/dev/shm").join(format!("condor-{name}"));
        Self::in_directory(path, true, None, user_bytes)
    }

    /// The system whose files are in the directory `path`, which is created if there is none. If it
    /// names a [memory](Self::in_memory), the windows are there.
    ///
    /// A relative `path` is taken from the working directory of now, and stays there: a child to
    /// which the system is [passed](Self::pass_to) may run in another one. What `path` ends with must
    /// not be a symbolic link.
    ///
    /// Files get the permissions of the directory, except execution. The file system must have
    /// locks, shared mappings and unnamed files (`O_TMPFILE`): tmpfs and the usual disk file
    /// systems do.
    ///
    /// # Errors
    /// As for [`named`](Self::named); [`SystemError::WrongKind`] for a link.
    pub fn at(path: impl AsRef<Path>, user_bytes: u32) -> Result<Self, SystemError> {
        Self::in_directory(absolute(path.as_ref())?, false, None, user_bytes)
    }

    /// The system whose windows lie in one file, in which there may be more: the memory of another
    /// machine, or a part of it.
    ///
    /// The directory `path`, created if there is none, has what processes need besides: what is
    /// locked, the bells, and a file `system` that says where the windows are. From then on
    /// [`at`](Self::at) finds the system there, too, in this process and in any other. Call this
    /// before: a system that has begun with files of its own stays so.
    ///
    /// Where others may write the directory, a `system` file that names a memory is believed only if
    /// this user, root or the owner of the directory wrote it: it tells this process which file to write.
    ///
    /// The memory is as its maker left it, zeros at first. [`remove`](Self::remove) leaves it alone.
    ///
    /// # Errors
    /// As for [`at`](Self::at); objects that overlap, lie at no word, or lie outside of the file; the
    /// directory names another memory.
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

    /// A new system for this process and for those to which it is passed.
    ///
    /// Its memory is sealed: no participant can make an access of another one fail.
    ///
    /// # Errors
    /// The size is not one of whole words, or the system has no memory or descriptors left.
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

    /// Lets a child, and its children, take part: they get the system by
    /// [`inherited`](Self::inherited).
    ///
    /// It is named in the environment variable `CONDOR_SYSTEM`, so a child is passed one system;
    /// no other child can take part in a family.
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

    /// The system that the parent, or an ancestor, [passed](Self::pass_to) to this process.
    ///
    /// # Errors
    /// None was passed, it has another number of processors, or it is not what it is said to be.
    pub fn inherited() -> Result<Self, SystemError> {
        let description = std::env::var_os(VARIABLE).unwrap_or_default();
        let refused = |reason| SystemError::BadDescription {
            description: description.to_string_lossy().into_owned(),
            reason,
        };
        let mut fields = description.as_bytes().splitn(4, |&byte| byte == b' ');
        let mut field = || fields.next().ok_or_else(|| refused("it is incomplete"));
        let count = parse::<usize>(field()?).ok_or_else(|| refused("it begins with no number"))?;
        if count != N {
            return Err(refused("the number of processors differs"));
        }
        let user_bytes = parse(field()?).ok_or_else(|| refused("the data size is no number"))?;
        let data_bytes = data_bytes(user_bytes)?;
        match field()? {
            b"at" => {
                let path = PathBuf::from(OsString::from_vec(field()?.to_vec()));
                if !path.is_absolute() {
                    return Err(refused("the path is not absolute"));
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
            _ => Err(refused("the kind of place is unknown")),
        }
    }

    /// Bytes in the users' part of every processor's `data`.
    #[must_use]
    pub fn user_bytes(&self) -> u32 {
        self.user_bytes
    }

    /// Takes `number` for this process, until the claim and all that came from it are dropped, or
    /// the process ends in whatever way.
    ///
    /// # Errors
    /// There is no such number, somebody holds it, or a file of the system cannot be created,
    /// opened or mapped, or is not what it should be.
    pub fn claim(&self, number: Processor) -> Result<Claim<N>, SystemError> {
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

    /// Takes the highest number that nobody holds: a *virtual processor*.
    ///
    /// # Errors
    /// All numbers are held; or as for [`claim`](Self::claim).
    pub fn claim_any(&self) -> Result<Claim<N>, SystemError> {
        for number in (0..N as u8).rev() {
            match self.claim(Processor(number)) {
                Err(SystemError::NumberTaken { .. }) => {}
                other => return other,
            }
        }
        Err(SystemError::NoFreeNumber { processors: N })
    }

    /// Removes the files of a named system; who claims a number afterwards begins a new one.
    ///
    /// Nothing needs it: files that are left behind are used again. A family vanishes with its
    /// last process, so there it does nothing.
    ///
    /// # Errors
    /// Somebody holds a number, the directory has files that are not the system's (nothing is
    /// removed then), or the operating system refuses.
    pub fn remove(self) -> Result<(), SystemError> {
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
        let Some(held) = objects.lock(own, Self::MAIL_BYTES, Access::ReadWrite)? else {
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

    fn opened(&self, memory: Memory) -> Result<Opened, SystemError> {
        let file = memory.open(self.needs()?)?;
        Ok(Opened { memory, file })
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
