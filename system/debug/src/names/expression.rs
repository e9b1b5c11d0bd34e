//! [`Expression`]: the name of a variable, and the way to a part of it.

use core::fmt;

/// An expression, such as `servo::SERVO.joints[2].gain`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Expression {
    pub(super) path: String,
    pub(super) steps: Vec<Step>,
}

/// A step to a part of a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Step {
    Field(String),
    Index(u64),
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Field(name) => write!(f, ".{name}"),
            Self::Index(index) => write!(f, "[{index}]"),
        }
    }
}

fn is_name(text: &str) -> bool {
    let mut letters = text.chars();
    !text.is_empty() && letters.all(|letter| letter.is_alphanumeric() || letter == '_')
}

impl Expression {
    pub(super) fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        let end = text.find(['.', '[']).unwrap_or(text.len());
        let (path, mut rest) = text.split_at(end);
        if !path.split("::").all(is_name) {
            return None;
        }
        let mut steps = Vec::new();
        while !rest.is_empty() {
            let (step, behind) = if let Some(inside) = rest.strip_prefix('[') {
                let (index, behind) = inside.split_once(']')?;
                (Step::Index(index.trim().parse().ok()?), behind)
            } else {
                let name = rest.strip_prefix('.')?;
                let end = name.find(['.', '[']).unwrap_or(name.len());
                let (name, behind) = name.split_at(end);
                if !is_name(name) {
                    return None;
                }
                (Step::Field(name.into()), behind)
            };
            steps.push(step);
            rest = behind;
        }
        Some(Self {
            path: path.into(),
            steps,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_path_has_fields_and_indices() {
        let parsed = Expression::parse("servo::SERVO.joints[2].0").expect("it is right");
        assert_eq!(parsed.path, "servo::SERVO");
        let steps = [
            Step::Field("joints".into()),
            Step::Index(2),
            Step::Field("0".into()),
        ];
        assert_eq!(parsed.steps, steps);
        for wrong in [
            "", ".a", "a.", "a..b", "a[", "a[]", "a[x]", "a b", "a[1]b", "a::",
        ] {
            assert_eq!(Expression::parse(wrong), None, "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_borne_and_what_is_read_is_printed_alike(text in ".{0,20}|[a.\\[\\]0:]{0,12}") {
            if let Some(parsed) = Expression::parse(&text) {
                let printed: String = parsed.steps.iter().map(Step::to_string).collect();
                let printed = parsed.path.clone() + &printed;
                prop_assert_eq!(Expression::parse(&printed), Some(parsed));
            }
        }
    }
}
