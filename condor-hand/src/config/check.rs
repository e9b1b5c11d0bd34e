//! The rules that a hand keeps.

mod finger;
mod finite;
mod machine;
mod place;
mod shared;
mod stop;

pub(in crate::config) use place::Path;
use place::{Examiner, Root};

use super::{Hand, Mistake};

impl<const FINGERS: usize, const JOINTS: usize> Hand<FINGERS, JOINTS> {
    /// Checks whether a controller can be made of this hand.
    ///
    /// # Errors
    ///
    /// The first mistake: first numbers that are not finite, then the processors, the fingers in
    /// order, the table, and last the rules for several of them together, which are channels and
    /// load.
    pub fn check(&self) -> Result<(), Mistake> {
        self.examine(&mut Path::new())
    }

    /// `check`, which leaves the way to the mistake in `path`.
    pub(in crate::config) fn examine(&self, path: &mut Path) -> Result<(), Mistake> {
        finite::examine(self, path)?;
        let mut examiner = Examiner::new(self, path);
        machine::rates(&mut examiner)?;
        machine::constants(&mut examiner)?;
        machine::processors(&mut examiner)?;
        if self.fingers.is_empty() {
            let place = examiner.wrong(Root::Hand, "fingers");
            return Err(Mistake::Empty { place });
        }
        for index in 0..self.fingers.len() {
            finger::examine(&mut examiner, index)?;
        }
        machine::axes(&mut examiner)?;
        machine::channels(&mut examiner)?;
        machine::load(&mut examiner)
    }
}
