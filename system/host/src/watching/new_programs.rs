//! [`NewPrograms`]: loops and cells of programs that come later.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use wildmatch::WildMatch;

use super::catalog::{CatalogEntry, VariableCatalog};
use crate::control::Member;
use crate::names::VariableName;
use crate::view::{MailboxState, View};

/// The time between two looks.
const LOOK: Duration = Duration::from_millis(500);

/// A finder of the variables of programs that are loaded or started while the system is already watched.
pub struct NewPrograms {
    members: Vec<Arc<Member>>,
    /// Patterns of the wanted variables; none if all are wanted.
    patterns: Vec<WildMatch>,
    wants_all: bool,
    /// The loops and cells that were found, each with the number of its processor.
    seen: BTreeSet<(u8, Arc<str>)>,
    looked: Instant,
}

impl NewPrograms {
    /// Makes a finder of the variables of loops and cells that are not in `known`. `members` are the processors to look
    /// at. The finder wants the variables that match a text in `patterns` with `*` or `?`; if `patterns` is empty, it
    /// wants all.
    #[must_use]
    pub fn after(known: &VariableCatalog, members: &[Member], patterns: &[String]) -> Self {
        let open = patterns.iter().filter(|text| text.contains(['*', '?']));
        Self {
            members: members.iter().cloned().map(Arc::new).collect(),
            patterns: open.map(|text| WildMatch::new(text)).collect(),
            wants_all: patterns.is_empty(),
            seen: places(&known.all).collect(),
            looked: Instant::now(),
        }
    }

    /// Returns the wanted variables of the loops and cells that are new since the last call. It looks at the processors
    /// every 500 ms; a call in between returns nothing. A table that cannot be read yet is tried again.
    pub fn look(&mut self, view: &View) -> Vec<CatalogEntry> {
        if self.looked.elapsed() < LOOK {
            return Vec::new();
        }
        self.looked = Instant::now();
        let mut known = VariableCatalog::default();
        for member in &self.members {
            let heart = view.heart(member.processor());
            if heart.is_ok_and(|heart| heart.presence == MailboxState::Up) {
                let is_new = |owner: &str| !self.seen.contains(&(member.number, owner.into()));
                // A program that begins just now is complete at the next look.
                let _ = known.add(view, member, is_new);
            }
        }
        self.seen.extend(places(&known.all));
        known.all.retain(|one| {
            let is_wanted = |pattern: &WildMatch| one.names().iter().any(|it| pattern.matches(it));
            self.wants_all || self.patterns.iter().any(is_wanted)
        });
        known.all
    }
}

/// Iterates over the loops and cells of variables, each with the number of its processor.
fn places(all: &[CatalogEntry]) -> impl Iterator<Item = (u8, Arc<str>)> {
    all.iter().map(|one| (one.member.number, one.owner.clone()))
}
