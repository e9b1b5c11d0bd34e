//! [`tell`]: the log of commands.

use std::io::Write;

/// Writes what a client has asked for, or what has become of it. The supervisor puts the lines of a service into the
/// log of the system.
pub(crate) fn tell(client: &str, text: &str) {
    // Texts come from the network.
    let text: String = text.chars().flat_map(plain).take(400).collect();
    // Nobody may read it.
    let _ = writeln!(std::io::stdout(), "{client}: {text}");
}

fn plain(letter: char) -> impl Iterator<Item = char> {
    let is_plain = letter == ' ' || letter.is_alphanumeric() || letter.is_ascii_punctuation();
    let plain = is_plain.then_some(letter);
    let escaped = (!is_plain).then(|| letter.escape_unicode());
    plain.into_iter().chain(escaped.into_iter().flatten())
}
