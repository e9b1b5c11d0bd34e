//! The list of commands: [`Command`], an entry of it, and what follows from it alone.

use core::fmt::{self, Display};

/// A command, as `help` shows it.
pub(in super::super) struct Command {
    pub(in super::super) name: &'static str,
    /// Its words: capitals stand for something, `[…]` may be left out, `…...` is repeated, and one
    /// of `a|b` is typed.
    pub(in super::super) arguments: &'static str,
    /// The help of the command, in a line.
    pub(in super::super) about: &'static str,
    /// A line that can be typed.
    pub(in super::super) example: &'static str,
}

/// Makes the list `COMMANDS`, and `Commands::execute`, which calls a command by its name: the name,
/// its words, what it does, an example, and the method.
macro_rules! commands {
    ($($name:literal $arguments:literal $about:literal $example:literal $method:ident;)*) => {
        /// All commands, in the order of `help`.
        pub(super) const COMMANDS: &[Command] = &[$(Command {
            name: $name,
            arguments: $arguments,
            about: $about,
            example: $example,
        }),*];

        impl<M: Machine> Commands<'_, '_, M> {
            fn execute<'l>(
                &mut self,
                name: &'l str,
                words: &mut Words<'l>,
            ) -> Result<(), Problem<'l>> {
                match name {
                    $($name => self.$method(words),)*
                    _ => Err(Problem::Command(name)),
                }
            }
        }
    };
}
pub(super) use commands;

/// The columns of a command and its words in the list.
const COLUMNS: usize = 37;

impl Command {
    /// Iterates over what may stand at a place among its words, from 0.
    pub(super) fn choices(&self, place: usize) -> impl Iterator<Item = &'static str> {
        let words = || self.arguments.split_ascii_whitespace();
        let (mut place, count) = (place, words().count());
        if self.arguments.ends_with("...") {
            // The last group is repeated.
            let opened = words()
                .enumerate()
                .filter(|(_, it)| it.as_bytes().first() == Some(&b'['));
            let first = opened.last().map_or(0, |(first, _)| first);
            if let Some(within) = place.checked_sub(first) {
                let repeated = count.saturating_sub(first);
                place = first.saturating_add(within.checked_rem(repeated).unwrap_or(0));
            }
        }
        let mut rest = words().nth(place);
        core::iter::from_fn(move || {
            let word = rest?;
            let end = word.bytes().position(|byte| byte == b'|');
            let (choice, after) = word.split_at_checked(end.unwrap_or(word.len()))?;
            rest = after.get(1..).filter(|_| end.is_some());
            Some(bare(choice))
        })
    }
}

/// A word without the brackets and dots around it.
fn bare(mut word: &str) -> &str {
    while let Some(inner) = word.strip_prefix("[") {
        word = inner;
    }
    while let Some(inner) = word.strip_suffix("]").or(word.strip_suffix(".")) {
        word = inner;
    }
    word
}

impl Display for Command {
    /// Shows its name and its words.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let gap = if self.arguments.is_empty() { "" } else { " " };
        write!(f, "{}{gap}{}", self.name, self.arguments)
    }
}

/// The line of a command in the list.
pub(super) struct Line(pub(super) &'static Command);

impl Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(command) = self;
        let written = command.name.len() + 1 + command.arguments.len();
        let width = COLUMNS.saturating_sub(written);
        write!(f, "{command}{:width$} {}", "", command.about)
    }
}

/// Returns the command of a name.
pub(in super::super) fn find(all: &'static [Command], name: &str) -> Option<&'static Command> {
    all.iter().find(|command| command.name == name)
}

/// Returns the name that somebody probably meant; `None` if there is none like it.
pub(in super::super) fn nearest(all: &'static [Command], word: &str) -> Option<&'static str> {
    let ranked = all.iter().map(|it| (distance(word, it.name), it.name));
    let (least, name) = ranked.min()?;
    (least <= word.len().div_ceil(3)).then_some(name)
}

/// The longest word that is compared with names.
const LONGEST: usize = 16;

/// The number of letters to put in, leave out or change, or of neighbours to exchange.
fn distance(a: &str, b: &str) -> usize {
    if a.len() > LONGEST || b.len() > LONGEST {
        return usize::MAX;
    }
    // The rows for one letter of `a` and for the letter before it.
    let mut row: [usize; LONGEST + 1] = core::array::from_fn(|count| count);
    let mut former = row;
    let mut former_letter = None;
    for (count, letter) in a.bytes().enumerate() {
        let before = former;
        former = row;
        let (mut left, mut other) = (count + 1, None);
        if let Some(first) = row.first_mut() {
            *first = left;
        }
        for (index, with) in b.bytes().enumerate() {
            let at = |row: &[usize], index: usize| row.get(index).copied().unwrap_or(LONGEST);
            let changed = at(&former, index) + usize::from(letter != with);
            let mut least = changed.min(left + 1).min(at(&former, index + 1) + 1);
            if index > 0 && other == Some(letter) && former_letter == Some(with) {
                least = least.min(at(&before, index - 1) + 1);
            }
            if let Some(place) = row.get_mut(index + 1) {
                *place = least;
            }
            (left, other) = (least, Some(with));
        }
        former_letter = Some(letter);
    }
    row.get(b.len()).copied().unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use super::super::COMMANDS;
    use super::*;

    #[test]
    fn the_list_fits_a_small_terminal_and_each_example_is_of_its_command() {
        for command in COMMANDS {
            let line = Line(command).to_string();
            assert!(line.chars().count() < 80, "{line}");
            let example = command.example.split(' ').next();
            assert_eq!(example, Some(command.name));
            let mut same = COMMANDS.iter().filter(|it| it.name == command.name);
            assert!(same.nth(1).is_none(), "{}", command.name);
        }
    }

    #[test]
    fn the_words_of_a_command_say_what_may_stand_where() {
        for (name, place, choices) in [
            ("help", 0, &["COMMAND"][..]),
            ("to", 0, &["FINGER.JOINT"]),
            ("to", 3, &[]),
            ("status", 0, &[]),
            ("watch", 7, &["FINGER", "FINGER.JOINT"]),
            ("gains", 1, &["GAIN"]),
            ("gains", 2, &["VALUE"]),
            ("gains", 5, &["GAIN"]),
            ("table", 0, &["home", "stop", "off", "clear", "X"]),
            ("fault", 1, &["position", "flexor", "extensor"]),
            ("load", 0, &["MOTION", "PROCESSOR"]),
        ] {
            let command = find(COMMANDS, name).unwrap();
            let found: Vec<_> = command.choices(place).collect();
            assert_eq!(found, choices, "{name} {place}");
        }
    }

    #[test]
    fn a_name_that_is_nearly_right_is_found() {
        for (typed, meant) in [
            ("stauts", Some("status")),
            ("enabel", Some("enable")),
            ("hlep", Some("help")),
            ("grap", Some("grasp")),
            ("moton", Some("motions")),
            ("dance", None),
            ("", None),
            ("x", None),
            ("restartrestartrestart", None),
        ] {
            assert_eq!(nearest(COMMANDS, typed), meant, "{typed}");
        }
        assert_eq!(distance("abcd", "acbd"), 1);
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(distance("", "abc"), 3);
        assert_eq!(distance("abc", ""), 3);
    }
}
