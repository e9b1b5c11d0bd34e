//! `hand`: what the laws of the hand cost beside general libraries.
//!
//! All contestants work on the shipped hand of sixteen joints, each task in states that change from
//! call to call. Before anything is timed, all have to find the same tips, Jacobians, torques,
//! accelerations and forces. Then they take short turns in an order that changes.

mod dynamics;
mod grasp;
mod kinematics;
mod pinocchio;
mod subject;
mod tensions;
mod tick;

use dynamics::{FORWARD, INVERSE};
use grasp::{CHOLESKY, SVD, TASKS};
use kinematics::TIPS;
use pinocchio::PINOCCHIO;
use subject::{OURS, Subject};
use tensions::{SMOOTH, TENSIONS};
use tick::{POSITIONS, TICK};

use crate::Result;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::race::Race;
use crate::rounds::Lane;

/// Checks and times all contestants.
///
/// # Errors
/// Returns an error if one of them finds other results, or if the Pinocchio that was asked for is not
/// there.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let subject: &'static Subject = Box::leak(Box::new(Subject::new()?));
    let mut race = Race::new();
    kinematics::enter(&mut race, subject)?;
    dynamics::enter(&mut race, subject);
    let [residual, of_cholesky] = grasp::enter(&mut race, subject)?;
    tensions::enter(&mut race, subject)?;
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
         Ours and the crates: cargo's release profile, for the baseline of the processor.\n\
         {about_pinocchio}\n{tables}\n\
         Largest |G f - w| / |w| of 20000 grasps: {residual:.1e}, by Cholesky {of_cholesky:.1e}.\n"
    );
    let ratio = |these: &[Lane<'_>], to: Lane<'_>| tables.ratio(these, &[to]);
    // Of the two numbers of fingers that with which we win less.
    let grasps = |peer| -> Result<Estimate> {
        let [three, four] = TASKS.map(|task| ratio(&[(task, peer, 0)], (task, grasp::OURS, 0)));
        let (three, four) = (three?, four?);
        Ok(if three.value < four.value {
            three
        } else {
            four
        })
    };
    let planar = |task| (task, OURS, 0);
    let tensions = ratio(&[(TENSIONS, SMOOTH, 0)], (TENSIONS, tensions::CHOLESKY, 0))?;
    let mut goals = vec![
        Goal::least(
            "k_vs_kinematics",
            ratio(&[(TIPS, "k", 0)], planar(TIPS))?,
            10.0,
        ),
        Goal::least("svd_vs_grasp", grasps(SVD)?, 50.0),
        Goal::least("cholesky_vs_grasp", grasps(CHOLESKY)?, 5.0),
        Goal::most("grasp_residual", Estimate::exactly(residual), 1e-12),
        Goal::most("tensions_vs_cholesky", tensions, 0.5),
    ];
    if pinocchio.is_ok() {
        let theirs = |task| (task, PINOCCHIO, 0);
        for (name, task, limit) in [
            ("pinocchio_kinematics", TIPS, 2.0),
            ("pinocchio_inverse", INVERSE, 4.0),
            ("pinocchio_forward", FORWARD, 8.0),
        ] {
            goals.push(Goal::least(
                name,
                ratio(&[theirs(task)], planar(task))?,
                limit,
            ));
        }
        let peers = [theirs(INVERSE), theirs(TIPS)];
        let tick = tables.ratio(&[(TICK, POSITIONS, 0)], &peers)?;
        goals.push(Goal::most("tick_vs_pinocchio", tick, 0.6));
    }
    Ok(Report { text, goals })
}
