//! Numbers as words, one after another.

/// Takes words; past the end there are zeros.
pub(super) struct WordReader<'a>(core::slice::Iter<'a, u32>);

impl<'a> WordReader<'a> {
    pub(super) fn from(words: &'a [u32]) -> Self {
        Self(words.iter())
    }

    pub(super) fn word(&mut self) -> u32 {
        self.0.next().copied().unwrap_or(0)
    }

    pub(super) fn long(&mut self) -> u64 {
        let (low, high) = (u64::from(self.word()), u64::from(self.word()));
        high << 32 | low
    }

    pub(super) fn number(&mut self) -> f64 {
        f64::from_bits(self.long())
    }

    pub(super) fn numbers<const K: usize>(&mut self) -> [f64; K] {
        core::array::from_fn(|_| self.number())
    }
}

/// Puts words; what has no room is left out.
pub(super) struct WordWriter<'a>(core::slice::IterMut<'a, u32>);

impl<'a> WordWriter<'a> {
    pub(super) fn into(words: &'a mut [u32]) -> Self {
        Self(words.iter_mut())
    }

    /// The number of words for which there is room.
    pub(super) fn room(&self) -> usize {
        self.0.len()
    }

    pub(super) fn word(&mut self, word: u32) -> &mut Self {
        if let Some(place) = self.0.next() {
            *place = word;
        }
        self
    }

    pub(super) fn words(&mut self, words: &[u32]) -> &mut Self {
        for &word in words {
            self.word(word);
        }
        self
    }

    pub(super) fn long(&mut self, long: u64) -> &mut Self {
        self.word(long as u32).word((long >> 32) as u32)
    }

    pub(super) fn number(&mut self, number: f64) -> &mut Self {
        self.long(number.to_bits())
    }

    pub(super) fn numbers(&mut self, numbers: &[f64]) -> &mut Self {
        for &number in numbers {
            self.number(number);
        }
        self
    }
}
