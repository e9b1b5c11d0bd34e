//! The settings of a grasp as TOML text, which people write.
//!
//! ```toml
//! # The stiffness of the object about its middle, along and about x, y, z: a matrix of
//! #   N/m      N/rad
//! #   N m/m    N m/rad
//! # or six numbers, its diagonal.
//! stiffness = [200.0, 250.0, 150.0, 0.1, 0.1, 0.1]
//! damping = 0.02              # s, times the stiffness; or a matrix, or its diagonal
//! axes = "palm"               # those of stiffness and damping: palm, object
//! mass_kg = 0.05              # of the object, whose weight the fingers bear
//! squeeze_n = 1.5             # between each pair of tips
//! posture_stiffness = 0.1     # N m/rad, along the self-motion of a finger
//! posture_damping = 0.002     # N m s/rad
//! friction = 0.5
//! ramp_s = 1.0
//! ```
//!
//! The stiffness is required. Without a damping it is 0.02 s times the stiffness, without a mass none;
//! the other numbers above are the defaults.

use core::fmt;
use core::marker::PhantomData;
use core::ops::Range;
use std::format;
use std::vec::Vec;

use condor_toml::{Misreading, SourceText, Spanned, TextError};
use serde::de::value::SeqAccessDeserializer;
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::{GraspAxes, GraspSettings};
use crate::decimal::Decimal;
use crate::grasp::distributed::order::by_columns;
use crate::grasp::{GraspError, SpatialGain};

/// The time of a damping that is not written, s.
const DAMPING_S: f64 = 0.02;
/// Rows and columns in words.
const AXES: [&str; 6] = [
    "along x", "along y", "along z", "about x", "about y", "about z",
];

impl GraspSettings {
    /// Reads the settings of a grasp from TOML text, and checks them.
    ///
    /// `file` is the name to show in error messages; no file is opened.
    ///
    /// # Errors
    /// [`TextError`] for the first mistake, with its place and the remedy.
    pub fn from_toml(text: &str, file: &str) -> Result<Self, TextError> {
        let text = SourceText::new(file, text);
        let file: File = text.read()?;
        file.settings().map_err(|fault| text.error(fault))
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    stiffness: Spanned<Gains>,
    damping: Option<Spanned<Gains>>,
    #[serde(default)]
    axes: GraspAxes,
    mass_kg: Option<Spanned<f64>>,
    squeeze_n: Option<Spanned<f64>>,
    posture_stiffness: Option<Spanned<f64>>,
    posture_damping: Option<Spanned<f64>>,
    friction: Option<Spanned<f64>>,
    ramp_s: Option<Spanned<f64>>,
}

/// A number of the settings.
type Place = fn(&mut GraspSettings) -> &mut f64;

/// A number, or a list of such.
enum NumberOr<T> {
    Number(f64),
    List(Vec<Spanned<T>>),
}

/// Gains as people write them: a factor of others, a diagonal, or the rows of a matrix.
type Gains = NumberOr<NumberOr<f64>>;

impl File {
    fn settings(&self) -> Result<GraspSettings, Misreading> {
        let stiffness = self.stiffness.get_ref().matrix(&self.stiffness.span())?;
        let scaled = |factor: f64| stiffness.map(|row| row.map(|gain| gain * factor));
        let damping = match &self.damping {
            None => scaled(DAMPING_S),
            Some(damping) => match damping.get_ref() {
                Gains::Number(time) => {
                    if !(time.is_finite() && *time >= 0.0) {
                        let problem = format!(
                            "the time of the damping is {} s; it must be at least 0",
                            Decimal(*time)
                        );
                        return Err(Misreading::at(&damping.span(), problem));
                    }
                    scaled(*time)
                }
                gains @ Gains::List(_) => gains.matrix(&damping.span())?,
            },
        };
        let usual = GraspSettings::diagonal([0.0; 6], [0.0; 6]);
        let mut settings = GraspSettings {
            stiffness,
            damping,
            axes: self.axes,
            ..usual
        };
        // One after another, so that a wrong one is known by its place.
        let keys: [(_, Place); 6] = [
            (&self.mass_kg, |it| &mut it.mass_kg),
            (&self.squeeze_n, |it| &mut it.squeeze_n),
            (&self.posture_stiffness, |it| &mut it.posture_stiffness),
            (&self.posture_damping, |it| &mut it.posture_damping),
            (&self.friction, |it| &mut it.friction),
            (&self.ramp_s, |it| &mut it.ramp_s),
        ];
        for (given, place) in keys {
            let Some(given) = given else {
                continue;
            };
            *place(&mut settings) = *given.get_ref();
            if let Err(error) = settings.check() {
                return Err(Misreading::at(&given.span(), error));
            }
        }
        Ok(settings)
    }
}

impl Gains {
    /// The matrix, which a gain of an object can be.
    fn matrix(&self, span: &Range<usize>) -> Result<[[f64; 6]; 6], Misreading> {
        let Self::List(list) = self else {
            let problem = "a number stands where a matrix of six rows, or its diagonal, should be";
            return Err(Misreading::at(span, problem));
        };
        let mut matrix = [[0.0; 6]; 6];
        let mut places = Vec::new();
        let many = |span: &Range<usize>, count: usize, what: &str| {
            let problem = format!("there are {count} {what} here; there must be 6");
            Err(Misreading::at(span, problem))
        };
        if list.len() != 6 {
            return many(span, list.len(), "numbers or rows");
        }
        let is_matrix = list
            .iter()
            .any(|entry| matches!(entry.get_ref(), NumberOr::List(_)));
        for (index, (row, entry)) in matrix.iter_mut().zip(list).enumerate() {
            match entry.get_ref() {
                NumberOr::Number(_) if is_matrix => {
                    let problem = "a number stands where a row of six numbers should be";
                    return Err(Misreading::at(&entry.span(), problem));
                }
                NumberOr::Number(number) => {
                    if let Some(place) = row.get_mut(index) {
                        *place = *number;
                    }
                    places.push(std::vec![entry.span(); 6]);
                }
                NumberOr::List(numbers) if numbers.len() != 6 => {
                    return many(&entry.span(), numbers.len(), "numbers");
                }
                NumberOr::List(numbers) => {
                    for (place, number) in row.iter_mut().zip(numbers) {
                        *place = *number.get_ref();
                    }
                    places.push(numbers.iter().map(Spanned::span).collect());
                }
            }
        }
        let place = |row: usize, column: usize| {
            let found = places.get(row).and_then(|row| row.get(column));
            found.cloned().unwrap_or_else(|| span.clone())
        };
        for (row, numbers) in matrix.iter().enumerate() {
            for (column, number) in numbers.iter().enumerate() {
                if !number.is_finite() {
                    let problem = format!("{} is no gain; it must be finite", Decimal(*number));
                    return Err(Misreading::at(&place(row, column), problem));
                }
            }
        }
        let Err(error) = SpatialGain::new(&by_columns(&matrix)) else {
            return Ok(matrix);
        };
        Err(match error {
            GraspError::NotSymmetric {
                row,
                column,
                value,
                mirrored,
            } => {
                // The lower one, which is written after the other.
                let (row, column, value, mirrored) = if row > column {
                    (row, column, value, mirrored)
                } else {
                    (column, row, mirrored, value)
                };
                let problem = format!(
                    "{} in row {}, column {} is not {} in row {}, column {}: \
                     the matrix must be symmetric",
                    Decimal(value),
                    row + 1,
                    column + 1,
                    Decimal(mirrored),
                    column + 1,
                    row + 1,
                );
                Misreading::at(&place(row, column), problem)
            }
            GraspError::NotSemidefinite { axis, pivot } => {
                let problem = format!(
                    "the matrix has a negative eigenvalue, which would push the object away: \
                     pivot {} {}",
                    Decimal(pivot),
                    AXES.get(axis).unwrap_or(&""),
                );
                Misreading::at(&place(axis, axis), problem)
            }
            other => Misreading::at(span, other),
        })
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for NumberOr<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Written<T>(PhantomData<T>);

        impl<'de, T: Deserialize<'de>> Visitor<'de> for Written<T> {
            type Value = NumberOr<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number or a list of six")
            }

            fn visit_f64<E>(self, number: f64) -> Result<NumberOr<T>, E> {
                Ok(NumberOr::Number(number))
            }

            #[allow(clippy::cast_precision_loss, reason = "no gain is that great")]
            fn visit_i64<E>(self, number: i64) -> Result<NumberOr<T>, E> {
                Ok(NumberOr::Number(number as f64))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<NumberOr<T>, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(list)).map(NumberOr::List)
            }
        }

        deserializer.deserialize_any(Written(PhantomData))
    }
}
