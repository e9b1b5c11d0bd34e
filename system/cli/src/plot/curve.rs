//! Curves and panes: what is drawn, and where.

use serde::{Deserialize, Serialize};

use super::history::History;
use condor_host::names::VariableName;

/// A value of a curve at an instant of the host's clock. A value that is not finite is a gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    pub(crate) curve: usize,
    pub(crate) at_ns: u64,
    pub(crate) value: f64,
}

/// A variable that is plotted.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Variable {
    pub(crate) processor: String,
    /// The name of its loop or cell.
    pub(crate) owner: String,
    pub(crate) name: String,
    pub(crate) unit: String,
    /// The labels of its values, if it is a choice.
    pub(crate) labels: Vec<String>,
}

impl VariableName for Variable {
    fn parts(&self) -> [&str; 3] {
        [&self.processor, &self.owner, &self.name]
    }
}

/// A variable with its values.
#[derive(Clone, Debug)]
pub(crate) struct Curve {
    pub(crate) variable: Variable,
    pub(crate) history: History,
}

/// The part of the range of values that a pane shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Range {
    /// All values that are seen.
    Auto,
    /// From the first value to the second.
    Fixed(f64, f64),
}

/// Curves on one axis of values.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Pane {
    /// The names and patterns that were asked for.
    pub(crate) names: Vec<String>,
    #[serde(skip)]
    pub(crate) curves: Vec<usize>,
    pub(crate) range: Range,
}

impl Pane {
    pub(crate) const fn new(names: Vec<String>) -> Self {
        Self {
            names,
            curves: Vec::new(),
            range: Range::Auto,
        }
    }
}

/// The names of the variables to fetch.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Wish {
    /// For each pane its names, or patterns with `*` and `?`.
    pub(crate) panes: Vec<Vec<String>>,
    /// Names of what is needed besides; one that is not there is left out.
    pub(crate) besides: Vec<String>,
}

/// The curves that a [`Wish`] names.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ChosenCurves {
    /// All curves; samples have places in this list.
    pub(crate) variables: Vec<Variable>,
    /// The curves of each pane.
    pub(crate) panes: Vec<Vec<usize>>,
    /// All names that there are.
    pub(crate) known: Vec<String>,
}
