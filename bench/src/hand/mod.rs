//! `hand`: what the laws of the hand cost beside general libraries.
//!
//! All contestants work on the shipped hand of sixteen joints, each task in states that change from
//! call to call. Before anything is timed, all have to find the same tips, Jacobians, torques,
//! accelerations and forces. Then they take short turns in an order that changes.

mod dynamics;
mod grasp;
mod kinematics;
mod pinocchio;
mod race;
mod subject;
mod tensions;
mod tick;

use std::fmt::Write as _;

use race::{Lane, Race, Times};
use subject::Subject;

use crate::Result;
use crate::measure::{Better, Estimate, Goal, Report};
use crate::options::Options;

const ROUNDS: usize = 151;
const QUICK_ROUNDS: usize = 31;

/// All lanes of the race.
struct Lanes {
    kinematics: kinematics::Lanes,
    dynamics: dynamics::Lanes,
    grasp: grasp::Entered,
    tensions: tensions::Lanes,
    tick: tick::Lanes,
    pinocchio: Result<pinocchio::Lanes>,
}

/// Checks and times all contestants.
///
/// # Errors
/// One of them finds other results, a tick allocates, or the Pinocchio that was asked for is not
/// there.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let subject: &'static Subject = Box::leak(Box::new(Subject::new()?));
    let mut race = Race::default();
    let lanes = Lanes {
        tick: tick::enter(&mut race, subject)?,
        kinematics: kinematics::enter(&mut race, subject)?,
        dynamics: dynamics::enter(&mut race, subject)?,
        grasp: grasp::enter(&mut race, subject)?,
        tensions: tensions::enter(&mut race, subject)?,
        pinocchio: pinocchio::enter(&mut race, subject, options.pinocchio.as_deref()),
    };
    if let (Some(_), Err(error)) = (&options.pinocchio, &lanes.pinocchio) {
        return Err(error.to_string().into());
    }
    let usual = if options.quick { QUICK_ROUNDS } else { ROUNDS };
    let rounds = options.rounds.unwrap_or(usual);
    let times = race.run(rounds)?;
    let mut text = format!(
        "{rounds} rounds; medians over the rounds of the time of a call and of its ratio to ours, with\n\
         the interval that holds the true median in 95 of 100 runs. Sixteen joints, one core.\n\
         Ours and the crates: cargo's release profile, for the baseline of the processor.\n"
    );
    match &lanes.pinocchio {
        Ok(pinocchio) => writeln!(text, "{}", pinocchio.version)?,
        Err(error) => writeln!(text, "Without Pinocchio: {error}")?,
    }
    for (task, ours, rows) in tasks(&lanes) {
        writeln!(text, "\n{task:38} {:>9}  x ours [95 %]", "ns")?;
        for (name, lane) in rows {
            let ns = times.ns(lane).value;
            let ratio = times.ratio(&[lane], &[ours]);
            writeln!(text, "  {name:36} {ns:9.1}  {ratio}")?;
        }
    }
    writeln!(
        text,
        "\nLargest |G f - w| / |w| of 20000 grasps: {:.1e}, by Cholesky {:.1e}. No tick has allocated.",
        lanes.grasp.residual, lanes.grasp.of_cholesky
    )?;
    let goals = goals(&lanes, &times);
    Ok(Report {
        text,
        goals,
        ..Report::default()
    })
}

/// A task, ours, and all rows of its table.
type Task = (&'static str, Lane, Vec<(&'static str, Lane)>);

fn tasks(lanes: &Lanes) -> Vec<Task> {
    let Lanes {
        kinematics,
        grasp,
        tensions,
        tick,
        ..
    } = lanes;
    let pinocchio = lanes.pinocchio.as_ref().ok();
    let with = |mut rows: Vec<(&'static str, Lane)>, lane: Option<Lane>| {
        rows.extend(lane.map(|lane| ("Pinocchio", lane)));
        rows
    };
    let dynamics = |task, [ours, chain, dynibo]: [Lane; 3], lane| {
        let rows = vec![("PlanarFinger", ours), ("Chain", chain), ("dynibo", dynibo)];
        (task, ours, with(rows, lane))
    };
    let grasps = |task, lanes: &grasp::Lanes| {
        let rows = vec![
            ("Contacts", lanes.ours),
            ("nalgebra, Cholesky of G Gᵀ", lanes.cholesky),
            ("nalgebra, SVD of G", lanes.svd),
        ];
        (task, lanes.ours, rows)
    };
    let rows = vec![
        ("PlanarFinger", kinematics.planar),
        ("the same once more", kinematics.again),
        ("Chain", kinematics.chain),
        ("k", kinematics.k),
        ("dynibo", kinematics.dynibo),
    ];
    let lane = pinocchio.map(|lanes| lanes.kinematics);
    let inverse = pinocchio.map(|lanes| lanes.inverse);
    let forward = pinocchio.map(|lanes| lanes.forward);
    vec![
        (
            "4 tips and their Jacobians",
            kinematics.planar,
            with(rows, lane),
        ),
        dynamics("inverse dynamics", lanes.dynamics.inverse, inverse),
        dynamics("forward dynamics", lanes.dynamics.forward, forward),
        grasps("forces of 3 fingers", &grasp.three),
        grasps("forces of 4 fingers", &grasp.four),
        (
            "32 tensions of 16 torques",
            tensions.smooth,
            vec![
                ("MomentArms, without a corner", tensions.smooth),
                ("MomentArms, least", tensions.hard),
                ("nalgebra, Cholesky of P Pᵀ", tensions.cholesky),
                ("the same, factored beforehand", tensions.factored),
            ],
        ),
        (
            "tick, with tips and Jacobians",
            tick.positions,
            vec![
                ("FingerController, positions", tick.positions),
                ("FingerController, grasp stiffness", tick.grasp),
            ],
        ),
    ]
}

fn goals(lanes: &Lanes, times: &Times) -> Vec<Goal> {
    let goal = |name, estimate, limit, better| Goal {
        name,
        estimate,
        limit,
        better,
    };
    // Of the two numbers of fingers that with which we win less.
    let lesser = |a: Estimate, b: Estimate| if a.value < b.value { a } else { b };
    let Lanes {
        kinematics,
        dynamics,
        grasp,
        tensions,
        tick,
        pinocchio,
    } = lanes;
    let grasps = |peer: fn(&grasp::Lanes) -> Lane| {
        let [three, four] =
            [&grasp.three, &grasp.four].map(|lanes| times.ratio(&[peer(lanes)], &[lanes.ours]));
        lesser(three, four)
    };
    let mut goals = vec![
        goal(
            "k_vs_kinematics",
            times.ratio(&[kinematics.k], &[kinematics.planar]),
            10.0,
            Better::Higher,
        ),
        goal(
            "svd_vs_grasp",
            grasps(|lanes| lanes.svd),
            50.0,
            Better::Higher,
        ),
        goal(
            "cholesky_vs_grasp",
            grasps(|lanes| lanes.cholesky),
            5.0,
            Better::Higher,
        ),
        goal(
            "grasp_residual",
            Estimate::of([grasp.residual]),
            1e-12,
            Better::Lower,
        ),
        goal(
            "tensions_vs_cholesky",
            times.ratio(&[tensions.smooth], &[tensions.cholesky]),
            0.5,
            Better::Lower,
        ),
    ];
    if let Ok(pinocchio) = pinocchio {
        let [inverse, ..] = dynamics.inverse;
        let [forward, ..] = dynamics.forward;
        let peers = [pinocchio.inverse, pinocchio.kinematics];
        goals.extend([
            goal(
                "pinocchio_kinematics",
                times.ratio(&[pinocchio.kinematics], &[kinematics.planar]),
                2.0,
                Better::Higher,
            ),
            goal(
                "pinocchio_inverse",
                times.ratio(&[pinocchio.inverse], &[inverse]),
                4.0,
                Better::Higher,
            ),
            goal(
                "pinocchio_forward",
                times.ratio(&[pinocchio.forward], &[forward]),
                8.0,
                Better::Higher,
            ),
            goal(
                "tick_vs_pinocchio",
                times.ratio(&[tick.positions], &peers),
                0.6,
                Better::Lower,
            ),
        ]);
    }
    goals
}
