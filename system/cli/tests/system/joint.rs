//! The program of the processors: a joint that shows what it does, and a terminal that echoes.

use std::time::Duration;

use condor_mbox::Vector;
use condor_mos::Rate;
use condor_rt::{Machine, Program, ProgramError, Setup};
use condor_vars::{Param, Var, cell_struct, choice};
use embedded_io::Read;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::running::{Up, this};

const ADD: Vector = Vector(5);

/// The description of a system of two.
pub(crate) const TWO: &str = r#"
    [[processors]]
    number = 0
    name = "a"
    program = "THIS"
    arguments = ["joint"]
    [[processors]]
    number = 1
    name = "b"
    program = "THIS"
    arguments = ["joint"]
"#;

/// Starts a system of two, of which the second one runs a program without variables until [`load_joint`].
pub(crate) fn start_one() -> Up {
    let (first, second) = TWO.split_at(TWO.len() / 2);
    let second = second.replace("[\"joint\"]", "[\"writer\"]");
    let up = Up::start(&format!("{first}{second}"), &[]);
    up.read_terminal("a", "hello");
    up
}

/// Loads a joint into the second processor of [`start_one`].
pub(crate) fn load_joint(up: &Up) {
    up.run(&["load", "b", this(), "joint"]);
}

/// Starts a system of two, whose loops have run.
pub(crate) fn start(options: &[&str]) -> Up {
    let up = Up::start(TWO, options);
    for name in ["a", "b"] {
        up.read_terminal(name, "hello");
    }
    up
}

choice! {
    /// The mode of the joint, as a variable of named values.
    pub(crate) enum Mode {
        /// Nothing.
        Idle = "idle",
        /// Stays where it is.
        Hold = "hold",
        /// Not to be asked for.
        Fault = "fault",
    }
}

#[derive(FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Contact {
    force: f32,
    fingers: u32,
}

cell_struct!(Contact {
    "force": force, "N", "At the tip.";
    "fingers": fingers, "";
});

/// A joint whose position is half the number of the tick.
pub(crate) struct Joint;

impl Program for Joint {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let position = Var::new("joint.position", "rad").about("Filtered.");
        let ticks = Var::<u64>::new("ticks", "");
        let beats = Var::<u32>::new("beats", "");
        let stiffness = Param::new("joint.stiffness", "N m/rad", 2.0, 0.0..=50.0);
        let mode = Param::new("mode", "", Mode::Idle, Mode::Idle..=Mode::Hold);
        let is_soft = Param::new("soft", "", false, false..=true);
        let mut setup = Setup::new(machine)?;
        let mut contact = setup.publish_fields::<Contact>("contact")?;
        setup
            .console()?
            .on(ADD, "add", &|call| call.data().wrapping_add(2))
            .watch(&position)
            .watch(&ticks)
            .tune(&stiffness)
            .tune(&mode)
            .tune(&is_soft)
            .fixed()
            .servo("servo", Rate::hz(100), &mut |tick| {
                position.set(0.5 * f64::from(tick.number));
                ticks.set(tick.number.into());
                let (force, fingers) = (1.5, 3);
                // Memory that is gone shows in the background.
                let _ = contact.publish(&Contact { force, fingers });
            })
            .watch(&beats)
            .servo("slow", Rate::hz(20), &mut |tick| beats.set(tick.number))
            .background(|background| {
                let console = background.console()?.console(background.mailbox());
                let mut typed = console.with_read_timeout(Duration::from_millis(1));
                let mut line = [0; 64];
                // A test that has read this relies on what loops do.
                for name in ["servo", "slow"] {
                    while background.statistics(name)?.run == 0 && !background.is_stopping() {
                        background.serve(Duration::from_millis(1))?;
                    }
                }
                background.print(format_args!("hello\r\n"));
                while !background.is_stopping() {
                    background.serve(Duration::from_millis(20))?;
                    if let Ok(count) = typed.read(&mut line) {
                        let line = String::from_utf8_lossy(&line[..count]);
                        background.print(format_args!("typed {}\r\n", line.trim()));
                    }
                }
                Ok(())
            })
    }
}
