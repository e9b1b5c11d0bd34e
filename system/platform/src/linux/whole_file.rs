//! [`WholeFile`]: a file that exists complete, or not at all.

use std::format;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use core::sync::atomic::{AtomicU32, Ordering};

use super::regular::check_regular;

/// A file that gets its name when it is complete.
///
/// Until then it is written under another name in the same directory, `.PROCESS-NUMBER.part`. So a reader finds the
/// former file or the complete new one, whatever happens: a full disk, a kill of the process, or a loss of power. A
/// file that is dropped before [`finish`](Self::finish) is removed.
///
/// ```
/// use std::io::Write;
///
/// use condor_platform::linux::WholeFile;
///
/// # fn main() -> std::io::Result<()> {
/// # let path = std::env::temp_dir().join(format!("whole file {}", std::process::id()));
/// let mut file = WholeFile::create(&path)?;
/// file.write_all(b"speed = 3\n")?;
/// assert!(!path.exists());
/// file.finish()?;
/// assert_eq!(std::fs::read(&path)?, b"speed = 3\n");
/// # std::fs::remove_file(path)
/// # }
/// ```
#[derive(Debug)]
pub struct WholeFile {
    file: File,
    part: PathBuf,
    path: PathBuf,
}

impl WholeFile {
    /// Begins a file whose name will be `path`. If `path` is a link, the link stays, and the file to which it leads is
    /// replaced. The new file gets the permissions of the file that it replaces.
    ///
    /// # Errors
    /// Returns an error of the kind [`InvalidInput`](ErrorKind::InvalidInput) if `path` exists and is not a
    /// regular file; the operating system's error if no file can be made in its directory.
    pub fn create(path: impl AsRef<Path>) -> io::Result<Self> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let path = path.as_ref();
        let path = path.canonicalize().unwrap_or_else(|_| path.into());
        let former = match path.metadata() {
            Ok(former) => Some(former),
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        former.as_ref().map_or(Ok(()), check_regular)?;
        let (file, part) = loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let name = format!(".{}-{number}.part", std::process::id());
            let part = directory(&path).join(name);
            match File::create_new(&part) {
                // A killed process of the same number has left it.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                file => break (file?, part),
            }
        };
        let this = Self { file, part, path };
        if let Some(former) = former {
            this.file.set_permissions(former.permissions())?;
        }
        Ok(this)
    }

    /// Writes `content` as the whole file `path`, and replaces a previous file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be made or named, as [`create`](Self::create) and
    /// [`finish`](Self::finish) do; the operating system's error if the content cannot be written.
    pub fn write(path: impl AsRef<Path>, content: impl AsRef<[u8]>) -> io::Result<()> {
        let mut file = Self::create(path)?;
        file.write_all(content.as_ref())?;
        file.finish()
    }

    /// Puts the file under its name once its content is on the disk, and replaces a previous file.
    ///
    /// # Errors
    /// Returns the operating system's error if the file cannot be synced or named. The previous file is then
    /// unchanged, unless only the sync of the directory has failed.
    pub fn finish(mut self) -> io::Result<()> {
        self.file.sync_all()?;
        fs::rename(&self.part, &self.path)?;
        // Another process may have a part of this name by now: nothing is left to remove.
        self.part.clear();
        sync_name(&self.path)
    }

    /// Puts the file under its name once its content is on the disk. Does not replace a file that has this name
    /// already.
    ///
    /// # Errors
    /// Returns an error of the kind [`AlreadyExists`](ErrorKind::AlreadyExists) if there is a file of this
    /// name; the operating system's error if the file cannot be synced or named.
    pub fn finish_new(self) -> io::Result<()> {
        self.file.sync_all()?;
        fs::hard_link(&self.part, &self.path)?;
        sync_name(&self.path)
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.part);
    }
}

/// Syncs the directory of `path`: a file name that was added or changed there then survives a loss of power.
///
/// # Errors
/// Returns the operating system's error if the directory cannot be opened or synced.
pub fn sync_name(path: impl AsRef<Path>) -> io::Result<()> {
    File::open(directory(path.as_ref()))?.sync_all()
}

/// Returns the directory in which a file has its name.
fn directory(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}
