//! A hand as TOML that people write.

mod defaults;

use condor_toml::{Misreading, SourceText, Spanned, TextError};
use toml::de::DeValue;

use super::Hand;

impl<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>
    Hand<FINGERS, JOINTS, ACTUATORS>
{
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

/// Returns the line, from 1, of the value at a path such as `fingers[0].joints[1].servo.kp` in the text of a
/// configuration file. For a value that a joint leaves out it is the line of the default. Returns `None` if there is
/// no such value, or the text is not TOML.
#[must_use]
pub fn line_of(text: &str, path: &str) -> Option<usize> {
    let text = SourceText::new("", text);
    let mut tree = text.parse().ok()?;
    defaults::fill(&mut tree).ok()?;
    let (value, is_whole) = nearest(&tree, path);
    is_whole.then(|| text.line(value.span().start))
}

fn read<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>(
    mut tree: Spanned<DeValue<'_>>,
) -> Result<Hand<FINGERS, JOINTS, ACTUATORS>, Misreading> {
    defaults::fill(&mut tree)?;
    let hand: Hand<FINGERS, JOINTS, ACTUATORS> = condor_toml::read(&tree)?;
    match hand.check() {
        Ok(()) => Ok(hand),
        Err(mistake) => {
            let (nearest, _) = nearest(&tree, &mistake.path);
            let span = nearest.span();
            Err(Misreading::at(&span, mistake))
        }
    }
}

/// The value at the end of a path such as `fingers[1].base`, or the last one on the way there; and whether it is the
/// end.
fn nearest<'a, 't>(tree: &'a Spanned<DeValue<'t>>, path: &str) -> (&'a Spanned<DeValue<'t>>, bool) {
    let mut value = tree;
    for step in path.split(['.', '[']) {
        let index = step.strip_suffix(']').and_then(|step| step.parse().ok());
        let next = match index {
            Some::<usize>(index) => value.get_ref().get(index),
            None => value.get_ref().get(step),
        };
        match next {
            Some(next) => value = next,
            None => return (value, false),
        }
    }
    (value, true)
}
