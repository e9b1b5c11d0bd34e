//! `hand`: what the laws of the hand cost beside Pinocchio.
//!
//! All contestants work on the shipped hand of sixteen joints, each task in states that change from
//! call to call. Before anything is timed, all have to find the same tips, Jacobians, torques and
//! accelerations. Then they take short turns in an order that changes.

mod laws;
mod pinocchio;
mod subject;
mod tick;

use laws::{FORWARD, INVERSE, OURS, TIPS};
use pinocchio::PINOCCHIO;
use subject::Subject;
use tick::{POSITIONS, TICK};

use crate::Result;
use crate::measure::{Goal, Report};
use crate::options::Options;
use crate::race::Race;

/// Checks and times all contestants.
///
/// # Errors
/// Returns an error if one of them finds other results, or if the Pinocchio that was asked for is not
/// there.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let subject: &'static Subject = Box::leak(Box::new(Subject::new()?));
    let mut race = Race::new();
    laws::enter(&mut race, subject);
    tick::enter(&mut race, subject)?;
    let pinocchio = pinocchio::enter(&mut race, subject, options.pinocchio.as_deref());
    let about_pinocchio = match &pinocchio {
        Ok(version) => version.clone(),
        Err(error) if options.pinocchio.is_some() => return Err(error.to_string().into()),
        Err(error) => format!("Without Pinocchio: {error}"),
    };
    let rounds = options.rounds(151, 31);
    let tables = race.run(rounds)?;
    let text = format!(
        "{rounds} rounds; medians over the rounds of the time of a call and of its ratio to ours, with\n\
         the interval that holds the true median in 95 of 100 runs. Sixteen joints, one core.\n\
         Ours: cargo's release profile, for the baseline of the processor.\n\
         {about_pinocchio}\n{tables}"
    );
    let mut goals = Vec::new();
    if pinocchio.is_ok() {
        let theirs = |task| (task, PINOCCHIO, 0);
        for (name, task, limit) in [
            ("pinocchio_kinematics", TIPS, 2.0),
            ("pinocchio_inverse", INVERSE, 4.0),
            ("pinocchio_forward", FORWARD, 8.0),
        ] {
            let ratio = tables.ratio(&[theirs(task)], &[(task, OURS, 0)])?;
            goals.push(Goal::least(name, ratio, limit));
        }
        let peers = [theirs(INVERSE), theirs(TIPS)];
        let tick = tables.ratio(&[(TICK, POSITIONS, 0)], &peers)?;
        goals.push(Goal::most("tick_vs_pinocchio", tick, 0.6));
    }
    Ok(Report { text, goals })
}
