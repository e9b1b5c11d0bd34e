//! [`Hand`]: a hand as its configuration describes it, without any processor.

use condor_hand::config;
use condor_hand::trajectory::Primitive;
use condor_hand::trajectory::image::encode_for;
use condor_hand::trajectory::motion::load;
use condor_host::robot::{Robot as _, Simulator as _};
use condor_view::HandView;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyList};

use crate::failure::Failure;

/// Fingers of a hand, at most.
const FINGERS: usize = 8;
/// Joints of a finger, at most.
const JOINTS: usize = 4;
/// Joints whose set-points can be made, at most.
const MOVED: usize = 32;
/// Bytes of motions, at most.
const BYTES: usize = 8192;

/// A hand: its joints and links, and the motions that its master makes.
#[pyclass(frozen)]
pub(crate) struct Hand {
    name: String,
    view: HandView<FINGERS, JOINTS>,
}

/// `(name, parent, x y z in m, quaternion x y z w)`, relative to the parent.
type Frame = (String, String, [f64; 3], [f64; 4]);

#[pymethods]
#[expect(
    clippy::needless_pass_by_value,
    reason = "PyO3 hands over lists of numbers by value"
)]
impl Hand {
    /// Reads the text of a configuration; `file` is its name in errors.
    #[new]
    fn new(py: Python<'_>, text: &str, file: &str) -> PyResult<Self> {
        let read = py.detach(|| {
            let hand = config::Hand::from_toml(text, file)?;
            let (name, view) = (hand.name.to_string(), HandView::new(&hand));
            Ok::<_, Failure>(Self { name, view })
        });
        Ok(read?)
    }

    /// Returns the name of the hand.
    fn name(&self) -> &str {
        &self.name
    }

    /// Returns the name, the least and the greatest position of each joint.
    fn joints(&self) -> Vec<(&str, f64, f64)> {
        let joints = self.view.joints().iter();
        let joints = joints.map(|it| (it.name.as_str(), it.limits[0], it.limits[1]));
        joints.collect()
    }

    /// Returns the frames of all links, parents first.
    fn frames(&self, py: Python<'_>, positions: Vec<f64>) -> Vec<Frame> {
        let frames = py.detach(|| self.view.frames(&positions)).into_iter();
        let frames = frames.map(|it| (it.name, it.parent, it.translation, it.rotation));
        frames.collect()
    }

    /// Returns the positions that bring a frame to a point, and how near they do, as JSON.
    fn inverse(
        &self,
        py: Python<'_>,
        frame: &str,
        point: [f64; 3],
        positions: Vec<f64>,
    ) -> PyResult<String> {
        let found = py.detach(|| {
            let found = self.view.dragged(&positions, frame, point);
            let found = found.map_err(|error| Failure::refused(error.to_string()))?;
            Ok::<_, Failure>(serde_json::to_string(&found)?)
        });
        Ok(found?)
    }

    /// Returns how near parts are to each other that must not meet, as JSON.
    fn clearances(&self, py: Python<'_>, positions: Vec<f64>) -> PyResult<String> {
        let found = py.detach(|| {
            let found = self.view.clearances(&positions);
            Ok::<_, Failure>(serde_json::to_string(&found)?)
        });
        Ok(found?)
    }

    /// Returns the motion that the master makes of a text: `(period, joints, rest)`. A joint is `(name, [position,
    /// velocity, acceleration, torque])`, each as bytes of float64; the rest is JSON.
    fn plan<'py>(
        &self,
        py: Python<'py>,
        positions: Vec<f64>,
        motion: &str,
        file: &str,
    ) -> PyResult<(f64, Bound<'py, PyList>, String)> {
        let plan = py.detach(|| {
            let plan = self.view.plan(&positions, motion, file);
            plan.map_err(|error| Failure::refused(error.to_string()))
        })?;
        let rest = serde_json::json!({
            "events": plan.events,
            "overloads": plan.overloads,
            "collisions": plan.collisions,
        });
        let joints = PyList::empty(py);
        for joint in &plan.joints {
            let bytes = |numbers: &[f64]| {
                let bytes: Vec<u8> = numbers.iter().flat_map(|it| it.to_le_bytes()).collect();
                PyByteArray::new(py, &bytes)
            };
            let all = [
                &joint.position,
                &joint.velocity,
                &joint.acceleration,
                &joint.torque,
            ];
            joints.append((&joint.name, all.map(|it| bytes(it))))?;
        }
        Ok((plan.period_s, joints, rest.to_string()))
    }

    /// Returns the text of a motion as bytes for the queue.
    fn compile(&self, py: Python<'_>, motion: &str, file: &str) -> PyResult<Vec<u8>> {
        let compiled = py.detach(|| {
            let joints = self.view.joints();
            let names: Vec<_> = joints.iter().map(|joint| &joint.name).collect();
            let motions: Vec<Primitive<MOVED>> = load(motion, file, &names)?;
            let mut bytes = vec![0; BYTES];
            let length = encode_for(joints.len(), &motions, &mut bytes)
                .map_err(|error| Failure::refused(format!("{file}: {error}")))?;
            bytes.truncate(length);
            Ok::<_, Failure>(bytes)
        });
        Ok(compiled?)
    }

    /// Returns the hand as URDF.
    fn urdf(&self) -> Option<String> {
        self.view.urdf()
    }
}
