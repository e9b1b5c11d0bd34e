//! Interrupts of boards that are memory, which arrive at random instants.

use std::time::Duration;

use condor_host::control::MemberState;

use crate::NEEDS;
use crate::releases::number;
use crate::running::{DRILLS, Up, image};

/// The greatest number of interrupts; `CONDOR_INTERRUPTS` sets another one.
const INTERRUPTS: u32 = 10_000;
/// The seed of the random numbers; `CONDOR_SEED` sets another one.
const SEED: u64 = 0x2545_f491_4f6c_dd1d;
/// The time that the program may take to end when it has printed that it does.
const PATIENCE: Duration = Duration::from_secs(60);

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn no_request_of_a_board_is_lost() {
    let interrupts = number("CONDOR_INTERRUPTS", INTERRUPTS);
    let seed = number("CONDOR_SEED", SEED);
    println!("CONDOR_SEED={seed}");
    let hart = |number: u8, name: &str, arguments: &str| {
        format!(
            "[[processors]]\nnumber = {number}\nname = {name:?}\nkind = \"hart\"\nhart = {number}\n\
             program = {:?}\narguments = [{arguments}]\non_failure = \"leave\"\n",
            image("drills-hart"),
        )
    };
    let boards = format!("\"arrivals\", \"0\", \"{interrupts}\", \"{seed}\"");
    let processors = hart(0, "target", "\"arrivals-target\"") + &hart(1, "boards", &boards);
    let bus = "[bus]\nbytes = 4096\n";
    let up = Up::prepared(DRILLS.as_ref(), bus, &processors, NEEDS, |_| {});
    // Programs that fail print this word, too. To ask for the state again and again would keep the harts from running
    // at the same time.
    println!("{}", up.read_terminal("boards", "ended: "));
    // The program fails if the target has lost a request, or has counted something wrong.
    up.wait_for_end("boards", PATIENCE);
    let target = up.member("target");
    assert_eq!((target.state, target.restarts), (MemberState::Running, 0));
    up.end();
}
