//! A hand as TOML that people write.

mod defaults;

use condor_toml::{Misreading, SourceText, Spanned, TextError};
use toml::de::DeValue;

use super::Hand;

impl<const FINGERS: usize, const JOINTS: usize> Hand<FINGERS, JOINTS> {
    /// Reads a hand from the TOML text of a configuration file, and checks the hand.
    ///
    /// `file` is the name to show in error messages; no file is opened.
    ///
    /// # Errors
    /// Returns an error with the line and column of the first problem if the text is not TOML, lacks a value,
    /// or has one that a hand cannot have.
    pub fn from_toml(text: &str, file: &str) -> Result<Self, TextError> {
        let text = SourceText::new(file, text);
        read(text.parse()?).map_err(|fault| text.error(fault))
    }
}

fn read<const FINGERS: usize, const JOINTS: usize>(
    mut tree: Spanned<DeValue<'_>>,
) -> Result<Hand<FINGERS, JOINTS>, Misreading> {
    defaults::fill(&mut tree)?;
    let hand: Hand<FINGERS, JOINTS> = condor_toml::read(&tree)?;
    match hand.check() {
        Ok(()) => Ok(hand),
        Err(mistake) => {
            let span = nearest(&tree, &mistake.path).span();
            Err(Misreading::at(&span, mistake))
        }
    }
}

/// The value at the end of a path such as `fingers[1].base`, or the last one on the way there.
fn nearest<'a, 't>(tree: &'a Spanned<DeValue<'t>>, path: &str) -> &'a Spanned<DeValue<'t>> {
    let mut value = tree;
    for step in path.split(['.', '[']) {
        let index = step.strip_suffix(']').and_then(|step| step.parse().ok());
        let next = match index {
            Some::<usize>(index) => value.get_ref().get(index),
            None => value.get_ref().get(step),
        };
        match next {
            Some(next) => value = next,
            None => break,
        }
    }
    value
}
