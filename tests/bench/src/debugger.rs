//! `debugger`: GDB on a hart by condor-debug, by QEMU's own stub, and on a process by gdbserver.
//!
//! One hart runs the program `debugged` of the drills, in a machine that has QEMU's stub, too. In a round GDB
//! does the same three times, from a script that it times itself. The process has a loop and a buffer.

use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use crate::Result;
use crate::firmware::{self, tool};
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::rounds;

/// The argument with which this program is the one that gdbserver traces.
pub(crate) const DEBUGGEE: &str = "debuggee-of-gdbserver";
const TARGET: &str = "riscv64gc-unknown-none-elf";
const GDB: &str = "gdb-multiarch";
/// The function of the hart at which the breakpoint is.
const TIMER: &str = "qemu_virt_board::trap::condor_timer";
/// The bytes that are read and written at once.
const BYTES: usize = 1 << 20;
/// The number of repetitions of steps, breakpoint hits and reads.
const STEPS: u32 = 300;
const HITS: u32 = 100;
const READS: u32 = 2000;
/// The figures, as the script prints their names.
const FIGURES: [&str; 5] = ["read", "write", "page", "step", "hit"];
/// The text before a figure.
const MARK: &str = "figure ";

/// The script that GDB runs; a breakpoint is at `PLACE`, and memory at `MEMORY`.
const SCRIPT: &str = "\
set pagination off
set confirm off
python
import gdb, time
inferior = gdb.selected_inferior()
def rate(name, count, act):
    begun = time.monotonic()
    act()
    print('figure', name, count / (time.monotonic() - begun))
def repeat(count, command):
    for _ in range(count):
        gdb.execute(command, to_string=True)
def pages():
    for page in range(READS):
        inferior.read_memory(begin + 4096 * (page % 256), 4096)
begin = MEMORY
data = bytes(inferior.read_memory(begin, BYTES))
def read():
    global data
    data = bytes(inferior.read_memory(begin, BYTES))
rate('read', BYTES / 1e6, read)
rate('write', BYTES / 1e6, lambda: inferior.write_memory(begin, data))
rate('page', READS, pages)
gdb.execute('tbreak PLACE', to_string=True)
gdb.execute('continue', to_string=True)
rate('step', STEPS, lambda: repeat(STEPS, 'stepi'))
gdb.execute('break PLACE', to_string=True)
rate('hit', HITS, lambda: repeat(HITS, 'continue'))
gdb.execute('delete')
end
detach
";

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(7, 7);
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let images = firmware::build(
        &tree.join("tests/firmware"),
        TARGET,
        &["monitor", "drills-hart"],
    )?;
    let build = ["build", "--release", "--locked", "-p", "drills"];
    let status = tool("cargo", "it comes with Rust: https://rustup.rs", |cargo| {
        cargo.args(build).current_dir(&tree).status()
    })?;
    if !status.success() {
        return Err("the drills do not build".into());
    }
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(tree.join("target"), PathBuf::from);
    let up = Up::start(&target.join("release/drills"), &images)?;
    let played = rounds::play(rounds, |_| {
        Ok([up.condor()?, up.stub()?, gdbserver(up.place.path())?])
    })?;
    let of = |who: usize, what: usize| played.iter().map(move |round| round[who][what]);
    let mut text = format!(
        "{rounds} rounds; a hart and a process, and three GDBs that take turns. Medians, with the interval that\n\
         holds the true median in 95 of 100 runs.\n\n\
         {:28}{:22}{:22}{:22}\n",
        "", "condor", "QEMU's stub", "gdbserver"
    );
    let heads = [
        "read 1 MiB, MB/s",
        "write 1 MiB, MB/s",
        "reads of 4 KiB per second",
        "stepi per second",
        "breakpoint hits per second",
    ];
    for (what, head) in heads.into_iter().enumerate() {
        let [condor, stub, server] = [0, 1, 2].map(|who| Estimate::of(of(who, what)));
        writeln!(text, "{head:28}{condor:<22.0}{stub:<22.0}{server:<22.0}")?;
    }
    text += "\nThe place of the breakpoint is the timer's interrupt of the hart, which comes 450 times a second.\n";
    let ratio = |what: usize, to: usize| Estimate::ratio(of(0, what), of(to, what));
    let goals = vec![
        Goal::least("read_vs_gdbserver", ratio(0, 2), 1.0),
        Goal::least("write_vs_gdbserver", ratio(1, 2), 1.0),
        Goal::least("pages_vs_gdbserver", ratio(2, 2), 1.0),
        Goal::least("steps_vs_qemu", ratio(3, 1), 1.0),
    ];
    Ok(Report { text, goals })
}

/// A system with one hart, which is killed with its children in the end.
struct Up {
    place: tempfile::TempDir,
    drills: PathBuf,
    image: PathBuf,
    child: Child,
}

impl Up {
    fn start(drills: &Path, images: &Path) -> Result<Self> {
        let place = tempfile::tempdir_in("/dev/shm")?;
        let image = images.join("drills-hart");
        let text = format!(
            "name = \"bench\"\nwindow_bytes = 524288\n[machine]\nmemory_bytes = 67108864\nmonitor = \"{}\"\n\
             options = [\"-gdb\", \"unix:{},server=on,wait=off\"]\n\
             [[processors]]\nnumber = 1\nname = \"one\"\nkind = \"hart\"\nhart = 0\nprogram = \"{}\"\n\
             arguments = [\"debugged\"]\n",
            images.join("monitor").display(),
            place.path().join("stub").display(),
            image.display(),
        );
        std::fs::write(place.path().join("bench.toml"), text)?;
        let mut child = Command::new(drills)
            .env("XDG_RUNTIME_DIR", place.path())
            .arg("up")
            .arg(place.path().join("bench.toml"))
            .arg("--headless")
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let errors = child.stderr.take().ok_or("no standard error")?;
        let mut lines = BufReader::new(errors).lines();
        let is_up = lines
            .by_ref()
            .map_while(std::result::Result::ok)
            .any(|line| line.contains(" have been started") || line.contains(" has been started"));
        let up = Self {
            place,
            drills: drills.into(),
            image,
            child,
        };
        if !is_up {
            return Err("the system does not come up; is qemu-system-riscv64 installed?".into());
        }
        // Lets it write on.
        std::thread::spawn(move || lines.for_each(drop));
        Ok(up)
    }

    fn condor(&self) -> Result<Figures> {
        let mut command = Command::new(&self.drills);
        command.env("XDG_RUNTIME_DIR", self.place.path());
        command.args(["gdb", "one", "--", "-nx", "-batch"]);
        play(command, self.place.path(), &self.begin()?, TIMER)
    }

    fn stub(&self) -> Result<Figures> {
        let mut command = Command::new(GDB);
        let begin = self.begin()?;
        command.args(["-nx", "-batch", "-ex"]);
        command.arg(format!("symbol-file {} -o {begin}", self.image.display()));
        command.arg("-ex");
        command.arg(format!(
            "target remote {}",
            self.place.path().join("stub").display()
        ));
        play(command, self.place.path(), &begin, TIMER)
    }

    /// Returns the offset at which the program is loaded, which the gateway tells GDB with the symbols.
    fn begin(&self) -> Result<String> {
        let output = Command::new(&self.drills)
            .env("XDG_RUNTIME_DIR", self.place.path())
            .args(["gdb", "one", "--non-stop", "--gdb", "echo"])
            .output()?;
        let text = String::from_utf8(output.stdout)?;
        let mut words = text.split_whitespace();
        words.find(|word| *word == "-o");
        let offset = words
            .next()
            .ok_or_else(|| format!("no offset in: {text}"))?;
        Ok(offset.to_owned())
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        // The process may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

type Figures = [f64; FIGURES.len()];

/// Has GDB do everything.
fn play(mut command: Command, place: &Path, memory: &str, breakpoint: &str) -> Result<Figures> {
    let script = SCRIPT
        .replace("MEMORY", memory)
        .replace("PLACE", breakpoint)
        .replace("BYTES", &BYTES.to_string())
        .replace("STEPS", &STEPS.to_string())
        .replace("HITS", &HITS.to_string())
        .replace("READS", &READS.to_string());
    let path = place.join("script.gdb");
    std::fs::File::create(&path)?.write_all(script.as_bytes())?;
    let output = command.arg("-x").arg(&path).stdin(Stdio::null()).output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let mut figures = [0.0; FIGURES.len()];
    for (name, figure) in FIGURES.iter().zip(&mut figures) {
        let mut lines = text.lines().filter_map(|line| line.strip_prefix(MARK));
        let found = lines.find_map(|line| line.strip_prefix(name)?.trim().parse().ok());
        let errors = String::from_utf8_lossy(&output.stderr);
        *figure = found.ok_or_else(|| format!("GDB does not `{name}`:\n{text}{errors}"))?;
    }
    Ok(figures)
}

/// Measures GDB and gdbserver on a process.
fn gdbserver(place: &Path) -> Result<Figures> {
    let own = std::env::current_exe()?;
    let mut server = tool("gdbserver", "apt-get install gdbserver", |server| {
        server
            .args(["--once", "127.0.0.1:0"])
            .arg(&own)
            .arg(DEBUGGEE)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
    })?;
    let played = traced(&mut server, &own, place);
    // The process, which goes on when GDB leaves it, ends with its parent.
    let _ = server.kill();
    let _ = server.wait();
    played
}

fn traced(server: &mut Child, own: &Path, place: &Path) -> Result<Figures> {
    let errors = server.stderr.take().ok_or("no standard error")?;
    let mut lines = BufReader::new(errors).lines();
    let mut port = None;
    while port.is_none() {
        let line = lines.next().ok_or("gdbserver has ended")??;
        port = line.strip_prefix("Listening on port ").map(str::to_owned);
    }
    let port = port.unwrap_or_default();
    std::thread::spawn(move || lines.for_each(drop));
    let mut command = Command::new(GDB);
    command.args(["-nx", "-batch", "-ex", "set sysroot"]);
    command.arg(own);
    command.args(["-ex", &format!("target remote 127.0.0.1:{port}")]);
    // Libraries and the loop are there then.
    command.args(["-ex", "tbreak condor_bench_turn", "-ex", "continue"]);
    command.args(["-ex", "set language c"]);
    let memory = "int(gdb.parse_and_eval('(unsigned long) &CONDOR_BENCH_BUFFER'))";
    play(command, place, memory, "condor_bench_turn")
}

/// The memory that the traced process reads, and GDB reads and writes.
// SAFETY: nothing else has this name.
#[unsafe(no_mangle)]
static CONDOR_BENCH_BUFFER: [AtomicU8; BYTES] = [const { AtomicU8::new(1) }; BYTES];

// SAFETY: nothing else has this name.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn condor_bench_turn(turn: usize) -> u8 {
    let mut sum = 0_u8;
    for byte in CONDOR_BENCH_BUFFER.iter().skip(turn % BYTES).take(1000) {
        sum = std::hint::black_box(sum.wrapping_add(byte.load(Relaxed)));
    }
    sum
}

/// Is the process that gdbserver traces, until gdbserver has ended.
pub(crate) fn be_traced() {
    let parent = rustix::process::getppid();
    let mut turn = 0;
    while rustix::process::getppid() == parent {
        std::hint::black_box(condor_bench_turn(turn));
        turn += 1;
    }
}
