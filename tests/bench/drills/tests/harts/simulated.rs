//! Harts in the simulated time of their system, beside processes.

use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use condor_host::control::MemberState;
use condor_mbox::layout::BELL_BYTES;
use drills::order::{NAME, Record};
use qemu_virt_host::MachineMemory;

use crate::NEEDS;
use crate::running::{self, Up, image};

const NUMBERS: [u8; 3] = [0, 1, 4];
const ROUNDS: u32 = 1000;
/// How long it may take until all have come to the end of their rounds.
const PATIENCE: Duration = Duration::from_secs(200);

/// Starts a system in which the processors `harts` are harts, the others are processes, and the times of
/// loops do not fit.
fn start(harts: &[u8], speed: &str) -> Up {
    let hart = |number: u8, hart: usize| {
        let image = image("drills-hart");
        format!("number = {number}\nkind = \"hart\"\nhart = {hart}\nprogram = {image:?}\n")
    };
    let bystander = hart(9, harts.len()) + "name = \"bystander\"\narguments = [\"echo\"]\n";
    let others = NUMBERS.map(|number| {
        let place = harts.iter().position(|&hart| hart == number);
        let kind = place.map_or_else(
            || format!("number = {number}\nprogram = \"self\"\n"),
            |place| hart(number, place),
        );
        format!(
            "{kind}name = \"p{number}\"\nloop_times_us = [1500, 5000]\n\
             arguments = [\"order\", \"peers=0,1,4\", \"rounds={ROUNDS}\"]\n"
        )
    });
    let tables = [vec![bystander], others.to_vec()].concat();
    let processors = format!("[[processors]]\n{}", tables.join("[[processors]]\n"));
    let clock = format!("[clock]\nkind = \"simulated\"\nspeed = {speed}\n");
    let condor = running::host_program("drills");
    Up::prepared(&condor, &clock, &processors, NEEDS, |_| {})
}

/// Returns the records of all processors, once they have come to the end of their rounds.
fn records(up: &Up) -> [Record; NUMBERS.len()] {
    let memory = MachineMemory::open(up.directory().path().join("memory")).unwrap();
    let begun = Instant::now();
    NUMBERS.map(|number| {
        let data = memory.map().data.at(number.into()) + BELL_BYTES;
        let bytes = memory.map().data_bytes - BELL_BYTES;
        let region = memory.region().part(data, bytes).unwrap();
        loop {
            // Until it has begun, there is nothing in which it could be found.
            if let Ok(Some(record)) = drills::published(&region, NAME) {
                return record;
            }
            assert!(
                begun.elapsed() < PATIENCE,
                "p{number} does not come to its end"
            );
            thread::sleep(Duration::from_millis(10));
        }
    })
}

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn harts_see_the_same_in_the_same_order_as_processes() {
    let [harts, processes] = [&[0, 1][..], &[]].map(|harts| {
        let up = start(harts, "\"max\"");
        let records = records(&up);
        up.end();
        records
    });
    assert_eq!(harts, processes);
    for record in harts {
        assert_eq!(
            (record.answered, record.skipped[0]),
            (ROUNDS, 0),
            "{record:?}"
        );
        assert!(record.skipped[1] > 0, "{record:?}");
    }
}

#[test]
#[ignore = "needs QEMU and images: cargo xtask riscv"]
fn time_goes_on_when_a_machine_has_been_started_again() {
    let up = start(&[0, 1], "1");
    let mut events = up.events();
    let status = up.client().status().unwrap();
    let machine = status.members().find(|it| it.name == "machine").unwrap();
    let machine = machine.pid.unwrap().to_string();
    assert!(
        Command::new("kill")
            .args(["-9", &machine])
            .status()
            .unwrap()
            .success()
    );
    for name in ["p0", "p1"] {
        running::wait(&mut events, name, MemberState::Running);
    }
    records(&up);
    for (name, restarts) in [("p0", 1), ("p1", 1), ("p4", 0)] {
        assert_eq!(up.member(name).restarts, restarts, "{name}");
    }
    up.end();
}
