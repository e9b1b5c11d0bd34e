//! [`Client`]: the processor whose files are mounted.

use std::collections::HashMap;
use std::time::Duration;

use condor_fs::wire::OPEN_FILES;
use condor_fs::{Area, Errno, FileError, FileStatus, FileSystem, OpenOptions};
use condor_mbox::linux::{LinuxMailbox, LinuxSystem, LinuxWindow};
use condor_mbox::{Processor, Region};

use crate::server::SERVER;
use crate::{AnyError, N};

const CLIENT: Processor = Processor(1);
/// The greatest number of open files. fsx leaves mapped what it has read by a mapping, and thereby open.
const FILES: usize = 256;
/// The longest path that the server takes, in bytes.
const PATH: u32 = 4095;
/// Bytes of a file's buffer: what one call moves. The kernel asks for more at once, so that the server
/// also dies between the parts of a write.
const BUFFER: u32 = 16 * 1024;
/// The time that an operation may take over all deaths of the server.
const TIMEOUT: Duration = Duration::from_secs(60);

type Mail = LinuxMailbox<'static, N>;
type File = condor_fs::File<'static, 'static, Mail, LinuxWindow, FILES>;

/// The client, and its open files by the numbers that the kernel has for them.
pub(crate) struct Client {
    pub(crate) files: &'static FileSystem<'static, Mail, LinuxWindow, FILES>,
    open: HashMap<u64, Open>,
    last: u64,
}

struct Open {
    node: u64,
    appends: bool,
    file: File,
}

/// A name in a directory, and the type bits of its `st_mode`, shifted right by 12.
pub(crate) type Entry = (Vec<u8>, u32);

impl Client {
    pub(crate) fn connect(system: &'static LinuxSystem<N>) -> Result<Self, AnyError> {
        let mut claim = system.claim(CLIENT)?;
        let own = Region::users(claim.windows()[CLIENT.index()].data.clone())?;
        let area = Area::<FILES>::new(&mut claim.places()?, PATH, BUFFER)?;
        // The filesystem is mounted until this process ends.
        let handler = Box::leak(Box::new(area.handler()));
        let mailbox = Box::leak(Box::new(claim.mailbox()?));
        mailbox.set_vector(OPEN_FILES, handler, "open files")?;
        mailbox.join()?;
        let files = FileSystem::connect(mailbox, SERVER, own, area, TIMEOUT)?;
        Ok(Self {
            files: Box::leak(Box::new(files)),
            open: HashMap::new(),
            last: 0,
        })
    }

    /// Opens `path`, which is that of `node`.
    pub(crate) fn open(
        &mut self,
        node: u64,
        path: &[u8],
        options: OpenOptions,
    ) -> Result<u64, FileError> {
        let file = self.files.open(path, options)?;
        self.last += 1;
        let appends = options == options.append();
        let open = Open {
            node,
            appends,
            file,
        };
        self.open.insert(self.last, open);
        Ok(self.last)
    }

    /// Says of which node a file is that was opened before it had one.
    pub(crate) fn opened(&mut self, handle: u64, node: u64) {
        if let Some(open) = self.open.get_mut(&handle) {
            open.node = node;
        }
    }

    pub(crate) fn file(&mut self, handle: u64) -> Result<&mut File, FileError> {
        let open = self.open.get_mut(&handle).ok_or(Errno::BADF)?;
        Ok(&mut open.file)
    }

    pub(crate) fn close(&mut self, handle: u64) -> Result<(), FileError> {
        self.open.remove(&handle).ok_or(Errno::BADF)?.file.close()
    }

    /// Returns the status of a node: by its path, or by an open file of it if it has none.
    pub(crate) fn status(&self, node: u64, path: Option<&[u8]>) -> Result<FileStatus, FileError> {
        if let Some(path) = path {
            return self.files.status(path);
        }
        let open = self.open.values().find(|open| open.node == node);
        open.ok_or(Errno::STALE)?.file.status()
    }

    pub(crate) fn read(&mut self, handle: u64, at: u64, len: u32) -> Result<Vec<u8>, FileError> {
        let file = self.file(handle)?;
        let mut data = vec![0; len as usize];
        let mut read = 0;
        while read < data.len() {
            match file.read_at(&mut data[read..], at + read as u64)? {
                0 => break,
                more => read += more,
            }
        }
        data.truncate(read);
        Ok(data)
    }

    pub(crate) fn write(&mut self, handle: u64, at: u64, data: &[u8]) -> Result<u32, FileError> {
        let open = self.open.get_mut(&handle).ok_or(Errno::BADF)?;
        let (file, appends) = (&mut open.file, open.appends);
        let mut written = 0;
        while written < data.len() {
            // Appended bytes go to the end only.
            let part = if appends {
                file.write(&data[written..])
            } else {
                file.write_at(&data[written..], at + written as u64)
            };
            match part {
                Ok(0) => break,
                Ok(more) => written += more,
                // The bytes that were written before the error are reported.
                Err(FileError::Errno(_)) if written > 0 => break,
                Err(error) => return Err(error),
            }
        }
        Ok(written as u32)
    }

    /// Returns all entries of a directory.
    pub(crate) fn entries(&self, path: &[u8]) -> Result<Vec<Entry>, FileError> {
        let mut directory = self.files.open_directory(path)?;
        let (mut entries, mut name) = (Vec::new(), [0; 255]);
        while let Some(entry) = directory.next(&mut name)? {
            entries.push((entry.name.to_vec(), entry.kind));
        }
        directory.close()?;
        Ok(entries)
    }
}
