//! [`Choice`]: the variables that a wish names.

use std::collections::BTreeSet;

use super::curve::{ChosenCurves, Variable, Wish};
use super::feed_event::FeedEvent;
use condor_host::names::{self, VariableName};

/// The variables that a wish names, each once.
pub(super) struct Choice<'k, T> {
    pub(super) columns: Vec<&'k T>,
    pub(super) chosen: ChosenCurves,
    unknown: Vec<Unknown>,
}

/// A name that stands for nothing.
struct Unknown {
    /// The pane that has it.
    pane: usize,
    name: String,
    why: String,
}

impl<'k, T: VariableName> Choice<'k, T> {
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
        for (pane, names) in wish.panes.iter().enumerate() {
            let mut curves: Vec<usize> = Vec::new();
            for name in names {
                match names::matching(all, core::slice::from_ref(name), hint) {
                    Ok(found) => curves.extend(found.into_iter().map(&mut place)),
                    Err(why) => {
                        let name = name.clone();
                        unknown.push(Unknown { pane, name, why });
                    }
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
            chosen: ChosenCurves {
                variables: columns.iter().map(variable).collect(),
                panes,
                known: names::labels(all, &every),
            },
            columns,
            unknown,
        }
    }

    /// Asks `find` for what nothing is known of. What it finds becomes a curve behind those of the columns;
    /// with `None` the name stands for nothing, as before.
    pub(super) fn find_others(
        &mut self,
        mut find: impl FnMut(&str) -> Option<Result<Variable, String>>,
    ) {
        for mut unknown in core::mem::take(&mut self.unknown) {
            match find(&unknown.name) {
                Some(Ok(variable)) => {
                    let curve = self.chosen.variables.len();
                    self.chosen.variables.push(variable);
                    if let Some(pane) = self.chosen.panes.get_mut(unknown.pane) {
                        pane.push(curve);
                    }
                    continue;
                }
                Some(Err(why)) => {
                    unknown.why += " (among the program's static variables: ";
                    unknown.why += &why;
                    unknown.why.push(')');
                }
                None => {}
            }
            self.unknown.push(unknown);
        }
    }

    /// Returns why some names stand for nothing; `None` if there are no such names.
    pub(super) fn trouble(&self) -> Option<FeedEvent> {
        let whys: Vec<&str> = self.unknown.iter().map(|it| &*it.why).collect();
        (!whys.is_empty()).then(|| FeedEvent::Trouble(whys.join("; ")))
    }
}
