//! [`Choice`]: the variables that a wish names.

use std::collections::BTreeSet;

use super::curve::{Chosen, Variable, Wish};
use super::news::News;
use crate::names::{self, Named};

/// The variables that a wish names, each once.
pub(super) struct Choice<'k, T> {
    pub(super) columns: Vec<&'k T>,
    pub(super) chosen: Chosen,
    /// Why some names stand for nothing.
    unknown: Vec<String>,
}

impl<'k, T: Named> Choice<'k, T> {
    /// Finds them among `all`; errors end with `hint`. `about` returns the unit of one, and the labels
    /// of its values.
    pub(super) fn of(
        all: &'k [T],
        wish: &Wish,
        hint: &str,
        about: impl Fn(&T) -> (String, Vec<String>),
    ) -> Self {
        let mut columns: Vec<&T> = Vec::new();
        let mut place = |one: &'k T| {
            let there = columns.iter().position(|it| core::ptr::eq(*it, one));
            there.unwrap_or_else(|| {
                columns.push(one);
                columns.len() - 1
            })
        };
        let (mut panes, mut unknown) = (Vec::new(), Vec::new());
        for names in &wish.panes {
            let mut curves: Vec<usize> = Vec::new();
            for name in names {
                match names::matching(all, core::slice::from_ref(name), hint) {
                    Ok(found) => curves.extend(found.into_iter().map(&mut place)),
                    Err(error) => unknown.push(error),
                }
            }
            let mut seen = BTreeSet::new();
            curves.retain(|curve| seen.insert(*curve));
            panes.push(curves);
        }
        for name in &wish.besides {
            if let Ok(one) = names::find(all, name, hint) {
                place(one);
            }
        }
        let variable = |one: &&T| {
            let [processor, owner, name] = one.parts().map(str::to_owned);
            let (unit, labels) = about(one);
            Variable {
                processor,
                owner,
                name,
                unit,
                labels,
            }
        };
        let every: Vec<&T> = all.iter().collect();
        Self {
            chosen: Chosen {
                variables: columns.iter().map(variable).collect(),
                panes,
                known: names::labels(all, &every),
            },
            columns,
            unknown,
        }
    }

    /// Returns why some names stand for nothing; `None` if there are no such names.
    pub(super) fn trouble(&self) -> Option<News> {
        (!self.unknown.is_empty()).then(|| News::Trouble(self.unknown.join("; ")))
    }
}
