//! What schedulers keep of their loops' past, and what they tell bodies.

use condor_mos::sim::{SimPlatform, Vectored};
use condor_mos::{
    ClockSpec, Counts, EventTable, Histograms, Keep, LoopId, Loops, NoStatistics, Overrun,
    Platform, Rate, Scheduler, Timer,
};

const FREQUENCY: Rate = Rate::hz(1000);
const FAST: LoopId = LoopId(0);
const SLOW: LoopId = LoopId(1);

type Kept<P, K> = Scheduler<P, 2, 8, K>;

/// A 100 Hz loop of 2 ticks and a 50 Hz loop of 4 ticks that is due first after 5.
fn loops<P: Platform, K: Keep>(platform: P) -> Kept<P, K> {
    let rates = [Rate::hz(100), Rate::hz(50)];
    let clock = ClockSpec::of::<u64>(FREQUENCY);
    Scheduler::keeping(
        platform,
        EventTable::phased(&rates, &[0, 5], clock).unwrap(),
    )
}

/// Runs until tick 100, and gives when the loops were due and when they began.
fn run<P: Platform<Instant = u64> + Sync, K: Keep>(
    processor: &SimPlatform,
    scheduler: &Kept<P, K>,
) -> [Vec<(u64, u64)>; 2] {
    let mut seen = [const { Vec::new() }; 2];
    let [fast, slow] = &mut seen;
    let now = || Timer::now(processor);
    let mut fast_loop = |due| {
        fast.push((due, now()));
        processor.work(2);
    };
    let mut slow_loop = |due| {
        slow.push((due, now()));
        processor.work(4);
    };
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast_loop).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow_loop).unwrap();
        let background = || {
            scheduler.start().unwrap();
            processor.run_until(100);
            scheduler.stop();
        };
        processor.with_vectors(
            |rank| scheduler.on_vector(rank),
            || processor.with_handler(|| scheduler.on_timer(), background),
        );
    });
    seen
}

fn is_on_time(seen: &[Vec<(u64, u64)>; 2]) {
    let [fast, slow] = seen;
    assert!(
        fast.iter()
            .copied()
            .eq((0..10).map(|run| (10 * run, 10 * run)))
    );
    let due = (0..5).map(|run| 20 * run + 5);
    assert!(slow.iter().copied().eq(due.map(|due| (due, due))));
}

#[test]
fn bodies_are_told_when_they_were_due_whatever_is_kept() {
    let processor = SimPlatform::new(FREQUENCY);
    is_on_time(&run(
        &processor,
        &loops::<_, NoStatistics>(processor.clone()),
    ));
    let processor = SimPlatform::new(FREQUENCY);
    is_on_time(&run(&processor, &loops::<_, Counts>(processor.clone())));
    let processor = Vectored(SimPlatform::new(FREQUENCY));
    is_on_time(&run(
        &processor,
        &loops::<_, NoStatistics>(processor.clone()),
    ));
    let processor = Vectored(SimPlatform::new(FREQUENCY));
    is_on_time(&run(&processor, &loops::<_, Histograms>(processor.clone())));
}

#[test]
fn histograms_have_percentiles_and_can_be_reset() {
    let processor = SimPlatform::new(FREQUENCY);
    let scheduler = loops::<_, Histograms>(processor.clone());
    run(&processor, &scheduler);
    let slow = scheduler.histograms(SLOW).unwrap();
    assert_eq!((slow.run().total(), slow.run().percentile(99.0)), (5, 5));
    assert_eq!(slow.lateness().percentile(100.0), 0);
    assert_eq!(scheduler.statistics(SLOW).unwrap().worst_run, 4);
    scheduler.reset_statistics(SLOW).unwrap();
    assert_eq!(scheduler.histograms(SLOW).unwrap().run().total(), 0);
    let counts = scheduler.statistics(SLOW).unwrap();
    assert_eq!((counts.released, counts.run, counts.worst_run), (0, 0, 0));
    assert_eq!(scheduler.statistics(FAST).unwrap().run, 10);
}

#[test]
fn utilisation_is_that_of_the_present_rate() {
    let processor = SimPlatform::new(FREQUENCY);
    let scheduler = loops::<_, Counts>(processor.clone());
    let mut fast_loop = |_| processor.work(2);
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast_loop).unwrap();
        let background = || {
            scheduler.start().unwrap();
            processor.run_until(99);
            assert!((scheduler.statistics(FAST).unwrap().utilisation() - 0.2).abs() < 1e-9);
            scheduler.set_rate(FAST, Rate::hz(250)).unwrap();
            processor.run_until(199);
        };
        processor.with_handler(|| scheduler.on_timer(), background);
    });
    let counts = scheduler.statistics(FAST).unwrap();
    assert_eq!(counts.rate, Rate::hz(250));
    assert!((counts.utilisation() - 0.5).abs() < 1e-9, "{counts}");
}
