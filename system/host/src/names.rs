//! Names of variables: each has three, and a name or a pattern may stand for several. And numbers in the place of
//! names.

use std::collections::{BTreeMap, BTreeSet};

use wildmatch::WildMatch;

/// The number of names that are suggested.
const SUGGESTIONS: usize = 5;

/// A variable that the functions of this module find by name. It has a name of its own, and those of its processor and
/// of its loop or cell.
pub trait VariableName {
    /// Returns the names of its processor and of its loop or cell, and its own name.
    fn parts(&self) -> [&str; 3];

    /// Returns the names that it may be called by, from the shortest to the longest.
    fn names(&self) -> [String; 3] {
        let [processor, owner, name] = self.parts();
        [
            name.to_owned(),
            format!("{processor}:{name}"),
            format!("{processor}:{owner}:{name}"),
        ]
    }

    /// Returns true if `name` is one of its [`names`](Self::names).
    fn is_called(&self, name: &str) -> bool {
        let [processor, owner, own] = self.parts();
        let Some(before) = name.strip_suffix(own) else {
            return false;
        };
        let Some(place) = before.strip_suffix(':') else {
            return before.is_empty();
        };
        let rest = place.strip_prefix(processor);
        rest.is_some_and(|rest| rest.is_empty() || rest.strip_prefix(':') == Some(owner))
    }
}

/// Finds the variable called `name` in `all`. If several variables have the same name of their own, `name` must be
/// `processor:name` or `processor:loop:name`. The text `hint` is added to the error if no variable has the name.
///
/// # Errors
/// Returns an error if no variable has the name, with similar names, or if several variables have it.
pub fn find<'a, T: VariableName>(all: &'a [T], name: &str, hint: &str) -> Result<&'a T, String> {
    let mut found = all.iter().filter(|one| one.is_called(name));
    match (found.next(), found.next()) {
        (Some(one), None) => Ok(one),
        (Some(one), Some(other)) => {
            let [_, on_processor, in_loop] = one.names();
            let [_, other_processor, other_loop] = other.names();
            let (one, other) = if on_processor == other_processor {
                (in_loop, other_loop)
            } else {
                (on_processor, other_processor)
            };
            Err(format!(
                "several variables have the name `{name}`: write {one} or {other}"
            ))
        }
        (None, _) => {
            let own = name.rsplit_once(':').map_or(name, |(_, own)| own);
            let nearest = nearest(own, all).unwrap_or_else(|| "there is none".into());
            Err(format!(
                "there is no variable or parameter `{name}`; {nearest}{hint}"
            ))
        }
    }
}

/// Finds the variables in `all` that `patterns` name, in the order of `patterns`. Each variable is returned once. In a
/// pattern, `*` stands for any characters, and `?` for one character. The text `hint` is added to the error if nothing
/// is found.
///
/// # Errors
/// Returns an error if a name stands for no variable or for several, or if a pattern matches nothing. The text
/// names the first such name or pattern.
pub fn matching<'a, T: VariableName>(
    all: &'a [T],
    patterns: &[String],
    hint: &str,
) -> Result<Vec<&'a T>, String> {
    let mut found: Vec<&T> = Vec::new();
    for text in patterns {
        if !text.contains(['*', '?']) {
            found.push(find(all, text, hint)?);
            continue;
        }
        let pattern = WildMatch::new(text);
        let matches = |one: &&T| one.names().iter().any(|name| pattern.matches(name));
        let before = found.len();
        found.extend(all.iter().filter(matches));
        if found.len() == before {
            return Err(format!("no variable or parameter matches `{text}`{hint}"));
        }
    }
    let mut seen = BTreeSet::new();
    found.retain(|one| seen.insert(core::ptr::from_ref(*one)));
    Ok(found)
}

/// Returns, for each variable in `chosen`, the shortest of its names that no other variable in `all` has.
pub fn labels<T: VariableName>(all: &[T], chosen: &[&T]) -> Vec<String> {
    let mut counts = BTreeMap::new();
    for name in all.iter().flat_map(VariableName::names) {
        *counts.entry(name).or_insert(0) += 1;
    }
    let label = |one: &&T| {
        let [name, on_processor, in_loop] = one.names();
        let unique = [name, on_processor].into_iter();
        let mut unique = unique.filter(|name| counts.get(name) == Some(&1));
        unique.next().unwrap_or(in_loop)
    };
    chosen.iter().map(label).collect()
}

/// Returns a phrase for an error, with the names in `all` that are most similar to `name`, five at most; `None` if
/// `all` is empty.
pub fn nearest<'n, T: VariableName + 'n>(
    name: &str,
    all: impl IntoIterator<Item = &'n T>,
) -> Option<String> {
    let names: BTreeSet<&str> = (all.into_iter())
        .map(|one| {
            let [.., name] = one.parts();
            name
        })
        .collect();
    let mut scored: Vec<(f64, &str)> = names
        .into_iter()
        .map(|other| (strsim::jaro_winkler(name, other), other))
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let count = scored.len();
    let names: Vec<&str> = scored.iter().take(SUGGESTIONS).map(|it| it.1).collect();
    let text = format!("of {count}, the most similar are {}", names.join(", "));
    (!names.is_empty()).then_some(text)
}

/// Parses a number as a 32-bit word: decimal, or hexadecimal after `0x`. If the number begins with `-`, the word is its
/// two's complement, and the number must be at least -2³¹.
///
/// # Errors
/// Returns an error if `text` is not such a number; the error names `text` and the range.
pub fn word(text: &str) -> Result<u32, String> {
    let number = whole(text);
    let signed = || number.and_then(|number| i32::try_from(number).ok());
    let word = number.and_then(|number| u32::try_from(number).ok());
    word.or_else(|| signed().map(i32::cast_unsigned))
        .ok_or_else(|| {
            format!(
                "`{text}` is not a number from {} to {}, or from -0x80000000 to {:#x}",
                i32::MIN,
                u32::MAX,
                u32::MAX
            )
        })
}

/// Parses a whole number: decimal, or hexadecimal after `0x`. There may be `_` between its digits. Returns `None` if
/// `text` is not a whole number, or if its magnitude needs more than 64 bits.
#[must_use]
pub fn whole(text: &str) -> Option<i128> {
    let digits = text.replace('_', "");
    let (sign, digits) = match digits.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, digits.strip_prefix('+').unwrap_or(&digits)),
    };
    let hexadecimal = digits
        .strip_prefix("0x")
        .or_else(|| digits.strip_prefix("0X"));
    let (digits, radix) = hexadecimal.map_or((digits, 10), |digits| (digits, 16));
    // A second sign is refused.
    let begins = digits.starts_with(|it: char| it.is_ascii_hexdigit());
    let number = u64::from_str_radix(digits, radix).ok().filter(|_| begins)?;
    Some(sign * i128::from(number))
}

#[cfg(test)]
mod tests {
    use super::{VariableName, find, labels, matching, nearest, word};

    struct One([&'static str; 3]);

    impl VariableName for One {
        fn parts(&self) -> [&str; 3] {
            self.0
        }
    }

    fn all() -> [One; 4] {
        [
            ("a", "servo", "kp"),
            ("a", "slow", "kp"),
            ("b", "servo", "kp"),
            ("b", "servo", "thumb.kv"),
        ]
        .map(|(processor, owner, name)| One([processor, owner, name]))
    }

    #[test]
    fn the_most_similar_names_come_first() {
        let text = nearest("thumb.kw", &all());
        assert_eq!(
            text.as_deref(),
            Some("of 2, the most similar are thumb.kv, kp")
        );
    }

    #[test]
    fn a_name_stands_for_one_variable() {
        let all = all();
        let found = find(&all, "b:kp", "").map(|one| one.names()[2].clone());
        assert_eq!(found.as_deref(), Ok("b:servo:kp"));
        let error = find(&all, "a:kp", "").map(|_| ()).unwrap_err();
        assert!(error.ends_with("write a:servo:kp or a:slow:kp"), "{error}");
        let error = find(&all, "kv", "; hint").map(|_| ()).unwrap_err();
        assert!(error.ends_with("kp, thumb.kv; hint"), "{error}");
    }

    #[test]
    fn a_variable_is_called_by_its_names_alone() {
        let one = One(["a", "servo", "kp"]);
        assert!(one.names().iter().all(|name| one.is_called(name)));
        for other in [
            "",
            "p",
            "xkp",
            ":kp",
            "servo:kp",
            "as:kp",
            "a:serv:kp",
            "aservo:kp",
            "a::kp",
        ] {
            assert!(!one.is_called(other), "{other}");
        }
    }

    #[test]
    fn a_pattern_stands_for_each_once() {
        let all = all();
        let patterns = ["thumb.kv", "b:*", "a:s?ow:*"].map(String::from);
        let found = matching(&all, &patterns, "").unwrap();
        let labels = labels(&all, &found);
        assert_eq!(labels, ["thumb.kv", "b:kp", "a:slow:kp"]);
        let patterns = ["x*".to_owned()];
        let error = matching(&all, &patterns, "; hint").map(|_| ()).unwrap_err();
        assert_eq!(error, "no variable or parameter matches `x*`; hint");
    }

    #[test]
    fn words_are_decimal_or_hexadecimal() {
        assert_eq!(word("42"), Ok(42));
        assert_eq!(word("+42"), Ok(42));
        assert_eq!(word("0xdead_beef"), Ok(0xdead_beef));
        assert_eq!(word("-300"), Ok((-300_i32).cast_unsigned()));
        assert_eq!(word("-0x12c"), Ok((-300_i32).cast_unsigned()));
        assert_eq!(word("-2147483648"), Ok(0x8000_0000));
        for wrong in [
            "",
            "0x",
            "-",
            "--1",
            "-+1",
            "0x+1",
            "-2147483649",
            "4294967296",
            "0x1_0000_0000",
            "ten",
        ] {
            let text = word(wrong).unwrap_err();
            assert!(text.contains("4294967295"), "{text}");
        }
    }
}
