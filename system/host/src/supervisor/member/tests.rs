use super::*;

/// A program that does nothing by itself.
struct Nothing;

impl Launch for Nothing {
    fn load(&mut self, _: &ProgramImage) -> Result<(), LaunchError> {
        Ok(())
    }

    fn start(&mut self) -> Result<(), LaunchError> {
        Ok(())
    }

    fn stop(&mut self, _: StopMethod) -> Result<(), LaunchError> {
        Ok(())
    }

    fn state(&mut self) -> RunState {
        RunState::Runs
    }
}

fn member(place: &std::path::Path, kind: Option<&'static str>) -> (Member, Journal) {
    let plan = Plan {
        number: Processor(1),
        name: "a".into(),
        program: "self".into(),
        arguments: Vec::new(),
        on_failure: OnFailure::Restart,
        restarts: 3,
        stall: None,
        kind,
        runs_here: true,
    };
    let environment = condor_rt::linux::Environment::new(place.into(), 4096, Processor(1));
    let image = ProgramImage::new("a".into(), Vec::new(), environment);
    let member = Member::new(plan, &image, Box::new(Nothing)).expect("it is loaded");
    (
        member,
        Journal::new(&place.join("log"), false).expect("room"),
    )
}

#[test]
fn what_does_not_run_though_nobody_stopped_it_has_failed() {
    let place = tempfile::tempdir().expect("a directory");
    let (mut member, mut journal) = member(place.path(), Some("process"));
    assert!(member.has_failed(), "it waits for its turn");
    member.started = Some(Instant::now());
    for phase in [Phase::Starting, Phase::Failed] {
        member.phase = phase;
        assert!(member.has_failed(), "{phase:?}");
    }
    member.phase = Phase::Up { stalled: false };
    assert!(!member.has_failed());
    member.ended(&Exit::Status(3), &mut journal);
    assert!(member.has_failed(), "it is about to be started again");
    member.phase = Phase::Up { stalled: false };
    assert!(!member.has_failed(), "once may happen");
    member.ended(&Exit::Status(3), &mut journal);
    member.phase = Phase::Up { stalled: false };
    assert!(member.has_failed(), "it is in a loop of failures");
    member.started = Instant::now().checked_sub(2 * SHORT);
    assert!(!member.has_failed());
    member.phase = Phase::Stopped;
    assert!(!member.has_failed());
}

#[test]
fn who_would_fail_again_in_the_same_way_is_not_started_again() {
    let place = tempfile::tempdir().expect("a directory");
    for kind in [None, Some("process")] {
        for phase in [Phase::Starting, Phase::Up { stalled: false }] {
            let (mut member, mut journal) = member(place.path(), kind);
            member.phase = phase;
            member.ended(&Exit::Status(MISTAKE.into()), &mut journal);
            assert_eq!(member.phase, Phase::Failed);
            assert_eq!(member.restarts, 0);
        }
    }
}

#[test]
fn incarnations_that_never_join_count_however_long_they_take() {
    let place = tempfile::tempdir().expect("a directory");
    let (mut member, mut journal) = member(place.path(), None);
    for restart in 1..=3 {
        member.phase = Phase::Starting;
        member.started = Some(Instant::now());
        member.ended(&Exit::Unknown, &mut journal);
        assert!(matches!(member.phase, Phase::Pausing { .. }), "{restart}");
        // As if each had taken more than a minute.
        for then in &mut member.recent {
            *then = then.checked_sub(2 * MINUTE).expect("an instant");
        }
    }
    member.phase = Phase::Starting;
    member.ended(&Exit::Unknown, &mut journal);
    assert_eq!(member.phase, Phase::Failed);
    // One that had joined for long begins anew.
    member.incarnation_joined = true;
    member.phase = Phase::Up { stalled: false };
    member.ended(&Exit::Unknown, &mut journal);
    assert!(matches!(member.phase, Phase::Pausing { .. }));
}
