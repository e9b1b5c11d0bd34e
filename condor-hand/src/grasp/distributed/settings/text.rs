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

use std::format;
use std::string::String;
use std::vec::Vec;

use condor_toml::{Misreading, SourceText, Spanned, TextError};
use serde::Deserialize;

use super::{GraspAxes, GraspSettings};
use crate::decimal::Decimal;
use crate::grasp::SpatialGain;
use crate::grasp::distributed::order::by_columns;

/// The time of a damping that is not written, s.
const DAMPING_S: f64 = 0.02;

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

/// Gains as people write them.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "gains must be six numbers, the diagonal of a matrix, or six rows of six numbers; a damping may be a \
                 time in s, too"
)]
enum Gains {
    /// The factor of others.
    Time(f64),
    Diagonal(Vec<f64>),
    Rows(Vec<Vec<f64>>),
}

impl File {
    fn settings(&self) -> Result<GraspSettings, Misreading> {
        let stiffness = matrix(&self.stiffness)?;
        let scaled = |factor: f64| stiffness.map(|row| row.map(|gain| gain * factor));
        let damping = match &self.damping {
            None => scaled(DAMPING_S),
            Some(damping) => match damping.get_ref() {
                Gains::Time(time) if time.is_finite() && *time >= 0.0 => scaled(*time),
                Gains::Time(time) => {
                    let time = Decimal(*time);
                    let problem =
                        format!("the time of the damping is {time} s; it must be at least 0");
                    return Err(Misreading::at(&damping.span(), problem));
                }
                _ => matrix(damping)?,
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

/// The matrix, which a gain of an object can be.
fn matrix(gains: &Spanned<Gains>) -> Result<[[f64; 6]; 6], Misreading> {
    let wrong = |problem: String| Misreading::at(&gains.span(), problem);
    let six = |numbers: &[f64], what: &str| {
        <[f64; 6]>::try_from(numbers).map_err(|_| {
            let count = numbers.len();
            wrong(format!("{what} has {count} numbers; it must have 6"))
        })
    };
    let mut matrix = [[0.0; 6]; 6];
    match gains.get_ref() {
        Gains::Time(_) => {
            let problem = "a number stands where a matrix of six rows, or its diagonal, should be";
            return Err(wrong(problem.into()));
        }
        Gains::Diagonal(diagonal) => {
            let diagonal = six(diagonal, "the diagonal")?;
            for (place, (row, gain)) in matrix.iter_mut().zip(diagonal).enumerate() {
                row.iter_mut()
                    .skip(place)
                    .take(1)
                    .for_each(|entry| *entry = gain);
            }
        }
        Gains::Rows(rows) if rows.len() != 6 => {
            let count = rows.len();
            return Err(wrong(format!(
                "the matrix has {count} rows; it must have 6"
            )));
        }
        Gains::Rows(rows) => {
            for (number, (place, row)) in (1..).zip(matrix.iter_mut().zip(rows)) {
                *place = six(row, &format!("row {number}"))?;
            }
        }
    }
    match SpatialGain::new(&by_columns(&matrix)) {
        Ok(_) => Ok(matrix),
        Err(error) => Err(Misreading::at(&gains.span(), error)),
    }
}
