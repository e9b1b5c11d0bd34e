//! The sentences of section 4.2 of the memo with the programs on harts: `cargo xtask riscv` runs them.

use crate::up::Up;

/// A session: each line that is typed, and the text that it brings.
const SESSION: [(&str, &str); 10] = [
    ("enable", "enabled, holding position\n"),
    ("run grasp", "grasp is done\n"),
    ("ball", "until `letgo`"),
    ("grasp 150", "closing on the ball"),
    ("letgo 1", "the support"),
    ("release", "the grasp has ended"),
    ("impedance ring 0.05", "ring"),
    ("status", "ring   impedance"),
    ("enable", "enabled, holding position\n"),
    ("status", "ring   follows"),
];

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn b_a_person_holds_a_ball_and_changes_modes() {
    let mut up = Up::of("harts.toml", "session-on-harts", "max", |text| text);
    up.expect("wave is done\n");
    for (typed, shown) in SESSION {
        up.types(typed);
        up.expect(shown);
    }
}

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn c_the_master_restarts_and_loads_programs() {
    let mut up = Up::of("harts.toml", "restarts-on-harts", "max", |text| text);
    up.expect("wave is done\n");
    up.types("load servo-b rack-hart table");
    up.expect("processor 2 is gone: nothing controls ring and thumb\n");
    up.expect("load servo-b: done\n");
    up.types("load 2 rack-hart servo");
    up.expect("load 2: done\n");
    up.types("restart servo-a");
    up.expect("`enable` makes index and middle hold again\n");
    // The fingers fall onto their stops meanwhile: a second later they lie there.
    up.types("watch middle");
    for _ in 0..4 {
        up.expect("\x1b[5A");
    }
    up.types("");
    up.types("enable");
    up.types("run open");
    up.expect("open is done\n");
}
