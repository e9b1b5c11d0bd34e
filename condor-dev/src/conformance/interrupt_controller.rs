//! The checks of [`InterruptController`].

use core::fmt;

use crate::interrupt::{InterruptController, InterruptLevel, InterruptVector};

/// The first check of [`interrupt_controller()`] that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{check}: `claim` returned {}, expected {}", VectorText(*.found), VectorText(*.expected))]
pub struct ControllerFailure {
    /// The rule that is broken.
    pub check: &'static str,
    /// The vector that was claimed.
    pub found: Option<InterruptVector>,
    /// The vector that should have been claimed.
    pub expected: Option<InterruptVector>,
}

/// A claimed vector in words.
struct VectorText(Option<InterruptVector>);

impl fmt::Display for VectorText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(vector) => write!(f, "vector {}", vector.0),
            None => f.write_str("no vector"),
        }
    }
}

const LOW: InterruptLevel = InterruptLevel(1);
const HIGH: InterruptLevel = InterruptLevel(2);

/// Checks that `controller` follows the rules for implementers of [`InterruptController`].
///
/// `lines` are two vectors with level-triggered interrupts. Both lines must be low and disabled,
/// and nothing else may use them; after a success they are low and disabled again. The controller
/// must distinguish the levels 1 and 2.
///
/// `nobody` is the number of a vector that the controller does not have. `set` must raise the line
/// of a vector (`true`) or lower it (`false`), as a board does, and must not return before the
/// controller has seen the change.
///
/// # Errors
/// [`ControllerFailure`] for the first check that fails.
pub fn interrupt_controller<C: InterruptController>(
    controller: &C,
    lines: [InterruptVector; 2],
    nobody: InterruptVector,
    set: impl FnMut(InterruptVector, bool),
) -> Result<(), ControllerFailure> {
    let [one, other] = lines;
    let mut bench = Bench { controller, set };
    bench.gives("nothing is pending at first", None)?;
    bench.single(one)?;
    bench.single(other)?;
    bench.disabled_in_service(one)?;
    bench.levels(one, other)?;
    bench.levels(other, one)?;
    bench.both_in_service(one, other)?;
    bench.unknown(one, nobody)
}

struct Bench<'c, C, F> {
    controller: &'c C,
    set: F,
}

impl<C: InterruptController, F: FnMut(InterruptVector, bool)> Bench<'_, C, F> {
    fn gives(
        &self,
        check: &'static str,
        expected: Option<InterruptVector>,
    ) -> Result<(), ControllerFailure> {
        let found = self.controller.claim();
        if found == expected {
            return Ok(());
        }
        Err(ControllerFailure {
            check,
            found,
            expected,
        })
    }

    /// Ends what was claimed of a line that is served now.
    fn serve(&mut self, line: InterruptVector) -> Result<(), ControllerFailure> {
        (self.set)(line, false);
        self.controller.complete(line);
        self.gives("a line whose interrupt was completed is not pending", None)
    }

    fn single(&mut self, line: InterruptVector) -> Result<(), ControllerFailure> {
        let controller = self.controller;
        (self.set)(line, true);
        self.gives("a disabled vector is not claimed", None)?;
        controller.enable(line, InterruptLevel(0));
        self.gives("level 0 never interrupts", None)?;
        controller.enable(line, LOW);
        self.gives(
            "an interrupt that was raised while its vector was disabled is pending once it is enabled",
            Some(line),
        )?;
        self.gives("a vector in service is not claimed again", None)?;
        controller.enable(line, HIGH);
        self.gives(
            "a vector in service is not claimed after it is enabled again",
            None,
        )?;
        controller.complete(line);
        self.gives(
            "a line that is still asserted is pending after `complete`",
            Some(line),
        )?;
        self.serve(line)?;
        (self.set)(line, true);
        self.gives("a line that is asserted again is pending", Some(line))?;
        self.serve(line)?;
        controller.disable(line);
        (self.set)(line, true);
        self.gives("a vector disabled again is not claimed", None)?;
        controller.enable(line, LOW);
        self.gives(
            "a disabled vector is pending once it is enabled again",
            Some(line),
        )?;
        self.serve(line)?;
        controller.disable(line);
        Ok(())
    }

    fn disabled_in_service(&mut self, line: InterruptVector) -> Result<(), ControllerFailure> {
        let controller = self.controller;
        controller.enable(line, LOW);
        (self.set)(line, true);
        self.gives("an asserted line is pending", Some(line))?;
        controller.disable(line);
        controller.complete(line);
        self.gives(
            "a vector that was disabled in service is not claimed after `complete`",
            None,
        )?;
        controller.enable(line, LOW);
        self.gives(
            "a vector that was disabled in service interrupts once it is enabled again",
            Some(line),
        )?;
        self.serve(line)?;
        controller.disable(line);
        Ok(())
    }

    fn levels(
        &mut self,
        urgent: InterruptVector,
        other: InterruptVector,
    ) -> Result<(), ControllerFailure> {
        let controller = self.controller;
        controller.enable(other, LOW);
        controller.enable(urgent, HIGH);
        (self.set)(other, true);
        (self.set)(urgent, true);
        self.gives("the highest level comes first", Some(urgent))?;
        (self.set)(urgent, false);
        controller.complete(urgent);
        self.gives("the next lower level comes second", Some(other))?;
        self.serve(other)?;
        controller.disable(urgent);
        controller.disable(other);
        Ok(())
    }

    fn both_in_service(
        &mut self,
        one: InterruptVector,
        other: InterruptVector,
    ) -> Result<(), ControllerFailure> {
        let controller = self.controller;
        controller.enable(one, HIGH);
        controller.enable(other, LOW);
        (self.set)(one, true);
        self.gives("an asserted line is pending", Some(one))?;
        (self.set)(other, true);
        self.gives(
            "another vector can be claimed while one is in service",
            Some(other),
        )?;
        self.gives("no vector in service is claimed twice", None)?;
        (self.set)(one, false);
        controller.complete(one);
        self.gives("completing one vector does not complete another", None)?;
        self.serve(other)?;
        controller.disable(one);
        controller.disable(other);
        Ok(())
    }

    fn unknown(
        &mut self,
        line: InterruptVector,
        nobody: InterruptVector,
    ) -> Result<(), ControllerFailure> {
        let controller = self.controller;
        controller.enable(nobody, HIGH);
        self.gives("a vector that does not exist is never pending", None)?;
        controller.enable(line, LOW);
        (self.set)(line, true);
        controller.complete(nobody);
        controller.disable(nobody);
        self.gives(
            "a call for a vector that does not exist changes no other vector",
            Some(line),
        )?;
        controller.complete(nobody);
        self.gives(
            "completing a vector that does not exist completes no other",
            None,
        )?;
        self.serve(line)?;
        controller.disable(line);
        Ok(())
    }
}
