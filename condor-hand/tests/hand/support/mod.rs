//! The hand of `tests/reference/geometry.json`, and the results of other programs beside it.

#![allow(dead_code, reason = "each test takes what it needs")]

pub(crate) mod arms;

use std::path::Path;

use condor_hand::Pose;
use condor_hand::kinematics::{Chain, ChainBody, ChainJoint, ChainMotion, PlanarFinger, Rod};
use condor_hand::math::max;
use condor_hand::transmission::{EffortLimits, Linear};
use nalgebra::{Matrix3, SVector, Vector3};
use proptest::test_runner::Config as ProptestConfig;
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// Fingers of the hand, and joints of each.
pub(crate) const FINGERS: usize = 4;

/// The numbers of the hand; the four fingers differ in their bases only.
#[derive(Deserialize)]
pub(crate) struct Geometry {
    /// Lower limits of the joints, rad.
    pub(crate) qmin: [f64; 4],
    /// Upper limits of the joints, rad.
    pub(crate) qmax: [f64; 4],
    /// m/s², in the axes of the palm.
    pub(crate) gravity: [f64; 3],
    /// The least tension, N.
    pub(crate) fmin: f64,
    /// The largest tension, N.
    pub(crate) fmax: f64,
    l: [f64; 4],
    base: [Base; FINGERS],
    mass: [f64; 4],
    com: [[f64; 3]; 4],
    inertia_about_com: [[[f64; 3]; 3]; 4],
    axes: [[f64; 3]; 4],
    offsets: [[f64; 3]; 4],
    tip: [f64; 3],
    #[serde(rename = "P_sym")]
    symmetric: [[f64; 8]; 4],
    #[serde(rename = "P_asym")]
    asymmetric: [[f64; 8]; 4],
}

#[derive(Deserialize)]
struct Base {
    #[serde(rename = "R")]
    rotation: [[f64; 3]; 3],
    p: [f64; 3],
}

/// How proptest runs: a failure prints its input, and leaves no file.
pub(crate) fn runs() -> ProptestConfig {
    ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// A file of `tests/reference`, by name.
pub(crate) fn reference<T: DeserializeOwned>(name: &str) -> T {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference");
    let text = std::fs::read_to_string(path.join(name)).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// The largest difference of two lists of efforts, N or N m.
pub(crate) fn largest_step<const A: usize>(a: &[f64; A], b: &[f64; A]) -> f64 {
    let steps = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    steps.fold(0.0, max)
}

/// The numbers of the hand.
pub(crate) fn geometry() -> Geometry {
    reference("geometry.json")
}

/// The joints of one finger in a list of all joints of the hand.
pub(crate) fn joints(all: &[f64], finger: usize) -> SVector<f64, 4> {
    SVector::from_column_slice(&all[4 * finger..4 * finger + 4])
}

/// A vector from its three numbers.
pub(crate) fn vector(v: [f64; 3]) -> Vector3<f64> {
    Vector3::from(v)
}

/// A matrix from its rows.
pub(crate) fn matrix(rows: [[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| rows[row][column])
}

impl Geometry {
    /// One finger in closed form.
    pub(crate) fn finger(&self, finger: usize) -> PlanarFinger {
        PlanarFinger::new(
            self.base(finger),
            self.l,
            std::array::from_fn(|link| Rod {
                mass: self.mass[link],
                center: self.com[link][0],
                inertia: matrix(self.inertia_about_com[link]).diagonal(),
            }),
        )
        .unwrap()
    }

    /// The same finger as a chain, from the axes and offsets of the file alone.
    pub(crate) fn chain(&self, finger: usize) -> Chain<4> {
        Chain::new(
            self.base(finger),
            std::array::from_fn(|joint| {
                ChainJoint::new(
                    Pose {
                        rotation: Matrix3::identity(),
                        position: vector(self.offsets[joint]),
                    },
                    ChainMotion::Revolute(vector(self.axes[joint])),
                )
            }),
            std::array::from_fn(|link| ChainBody {
                mass: self.mass[link],
                center: vector(self.com[link]),
                inertia: matrix(self.inertia_about_com[link]),
            }),
            vector(self.tip),
        )
        .unwrap()
    }

    /// Tendons whose antagonists cross the proximal joints oppositely: flexor and extensor of each joint in turn.
    pub(crate) fn symmetric_tendons(&self) -> Linear<4, 8> {
        tendons(&self.symmetric)
    }

    /// Tendons with which co-contraction loads the proximal joints.
    pub(crate) fn asymmetric_tendons(&self) -> Linear<4, 8> {
        tendons(&self.asymmetric)
    }

    fn base(&self, finger: usize) -> Pose {
        let Base { rotation, p } = &self.base[finger];
        Pose {
            rotation: matrix(*rotation),
            position: vector(*p),
        }
    }
}

/// The file has a row for each joint, and a transmission a row for each actuator.
fn tendons(rows: &[[f64; 8]; 4]) -> Linear<4, 8> {
    let arms = std::array::from_fn(|actuator| rows.map(|row| row[actuator]));
    let limits = EffortLimits {
        low: 4.0,
        high: 130.0,
        bias: 7.0,
    };
    Linear::new(arms, [limits; 8]).unwrap()
}
