//! [`Variables`]: a servo loop that shows many variables, to be recorded and drawn.

use core::time::Duration;

use condor_mos::Rate;
use condor_rt::{Machine, Program, ProgramError, Setup};
use condor_vars::Vars;

/// The number of variables of a block.
const BLOCK: usize = 625;

/// The program: a loop of 1 kHz, called `servo`, that shows 2 500 variables, `a.0` to `d.624`. The variable
/// with index `i` is the number of the tick plus `i`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Variables;

static A: Vars<f64, BLOCK> = Vars::numbered("a", "rad");
static B: Vars<f64, BLOCK> = Vars::numbered("b", "rad");
static C: Vars<f64, BLOCK> = Vars::numbered("c", "rad");
static D: Vars<f64, BLOCK> = Vars::numbered("d", "rad");

impl Program for Variables {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?
            .console()?
            .watch(&A)
            .watch(&B)
            .watch(&C)
            .watch(&D)
            .servo("servo", Rate::hz(1000), &mut |tick| {
                let mut value = f64::from(tick.number);
                for block in [&A, &B, &C, &D] {
                    for place in 0..BLOCK {
                        block.set_at(place, value);
                        value += 1.0;
                    }
                }
            })
            .background(|background| {
                while !background.is_stopping() {
                    background.serve(Duration::from_millis(20))?;
                }
                Ok(())
            })
    }
}
