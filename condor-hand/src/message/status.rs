use super::words::{WordReader, WordWriter};
use crate::servo::ServoMode;
use crate::tendon::fault::{FaultCode, FaultSite, FingerFault};

/// The state of a finger of `N` joints, as the servo loop last reported it to clients.
///
/// In the response to a client the state is these words, in this order: the saturated joints, one
/// bit each; 1 if the finger rests; the number of the fault's code plus 1, or 0; the fault's site
/// (0 finger, 1 joint, 2 flexor, 3 extensor), and its joint; the fault's value, two words; the
/// modes, eight to a word, the first in the lowest four bits, four words; the number of restarts;
/// the number of the last order that was processed; the number of refused set-points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoStatus<const N: usize> {
    /// The present mode of each joint.
    pub modes: [ServoMode; N],
    /// A bit for each joint whose tendons cannot give the torque that it needs.
    pub saturated: u32,
    /// The first fault since the last restart; `None` if there was none.
    pub fault: Option<FingerFault>,
    /// True after a fault, while the finger goes to its least tensions or stays there.
    pub is_resting: bool,
    /// The number of restarts.
    pub restarts: u32,
    /// The number of the last order that the loop has processed.
    pub settled: u32,
    /// The number of times that set-points of the master were refused, because a number in them was
    /// not finite.
    pub refused_set_points: u32,
    /// The number of ticks of the loop; wraps.
    pub ticks: u32,
}

/// The words of a [`ServoStatus`].
pub(super) type Report = [u32; 16];

const MODE_WORDS: usize = 4;
const MODES_A_WORD: usize = 8;

impl<const N: usize> ServoStatus<N> {
    pub(super) fn words(&self) -> Report {
        let (code, [channel, joint], value) = match self.fault {
            None => (0, [0, 0], 0.0),
            Some(FingerFault { code, site, value }) => {
                let channel = match site {
                    FaultSite::Finger => [0, 0],
                    FaultSite::Joint(joint) => [1, joint as u32],
                    FaultSite::Flexor(joint) => [2, joint as u32],
                    FaultSite::Extensor(joint) => [3, joint as u32],
                };
                (code as u32 + 1, channel, value)
            }
        };
        let mut modes = [0; MODE_WORDS];
        for (word, of_word) in modes.iter_mut().zip(self.modes.chunks(MODES_A_WORD)) {
            for mode in of_word.iter().rev() {
                *word = *word << 4 | *mode as u32;
            }
        }
        let mut words = Report::default();
        WordWriter::into(&mut words)
            .words(&[self.saturated, u32::from(self.is_resting)])
            .words(&[code, channel, joint])
            .number(value)
            .words(&modes)
            .words(&[self.restarts, self.settled, self.refused_set_points]);
        words
    }

    /// The status in these words; the word that makes none of them.
    pub(super) fn take(words: &[u32], ticks: u32) -> Result<Self, u32> {
        let mut taken = WordReader::from(words);
        let (saturated, resting) = (taken.word(), taken.word());
        let (code, channel, joint) = (taken.word(), taken.word(), taken.word() as usize);
        let value = taken.number();
        let fault = match code.checked_sub(1) {
            None => None,
            Some(number) => Some(FingerFault {
                code: FaultCode::ALL.get(number as usize).copied().ok_or(code)?,
                site: match channel {
                    0 => FaultSite::Finger,
                    1 => FaultSite::Joint(joint),
                    2 => FaultSite::Flexor(joint),
                    3 => FaultSite::Extensor(joint),
                    _ => return Err(channel),
                },
                value,
            }),
        };
        let packed: [u32; MODE_WORDS] = core::array::from_fn(|_| taken.word());
        let mut modes = [ServoMode::Off; N];
        for (of_word, word) in modes.chunks_mut(MODES_A_WORD).zip(packed) {
            for (mode, shift) in of_word.iter_mut().zip((0..).step_by(4)) {
                let number = word >> shift & 15;
                *mode = ServoMode::from_number(number).ok_or(word)?;
            }
        }
        Ok(Self {
            modes,
            saturated,
            fault,
            is_resting: resting != 0,
            restarts: taken.word(),
            settled: taken.word(),
            refused_set_points: taken.word(),
            ticks,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_comes_back_from_its_words() {
        let mut modes = [ServoMode::Torque; 19];
        modes[0] = ServoMode::Grasp;
        modes[7] = ServoMode::Position;
        modes[18] = ServoMode::Tension;
        for site in [
            FaultSite::Finger,
            FaultSite::Joint(2),
            FaultSite::Flexor(18),
            FaultSite::Extensor(1),
        ] {
            for code in FaultCode::ALL {
                let status = ServoStatus {
                    modes,
                    saturated: 0x4_0001,
                    fault: Some(FingerFault {
                        code,
                        site,
                        value: -0.25,
                    }),
                    is_resting: true,
                    restarts: 3,
                    settled: 77,
                    refused_set_points: 5,
                    ticks: 9,
                };
                assert_eq!(ServoStatus::take(&status.words(), 9), Ok(status));
            }
        }
    }
}
