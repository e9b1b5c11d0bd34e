/// What the two tendons of one joint have: the flexor pulls it to positive angles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Pair<T> {
    /// Of the tendon that pulls to positive angles.
    pub flexor: T,
    /// Of its antagonist.
    pub extensor: T,
}

/// One pair for each joint of a finger, proximal first.
pub type Pairs<T, const N: usize> = [Pair<T>; N];

impl<T> Pair<T> {
    /// The same of both tendons, by a function.
    pub fn map<U>(self, mut function: impl FnMut(T) -> U) -> Pair<U> {
        Pair {
            flexor: function(self.flexor),
            extensor: function(self.extensor),
        }
    }
}

impl<T: Copy> Pair<T> {
    /// The same for both tendons.
    #[must_use]
    pub const fn both(value: T) -> Self {
        Self {
            flexor: value,
            extensor: value,
        }
    }
}
