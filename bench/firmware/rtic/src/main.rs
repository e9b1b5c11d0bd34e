//! The three loops as software tasks of RTIC 2, the way its users write them: a loop around
//! `delay_until`, one priority for each rate.
#![no_std]
#![no_main]

mod monotonic;

// The start of the program and the vector table.
use cortex_m_rt as _;

/// The application.
#[rtic::app(device = board, peripherals = false, dispatchers = [SPARE0, SPARE1, SPARE2])]
mod app {
    use board::body::body;
    use board::{PERIODS, report, timer};
    use rtic_time::timer_queue::TimerQueueBackend;

    use crate::monotonic::Counter;

    /// Ticks until release 0, in which everything is set up.
    const AHEAD: u32 = PERIODS[0];

    #[shared]
    struct Shared {}

    #[local]
    struct Local {
        origin: u32,
    }

    #[init]
    fn init(mut context: init::Context) -> (Shared, Local) {
        Counter::start(&mut context.core.NVIC);
        let origin = timer::now().wrapping_add(AHEAD);
        // None is running yet, so none can be refused.
        let _ = fastest::spawn(origin);
        let _ = middle::spawn(origin);
        let _ = slowest::spawn(origin);
        (Shared {}, Local { origin })
    }

    #[idle(local = [origin])]
    fn idle(context: idle::Context) -> ! {
        report::loops(*context.local.origin)
    }

    #[task(priority = 3)]
    async fn fastest(_: fastest::Context, origin: u32) {
        releases::<0>(origin).await;
    }

    #[task(priority = 2)]
    async fn middle(_: middle::Context, origin: u32) {
        releases::<1>(origin).await;
    }

    #[task(priority = 1)]
    async fn slowest(_: slowest::Context, origin: u32) {
        releases::<2>(origin).await;
    }

    async fn releases<const LOOP: usize>(origin: u32) {
        let mut instant = origin;
        loop {
            Counter::timer_queue().delay_until(instant).await;
            body::<LOOP>();
            instant = instant.wrapping_add(PERIODS[LOOP]);
        }
    }
}
