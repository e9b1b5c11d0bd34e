/// A value for each of the two tendons of a joint; the flexor pulls the joint to positive angles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Pair<T> {
    /// The value of the tendon that pulls to positive angles.
    pub flexor: T,
    /// The value of its antagonist.
    pub extensor: T,
}

/// One pair for each joint of a finger, proximal first.
pub type TendonPairs<T, const N: usize> = [Pair<T>; N];

impl<T> Pair<T> {
    /// Applies a function to both values.
    pub fn map<U>(self, mut function: impl FnMut(T) -> U) -> Pair<U> {
        Pair {
            flexor: function(self.flexor),
            extensor: function(self.extensor),
        }
    }

    /// Flexor and extensor as lanes.
    pub(crate) fn lanes(self) -> [T; 2] {
        [self.flexor, self.extensor]
    }
}

impl<T: Copy> Pair<T> {
    /// Makes a pair of equal values.
    #[must_use]
    pub const fn both(value: T) -> Self {
        Self {
            flexor: value,
            extensor: value,
        }
    }
}
