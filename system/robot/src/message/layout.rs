use condor_hand::trajectory::{SetPoint, StopGuard};
use condor_mbox::exchange::Blocks;
use condor_mbox::published::{Publisher, Subscriber};
use condor_mbox::{AccessError, Allocator, MemoryWindow, Published, Region};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::ServoBlocks;

/// The record that the master publishes in each tick.
pub(super) type Points<const N: usize> = [JointPoint; N];

/// The set-point of a joint, the number of its motion, and the conditions that stop the motion.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub(super) struct JointPoint {
    position: f64,
    velocity: f64,
    acceleration: f64,
    motion: u32,
    /// 1 if a contact stops the motion, otherwise 0.
    contact: u32,
    torque: f64,
    effort: f64,
}

impl JointPoint {
    fn new(point: &SetPoint, guard: &StopGuard) -> Self {
        Self {
            position: point.position,
            velocity: point.velocity,
            acceleration: point.acceleration,
            motion: guard.motion,
            contact: guard.contact.into(),
            torque: guard.torque,
            effort: guard.effort,
        }
    }

    pub(super) const fn point(&self) -> SetPoint {
        SetPoint {
            position: self.position,
            velocity: self.velocity,
            acceleration: self.acceleration,
        }
    }

    pub(super) const fn guard(&self) -> StopGuard {
        StopGuard {
            motion: self.motion,
            torque: self.torque,
            effort: self.effort,
            contact: self.contact != 0,
        }
    }
}

/// The places of the servos' request blocks and set-points in the `data` of their processor.
///
/// Both processors must make the layout with the same numbers of fingers, joints and processors,
/// and at the same offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServoLayout<const F: usize, const N: usize> {
    points: u32,
    pub(super) blocks: ServoBlocks<N>,
}

impl<const F: usize, const N: usize> ServoLayout<F, N> {
    /// Allocates room from `places` for the set-points of all fingers, and for the request blocks
    /// of `processors` processors.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no room.
    pub const fn new(places: &mut Allocator, processors: u8) -> Result<Self, AccessError> {
        let points = match places.bytes(F * Published::<Points<N>>::BYTES as usize) {
            Ok(offset) => offset,
            Err(error) => return Err(error),
        };
        match Blocks::new(places, processors) {
            Ok(blocks) => Ok(Self { points, blocks }),
            Err(error) => Err(error),
        }
    }

    /// Returns the blocks through which other processors ask the servos.
    #[must_use]
    pub const fn blocks(&self) -> ServoBlocks<N> {
        self.blocks
    }

    /// Makes the writer of the set-points of finger number `finger`, for the master. There must be
    /// only one writer for a finger at a time.
    ///
    /// `region` is the users' region of the servo processor's `data` ([`Region::users`]).
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` for a finger that the hand does not have, or if
    /// the places are not in the region; of another kind if the memory cannot be accessed.
    pub fn set_points<W: MemoryWindow + Clone>(
        &self,
        finger: usize,
        region: &Region<W>,
    ) -> Result<SetPoints<W, N>, AccessError> {
        let publisher = self.points(finger).publisher(region.clone())?;
        Ok(SetPoints { publisher })
    }

    pub(super) fn subscriber<W: MemoryWindow + Clone>(
        &self,
        finger: usize,
        region: &Region<W>,
    ) -> Result<Subscriber<Points<N>, Region<W>>, AccessError> {
        self.points(finger).subscriber(region.clone())
    }

    pub(super) fn check<W: MemoryWindow>(&self, region: &Region<W>) -> Result<(), AccessError> {
        region.check(self.points, F * Published::<Points<N>>::BYTES as usize)?;
        region.check(self.blocks.offset(), self.blocks.bytes())
    }

    /// The cell of a finger; outside of every window for one that there is not.
    fn points(&self, finger: usize) -> Published<Points<N>> {
        Published::at(if finger < F {
            self.points
                .wrapping_add(finger as u32 * Published::<Points<N>>::BYTES)
        } else {
            u32::MAX - 3
        })
    }
}

/// The writer of the set-points of a finger with `N` joints, in the master: the program that
/// computes the trajectories of the hand.
#[derive(Debug)]
pub struct SetPoints<W, const N: usize> {
    publisher: Publisher<Points<N>, Region<W>>,
}

impl<W: MemoryWindow, const N: usize> SetPoints<W, N> {
    /// Publishes the set-points of one tick of the master: the states that the joints must have one
    /// such tick from now. `guards` are the motion of each joint and the conditions that stop the
    /// motion. Returns the sequence number of the publication.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be written.
    pub fn publish(
        &mut self,
        points: &[SetPoint; N],
        guards: &[StopGuard; N],
    ) -> Result<u32, AccessError> {
        let mut both = points.iter().zip(guards);
        let rest = (&SetPoint::rest(0.0), &StopGuard::NONE);
        self.publisher.publish(&core::array::from_fn(|_| {
            let (point, guard) = both.next().unwrap_or(rest);
            JointPoint::new(point, guard)
        }))
    }
}
