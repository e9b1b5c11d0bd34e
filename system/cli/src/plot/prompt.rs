//! The texts that are typed into a [`Plot`]: names, and the condition of the trigger.

use tui_input::Input;

use super::model::{Plot, Prompt};

impl Plot {
    /// Returns the names that contain the word that is being typed; none without a word.
    pub(crate) fn fitting(&self) -> Vec<&str> {
        let before = self.before_cursor();
        let word = word(&before);
        let names = self.known.iter().map(String::as_str);
        let fits = |name: &&str| !word.is_empty() && name.contains(word) && *name != word;
        names.filter(fits).collect()
    }

    /// Completes the word that is being typed as far as all names that begin with it agree; if none
    /// does, with the only name that contains it.
    pub(crate) fn complete(&mut self) {
        let typed = self.before_cursor();
        let word = word(&typed);
        let fitting = self.fitting();
        let begun = fitting.iter().filter(|name| name.starts_with(word));
        let common = begun.copied().reduce(|common, name| {
            let same = common.char_indices().zip(name.chars());
            let end = same.take_while(|((_, a), b)| a == b).last();
            let end = end.map_or(0, |((at, letter), _)| at + letter.len_utf8());
            common.get(..end).unwrap_or_default()
        });
        let only = match fitting.as_slice() {
            [only] => Some(*only),
            _ => None,
        };
        if let Some(whole) = common.or(only).map(str::to_owned) {
            let before = typed.strip_suffix(word).unwrap_or_default();
            let behind = self.typed.value().chars().skip(self.typed.cursor());
            let behind: String = behind.collect();
            let cursor = before.chars().count() + whole.chars().count();
            let typed = Input::new(format!("{before}{whole}{behind}"));
            self.typed = typed.with_cursor(cursor);
        }
    }

    /// Returns the text before the cursor.
    fn before_cursor(&self) -> String {
        let letters = self.typed.value().chars();
        letters.take(self.typed.cursor()).collect()
    }

    /// Does what was typed.
    pub(crate) fn take_typed(&mut self, prompt: Prompt) -> Result<(), String> {
        let typed = core::mem::take(&mut self.typed);
        let names = typed.value().split_whitespace();
        let names: Vec<String> = names.map(String::from).collect();
        match prompt {
            Prompt::Names => {
                if let Some(pane) = self.panes.get_mut(self.focus) {
                    pane.names = names;
                    pane.curves.clear();
                }
            }
            Prompt::NewPane => self.add_pane(names),
            Prompt::Trigger if names.is_empty() => self.arm(None),
            Prompt::Trigger => match typed.value().parse() {
                Ok(condition) => self.arm(Some(condition)),
                Err(error) => {
                    self.typed = typed;
                    return Err(error);
                }
            },
            Prompt::Help => {}
        }
        Ok(())
    }
}

/// The word at the end of a text.
fn word(text: &str) -> &str {
    text.rsplit(char::is_whitespace).next().unwrap_or_default()
}
