//! The rules that a hand keeps.

mod at;
mod finger;
mod machine;
mod stop;

use at::At;
pub(super) use at::{cutoff_rules, range};
pub(super) use stop::LOWER_CUTOFF;

use super::{Hand, Mistake};

impl<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>
    Hand<FINGERS, JOINTS, ACTUATORS>
{
    /// Checks that a controller can be made from this hand.
    ///
    /// Call it for a hand that was made or changed in code. `from_toml` (feature `text`) and
    /// [`from_image`](Self::from_image) have called it already.
    ///
    /// # Errors
    /// Returns the first [`Mistake`] if the hand has one, in this order: the processors, each finger, the
    /// table, and the rules for several of them together, which are channels and load.
    pub fn check(&self) -> Result<(), Mistake> {
        let at = At::hand();
        self.check_rates(&at)?;
        self.check_constants(&at)?;
        self.check_processors(&at)?;
        at.not_empty("fingers", self.fingers.is_empty())?;
        for index in 0..self.fingers.len() {
            self.check_finger(index)?;
        }
        self.check_axes(&at)?;
        self.check_channels()?;
        self.check_load()
    }
}
