//! The order of the contestants, which changes from turn to turn, and other chances.

/// Permutations that are the same in every run (splitmix64).
pub(crate) struct Shuffle(pub(crate) u64);

impl Shuffle {
    /// Puts `items` into the next order.
    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, (self.next() % (last as u64 + 1)) as usize);
        }
    }

    /// Returns a number between two, each as likely as any other.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        // 53 bits are exact.
        let part = (self.next() >> 11) as f64 / (1_u64 << 53) as f64;
        low + (high - low) * part
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }
}
