/// The bytes that decide the next events; zeros when there are no more.
pub(crate) struct Source<'a> {
    bytes: &'a [u8],
}

/// Numbers that are worth trying.
const SPECIAL: [f64; 24] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
    f64::MIN_POSITIVE,
    5e-324,
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    -0.1,
    0.01,
    1e-4,
    1e-9,
    1e-300,
    4.0,
    130.0,
    200.0,
    1e6,
    1e18,
    -1e300,
];

impl<'a> Source<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    pub(crate) fn rest(&self) -> &'a [u8] {
        self.bytes
    }

    pub(crate) fn byte(&mut self) -> u8 {
        self.array::<1>()[0]
    }

    pub(crate) fn below(&mut self, count: usize) -> usize {
        usize::from(u16::from_le_bytes(self.array())) % count
    }

    fn array<const N: usize>(&mut self) -> [u8; N] {
        let mut array = [0; N];
        let (taken, rest) = self.bytes.split_at(N.min(self.bytes.len()));
        array[..taken.len()].copy_from_slice(taken);
        self.bytes = rest;
        array
    }

    /// Returns any number; in half of all cases one near `usual`.
    pub(crate) fn number(&mut self, usual: f64) -> f64 {
        match self.byte() {
            choice @ 0..128 => usual * (0.5 + f64::from(choice) / 128.0),
            choice @ 128..240 => SPECIAL[usize::from(choice) % SPECIAL.len()],
            _ => f64::from_le_bytes(self.array()),
        }
    }
}
