//! The list of commands: [`Command`], an entry of it, and what follows from it alone.

use core::fmt::{self, Display};

/// Commands that `help` lists together.
pub(in super::super) struct Group {
    pub(in super::super) name: &'static str,
    /// A word on what its commands do.
    pub(in super::super) about: &'static str,
    pub(in super::super) commands: &'static [Command],
}

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
    /// The rest that a person should know: ranges of the words, and what is needed first. May be empty.
    pub(in super::super) more: &'static str,
}

/// Makes the list `GROUPS`, and `Commands::execute`, which calls a command by its name: the name, its
/// words, what it does, an example, the method, and what else there is to know.
macro_rules! commands {
    ($($group:literal: $summary:literal {
        $($name:literal $arguments:literal $about:literal $example:literal $method:ident $more:literal;)*
    })*) => {
        /// All groups of commands, in the order of `help`.
        pub(super) const GROUPS: &[Group] = &[$(Group {
            name: $group,
            about: $summary,
            commands: &[$(Command {
                name: $name,
                arguments: $arguments,
                about: $about,
                example: $example,
                more: $more,
            }),*],
        }),*];

        impl<M: Machine> Commands<'_, '_, M> {
            fn execute<'l>(
                &mut self,
                name: &'l str,
                words: &mut Words<'l>,
            ) -> Result<(), Problem<'l>> {
                match name {
                    $($($name => self.$method(words),)*)*
                    _ => Err(Problem::Command(name)),
                }
            }
        }
    };
}
pub(super) use commands;

/// The columns of a command and its words in the list.
const COLUMNS: usize = 37;
/// The columns of the name of a group.
const GROUP: usize = 9;

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
        let arguments = command.arguments.len();
        let written = command.name.len() + arguments + usize::from(arguments > 0);
        let width = COLUMNS.saturating_sub(written);
        write!(f, "{command}{:width$} {}", "", command.about)
    }
}

impl Display for Group {
    /// Shows its name, and those of its commands.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<GROUP$}", self.name)?;
        self.commands
            .iter()
            .try_for_each(|it| write!(f, " {}", it.name))
    }
}

/// Returns the commands of all groups.
pub(super) fn all(groups: &'static [Group]) -> impl Iterator<Item = &'static Command> {
    groups.iter().flat_map(|group| group.commands)
}

/// Returns the command of a name.
pub(in super::super) fn find(groups: &'static [Group], name: &str) -> Option<&'static Command> {
    all(groups).find(|command| command.name == name)
}

/// Returns the name that somebody probably meant; `None` if there is none like it.
pub(in super::super) fn nearest(groups: &'static [Group], word: &str) -> Option<&'static str> {
    let ranked = all(groups).map(|it| (distance(word, it.name), it.name));
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
    use super::super::GROUPS;
    use super::*;

    #[test]
    fn the_list_fits_a_small_terminal_and_each_example_is_of_its_command() {
        assert!(GROUPS.len() < 20);
        for group in GROUPS {
            assert!(
                group.to_string().len() < 80 && group.commands.len() < 20,
                "{group}"
            );
            assert!(find(GROUPS, group.name).is_none(), "{group}");
        }
        for command in all(GROUPS) {
            let line = Line(command).to_string();
            for line in command.more.split_inclusive(". ").chain([line.as_str()]) {
                assert!(line.trim_end().chars().count() < 80, "{line}");
            }
            let example = command.example.split(' ').next();
            assert_eq!(example, Some(command.name));
            let mut same = all(GROUPS).filter(|it| it.name == command.name);
            assert!(same.nth(1).is_none(), "{}", command.name);
        }
    }

    #[test]
    fn the_words_of_a_command_say_what_may_stand_where() {
        for (name, place, choices) in [
            ("help", 0, &["GROUP", "COMMAND"][..]),
            ("to", 0, &["FINGER.JOINT"]),
            ("to", 3, &[]),
            ("status", 0, &[]),
            ("watch", 7, &["FINGER", "FINGER.JOINT"]),
            ("gains", 1, &["GAIN"]),
            ("gains", 2, &["VALUE"]),
            ("gains", 5, &["GAIN"]),
            ("table", 0, &["home", "stop", "off", "clear", "X"]),
            ("fault", 1, &["position", "effort", "drive"]),
            ("effort", 0, &["FINGER.ACTUATOR"]),
            ("load", 0, &["PROCESSOR"]),
        ] {
            let command = find(GROUPS, name).unwrap();
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
            assert_eq!(nearest(GROUPS, typed), meant, "{typed}");
        }
        assert_eq!(distance("abcd", "acbd"), 1);
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(distance("", "abc"), 3);
        assert_eq!(distance("abc", ""), 3);
    }
}
