//! Two processors do a random mix of operations, each beside a model of what must come of it, while the
//! server is killed at random instants.
//!
//! `cargo test --release -p condor-fs --features linux --test faults -- --kills 1000 [--seed N]
//! [--directory DIRECTORY]`
//!
//! Without arguments it is short; those of libtest count for nothing. The directory, one of the build if
//! not given, must be on a disk: tmpfs never uses an inode number
//! again. The disk may be full at times: what finds no space must have no effect. One wrong, lost or
//! doubled effect, and the program fails.

#[path = "../../examples/serving/mod.rs"]
mod serving;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use condor_fs::{AllocationMode, Errno, FileError, OpenOptions};
use condor_mbox::Processor;
use condor_mbox::linux::LinuxSystem;
use embedded_io::SeekFrom;
use interrupt_injector::{argument, seed};
use serving::{AnyError, BYTES, Files, N, ServerProcess, on_processor, served};

const CLIENTS: [Processor; 2] = [Processor(1), Processor(2)];
/// The kind of filesystem that never uses an inode number again.
const TMPFS: u64 = 0x0102_1994;
/// Bytes of a record in the log that both clients append to.
const RECORD: usize = 16;

struct Options {
    kills: u32,
    seed: u64,
    directory: PathBuf,
}

impl Options {
    fn of_arguments() -> Result<Self, AnyError> {
        Ok(Self {
            kills: argument("--kills", 30)?,
            seed: seed()?,
            directory: argument("--directory", env!("CARGO_TARGET_TMPDIR").into())?,
        })
    }
}

fn main() -> Result<(), AnyError> {
    if served()? {
        return Ok(());
    }
    let options = Options::of_arguments()?;
    let root = tempfile::tempdir_in(&options.directory)?;
    if rustix::fs::statfs(root.path())?.f_type.cast_unsigned() == TMPFS {
        return Err("the directory is on a tmpfs: give --directory on a disk".into());
    }
    let system = LinuxSystem::<N>::family(BYTES)?;
    let (stop, done) = (AtomicBool::new(false), AtomicU64::new(0));
    let begun = Instant::now();
    let models = std::thread::scope(|threads| {
        let clients = CLIENTS.map(|number| {
            let (system, stop, done) = (&system, &stop, &done);
            let seed = options.seed ^ (u64::from(number.0) << 32);
            threads.spawn(move || {
                let outcome = on_processor(system, number, |files, _, _| {
                    let mut client = Client::new(files, number, seed)?;
                    while !stop.load(Ordering::Relaxed) {
                        client.step()?;
                        done.fetch_add(1, Ordering::Relaxed);
                    }
                    Ok((client.model, client.appended, client.refused))
                });
                // Who found something wrong ends it for all.
                stop.store(true, Ordering::Relaxed);
                outcome
            })
        });
        let killed = kill(&options, &system, root.path(), &stop, &done);
        stop.store(true, Ordering::Relaxed);
        // The last operations need a server.
        let last = ServerProcess::start(&system, root.path())?;
        let mut models = Vec::new();
        for client in clients {
            models.push(client.join().map_err(|_| "a client panicked")??);
        }
        drop(last);
        println!("{} kills", killed?);
        Ok::<_, AnyError>(models)
    })?;
    let wrong = judge(root.path(), &models)?;
    println!(
        "{} operations in {:.1} s, {} without space: {wrong} wrong, lost or doubled effects",
        done.load(Ordering::Relaxed),
        begun.elapsed().as_secs_f64(),
        models.iter().map(|(_, _, refused)| refused).sum::<u64>()
    );
    if wrong == 0 {
        Ok(())
    } else {
        Err("the file service broke its promise".into())
    }
}

/// Kills servers at random instants; gives how many.
fn kill(
    options: &Options,
    system: &LinuxSystem<N>,
    root: &Path,
    stop: &AtomicBool,
    done: &AtomicU64,
) -> Result<u32, AnyError> {
    let mut random = Random(options.seed | 1);
    let stopped = || stop.load(Ordering::Relaxed);
    for kills in 0..options.kills {
        if stopped() {
            return Ok(kills);
        }
        let before = done.load(Ordering::Relaxed);
        let server = ServerProcess::start(system, root)?;
        // On a loaded machine a server may not get to work in its time: some wait until one has.
        while kills % 4 == 3 && done.load(Ordering::Relaxed) == before && !stopped() {
            std::thread::yield_now();
        }
        // From before it serves until after some hundred operations.
        std::thread::sleep(Duration::from_micros(random.below(25_000)));
        server.kill()?;
    }
    Ok(options.kills)
}

/// What a client's directory must hold: files, and directories as `None`.
type Model = BTreeMap<String, Option<Vec<u8>>>;

struct Client<'c, 'm, 'v> {
    files: &'c Files<'m, 'v>,
    number: Processor,
    random: Random,
    model: Model,
    /// Records in the log of both.
    appended: u64,
    /// Operations that found no space.
    refused: u64,
}

impl<'c, 'm, 'v> Client<'c, 'm, 'v> {
    fn new(files: &'c Files<'m, 'v>, number: Processor, seed: u64) -> Result<Self, AnyError> {
        let mut client = Self {
            files,
            number,
            random: Random(seed | 1),
            model: Model::new(),
            appended: 0,
            refused: 0,
        };
        let directory = format!("{}", number.0);
        while !client.expect(&directory, files.make_directory(&directory).err(), None)? {}
        Ok(client)
    }

    fn path(&self, name: &str) -> String {
        format!("{}/{name}", self.number.0)
    }

    /// One random operation, in the tree and in the model.
    fn step(&mut self) -> Result<(), AnyError> {
        let (kind, name) = (self.random.below(15), format!("n{}", self.random.below(6)));
        let path = self.path(&name);
        let write = OpenOptions::new().write();
        let found = self.model.get(&name).cloned();
        match kind {
            0 | 1 => {
                let expected = found.is_some().then_some(Errno::EXIST);
                let data = self.random.bytes(300);
                let opened = self.files.open(&path, write.exclusive());
                self.expect(&path, opened.as_ref().err().copied(), expected)?;
                if let Ok(mut file) = opened {
                    let written = self.written(file.write(&data))?;
                    file.close()?;
                    self.model.insert(name, Some(data[..written].to_vec()));
                }
            }
            2..=4 => {
                let mut options = write.read();
                if kind == 4 {
                    options = options.append();
                }
                let expected = match found {
                    None => Some(Errno::NOENT),
                    Some(None) => Some(Errno::ISDIR),
                    Some(_) => None,
                };
                let opened = self.files.open(&path, options);
                self.expect(&path, opened.as_ref().err().copied(), expected)?;
                if let (Ok(mut file), Some(Some(mut model))) = (opened, found) {
                    let data = self.random.bytes(500);
                    let mut at = usize::try_from(self.random.below(600))?;
                    if kind == 4 {
                        at = model.len();
                    } else if kind == 3
                        && self.expect(&path, file.truncate(at as u64).err(), None)?
                    {
                        model.resize(at, 0);
                    }
                    file.seek(SeekFrom::Start(at as u64))?;
                    let written = self.written(file.write(&data))?;
                    if written > 0 {
                        model.resize(model.len().max(at + written), 0);
                        model[at..at + written].copy_from_slice(&data[..written]);
                    }
                    check(&mut file, &path, &model)?;
                    file.close()?;
                    self.model.insert(name, Some(model));
                }
            }
            5 | 6 => {
                let expected = match found {
                    None => Some(Errno::NOENT),
                    Some(None) => Some(Errno::ISDIR),
                    Some(_) => None,
                };
                if self.expect(&path, self.files.unlink(&path).err(), expected)? {
                    self.model.remove(&name);
                }
            }
            7 | 8 => self.rename(&name)?,
            9 => {
                let expected = found.is_some().then_some(Errno::EXIST);
                if self.expect(&path, self.files.make_directory(&path).err(), expected)? {
                    self.model.insert(name, None);
                }
            }
            10 => {
                let expected = match found {
                    None => Some(Errno::NOENT),
                    Some(None) => None,
                    Some(_) => Some(Errno::NOTDIR),
                };
                let removed = self.files.remove_directory(&path);
                if self.expect(&path, removed.err(), expected)? {
                    self.model.remove(&name);
                }
            }
            11 => self.exchange(&name)?,
            12 => self.unlinked(&name)?,
            13 => self.range(&name)?,
            _ => self.append()?,
        }
        Ok(())
    }

    /// Two names, of whatever they are.
    fn exchange(&mut self, name: &str) -> Result<(), AnyError> {
        let other = format!("n{}", self.random.below(6));
        let both = (self.model.get(name).cloned()).zip(self.model.get(&other).cloned());
        let expected = both.is_none().then_some(Errno::NOENT);
        let outcome = self.files.exchange(self.path(name), self.path(&other));
        if self.expect(name, outcome.err(), expected)?
            && let Some((one, two)) = both
        {
            self.model.insert(name.into(), two);
            self.model.insert(other, one);
        }
        Ok(())
    }

    /// A file that is unlinked while it is open keeps its contents, and has no link.
    fn unlinked(&mut self, name: &str) -> Result<(), AnyError> {
        let path = self.path(name);
        if self.model.contains_key(name) {
            return Ok(());
        }
        let new = OpenOptions::new().write().read().exclusive();
        let opened = self.files.open(&path, new);
        self.expect(&path, opened.as_ref().err().copied(), None)?;
        let Ok(mut file) = opened else { return Ok(()) };
        let mut model = vec![7; usize::try_from(self.random.below(200))?];
        let written = self.written(file.write(&model))?;
        model.truncate(written);
        if !self.expect(&path, self.files.unlink(&path).err(), None)? {
            return Err(format!("{path}: no space to unlink it").into());
        }
        let links = file.status()?.links;
        if links != 0 {
            return Err(format!("{path} was unlinked and has {links} links").into());
        }
        check(&mut file, &path, &model)?;
        Ok(file.close()?)
    }

    /// Holes and room, and what lies there.
    fn range(&mut self, name: &str) -> Result<(), AnyError> {
        let path = self.path(name);
        let Some(Some(mut model)) = self.model.get(name).cloned() else {
            return Ok(());
        };
        let both = OpenOptions::new().write().read();
        let mut file = self.files.open(&path, both)?;
        let (at, len) = (self.random.below(600), 1 + self.random.below(300));
        let (begin, end) = (usize::try_from(at)?, usize::try_from(at + len)?);
        let what = match self.random.below(4) {
            0 => AllocationMode::Extend,
            1 => AllocationMode::PunchHole,
            2 => AllocationMode::Zero,
            _ => AllocationMode::KeepSize,
        };
        let done = match file.allocate(what, at, len) {
            // A disk may not be able to zero ranges.
            Err(FileError::Errno(Errno::OPNOTSUPP)) => false,
            outcome => self.expect(&path, outcome.err(), None)?,
        };
        if done {
            if matches!(what, AllocationMode::Extend | AllocationMode::Zero) {
                model.resize(model.len().max(end), 0);
            }
            if matches!(what, AllocationMode::PunchHole | AllocationMode::Zero) {
                let end = end.min(model.len());
                model[begin.min(end)..end].fill(0);
            }
        }
        if file.next_data(model.len() as u64)?.is_some() {
            return Err(format!("{path} has data behind its end").into());
        }
        check(&mut file, &path, &model)?;
        file.close()?;
        self.model.insert(name.into(), Some(model));
        Ok(())
    }

    fn rename(&mut self, name: &str) -> Result<(), AnyError> {
        let found = self.model.get(name).cloned();
        let to = format!("n{}", self.random.below(6));
        let target = self.model.get(&to);
        let expected = match (&found, target) {
            (None, _) => Some(Errno::NOENT),
            _ if name == to => None,
            (Some(Some(_)), Some(None)) => Some(Errno::ISDIR),
            (Some(None), Some(Some(_))) => Some(Errno::NOTDIR),
            _ => None,
        };
        let outcome = self.files.rename(self.path(name), self.path(&to));
        if self.expect(name, outcome.err(), expected)?
            && let Some(what) = found
        {
            self.model.remove(name);
            self.model.insert(to, what);
        }
        Ok(())
    }

    /// A record of its own to the log of both.
    fn append(&mut self) -> Result<(), AnyError> {
        let options = OpenOptions::new().append().create();
        let opened = self.files.open("log", options);
        self.expect("log", opened.as_ref().err().copied(), None)?;
        let Ok(mut log) = opened else { return Ok(()) };
        let record = format!("{:03} {:011}\n", self.number.0, self.appended);
        match self.written(log.write(record.as_bytes()))? {
            RECORD => self.appended += 1,
            0 => {}
            _ => return Err("a record was cut".into()),
        }
        Ok(log.close()?)
    }

    /// How many bytes were written; none if there was no space.
    fn written(&mut self, outcome: Result<usize, FileError>) -> Result<usize, AnyError> {
        match outcome {
            Err(FileError::Errno(Errno::NOSPC)) => {
                self.refused += 1;
                Ok(0)
            }
            outcome => Ok(outcome?),
        }
    }

    /// Whether an operation took effect: it must end as expected, or have found no space.
    fn expect(
        &mut self,
        what: &str,
        found: Option<FileError>,
        expected: Option<Errno>,
    ) -> Result<bool, AnyError> {
        match (found, expected) {
            (None, None) => Ok(true),
            (Some(FileError::Errno(Errno::NOSPC)), _) => {
                self.refused += 1;
                Ok(false)
            }
            (Some(FileError::Errno(found)), Some(expected)) if found == expected => Ok(false),
            (Some(found), _) => Err(format!("{what}: {found}, expected {expected:?}").into()),
            (None, Some(expected)) => Err(format!("{what}: success, expected {expected}").into()),
        }
    }
}

/// Reads all of a file, and compares it with what it should hold.
fn check(
    file: &mut condor_fs::File<
        '_,
        '_,
        condor_mbox::linux::LinuxMailbox<'_, N>,
        condor_mbox::linux::LinuxWindow,
        { serving::FILES },
    >,
    path: &str,
    model: &[u8],
) -> Result<(), AnyError> {
    file.seek(SeekFrom::Start(0))?;
    let mut read = vec![0; model.len() + 1];
    let mut len = 0;
    loop {
        match file.read(&mut read[len..])? {
            0 => break,
            more => len += more,
        }
    }
    if &read[..len] != model {
        return Err(format!(
            "{path} has {len} bytes that differ from the {} of the model",
            model.len()
        )
        .into());
    }
    Ok(())
}

/// Compares the tree with the models; gives how much differs.
fn judge(root: &Path, models: &[(Model, u64, u64)]) -> Result<u64, AnyError> {
    let mut wrong = 0;
    let log = match std::fs::read_to_string(root.join("log")) {
        // There never was space for a record.
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        log => log?,
    };
    let mut next = vec![0_u64; models.len()];
    for record in log.lines() {
        let (number, count) = record.split_once(' ').ok_or("a record is broken")?;
        let client = number.parse::<usize>()? - 1;
        // In the order in which they were appended, each once.
        wrong += u64::from(count.parse::<u64>()? != next[client]);
        next[client] += 1;
    }
    for (number, ((model, appended, _), next)) in (1..).zip(models.iter().zip(&next)) {
        wrong += appended.abs_diff(*next);
        let mut found = Model::new();
        for entry in std::fs::read_dir(root.join(number.to_string()))? {
            let entry = entry?;
            let data = if entry.file_type()?.is_dir() {
                None
            } else {
                Some(std::fs::read(entry.path())?)
            };
            found.insert(entry.file_name().to_string_lossy().into_owned(), data);
        }
        if found != *model {
            println!("the directory of processor {number} differs from its model");
            wrong += 1;
        }
    }
    for entry in std::fs::read_dir(root.join(".condor-fs"))? {
        let name = entry?.file_name();
        // A file that was dropped open and unlinked may be left; nothing here is.
        if name != "lock" && name != "journal" {
            println!("{} was left over", name.display());
            wrong += 1;
        }
    }
    Ok(wrong)
}

/// xorshift64.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % end
    }

    fn bytes(&mut self, most: u64) -> Vec<u8> {
        let len = self.below(most);
        (0..len).map(|_| self.below(256) as u8).collect()
    }
}
