//! [`Known`]: all names that there are.

use condor_hand::monitor::Variable;

use crate::cli::AnyError;
use crate::commands::running;
use crate::control::Member;
use crate::plain::plain;
use crate::view::View;
use crate::view::gains::Gain;

/// How many names are suggested.
const SUGGESTIONS: usize = 5;

/// A name of a processor.
pub(super) struct One<'s> {
    pub(super) member: &'s Member,
    pub(super) what: What,
}

/// What it stands for.
pub(super) enum What {
    /// A variable of its monitor, and its number there.
    Variable(usize, Variable),
    /// A gain, and its value.
    Gain(Gain, f64),
}

impl What {
    pub(super) fn name(&self) -> &str {
        match self {
            Self::Variable(_, variable) => &variable.name,
            Self::Gain(gain, _) => &gain.name,
        }
    }

    pub(super) fn unit(&self) -> &str {
        match self {
            Self::Variable(_, variable) => &variable.unit,
            Self::Gain(gain, _) => gain.unit,
        }
    }
}

/// The variables and gains of some processors.
pub(super) struct Known<'s> {
    pub(super) all: Vec<One<'s>>,
    /// What could not be asked.
    troubles: Vec<String>,
}

impl<'s> Known<'s> {
    /// Those of processors of a system; one that does not answer hides no other.
    pub(super) fn all(view: &View, members: &[&'s Member]) -> Result<Self, AnyError> {
        let mut known = Self {
            all: Vec::new(),
            troubles: Vec::new(),
        };
        for &member in members {
            if let Err(error) = known.add(view, member) {
                known.troubles.push(format!("{}: {error}", member.name));
            }
        }
        if known.all.is_empty() {
            let whose = match members {
                [only] => only.name.as_str(),
                _ => "the system",
            };
            let troubles = match known.troubles.as_slice() {
                [] => "there are neither monitors nor servos".into(),
                troubles => troubles.join("; "),
            };
            return Err(format!("{whose} has no variables: {troubles}").into());
        }
        Ok(known)
    }

    fn add(&mut self, view: &View, member: &'s Member) -> Result<(), AnyError> {
        let number = running::number(member);
        if let Some(monitor) = view.monitor(number)? {
            let variables = monitor.variables()?.into_iter();
            self.all.extend(variables.map(|(number, variable)| One {
                member,
                what: What::Variable(number, variable),
            }));
        }
        if let Some(mut servos) = view.servos(number)? {
            self.all
                .extend(servos.all()?.into_iter().map(|(gain, value)| One {
                    member,
                    what: What::Gain(gain, value),
                }));
        }
        Ok(())
    }

    pub(super) fn tell_troubles(&self) {
        for trouble in &self.troubles {
            eprintln!("condor: {}", plain(trouble));
        }
    }

    /// What a name stands for; names that two processors have begin with theirs and a colon.
    pub(super) fn find(&self, name: &str) -> Result<&One<'s>, String> {
        let (processor, own) = match name.split_once(':') {
            Some((processor, own)) => (Some(processor), own),
            None => (None, name),
        };
        let mut found = self.all.iter().filter(|one| {
            one.what.name() == own && processor.is_none_or(|wanted| one.member.name == wanted)
        });
        match (found.next(), found.next()) {
            (Some(one), None) => Ok(one),
            (Some(one), Some(other)) => Err(format!(
                "`{name}` is on several processors: write {}:{own} or {}:{own}",
                one.member.name, other.member.name
            )),
            (None, _) => Err(self.unknown(own)),
        }
    }

    fn unknown(&self, name: &str) -> String {
        let troubles = self.troubles.join("; ");
        let troubles = if troubles.is_empty() {
            troubles
        } else {
            format!("; {troubles}")
        };
        format!(
            "there is no variable or gain `{name}`; {}{troubles}",
            nearest(name, self.all.iter().map(|one| one.what.name()))
        )
    }

    /// The gains that may have been meant.
    pub(super) fn gains_like(&self, name: &str) -> String {
        let gains = self.all.iter().filter_map(|one| match &one.what {
            What::Gain(gain, _) => Some(gain.name.as_str()),
            What::Variable(..) => None,
        });
        nearest(name, gains)
    }
}

/// The names that are most like one.
fn nearest<'n>(name: &str, names: impl Iterator<Item = &'n str>) -> String {
    let mut scored: Vec<(f64, &str)> = names
        .map(|other| (strsim::jaro_winkler(name, other), other))
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let count = scored.len();
    let names: Vec<&str> = scored.iter().take(SUGGESTIONS).map(|it| it.1).collect();
    match names.as_slice() {
        [] => "there is none that can be set".into(),
        names => format!(
            "of {count}, the most similar are {}; `vars list` shows all",
            names.join(", ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn the_most_similar_names_come_first() {
        let names = ["thumb.base.kp", "index.proximal.kp", "index.proximal.kv"];
        let text = nearest("index.proximl.kp", names.into_iter());
        assert!(
            text.starts_with("of 3, the most similar are index.proximal.kp,"),
            "{text}"
        );
    }
}
