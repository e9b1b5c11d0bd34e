//! [`Hand`]: a hand as its configuration describes it, without any processor.

use condor_hand::config::{self, Converter, Wire};
use condor_hand::trajectory::Primitive;
use condor_hand::trajectory::image::encode;
use condor_host::robot::{Robot as _, Simulator as _};
use condor_scene::HandView;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyList};

use crate::failure::Failure;

/// The greatest number of fingers of a hand.
const FINGERS: usize = 8;
/// The greatest number of joints of a finger.
const JOINTS: usize = 4;
/// The greatest number of actuators of a finger.
const ACTUATORS: usize = 8;
/// The greatest number of joints for which set-points can be made.
const MOVED: usize = 32;
/// The greatest size of the compiled text of a motion, in bytes.
const BYTES: usize = 8192;

/// A hand, computed from its configuration alone: its joints and links, and the motions that its master would make.
#[pyclass(frozen)]
pub(crate) struct Hand {
    description: config::Hand<FINGERS, JOINTS, ACTUATORS>,
    view: HandView<FINGERS, JOINTS, ACTUATORS>,
    wires: Vec<WiringRow>,
}

/// A sensor or an actuator: `(name, kind, whether it is an output, board, channel, bits, gain, offset, value at rest)`.
type WiringRow = (String, &'static str, bool, u8, u8, u8, f64, f64, f64);

/// A link relative to its parent: `(name, parent, x y z in m, quaternion x y z w)`.
type Frame = (String, String, [f64; 3], [f64; 4]);

#[pymethods]
#[expect(
    clippy::needless_pass_by_value,
    reason = "PyO3 hands over lists of numbers by value"
)]
impl Hand {
    /// Reads and checks the text of a configuration. `file` is the name of the text in errors.
    #[new]
    fn new(py: Python<'_>, text: &str, file: &str) -> PyResult<Self> {
        let read = py.detach(|| {
            let description = config::Hand::from_toml(text, file)?;
            Ok::<_, Failure>(Self {
                view: HandView::new(&description),
                wires: wired(&description),
                description,
            })
        });
        Ok(read?)
    }

    /// Returns the name of the hand.
    fn name(&self) -> &str {
        &self.description.name
    }

    /// Returns `(name, least position, greatest position)` of each joint, rad.
    fn joints(&self) -> Vec<(&str, f64, f64)> {
        let joints = self.view.joints().iter();
        let joints = joints.map(|it| (it.name.as_str(), it.limits[0], it.limits[1]));
        joints.collect()
    }

    /// Returns the channels of all sensors and actuators, with their calibrations.
    fn wires(&self) -> Vec<WiringRow> {
        self.wires.clone()
    }

    /// Returns the frames of all links, parents first, if the joints have these `positions`, rad.
    fn frames(&self, py: Python<'_>, positions: Vec<f64>) -> Vec<Frame> {
        let frames = py.detach(|| self.view.frames(&positions)).into_iter();
        let frames = frames.map(|it| (it.name, it.parent, it.translation, it.rotation));
        frames.collect()
    }

    /// Returns the positions that bring the frame `frame` to `point`, or as near to it as was found, as JSON. The
    /// search begins at `positions`.
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

    /// Returns the distances between the parts of the hand that must not touch each other, as JSON.
    fn clearances(&self, py: Python<'_>, positions: Vec<f64>) -> PyResult<String> {
        let found = py.detach(|| {
            let found = self.view.clearances(&positions);
            Ok::<_, Failure>(serde_json::to_string(&found)?)
        });
        Ok(found?)
    }

    /// Returns the motion that the master would make of the text `motion`: `(period, joints, rest)`. A joint is `(name,
    /// [position, velocity, acceleration, torque])`, each as bytes of float64; the rest is JSON.
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

    /// Compiles the text of a motion to the bytes that the queue of motions takes. `file` is the name of the text in
    /// errors.
    fn compile(&self, py: Python<'_>, motion: &str, file: &str) -> PyResult<Vec<u8>> {
        let compiled = py.detach(|| {
            let motions: Vec<Primitive<MOVED>> = self.description.motions(motion, file)?;
            let mut bytes = vec![0; BYTES];
            let length = encode(self.view.joints().len(), &motions, &mut bytes)
                .map_err(|error| Failure::refused(format!("{file}: {error}")))?;
            bytes.truncate(length);
            Ok::<_, Failure>(bytes)
        });
        Ok(compiled?)
    }

    /// Returns the hand as URDF, the XML format for models of robots; `None` if there is no such model of it.
    fn urdf(&self) -> Option<String> {
        self.view.urdf()
    }
}

/// Returns the wires of a hand: of each finger the positions of its joints, its actuators and its tip, then the axes of
/// the table.
fn wired(hand: &config::Hand<FINGERS, JOINTS, ACTUATORS>) -> Vec<WiringRow> {
    let all = hand.wires().filter_map(|(at, wire)| {
        let (name, kind, at_rest) = end_of(hand, wire)?;
        let (is_output, bits, gain, offset) = match at.converter {
            Converter::Adc => {
                let it = hand.input(wire)?;
                (false, it.bits, it.gain, it.offset)
            }
            Converter::Dac => {
                let it = hand.output(wire)?;
                (true, it.bits, it.gain, it.offset)
            }
        };
        let (board, channel) = (at.board, at.channel);
        Some((
            name, kind, is_output, board, channel, bits, gain, offset, at_rest,
        ))
    });
    all.collect()
}

/// Returns the name and the kind of what is at the end of a wire, and the effort of an actuator from which nothing is
/// asked, N or N m; 0 for all else.
fn end_of(
    hand: &config::Hand<FINGERS, JOINTS, ACTUATORS>,
    wire: Wire,
) -> Option<(String, &'static str, f64)> {
    let of = |finger: usize, part: &str| Some(format!("{}.{part}", hand.fingers.get(finger)?.name));
    Some(match wire {
        Wire::Position { finger, joint } => {
            let name = of(finger, &hand.joint(finger, joint)?.name)?;
            (name, "position", 0.0)
        }
        Wire::Actuator { finger, actuator } => {
            let own = hand.actuator(finger, actuator)?;
            (of(finger, &own.name)?, "actuator", own.limits().at_rest())
        }
        Wire::Encoder { finger, actuator } => {
            let name = of(finger, &hand.actuator(finger, actuator)?.name)?;
            (name, "encoder", 0.0)
        }
        Wire::Touch { finger } => (hand.fingers.get(finger)?.name.to_string(), "touch", 0.0),
        Wire::Axis { axis } => {
            let axis = hand.table.as_ref()?.axes.get(axis)?;
            (axis.name.to_string(), "axis", 0.0)
        }
    })
}
