//! The template, as a new user has it: made outside of the tree, built, tested, and brought up.

use std::env;
use std::fs::{self, File};
use std::io::{Read as _, Write as _};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use rustix::io::ioctl_fionbio;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use serde_json::Value;

use crate::Result;
use crate::command::Line;
use crate::context::{Context, list, text};
use crate::firmware::{self, HARTS_TARGET};
use crate::image::Image;
use crate::parts::Summary;
use crate::parts::panics::{self, PANICKED};
use crate::parts::test;
use crate::sources;
use crate::tools::{need_qemu, need_target};

/// The name of the project, and of its systems.
const NAME: &str = "template-check";
/// The name of the system in simulated time.
const SIMULATED: &str = "template-check-simulated";
/// The name of a project that begins with a robot.
const ROBOT: &str = "robot-check";
/// Lines that the robot may have: its description and its program.
const ROBOT_LINES: usize = 150;
/// Lines of Rust that the template may have, without comments and empty lines.
const LINES: usize = 250;
/// The time that the joint may take to its target.
const PATIENCE: Duration = Duration::from_secs(60);

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let lines = lines(&context.root.join("examples/two-processors"))?;
    if lines > LINES {
        return Err(format!("the template has {lines} lines of Rust, and may have {LINES}").into());
    }
    // `condor` is one of the programs of `test`.
    test::build(context)?;
    let outside = env::temp_dir().join(format!("condor-{}", std::process::id()));
    fs::create_dir_all(&outside)?;
    let outcome = check(context, &outside);
    fs::remove_dir_all(&outside)?;
    let harts = outcome?;
    Ok(Summary::of(format!(
        "{lines} lines of Rust, as processes{harts}"
    )))
}

fn check(context: &Context, outside: &Path) -> Result<&'static str> {
    let robot = make(context, outside, ROBOT, &["--robot"])?;
    let mut lines = 0;
    for file in ["finger.toml", "src/main.rs"] {
        lines += fs::read_to_string(robot.directory.join(file))?
            .lines()
            .count();
    }
    if lines > ROBOT_LINES {
        return Err(format!(
            "the new project of a robot has {lines} lines, and may have {ROBOT_LINES}"
        )
        .into());
    }
    robot.cargo("cargo test --offline").run()?;
    let project = make(context, outside, NAME, &[])?;
    project.cargo("cargo test --offline").run()?;
    let simulated = project.simulated()?;
    project.bring_up("condor.toml", NAME, true)?;
    project.bring_up(simulated, SIMULATED, false)?;

    need_target(context, HARTS_TARGET)?;
    let image = format!("{NAME}-hart");
    let build = format!("cargo build --offline --release -p {image} --target {HARTS_TARGET}");
    project.cargo(&build).run()?;
    let path = format!("target/{HARTS_TARGET}/release/{image}");
    if let Some(origins) = Image::read(&project.directory.join(path))?.origins_of(PANICKED)? {
        return Err(format!("{image} can panic: {}", panics::list(&origins)).into());
    }
    if need_qemu(context, "qemu-system-riscv64").is_err() && env::var_os("CI").is_none() {
        return Ok(", not in QEMU, which is not here");
    }
    firmware::build(context, "-p monitor", HARTS_TARGET, "release")?;
    project.bring_up("harts.toml", &format!("{NAME}-on-harts"), false)?;
    Ok(" and on a hart")
}

/// Makes a project outside of the tree, as a new user does.
fn make<'c>(
    context: &'c Context,
    outside: &Path,
    name: &str,
    options: &[&str],
) -> Result<Project<'c>> {
    let made = Command::new(context.root.join("target/debug/condor"))
        .args(["new", name, "--path"])
        .arg(&context.root)
        .args(options)
        .current_dir(outside)
        .status()?;
    if !made.success() {
        return Err(format!("`condor new {name}` failed: {made}").into());
    }
    let directory = outside.join(name);
    // Kept from run to run.
    let target = context.root.join("target/template");
    fs::create_dir_all(&target)?;
    symlink(target, directory.join("target"))?;
    Ok(Project { context, directory })
}

/// Counts lines of Rust, and finds no unsafe code.
fn lines(directory: &Path) -> Result<usize> {
    let mut count = 0;
    for path in sources::below(directory, &|_| false)? {
        let code = fs::read_to_string(&path)?;
        if code.contains("unsafe") {
            return Err(format!("{} has unsafe code", path.display()).into());
        }
        count += sources::lines_of_code(&code);
    }
    Ok(count)
}

struct Project<'c> {
    context: &'c Context,
    directory: PathBuf,
}

impl Project<'_> {
    fn cargo(&self, line: &str) -> Line {
        self.context
            .command(line)
            .dir(&self.directory.to_string_lossy())
            .env("CARGO_TARGET_DIR", "target")
            .env("CARGO_PROFILE_DEV_DEBUG", "line-tables-only")
    }

    /// Brings a system up, moves the joint, also from a panel on the serial port of the servo, sets a parameter,
    /// kills the servo if it is a process, and takes the system down.
    fn bring_up(&self, description: &str, system: &str, kills: bool) -> Result<()> {
        let mut panel = Panel::connect(&self.directory.join(description))?;
        let mut up = self.program(&["up", description, "--headless", "--for", "5m"]);
        let up = Running(up.stdout(Stdio::null()).spawn()?);
        self.until_at(system, 300)?;
        self.ask(&["vars", "set", "joint.stiffness", "4", "--system", system])?;
        self.ask(&["vars", "set", "report.hz", "5", "--system", system])?;
        self.ask(&["vars", "set", "servo.hz", "250", "--system", system])?;
        self.until_at(system, -400)?;
        self.logged(" to -400 mrad\n")?;
        self.until_both_log(system)?;
        panel.moves()?;
        self.logged(" to 250 mrad\n")?;
        if kills {
            self.kill_servo(system)?;
            self.until_at(system, 200)?;
        }
        self.ask(&["down", "--system", system])?;
        up.ended()
    }

    /// Waits until the servo has written `line` to its log, which is empty then.
    fn logged(&self, line: &str) -> Result<()> {
        let (path, begun) = (self.directory.join("files/servo.log"), Instant::now());
        loop {
            let log = fs::read_to_string(&path).unwrap_or_default();
            if log.contains(line) {
                return Ok(fs::write(path, "")?);
            }
            if begun.elapsed() > PATIENCE {
                return Err(format!("{} has no line {line:?}: {log:?}", path.display()).into());
            }
            thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits until both programs have appended to the log that they share.
    fn until_both_log(&self, system: &str) -> Result<()> {
        let begun = Instant::now();
        loop {
            let log = self.ask(&["log", "--shared", "--system", system])?;
            if ["master: sends the joint", "servo: from"]
                .iter()
                .all(|line| log.contains(line))
            {
                return Ok(());
            }
            if begun.elapsed() > PATIENCE {
                return Err(format!("{system}: the shared log is {log:?}").into());
            }
            thread::sleep(Duration::from_millis(50));
        }
    }

    /// Writes the description of the same system in simulated time; returns the name of the file.
    fn simulated(&self) -> Result<&'static str> {
        const FILE: &str = "simulated.toml";
        let text = fs::read_to_string(self.directory.join("condor.toml"))?;
        let simulated = text
            .replace("# [clock]\n# kind", "[clock]\nkind")
            .replace(&format!("\"{NAME}\""), &format!("\"{SIMULATED}\""));
        fs::write(self.directory.join(FILE), simulated)?;
        Ok(FILE)
    }

    /// Has the joint move until it is there.
    fn until_at(&self, system: &str, mrad: i32) -> Result<()> {
        let data = mrad.cast_unsigned().to_string();
        let begun = Instant::now();
        loop {
            // As long as the servo is not up, there is no answer.
            let answer = self.ask(&[
                "send", "servo", "1", &data, "--reply", "--json", "--system", system,
            ]);
            let reply = answer.and_then(|answer| Ok(serde_json::from_str::<Value>(&answer)?));
            let at = reply
                .as_ref()
                .ok()
                .and_then(|reply| reply["reply"].as_u64());
            if at.is_some_and(|at| (at as u32).cast_signed().abs_diff(mrad) < 20) {
                return Ok(());
            }
            if begun.elapsed() > PATIENCE {
                return Err(format!(
                    "{system}: the joint does not get to {mrad} mrad; the last reply: {reply:?}"
                )
                .into());
            }
            thread::sleep(Duration::from_millis(50));
        }
    }

    fn kill_servo(&self, system: &str) -> Result<()> {
        let shown = self.ask(&["ps", "--json", "--system", system])?;
        let shown: Value = serde_json::from_str(&shown)?;
        let mut processors = list(&shown["processors"]).iter();
        let servo = processors.find(|one| text(&one["name"]) == "servo");
        let pid = servo.and_then(|servo| servo["pid"].as_u64());
        let pid = pid.ok_or_else(|| format!("{system}: no process of the servo in {shown}"))?;
        self.context.command(&format!("kill -KILL {pid}")).run()
    }

    fn ask(&self, arguments: &[&str]) -> Result<String> {
        let output = self.program(arguments).output()?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            return Err(format!("`{NAME} {}`: {said}", arguments.join(" ")).into());
        }
        Ok(String::from_utf8(output.stdout)?)
    }

    fn program(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(self.directory.join("target/debug").join(NAME));
        command.args(arguments).current_dir(&self.directory);
        command
    }
}

/// The other end of a serial line.
struct Panel(File);

impl Panel {
    /// Makes a line, one end of which is the serial port in a description.
    fn connect(description: &Path) -> Result<Self> {
        let end = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&end)?;
        unlockpt(&end)?;
        ioctl_fionbio(&end, true)?;
        let port = ptsname(&end, Vec::new())?.into_string()?;
        let text = fs::read_to_string(description)?;
        let connected = text.replace(
            "# serial = \"/dev/ttyUSB0\"",
            &format!("serial = \"{port}\""),
        );
        if connected == text {
            return Err(format!("{} has no line for a serial port", description.display()).into());
        }
        fs::write(description, connected)?;
        Ok(Self(end.into()))
    }

    /// Types an angle, after a word that is none, and reads the answers.
    fn moves(&mut self) -> Result<()> {
        self.0.write_all(b"what\r\n250\r\n")?;
        let (mut answer, begun) = (String::new(), Instant::now());
        while !(answer.contains("what is not an angle: type mrad")
            && answer.ends_with(" -> 250\r\n"))
        {
            let mut bytes = [0; 64];
            // Without anything to read, this is an error.
            let read = self.0.read(&mut bytes).unwrap_or(0);
            answer += &String::from_utf8_lossy(&bytes[..read]);
            if begun.elapsed() > PATIENCE {
                return Err(
                    format!("the panel on the serial port has the answer {answer:?}").into(),
                );
            }
            thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }
}

/// A system that is up, and does not outlive a check that fails.
struct Running(Child);

impl Running {
    fn ended(mut self) -> Result<()> {
        let status = self.0.wait()?;
        if status.success() {
            return Ok(());
        }
        Err(format!("`{NAME} up`: {status}").into())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // One that has ended is not there any more.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
