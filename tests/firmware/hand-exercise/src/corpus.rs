//! The input of the corpus.

use condor_hand::plant::Noise;
use nalgebra::SVector;

/// Finite numbers: zeros, subnormals, tiny and ordinary ones, whole turns, and large ones.
pub(crate) const FINITE: [f64; 24] = [
    0.0,
    -0.0,
    5e-324,
    -5e-324,
    1e-310,
    1e-40,
    -1e-40,
    1e-8,
    -1e-8,
    0.1,
    -0.3,
    0.5,
    -0.75,
    1.0,
    -1.0,
    core::f64::consts::FRAC_PI_2,
    -core::f64::consts::FRAC_PI_2,
    core::f64::consts::PI,
    -core::f64::consts::PI,
    7.25,
    -25.0,
    1000.0,
    -1e6,
    1e15,
];

/// Numbers that a broken sensor or a careless user may send besides.
pub(crate) const HOSTILE: [f64; 5] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
];

/// Returns all numbers, finite and hostile ones.
pub(crate) fn any() -> impl Iterator<Item = f64> {
    FINITE.into_iter().chain(HOSTILE)
}

/// Numbers of no pattern between two bounds.
pub(crate) struct Between {
    noise: Noise,
}

impl Between {
    pub(crate) fn seeded(seed: u64) -> Self {
        let noise = Noise::new(seed);
        Self { noise }
    }

    pub(crate) fn one(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.noise.uniform()
    }

    pub(crate) fn vector<const N: usize>(&mut self, low: f64, high: f64) -> SVector<f64, N> {
        SVector::from_fn(|_, _| self.one(low, high))
    }
}

const HALF_TURN: f64 = core::f64::consts::PI;

/// Returns postures: straight and folded ones, which are singular; each of [`FINITE`] at all joints and at
/// one; and many of no pattern.
pub(crate) fn postures() -> impl Iterator<Item = SVector<f64, 4>> {
    let singular = [
        [0.0, 0.0, 0.0, 0.0],
        [0.3, -0.0, 0.0, -0.0],
        [0.0, HALF_TURN, 0.0, 0.0],
        [0.0, 0.5, HALF_TURN, 0.0],
        [0.0, 0.5, 0.0, HALF_TURN],
        [-0.2, 1.2, HALF_TURN, HALF_TURN],
        [0.0, -HALF_TURN / 2.0, 0.0, 0.0],
    ];
    let singular = singular.into_iter().map(SVector::from);
    let same = FINITE.into_iter().map(SVector::repeat);
    let one = FINITE.into_iter().map(|angle| {
        let mut q = SVector::<f64, 4>::repeat(0.4);
        if let Some(joint) = q.iter_mut().nth(2) {
            *joint = angle;
        }
        q
    });
    let mut between = Between::seeded(1);
    let others = core::iter::repeat_with(move || between.vector(-2.0, 2.0)).take(60);
    singular.chain(same).chain(one).chain(others)
}
