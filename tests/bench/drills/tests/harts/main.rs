//! Harts of a RISC-V machine in QEMU as processors. The images are built, and these tests run, by
//! `cargo xtask riscv`.

mod arrivals;
mod debugger;
mod editors;
mod releases;
mod running;
mod simulated;

use std::time::Duration;

use condor_host::control::{ControlRequest, MemberState};
use running::{Up, image};

const NEEDS: &str = "QEMU and images: cargo xtask riscv";

/// What is done wrong, and what the log and the terminal say of it.
const TRAPS: [(&str, &str); 5] = [
    ("illegal", "illegal instruction"),
    ("access", "load access fault"),
    // The program ends itself by it.
    ("float", "illegal instruction"),
    ("misaligned", "store address misaligned"),
    // The guard lies where the frame is saved, or where an interrupt would be.
    ("stack", "store access fault"),
];

fn processors() -> String {
    echoes(2)
}

/// Harts that answer, each as the processor of its number.
fn echoes(count: u32) -> String {
    let hart = |number| {
        format!(
            "[[processors]]\nnumber = {number}\nname = \"h{number}\"\nkind = \"hart\"\nhart = {number}\n\
             program = {:?}\narguments = [\"echo\"]\n\
             float_exceptions = true\non_failure = \"leave\"\n",
            image("drills-hart"),
        )
    };
    (0..count).map(hart).collect()
}

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn a_trap_ends_one_program_and_no_other() {
    let up = Up::start(&processors(), NEEDS);
    let incarnation = up.pid_and_state("h1");
    for (what, told) in TRAPS {
        let mut events = up.events();
        up.load("h0", &["faulty", what]);
        running::wait(&mut events, "h0", MemberState::Failed);
        let member = up.member("h0");
        let exit = member.last_exit.unwrap();
        assert!(exit.starts_with(told), "{what}: {exit}");
        up.read_terminal("h0", &format!("hart 0, processor 0: {told} at pc 0x"));
        up.read_terminal("h0", "ra ");
        // The other one answers.
        assert_eq!(up.ask(1, 41), 42, "after {what}");
    }
    assert_eq!(up.pid_and_state("h1"), incarnation);
    let log = up.log();
    let float =
        "the servo loop `divide` has raised a floating-point exception: an invalid operation; ";
    assert!(log.contains(float), "{log}");
    up.load("h0", &["echo"]);
    assert_eq!(up.ask(0, 1), 2, "the hart runs programs again");
    up.end();
}

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn as_many_harts_as_there_can_be_run_at_once() {
    let most = 12;
    let up = Up::start(&echoes(most.into()), NEEDS);
    for number in 0..most {
        assert_eq!(up.ask(number, 41), 42);
        assert_eq!(up.member(&format!("h{number}")).state, MemberState::Running);
    }
    up.end();
}

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn a_program_that_fails_says_why_in_the_log() {
    let up = Up::start(&processors(), NEEDS);
    let refused = up.client().ask(&ControlRequest::Load {
        processor: "h0".into(),
        program: up.member("h0").program,
        arguments: vec!["table".into(), "to=nobody".into()],
    });
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("`h0` is not running"), "{refused}");
    let log = up.log();
    let error = "h0: an argument is missing or wrong: NAME=PROCESSOR,PROCESSOR,…";
    assert!(log.contains(error), "{log}");
    up.load("h0", &["echo"]);
    assert_eq!(up.ask(0, 6), 7);
    up.end();
}

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn the_host_hears_the_messages_to_a_hart() {
    let up = Up::start(&processors(), NEEDS);
    let mut observer = up.hearing("h0");
    assert_eq!(up.ask(0, 41), 42);
    let message = observer.line("\"vector\":12");
    for field in [
        "\"data\":41",
        "\"to\":\"h0\"",
        "\"vector\":12",
        "\"missed\":0",
    ] {
        assert!(message.contains(field), "{message}");
    }
    // Its next program has another incarnation.
    up.load("h0", &["echo"]);
    assert_eq!(up.ask(0, 6), 7);
    let message = observer.line("\"vector\":12");
    assert!(message.contains("\"data\":6"), "{message}");
    up.end();
    assert!(observer.end().contains("the system has ended"));
}

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn an_interrupt_that_nobody_handles_is_named_and_comes_no_more() {
    let up = Up::start(&processors(), NEEDS);
    up.load("h0", &["faulty", "interrupt"]);
    up.read_terminal("h0", "not handled: vector 11, causes 0x2");
    // The hart is rung as before.
    up.load("h0", &["echo"]);
    assert_eq!(up.ask(0, 6), 7);
    up.end();
}

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn a_program_that_does_not_listen_is_taken_away() {
    let up = Up::start(&processors(), NEEDS);
    up.load("h0", &["faulty", "spin"]);
    up.client()
        .ask(&ControlRequest::Stop {
            processor: "h0".into(),
        })
        .unwrap();
    let member = up.member("h0");
    assert_eq!(member.state, MemberState::Stopped);
    let exit = member.last_exit.unwrap();
    assert!(exit.contains("can run another program"), "{exit}");
    up.load("h0", &["echo"]);
    assert_eq!(up.ask(0, 6), 7);
    assert_eq!(up.ask(1, 7), 8);
    up.end();
}

/// The recording is one of a servo processor of the hand; what comes of it on x86-64 is what a test of
/// that package compares with the same file.
#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn the_hand_is_controlled_by_the_same_bits_as_on_this_machine() {
    let hand = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../examples/utah-mit-hand"
    );
    let condor = running::host_program("utah-mit-hand");
    let replay = |to: &str| format!("\"replay\", \"from=servo.mcap\", \"to={to}\"");
    let processors = format!(
        "[[processors]]\nnumber = 0\nname = \"h0\"\nkind = \"hart\"\nhart = 0\nprogram = {:?}\n\
         arguments = [{}]\non_failure = \"leave\"\n\
         [[processors]]\nnumber = 4\nname = \"p4\"\nprogram = {:?}\narguments = [\"program\", {}]\n\
         on_failure = \"leave\"\n",
        image("rack-hart"),
        replay("hart.out"),
        condor,
        replay("process.out"),
    );
    let keys = "robot = \"hand.toml\"\n";
    let up = Up::prepared(&condor, keys, &processors, NEEDS, |place| {
        std::fs::copy(
            format!("{hand}/tests/data/servo.mcap"),
            place.join("files/servo.mcap"),
        )
        .unwrap();
        std::fs::copy(
            format!("{hand}/../../condor-hand/hands/utah-mit.toml"),
            place.join("hand.toml"),
        )
        .unwrap();
    });
    for name in ["h0", "p4"] {
        up.read_terminal(name, "replayed ");
        up.wait_for_end(name, Duration::from_secs(100));
    }
    let output = |name: &str| std::fs::read(up.place().join("files").join(name)).unwrap();
    let (hart, process) = (output("hart.out"), output("process.out"));
    assert!(hart.len() > 100_000, "{} bytes", hart.len());
    assert!(hart == process, "they differ");
    up.end();
}
