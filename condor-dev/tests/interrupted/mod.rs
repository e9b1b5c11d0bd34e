//! Interrupts at every point of what the contexts of one processor share: rings, drivers, and the entry
//! of interrupts.

mod dispatch;
#[cfg(feature = "sim")]
mod drivers;
mod ring;

use std::rc::Rc;

use interrupt_injector::{Interrupts, explore};

/// Interrupts `operation` with `routine` at each of its points in turn, and then checks.
fn everywhere<W: 'static>(
    world: impl Fn() -> W,
    routine: impl Fn(&W) + Clone + 'static,
    operation: impl Fn(&W),
    check: impl Fn(&W),
) {
    let runs = explore(Interrupts::Nested(1), |plan| {
        let world = Rc::new(world());
        let (seen, routine) = (Rc::clone(&world), routine.clone());
        plan.run(move |_| routine(&seen), || operation(&world));
        check(&world);
    });
    println!("{runs} runs");
    assert!(runs > 4, "an operation has some points");
}
