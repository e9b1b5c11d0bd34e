//! `condor sim`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use clap::Args;
use condor_platform::linux::read_text;
use condor_toml::suggest;

use super::export::{quoted, written};
use super::view::At;
use super::{print, print_json};
use crate::live::{self, Workshop};
use crate::table::{Left, Right, TextTable, or_dash};
use condor_host::application::Application;
use condor_host::error::{AnyError, NamedFileError, me};
use condor_host::plain::plain;
use condor_host::robot::{Plan, Robot, Simulator, What, largest};
use condor_host::signals;

/// The arguments of `condor sim`.
#[derive(Debug, Args)]
pub(crate) struct Sim {
    /// The file with the configuration of the robot
    robot: PathBuf,
    /// Checks the motion in this file, and prints its times, limits, torques and collisions
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["port", "listen", "origins"]
    )]
    check: Option<PathBuf>,
    /// The position of a joint at the start, rad or m: NAME=NUMBER; may be given several times. Others are
    /// at 0, or at the limit that is nearest to it
    #[arg(
        long = "from",
        value_name = "POSITION",
        value_parser = position,
        requires = "check"
    )]
    from: Vec<(String, f64)>,
    /// Writes set-points, torques and efforts of each tick as a table into this file
    #[arg(long, value_name = "FILE", requires = "check")]
    csv: Option<PathBuf>,
    /// Prints the whole plan as JSON
    #[arg(long, requires = "check")]
    json: bool,
    #[command(flatten)]
    at: At,
}

/// Reads `NAME=NUMBER`.
fn position(text: &str) -> Result<(String, f64), String> {
    let (name, number) = text
        .split_once('=')
        .ok_or("write a joint and its position as NAME=NUMBER")?;
    let position = number.parse().ok().filter(|it: &f64| it.is_finite());
    let position = position.ok_or_else(|| format!("{number:?} is not a number"))?;
    Ok((name.to_owned(), position))
}

impl Sim {
    /// Returns true if the robot can make the motion, and nothing meets; if none is to be checked, serves the page.
    pub(crate) fn run(&self, application: &dyn Application) -> Result<bool, AnyError> {
        let robot = application.robot(&self.robot)?;
        let simulator = robot.as_ref().and_then(|robot| robot.simulator());
        let (Some(robot), Some(simulator)) = (robot.as_deref(), simulator) else {
            let file = self.robot.display();
            return Err(format!(
                "{} cannot simulate the robot of {file}; use the program that was built for this robot", me()).into());
        };
        if let Some(motion) = &self.check {
            return self.check(robot, simulator, motion);
        }
        let workshop = Workshop {
            application,
            robot,
            simulator,
            file: &self.robot,
            system: None,
        };
        let name = self.robot.file_name().unwrap_or_default();
        let end = signals::flag()?;
        let ends = || end.load(Ordering::Relaxed);
        live::simulate(&name.to_string_lossy(), workshop, self.at.door()?, ends)?;
        Ok(true)
    }

    fn check(
        &self,
        robot: &dyn Robot,
        simulator: &dyn Simulator,
        motion: &Path,
    ) -> Result<bool, AnyError> {
        let mut from = simulator.moved(&[]).positions;
        for (name, position) in &self.from {
            let place = robot.joints().iter().position(|joint| joint.name == *name);
            let place = place.and_then(|place| from.get_mut(place));
            *place.ok_or_else(|| no_joint(name, robot))? = *position;
        }
        let text = read_text(motion).map_err(NamedFileError::at("read", motion))?;
        let plan = simulator.plan(&from, &text, &motion.to_string_lossy())?;
        if let Some(path) = &self.csv {
            written(path, |out| table(&plan, out))?;
        }
        if self.json {
            print_json(&plan)?;
        } else {
            print(said(&plan))?;
        }
        Ok(is_possible(&plan))
    }
}

fn no_joint(name: &str, robot: &dyn Robot) -> String {
    let joints = robot.joints().iter();
    let names: Vec<&str> = joints.map(|joint| joint.name.as_str()).collect();
    format!("no joint is called {name:?}; {}", suggest(name, &names))
}

/// Returns true if the robot can make all steps, and nothing meets.
fn is_possible(plan: &Plan) -> bool {
    let is_refused = |what: &What| matches!(what, What::Refused { .. } | What::Waits);
    let is_whole = !plan.events.iter().any(|event| is_refused(&event.what));
    is_whole && plan.overloads.is_empty() && plan.collisions.is_empty()
}

/// Returns what a plan takes, for people.
fn said(plan: &Plan) -> String {
    let mut joints = TextTable::new([
        ("joint", Left),
        ("least", Right),
        ("most", Right),
        ("speed", Right),
        ("of limit", Right),
        ("torque", Right),
        ("of limit", Right),
        ("effort", Right),
        ("of limit", Right),
    ]);
    for joint in &plan.joints {
        let positions = joint.position.iter().copied();
        let peaks = joint.peaks();
        let actuators = joint.actuators.iter();
        let effort = actuators.map(|it| largest(&it.effort)).reduce(f64::max);
        joints.row([
            joint.name.clone(),
            format!("{:.3}", positions.clone().fold(f64::INFINITY, f64::min)),
            format!("{:.3}", positions.fold(f64::NEG_INFINITY, f64::max)),
            format!("{:.2}", largest(&joint.velocity)),
            percent(peaks.velocity),
            format!("{:.3}", largest(&joint.torque)),
            percent(peaks.torque),
            or_dash(effort.map(|effort| format!("{effort:.3}"))),
            or_dash(peaks.effort.map(percent)),
        ]);
    }
    let mut steps = TextTable::new([("s", Right), ("step", Right), ("", Left)]);
    for event in &plan.events {
        steps.row([
            format!("{:.2}", event.at_s),
            event.step.to_string(),
            happens(&event.what),
        ]);
    }
    let mut warnings = Vec::new();
    for overload in &plan.overloads {
        warnings.push(format!(
            "{:.2} to {:.2} s: the actuators of {} cannot give {:.3} N m, but {:.3} N m\n",
            overload.from_s,
            overload.to_s,
            plain(&overload.joint),
            overload.torque,
            overload.possible,
        ));
    }
    for collision in &plan.collisions {
        let [one, other] = &collision.deepest.parts;
        warnings.push(format!(
            "{:.2} to {:.2} s: {} and {} meet, {:.1} mm deep\n",
            collision.from_s,
            collision.to_s,
            plain(one),
            plain(other),
            -1e3 * collision.deepest.distance_m,
        ));
    }
    if is_possible(plan) {
        warnings.push(format!(
            "Checked {} ticks of {} s: all steps can be made, the actuators give every torque, and no parts meet.\n",
            plan.joints.first().map_or(0, |joint| joint.position.len()),
            plan.period_s,
        ));
    }
    format!("{joints}\n{steps}{}", warnings.concat())
}

fn happens(what: &What) -> String {
    match what {
        What::Begins => "begins".into(),
        What::BeginsAdjusted => "begins in a changed form, to keep the limits".into(),
        What::Reached => "has reached its targets".into(),
        What::Stopped => "is stopped by its time".into(),
        What::Superseded => "ends, since another step takes its joints".into(),
        What::Dropped => "is dropped".into(),
        What::Refused { reason } => format!("is refused: {reason}"),
        What::Waits => "waits for a sensor: here the plan ends".into(),
        What::Holds => "holds until `resume`".into(),
    }
}

fn percent(part: f64) -> String {
    format!("{:.0} %", 100.0 * part)
}

/// Writes all that a plan has of each tick.
fn table(plan: &Plan, out: &mut dyn Write) -> Result<(), AnyError> {
    let mut columns: Vec<(String, &[f64])> = Vec::new();
    for joint in &plan.joints {
        for (what, values) in [
            ("position", &joint.position),
            ("velocity", &joint.velocity),
            ("acceleration", &joint.acceleration),
            ("torque", &joint.torque),
        ] {
            columns.push((format!("{}.{what}", joint.name), values));
        }
        for actuator in &joint.actuators {
            columns.push((format!("{}.effort", actuator.name), &actuator.effort));
        }
    }
    write!(out, "time")?;
    for (name, _) in &columns {
        write!(out, ",{}", quoted(name))?;
    }
    writeln!(out)?;
    let ticks = columns.first().map_or(0, |(_, values)| values.len());
    for (tick, number) in (0..ticks).zip(0_u32..) {
        write!(out, "{}", f64::from(number) * plan.period_s)?;
        for (_, values) in &columns {
            match values.get(tick) {
                Some(value) => write!(out, ",{value}")?,
                None => write!(out, ",")?,
            }
        }
        writeln!(out)?;
    }
    Ok(())
}
