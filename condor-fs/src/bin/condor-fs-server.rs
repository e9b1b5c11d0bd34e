//! Serves a directory tree to the processors of a named system.

use std::process::ExitCode;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use condor_fs::server::{FileServer, ServerOptions};
use condor_mbox::Processor;
use condor_mbox::linux::LinuxSystem;

const USAGE: &str = "usage: condor-fs-server --system NAME --bytes N [--processor N] [options] DIRECTORY

Serves DIRECTORY to the processors of a system of 32, as condor_mbox::linux::System::<32>::named(NAME, N).

  --system NAME         the name of the system
  --bytes N             size of each processor's data, the same in all programs
  --processor N         the server's own number (0)
  --read-only           nothing in the tree can be changed
  --read-only-for N     the same for processor N only; may be given again
  --refuse N            processor N is not served; may be given again
  --file-mode OCTAL     permissions of new files, less the umask (666)
  --directory-mode OCTAL  permissions of new directories, less the umask (777)
  --max-file-bytes N    no file can be made longer
  --quota-bytes N       all files together cannot be made longer, with 1024 bytes
                        for each name of a file or directory

It serves with the rights of its own user, until it is killed. --read-only-for and --refuse protect from
programs that err, not from one that writes the memory of other processors.";

/// The longest wait for the number while a server that was killed before still exits.
const SUCCESSION: Duration = Duration::from_secs(5);

struct Arguments {
    system: String,
    bytes: u32,
    processor: u8,
    directory: String,
    options: ServerOptions,
}

fn main() -> ExitCode {
    if std::env::args().any(|it| it == "--help" || it == "-h") {
        println!("{USAGE}");
        return ExitCode::SUCCESS;
    }
    let Some(arguments) = parse(std::env::args().skip(1)) else {
        eprintln!("{USAGE}");
        return ExitCode::from(2);
    };
    match serve(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("condor-fs-server: {error}");
            ExitCode::FAILURE
        }
    }
}

fn serve(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let server = FileServer::new(&arguments.directory, arguments.options)?;
    let system = LinuxSystem::<32>::named(&arguments.system, arguments.bytes)?;
    let claim = system.claim_within(Processor(arguments.processor), SUCCESSION)?;
    // The server runs until it is killed, which is safe at any moment.
    Ok(server.serve(claim, &AtomicBool::new(false))?)
}

fn parse(mut words: impl Iterator<Item = String>) -> Option<Arguments> {
    let (mut system, mut bytes, mut directory) = (None, None, None);
    let (mut processor, mut options) = (0, ServerOptions::default());
    while let Some(word) = words.next() {
        match word.as_str() {
            "--system" => system = Some(words.next()?),
            "--bytes" => bytes = Some(words.next()?.parse().ok()?),
            "--processor" => processor = words.next()?.parse().ok()?,
            "--read-only" => options.read_only = true,
            "--read-only-for" => {
                options.read_only_for = options.read_only_for.with(number(words.next())?);
            }
            "--refuse" => options.refused = options.refused.with(number(words.next())?),
            "--file-mode" => options.file_mode = mode(words.next())?,
            "--directory-mode" => options.directory_mode = mode(words.next())?,
            "--max-file-bytes" => options.max_file_bytes = Some(words.next()?.parse().ok()?),
            "--quota-bytes" => options.quota_bytes = Some(words.next()?.parse().ok()?),
            _ if word.starts_with("--") || directory.is_some() => return None,
            _ => directory = Some(word),
        }
    }
    Some(Arguments {
        system: system?,
        bytes: bytes?,
        processor,
        directory: directory?,
        options,
    })
}

fn number(word: Option<String>) -> Option<Processor> {
    word?.parse().ok().map(Processor)
}

/// Permissions alone, as `chmod` has them.
fn mode(word: Option<String>) -> Option<u32> {
    let mode = u32::from_str_radix(&word?, 8).ok()?;
    (mode <= 0o777).then_some(mode)
}
