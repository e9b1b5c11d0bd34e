//! The sentences of section 4.2 of the memo with the programs on harts: `cargo xtask riscv` runs them.

use crate::up::Up;

/// A session: each line that is typed, and the text that it brings.
const SESSION: [(&str, &str); 12] = [
    ("enable", "enable: done\n"),
    ("run grasp", "grasp is done\n"),
    ("ball", "ball: done\n"),
    ("grasp 150", "grasp: done\n"),
    ("status", "index  grasps"),
    ("letgo", "letgo: done\n"),
    ("release", "release: done\n"),
    ("enable", "enable: done\n"),
    ("impedance ring 0.05", "impedance: done\n"),
    ("status", "ring   impedance"),
    ("enable", "enable: done\n"),
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
    up.expect("restart servo-a: done\n");
    up.types("enable");
    up.types("run open");
    up.expect("open is done\n");
}
