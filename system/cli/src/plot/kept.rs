//! [`PlotChoices`]: the part of a [`Plot`] that a person chooses, to be kept.

use serde::{Deserialize, Serialize};

use super::curve::{Pane, Range};
use super::model::{Plot, RobotPane, SPANS_NS};

/// The choices of a person for a plot.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlotChoices {
    panes: Vec<Pane>,
    span_ns: u64,
    robot: RobotPane,
    trigger: Option<String>,
}

impl Plot {
    /// Returns the choices.
    pub(crate) fn choices(&self) -> PlotChoices {
        PlotChoices {
            panes: self.panes.clone(),
            span_ns: self.span_ns,
            robot: self.place,
            trigger: self.trigger().map(|(condition, _)| condition.to_string()),
        }
    }

    /// Takes over the choices of another time.
    ///
    /// # Errors
    /// Returns the reason if they are none that a plot can have; the plot stays as it was.
    pub(crate) fn restore(&mut self, choices: PlotChoices) -> Result<(), String> {
        let [shortest, longest] = SPANS_NS;
        let is_range = |pane: &Pane| !matches!(pane.range, Range::Fixed(low, high) if low >= high);
        let is_possible = (shortest..=longest).contains(&choices.span_ns)
            && !choices.panes.is_empty()
            && choices.panes.iter().all(is_range);
        if !is_possible {
            return Err("the plots in it have impossible ranges".into());
        }
        let trigger = choices.trigger.map(|text| text.parse()).transpose()?;
        (self.panes, self.span_ns) = (choices.panes, choices.span_ns);
        if self.figure.is_some() {
            self.place = choices.robot;
        }
        self.arm(trigger);
        Ok(())
    }
}
