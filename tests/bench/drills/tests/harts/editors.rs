//! GDB as an editor has it: by its machine interface, which reads commands and prints records.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use condor_host::control::MemberState;

use crate::debugger::{both_run, kill, up};
use crate::running::{DRILLS, Up};

/// A GDB that is told one command after the other.
struct Editor {
    gdb: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Editor {
    fn start(command: &mut Command) -> Self {
        let mut gdb = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        Self {
            input: gdb.stdin.take().unwrap(),
            output: BufReader::new(gdb.stdout.take().unwrap()),
            gdb,
        }
    }

    /// Reads records until one begins with `begin` and contains `part`.
    fn wait(&mut self, begin: &str, part: &str) -> String {
        loop {
            let mut line = String::new();
            self.output.read_line(&mut line).unwrap();
            // Seen if the test fails, or waits for ever.
            print!("{line}");
            assert!(!line.is_empty(), "no {begin} with {part:?}");
            assert!(!line.starts_with("^error"), "{line}");
            if line.starts_with(begin) && line.contains(part) {
                return line;
            }
        }
    }

    /// Sends a command, and returns its result.
    fn tell(&mut self, command: &str) -> String {
        println!("> {command}");
        writeln!(self.input, "{command}").unwrap();
        self.wait("^", "")
    }

    /// Sends a command after which programs run.
    fn run(&mut self, command: &str) {
        assert!(self.tell(command).starts_with("^running"), "{command}");
    }

    fn end(mut self) {
        writeln!(self.input, "-gdb-exit").unwrap();
        self.gdb.wait().unwrap();
    }
}

/// Returns the line in which the program calls `scale`.
fn line() -> usize {
    let source = include_str!("../../hart/src/debugged.rs");
    let before = source
        .lines()
        .take_while(|line| !line.contains("scale(error, gain);"));
    before.count() + 1
}

/// Sends GDB the commands that the C/C++ extension of VS Code sends with the configuration of
/// system/host/README.md, in the order of `GetInitializeCommands` in `MIEngine`, its part that speaks to GDB.
#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn an_editor_breaks_looks_steps_pauses_and_leaves() {
    let up = up("");
    let mut gateway = Command::new(DRILLS)
        .env("XDG_RUNTIME_DIR", up.place())
        .args(["debug", "one", "--tcp", "0"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut told = String::new();
    let output = gateway.stdout.take().unwrap();
    BufReader::new(output).read_line(&mut told).unwrap();
    let words: Vec<&str> = told.split_whitespace().collect();
    let (program, address) = (words[1], words[words.len() - 1].trim_end_matches('\''));
    let mut editor = Editor::start(Command::new("gdb-multiarch").args(["-nx", "--interpreter=mi"]));
    for command in [
        "-gdb-set mi-async on",
        "-interpreter-exec console \"set pagination off\"",
        "-interpreter-exec console \"set debuginfod enabled off\"",
        "-gdb-set auto-solib-add on",
        "-environment-cd /",
        &format!("-file-exec-and-symbols {program}"),
        "-interpreter-exec console \"show architecture\"",
        "-break-insert -f main",
        &format!("-target-select remote {address}"),
        &format!("-break-insert -f debugged.rs:{}", line()),
    ] {
        editor.tell(command);
    }
    up.wait_for("one", MemberState::Held);
    editor.run("-exec-continue");
    editor.wait("*stopped", "reason=\"breakpoint-hit\"");
    assert!(
        editor
            .tell("-thread-info")
            .contains("one, hart 0, processor 1")
    );
    let frames = editor.tell("-stack-list-frames 0 1000");
    assert!(frames.contains("drills_hart::debugged::torque"), "{frames}");
    let variables = editor.tell("-stack-list-variables --thread 1 --frame 0 --simple-values");
    assert!(variables.contains("name=\"gain\""), "{variables}");
    let made = editor.tell("-var-create --thread 1 --frame 0 - * \"gain\"");
    assert!(made.contains("value=\"2\""), "{made}");
    editor.run("-exec-next");
    editor.wait("*stopped", "reason=\"end-stepping-range\"");
    // A breakpoint is removed and set while the program runs: the extension pauses it for that.
    editor.tell("-break-delete 2");
    editor.run("-exec-continue");
    editor.tell("-exec-interrupt");
    editor.wait("*stopped", "SIGINT");
    editor.tell("-break-insert -f drills_hart::debugged::scale");
    editor.run("-exec-continue");
    editor.wait("*stopped", "reason=\"breakpoint-hit\"");
    editor.tell("-target-detach");
    editor.end();
    both_run(&up);
    kill(gateway.id());
    gateway.wait().unwrap();
}

/// Starts GDB in non-stop mode on both processors.
fn non_stop(up: &Up) -> Editor {
    let mut command = Command::new(DRILLS);
    command.env("XDG_RUNTIME_DIR", up.place());
    command.args(["gdb", "--non-stop", "one", "two", "--"]);
    Editor::start(command.args(["-nx", "-iex", "set mi-async on", "--interpreter=mi"]))
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn one_thread_stops_while_another_runs_and_is_read() {
    let up = up("");
    let mut editor = non_stop(&up);
    // Without a frame, GDB knows of no language.
    editor.tell("-gdb-set language rust");
    let threads = editor.tell("-thread-info");
    assert_eq!(threads.matches("state=\"running\"").count(), 2, "{threads}");
    // A name means the copy of the thread that stands, if one does.
    let told =
        editor.tell("-data-evaluate-expression &drills_hart::debugged::WATCHED.fast.v.value");
    let begin = told.find("0x").unwrap();
    let address = &told[begin..][..10];
    let fast = &format!("-data-evaluate-expression \"*({address} as *mut u32)\"");
    let before = editor.tell(fast);
    assert!(before.contains("value="), "{before}");
    while editor.tell(fast) == before {}
    editor.tell("-exec-interrupt --thread 2");
    editor.wait("*stopped", "thread-id=\"2\"");
    up.wait_for("two", MemberState::Held);
    assert_eq!(up.member("one").state, MemberState::Running);
    let before = editor.tell(fast);
    while editor.tell(fast) == before {}
    // Into a program that runs.
    editor.tell("-break-insert -t drills_hart::debugged::torque");
    editor.wait("*stopped", "thread-id=\"1\"");
    editor.tell("-exec-continue --thread 2");
    up.wait_for("two", MemberState::Running);
    assert_eq!(up.member("one").state, MemberState::Held);
    editor.end();
    both_run(&up);
}
