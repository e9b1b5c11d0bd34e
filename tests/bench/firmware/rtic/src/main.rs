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
    use board::{PERIODS, report};
    use rtic_time::timer_queue::TimerQueueBackend;

    use crate::monotonic::Counter;

    #[shared]
    struct Shared {}

    #[local]
    struct Local {}

    #[init]
    fn init(mut context: init::Context) -> (Shared, Local) {
        Counter::prepare(&mut context.core.NVIC);
        // None is running yet, so none can be refused.
        let _ = fastest::spawn();
        let _ = middle::spawn();
        let _ = slowest::spawn();
        (Shared {}, Local {})
    }

    #[idle]
    fn idle(_: idle::Context) -> ! {
        report::loops()
    }

    #[task(priority = 3)]
    async fn fastest(_: fastest::Context) {
        releases::<0>().await;
    }

    #[task(priority = 2)]
    async fn middle(_: middle::Context) {
        releases::<1>().await;
    }

    #[task(priority = 1)]
    async fn slowest(_: slowest::Context) {
        releases::<2>().await;
    }

    async fn releases<const LOOP: usize>() {
        let mut instant = 0_u32;
        loop {
            Counter::timer_queue().delay_until(instant).await;
            body::<LOOP>();
            instant = instant.wrapping_add(PERIODS[LOOP]);
        }
    }
}
