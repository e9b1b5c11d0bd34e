//! The whole hand in virtual time: its robot, both servo processors, the table, and a small master.

#![cfg(feature = "sim")]

mod rig;

use rig::{FIRST, Master, Posture, Run, SECOND, run};

/// Switches all joints on where they are.
fn begin(master: &mut Master<'_>) {
    master.wait_for_all();
    master.enable(FIRST);
    master.enable(SECOND);
    master.hold(0.4);
}

/// From the present posture, by so much of each joint, rad.
fn by(from: &Posture, step: [f64; 4]) -> Posture {
    from.map(|finger| std::array::from_fn(|joint| finger[joint] + step[joint]))
}

fn moves(master: &mut Master<'_>) {
    begin(master);
    let start = master.present();
    // Quintics of 0.4 s, of up to 34 degrees.
    for step in [[0.2, -0.5, -0.6, -0.4], [-0.2, 0.0, 0.0, 0.0], [0.0; 4]] {
        master.go(0.4, by(&start, step));
    }
    master.wait(0.2);
}

#[test]
fn set_points_are_tracked_and_no_release_is_skipped() {
    let seen = run(4.0, None, moves);
    println!("peak {:.3} deg, {:?}", seen.peak_rad.to_degrees(), seen.counts);
    println!("{:?}", seen.said);
    let peak = seen.peak_rad.to_degrees();
    assert!(peak > 0.1 && peak < 2.5, "{peak}");
    assert_eq!(seen.counts.len(), 4);
    for (number, runs, skips) in &seen.counts {
        assert!(*runs > 600, "{number} ran {runs} times");
        assert_eq!(*skips, 0, "{number}");
    }
}

#[test]
fn two_runs_are_the_same_to_the_last_bit() {
    let first = run(4.0, None, moves);
    assert!(first.positions.len() > 100 * 128);
    assert!(first == run(4.0, None, moves));
}
