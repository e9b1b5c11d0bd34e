/// A generator of random numbers that are the same for the same seed on every target: xoshiro256++
/// (Blackman and Vigna 2019), its state filled by `SplitMix64`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise {
    state: [u64; 4],
}

impl Noise {
    /// Makes the generator for a seed, which may be any number.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut at = seed;
        let state = [(); 4].map(|()| {
            at = at.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut mixed = at;
            mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            mixed ^ (mixed >> 31)
        });
        Self { state }
    }

    /// Returns the next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        let [mut a, mut b, mut c, mut d] = self.state;
        let bits = a.wrapping_add(d).rotate_left(23).wrapping_add(a);
        let shifted = b << 17;
        c ^= a;
        d ^= b;
        b ^= c;
        a ^= d;
        c ^= shifted;
        d = d.rotate_left(45);
        self.state = [a, b, c, d];
        bits
    }

    /// Returns the next random number, uniformly distributed over `0.0..1.0`.
    pub fn uniform(&mut self) -> f64 {
        // 53 bits are what a double holds.
        #[allow(clippy::cast_precision_loss, reason = "53 bits fit")]
        let integer = (self.bits() >> 11) as f64;
        integer / 9_007_199_254_740_992.0
    }

    /// Returns the next random number with a nearly normal distribution of mean 0 and standard
    /// deviation 1. It is the sum of twelve uniform numbers less 6, so it is never beyond 6 or -6.
    pub fn normal(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            sum += self.uniform();
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_is_the_published_one() {
        // The first numbers of the reference program in C, its state 1, 2, 3, 4.
        let mut noise = Noise {
            state: [1, 2, 3, 4],
        };
        let numbers = [(); 4].map(|()| noise.bits());
        assert_eq!(
            numbers,
            [
                41_943_041,
                58_720_359,
                3_588_806_011_781_223,
                3_591_011_842_654_386
            ]
        );
    }
}
