//! How well the joints follow, of each motion.

use condor_robot::objects;

use crate::typist::{FIRST, MASTER, Typist, run};

/// Name, runs and largest peak of each motion, degrees.
fn followed(typist: &Typist<'_>) -> Vec<(String, u64, f64)> {
    let region = typist.region(MASTER);
    let cell = objects::followed(&region).unwrap().unwrap();
    let latest = cell.subscriber(&region).unwrap().read().unwrap();
    let motions = latest.value.motions().map(|(name, motion)| {
        let worst = motion.figures.worst().unwrap();
        assert!(worst.rms_rad > 0.0 && worst.rms_rad < worst.peak_rad);
        (name.to_owned(), motion.runs, worst.peak_rad.to_degrees())
    });
    motions.collect()
}

#[test]
fn what_is_between_motions_or_broken_off_counts_for_none() {
    run(|typist| {
        typist.begin();
        typist.types("enable");
        typist.wait(1.0);
        let first = typist.runs("open");
        // Too fast to be followed well, and no motion with a name.
        let said = typist.says("to index.distal 1.2 0.15");
        assert_eq!(said, "index.distal goes to 1.2 rad\nindex.distal is done\n");
        typist.wait(1.0);
        typist.shown.clear();
        typist.types("run fist");
        typist.wait(0.3);
        typist.types("abort");
        typist.wait(0.5);
        assert!(
            !typist.shown.contains("fist: largest tracking error"),
            "{}",
            typist.shown
        );
        let second = typist.runs("open");
        let wave = typist.runs("wave");
        let found = followed(typist);
        let [(open, 2, open_deg), (waved, 1, wave_deg)] = &found[..] else {
            panic!("{found:?}");
        };
        assert_eq!((open.as_str(), waved.as_str()), ("open", "wave"));
        // The set-points of the servos are on the way between those of the master.
        for (told, seen) in [(open_deg, first.max(second)), (wave_deg, wave)] {
            assert!((0.2 * seen..1.5 * seen).contains(told), "{found:?}");
        }
        let region = typist.region(FIRST);
        let cell = objects::tracking(&region).unwrap().unwrap();
        let tracking = cell.subscriber(&region).unwrap().read().unwrap().value;
        let whole = tracking.whole.worst().unwrap().peak_rad.to_degrees();
        assert!(
            whole > open_deg.max(*wave_deg) + 0.3,
            "{whole} deg in the whole run"
        );
    });
}

#[test]
fn fingers_that_are_still_caught_do_not_count_for_a_motion() {
    run(|typist| {
        typist.begin();
        typist.types("enable");
        typist.types("run wave");
        typist.expect("wave: largest tracking error ", 30.0);
        let [(wave, 1, peak_deg)] = &followed(typist)[..] else {
            panic!("{:?}", followed(typist));
        };
        let seen = typist.peak_rad.to_degrees();
        println!("{wave}: peak {peak_deg} deg, and {seen} deg while the fingers were caught");
        assert!((0.02..1.0).contains(peak_deg), "{peak_deg} deg");
        assert!(seen > 2.0, "{seen} deg");
    });
}
