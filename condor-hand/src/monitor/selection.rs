use thiserror::Error;

use super::layout::VARIABLES;

pub(super) const MASK_WORDS: usize = 8;

/// Some of the variables, and every which tick of the servos they are sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Selection {
    pub(super) every: u32,
    pub(super) mask: [u32; MASK_WORDS],
}

/// A selection that a monitor cannot follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SelectionError {
    /// A sample every 0 ticks.
    #[error("a row every {every} ticks; it must be 1 or more")]
    Every {
        /// The number of ticks.
        every: u32,
    },
    /// A variable that there is not.
    #[error("there is no variable {variable}; the monitor has {variables}, from 0")]
    NoVariable {
        /// The first that there is not.
        variable: u32,
        /// How many there are.
        variables: u32,
    },
    /// More variables than a row has columns.
    #[error("{chosen} variables are chosen; a row has {columns} columns")]
    Columns {
        /// How many were chosen.
        chosen: u32,
        /// How many a row has.
        columns: u32,
    },
}

impl Selection {
    /// Nothing, in every tick: no rows are written.
    pub const NOTHING: Self = Self {
        every: 1,
        mask: [0; MASK_WORDS],
    };

    /// These variables, a row every `every` ticks.
    ///
    /// # Errors
    /// A variable that no monitor has; `every` of 0.
    pub fn new(
        variables: impl IntoIterator<Item = usize>,
        every: u32,
    ) -> Result<Self, SelectionError> {
        let mut selection = Self {
            every,
            ..Self::NOTHING
        };
        for variable in variables {
            match selection.mask.get_mut(variable / 32) {
                Some(word) => *word |= 1 << (variable % 32),
                None => {
                    return Err(SelectionError::NoVariable {
                        variable: variable as u32,
                        variables: VARIABLES as u32,
                    });
                }
            }
        }
        selection.check(VARIABLES as u32, VARIABLES as u32)?;
        Ok(selection)
    }

    /// Every which tick makes a row.
    #[must_use]
    pub const fn every(&self) -> u32 {
        self.every
    }

    /// Whether a variable is in it.
    #[must_use]
    pub fn contains(&self, variable: usize) -> bool {
        let word = self.mask.get(variable / 32).copied().unwrap_or(0);
        word & (1 << (variable % 32)) != 0
    }

    /// How many variables are in it.
    #[must_use]
    pub fn count(&self) -> usize {
        self.mask
            .iter()
            .map(|word| word.count_ones() as usize)
            .sum()
    }

    /// The variables in it, lowest first.
    pub fn variables(&self) -> impl Iterator<Item = usize> + '_ {
        (0..).step_by(32).zip(self.mask).flat_map(|(first, word)| {
            let mut left = word;
            core::iter::from_fn(move || {
                let bit = left.trailing_zeros();
                left &= left.wrapping_sub(1);
                (bit < 32).then_some(first + bit as usize)
            })
        })
    }

    /// The column of a variable in rows of this selection.
    #[must_use]
    pub fn column(&self, variable: usize) -> Option<usize> {
        if !self.contains(variable) {
            return None;
        }
        let before = self.mask.iter().take(variable / 32);
        let of_word = self.mask.get(variable / 32)? & ((1 << (variable % 32)) - 1);
        let before: u32 = before.map(|word| word.count_ones()).sum();
        Some((before + of_word.count_ones()) as usize)
    }

    /// Whether a monitor of so many variables and columns can follow it.
    pub(super) fn check(&self, variables: u32, columns: u32) -> Result<(), SelectionError> {
        if self.every == 0 {
            return Err(SelectionError::Every { every: 0 });
        }
        if let Some(variable) = self.variables().find(|&at| at >= variables as usize) {
            return Err(SelectionError::NoVariable {
                variable: variable as u32,
                variables,
            });
        }
        let chosen = self.count() as u32;
        if chosen > columns {
            return Err(SelectionError::Columns { chosen, columns });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variables_and_columns_agree() {
        let chosen = [0, 5, 31, 32, 100, 255];
        let selection = Selection::new(chosen.into_iter().rev(), 3).unwrap();
        assert!(selection.variables().eq(chosen));
        assert_eq!(selection.count(), chosen.len());
        for variable in 0..300 {
            let column = chosen.iter().position(|&at| at == variable);
            assert_eq!(selection.column(variable), column);
        }
    }
}
