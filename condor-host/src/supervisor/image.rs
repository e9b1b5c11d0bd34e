//! The configuration of the robot, as text and as the image that programs load.

use std::boxed::Box;
use std::path::Path;

use condor_hand::config::{Hand, ImageError, TextError};

/// The name of the image among the files that are served.
pub const IMAGE: &str = "hand.image";

/// Room for any hand that has a use; the image of a hand is the same in any capacity.
type Any = Hand<8, 8>;

/// Bytes that no image reaches.
const MOST_BYTES: usize = 1 << 20;

/// Reads a configuration and checks it.
///
/// # Errors
/// Its first mistake.
pub fn read(text: &str, file: &str) -> Result<Box<Any>, TextError> {
    Any::from_toml(text, file).map(Box::new)
}

/// Why there is no image.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompileError {
    /// The configuration is wrong.
    #[error(transparent)]
    Text(#[from] TextError),
    /// It has no image.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file.
    #[error("cannot {doing} {path}: {source}")]
    File {
        /// What was tried.
        doing: &'static str,
        /// With which file.
        path: String,
        /// The answer.
        source: std::io::Error,
    },
}

/// Compiles the configuration in `text` to its image in `directory`, where it replaces the former
/// one as a whole.
///
/// # Errors
/// [`CompileError`].
pub fn compile(text: &Path, directory: &Path) -> Result<(), CompileError> {
    let at = |doing, path: &Path| {
        let path = path.display().to_string();
        move |source| CompileError::File {
            doing,
            path,
            source,
        }
    };
    let content = std::fs::read_to_string(text).map_err(at("read", text))?;
    let hand = read(&content, &text.to_string_lossy())?;
    let mut image = vec![0; MOST_BYTES];
    let len = hand.to_image(&mut image)?;
    let part = directory.join(".hand.image.part");
    std::fs::write(&part, image.get(..len).unwrap_or_default()).map_err(at("write", &part))?;
    let whole = directory.join(IMAGE);
    std::fs::rename(&part, &whole).map_err(at("write", &whole))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_image_that_is_served_is_that_of_the_configuration() {
        let place = tempfile::tempdir().expect("a directory");
        let text = include_str!("../../../condor-hand/hands/utah-mit.toml");
        let file = place.path().join("hand.toml");
        std::fs::write(&file, text).expect("room");
        // What a run before left there is replaced.
        std::fs::write(place.path().join(IMAGE), "old").expect("room");
        compile(&file, place.path()).expect("it is right");
        let image = std::fs::read(place.path().join(IMAGE)).expect("it is there");
        let hand = Hand::<4, 4>::from_toml(text, "hand.toml").expect("it is right");
        assert_eq!(Hand::<4, 4>::from_image(&image), Ok(hand));
    }
}
