//! [`Trigger`]: an instant at which a variable passes a level.

use core::fmt;
use core::str::FromStr;

/// The direction in which a level is passed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Edge {
    Rising,
    Falling,
}

/// The condition of a trigger: `NAME>LEVEL` for a rising edge, `NAME<LEVEL` for a falling one; `~WIDTH` after
/// it is the hysteresis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Condition {
    pub(crate) name: String,
    pub(crate) edge: Edge,
    pub(crate) level: f64,
    /// The distance that the variable must have been beyond the level, on its other side.
    pub(crate) hysteresis: f64,
}

impl FromStr for Condition {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "`{text}` is not a trigger such as `joint.position>0.5` or, \
                 with hysteresis, `joint.position<0.5~0.01`"
            )
        };
        let at = text.find(['>', '<']).ok_or_else(wrong)?;
        let (name, rest) = text.split_at(at);
        let edge = if rest.starts_with('>') {
            Edge::Rising
        } else {
            Edge::Falling
        };
        let rest = rest.get(1..).unwrap_or_default();
        let (level, width) = rest.split_once('~').unwrap_or((rest, "0"));
        let number = |text: &str| {
            let number: Option<f64> = text.trim().parse().ok();
            number.filter(|it| it.is_finite()).ok_or_else(wrong)
        };
        let (name, level, hysteresis) = (name.trim(), number(level)?, number(width)?);
        if name.is_empty() || hysteresis < 0.0 {
            return Err(wrong());
        }
        Ok(Self {
            name: name.into(),
            edge,
            level,
            hysteresis,
        })
    }
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = match self.edge {
            Edge::Rising => '>',
            Edge::Falling => '<',
        };
        write!(f, "{}{sign}{}", self.name, self.level)?;
        if self.hysteresis > 0.0 {
            write!(f, "~{}", self.hysteresis)?;
        }
        Ok(())
    }
}

/// Looks for the instants at which a condition comes true.
#[derive(Clone, Debug)]
pub(crate) struct Trigger {
    pub(crate) condition: Condition,
    /// Whether the variable has been on the other side since the last time.
    is_armed: bool,
}

impl Trigger {
    pub(crate) const fn new(condition: Condition) -> Self {
        Self {
            condition,
            is_armed: false,
        }
    }

    /// Takes the next value, and returns true if it is the first one beyond the level. What is not
    /// finite, as after lost rows, disarms: nobody knows when the level was passed.
    pub(crate) fn fires(&mut self, value: f64) -> bool {
        let Condition {
            edge,
            level,
            hysteresis,
            ..
        } = self.condition;
        let (beyond, width) = match edge {
            Edge::Rising => (value - level, hysteresis),
            Edge::Falling => (level - value, hysteresis),
        };
        if !beyond.is_finite() {
            self.is_armed = false;
            return false;
        }
        let fires = self.is_armed && beyond > 0.0;
        if fires {
            self.is_armed = false;
        } else if beyond <= -width {
            self.is_armed = true;
        }
        fires
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn fired(condition: &str, values: &[f64]) -> Vec<usize> {
        let mut trigger = Trigger::new(condition.parse().unwrap());
        let fired = values.iter().enumerate();
        let fired = fired.filter(|(_, value)| trigger.fires(**value));
        fired.map(|(place, _)| place).collect()
    }

    #[test]
    fn conditions_are_read_as_they_are_written() {
        for text in [
            "index.proximal.position>0.5",
            "a:servo:mode<-2~0.25",
            "x>1000",
        ] {
            let condition: Condition = text.parse().unwrap();
            assert_eq!(condition.to_string(), text);
        }
        for wrong in ["", "x", ">1", "x>", "x>NaN", "x>1~-1", "x>1~", "x=1"] {
            let error = wrong.parse::<Condition>().unwrap_err();
            assert!(error.starts_with(&format!("`{wrong}` is not")), "{error}");
        }
    }

    #[test]
    fn an_edge_fires_once() {
        let values = [2.0, 0.0, 1.0, 2.0, 3.0, 0.5, 2.0];
        assert_eq!(fired("x>1", &values), [3, 6]);
        assert_eq!(fired("x<1", &values), [1, 5]);
    }

    #[test]
    fn noise_within_the_hysteresis_fires_no_second_time() {
        let values = [0.0, 1.1, 0.9, 1.1, 0.5, 1.1];
        assert_eq!(fired("x>1", &values), [1, 3, 5]);
        assert_eq!(fired("x>1~0.5", &values), [1, 5]);
    }

    #[test]
    fn nothing_fires_across_a_gap() {
        assert_eq!(fired("x>1", &[0.0, f64::NAN, 2.0, 0.0, 2.0]), [4]);
    }

    proptest! {
        /// The reference looks back over all values for each one.
        #[test]
        fn it_fires_where_a_look_at_all_values_says(
            values in proptest::collection::vec(
                prop_oneof![9 => (-8..8_i8).prop_map(f64::from), 1 => Just(f64::NAN)], 0..200),
            level in -4..4_i8,
            width in 0..4_i8,
        ) {
            let (level, width) = (f64::from(level), f64::from(width));
            let expected: Vec<usize> = (0..values.len()).filter(|&place| {
                let known = values[..place].iter().rposition(|it| it.is_nan());
                let before = &values[known.map_or(0, |gap| gap + 1)..place];
                // Since it was last low enough, it has not been beyond the level.
                let low = before.iter().rposition(|it| *it <= level - width);
                let since = low.map(|low| &before[low..]);
                values[place] > level && since.is_some_and(|it| it.iter().all(|it| *it <= level))
            }).collect();
            prop_assert_eq!(fired(&format!("x>{level}~{width}"), &values), expected);
        }
    }
}
