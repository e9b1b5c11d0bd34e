//! The tasks in Pinocchio, by a program in C++ that is compiled here and asked line by line.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::rc::Rc;

use super::laws::{self, FORWARD, INVERSE, TIPS, list, no_tips};
use super::subject::{FINGERS, GRAVITY, Joints, Subject, agree, flat};
use crate::Result;
use crate::process::Asked;
use crate::race::Race;

/// The name of Pinocchio in the tables.
pub(super) const PINOCCHIO: &str = "Pinocchio";

/// The program while it runs.
struct Pinocchio(Asked);

/// Compiles the program, checks that it has the same results, and lets it take part; returns its version
/// and what it was compiled with.
///
/// # Errors
/// Returns an error if the packages cannot be installed, if the program cannot be compiled, or if its
/// results differ.
pub(super) fn enter(
    race: &mut Race<'_>,
    subject: &'static Subject,
    environment: Option<&Path>,
) -> Result<String> {
    let (program, compiler) = compile(environment)?;
    let (mut pinocchio, version) = Pinocchio::start(&program, subject)?;
    for (number, state) in subject.states.iter().enumerate() {
        let mut ours = no_tips();
        laws::tips(&subject.planar, state, &mut ours);
        let theirs = pinocchio.show("kinematics", number)?;
        agree("the tips of Pinocchio", &list(&ours), &theirs, 1e-12)?;

        let mut ours = Joints::default();
        laws::inverse(&subject.planar, state, &mut ours);
        let theirs = pinocchio.show("inverse", number)?;
        let what = "the inverse dynamics of Pinocchio";
        agree(what, &flat(&ours), &theirs, 1e-12)?;

        laws::forward(&subject.planar, state, &mut ours);
        let theirs = pinocchio.show("forward", number)?;
        let what = "the forward dynamics of Pinocchio";
        // Light links make the mass matrix ill-conditioned.
        agree(what, &flat(&ours), &theirs, 1e-10)?;
    }
    let pinocchio = Rc::new(RefCell::new(pinocchio));
    for (task, name) in [
        (TIPS, "kinematics"),
        (INVERSE, "inverse"),
        (FORWARD, "forward"),
    ] {
        let pinocchio = Rc::clone(&pinocchio);
        race.enter_timed(task, PINOCCHIO, move |calls| {
            let line = pinocchio.borrow_mut().ask(&format!("{name} {calls}"))?;
            Ok(line.trim().parse()?)
        });
    }
    Ok(format!("Pinocchio {version}: {compiler}"))
}

/// Compiles the program; returns its path, and the compiler with its flags.
fn compile(environment: Option<&Path>) -> Result<(PathBuf, String)> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let target = here.join("target");
    std::fs::create_dir_all(&target)?;
    let own = target.join("pinocchio");
    let program = target.join("pinocchio-hand");
    let output = Command::new(here.join("pinocchio/build.sh"))
        .arg(environment.unwrap_or(&own))
        .arg(&program)
        .stdin(Stdio::null())
        .output()?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr);
        let last = message.lines().rev().find(|line| line.contains("rror"));
        let last = last.or(message.lines().next_back()).unwrap_or_default();
        return Err(format!("build.sh: {}: {last}", output.status).into());
    }
    let compiler = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    Ok((program, compiler))
}

impl Pinocchio {
    /// Starts the program and tells it the hand and its states.
    fn start(program: &Path, subject: &Subject) -> Result<(Self, String)> {
        let mut pinocchio = Self(Asked::of(&mut Command::new(program))?);
        let version = pinocchio.ask(&numbers(subject))?;
        Ok((pinocchio, version.trim().to_owned()))
    }

    fn ask(&mut self, line: &str) -> Result<String> {
        self.0.tell(line)?;
        self.0.line()
    }

    fn show(&mut self, task: &str, state: usize) -> Result<Vec<f64>> {
        let line = self.ask(&format!("show {task} {state}"))?;
        let numbers = line.split_whitespace().map(str::parse);
        Ok(numbers.collect::<std::result::Result<_, _>>()?)
    }
}

/// Returns all numbers of the hand and of its states, in the order of `hand.cpp`.
fn numbers(subject: &Subject) -> String {
    let mut numbers = vec![FINGERS as f64];
    for finger in &subject.planar {
        numbers.extend(finger.base().rotation.transpose().iter());
        numbers.extend(finger.base().position.iter());
        numbers.extend(finger.lengths());
        for rod in finger.bodies() {
            numbers.extend([rod.mass, rod.center]);
            numbers.extend(rod.inertia.iter());
        }
    }
    numbers.extend(GRAVITY.iter());
    numbers.push(subject.states.len() as f64);
    for state in &subject.states {
        for joints in [&state.q, &state.qd, &state.qdd, &state.torque] {
            numbers.extend(flat(joints));
        }
    }
    let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
    numbers.join(" ")
}
