use condor_hand::trajectory::SetPoint;

/// FNV-1a of 64 bits (Fowler, Noll and Vo, 1991) over the bits of numbers.
pub(crate) struct Digest {
    hash: u64,
    spoilt: bool,
}

const BASIS: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0100_0000_01b3;
/// The bits that stand for any NaN, whose payload and sign differ from target to target.
const NAN: u64 = 0x7ff8_0000_0000_0000;

impl Digest {
    pub(crate) const fn new() -> Self {
        Self {
            hash: BASIS,
            spoilt: false,
        }
    }

    pub(crate) const fn hash(&self) -> u64 {
        self.hash
    }

    /// Returns true if there was a NaN where none may be.
    pub(crate) const fn is_spoilt(&self) -> bool {
        self.spoilt
    }

    pub(crate) fn bits(&mut self, bits: u64) {
        for byte in bits.to_le_bytes() {
            self.hash = (self.hash ^ u64::from(byte)).wrapping_mul(PRIME);
        }
    }

    /// Adds a number that must not be a NaN.
    pub(crate) fn number(&mut self, value: f64) {
        self.spoilt |= value.is_nan();
        self.reading(value);
    }

    /// Adds a number that may be a NaN.
    pub(crate) fn reading(&mut self, value: f64) {
        self.bits(if value.is_nan() { NAN } else { value.to_bits() });
    }

    pub(crate) fn numbers<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) {
        for &value in values {
            self.number(value);
        }
    }

    pub(crate) fn point(&mut self, point: &SetPoint) {
        self.number(point.position);
        self.number(point.velocity);
        self.number(point.acceleration);
    }

    /// Adds whether there is an answer; returns the answer.
    pub(crate) fn answer<U>(&mut self, answer: Option<U>) -> Option<U> {
        self.bits(u64::from(answer.is_some()));
        answer
    }
}
