/// Two values, one for each tendon of a joint: the flexor, which pulls the joint to positive
/// angles, and the extensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Pair<T> {
    /// The value of the tendon that pulls to positive angles.
    pub flexor: T,
    /// The value of its antagonist.
    pub extensor: T,
}

/// The values of all tendons of a finger: one [`Pair`] for each joint, proximal first.
pub type TendonPairs<T, const N: usize> = [Pair<T>; N];

impl<T> Pair<T> {
    /// Returns the pair of the results of `function` for the flexor's and for the extensor's value.
    pub fn map<U>(self, mut function: impl FnMut(T) -> U) -> Pair<U> {
        Pair {
            flexor: function(self.flexor),
            extensor: function(self.extensor),
        }
    }

    /// A pair of lanes.
    pub(crate) fn of([flexor, extensor]: [T; 2]) -> Self {
        Self { flexor, extensor }
    }

    /// Flexor and extensor as lanes.
    pub(crate) fn lanes(self) -> [T; 2] {
        [self.flexor, self.extensor]
    }
}

impl<T: Copy> Pair<T> {
    /// Returns a pair in which flexor and extensor have the same value.
    #[must_use]
    pub const fn both(value: T) -> Self {
        Self {
            flexor: value,
            extensor: value,
        }
    }
}
