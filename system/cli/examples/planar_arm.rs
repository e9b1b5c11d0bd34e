//! A planar arm of three joints, whose postures and motions are tried in a browser.
//!
//! Its configuration is a file such as
//!
//! ```toml
//! lengths = [0.3, 0.25, 0.1]
//! ```
//!
//! with the lengths of its links, m. Its motion files are JSON: after each other, joints go to positions (rad) in some
//! time (s), as in `{"motion": [{"duration": 1.0, "to": {"elbow": 0.5}}]}`.
//!
//! `cargo run -p condor-cli --example planar_arm -- sim FILE`

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;

use condor_cli::{AnyError, Application};
use condor_host::robot::{
    Clearance, DragResult, Frame, JointPlan, LimitedJoint, LimitedPosture, Plan, PlanEvent, Robot,
    RobotJoint, RobotLine, Simulator, What,
};
use condor_toml::SourceText;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

const JOINTS: [&str; 3] = ["shoulder", "elbow", "wrist"];
const TIP: &str = "tip";
const LIMIT: f64 = 2.5;
/// The time between two set-points, s.
const PERIOD_S: f64 = 0.01;
/// The greatest speed and acceleration, rad/s and rad/s², and the inertia that each joint feels, kg m².
const FASTEST: [f64; 2] = [3.0, 20.0];
const INERTIA: f64 = 0.1;
/// The longest time of a step, s.
const LONGEST_S: f64 = 60.0;

/// The lengths of the links, m.
struct Arm([f64; 3], Vec<RobotJoint>);

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Motion {
    motion: Vec<Step>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Step {
    duration: f64,
    to: BTreeMap<String, f64>,
}

impl Arm {
    /// Returns the points from the base to the tip.
    fn chain(&self, positions: &[f64]) -> Vec<[f64; 3]> {
        let (mut angle, mut points) = (0.0, vec![[0.0; 3]]);
        for (length, position) in self.0.iter().zip(self.moved(positions).positions) {
            angle += position;
            let [x, y, _] = points[points.len() - 1];
            points.push([x + length * angle.cos(), y + length * angle.sin(), 0.0]);
        }
        points
    }

    fn read(text: &str, file: &str) -> Result<Motion, AnyError> {
        let motion: Motion = serde_json::from_str(text).map_err(|it| format!("{file}: {it}"))?;
        for step in &motion.motion {
            if !(PERIOD_S..=LONGEST_S).contains(&step.duration) {
                return Err(format!("{file}: a step cannot take {} s", step.duration).into());
            }
            if let Some(other) = step.to.keys().find(|it| !JOINTS.contains(&it.as_str())) {
                return Err(format!("{file}: there is no joint {other:?}").into());
            }
        }
        Ok(motion)
    }
}

impl Robot for Arm {
    fn joints(&self) -> &[RobotJoint] {
        &self.1
    }

    fn lines(&self, positions: &[f64]) -> Vec<RobotLine> {
        vec![RobotLine {
            name: "arm".into(),
            points: self.chain(positions),
            radius_m: 0.02,
            effort: None,
        }]
    }

    fn frames(&self, positions: &[f64]) -> Vec<Frame> {
        let angles = self.moved(positions).positions.into_iter().chain([0.0]);
        let lengths = [0.0].into_iter().chain(self.0);
        let parents = ["base"].into_iter().chain(JOINTS);
        let names = JOINTS.into_iter().chain([TIP]);
        let all = names.zip(parents).zip(lengths.zip(angles));
        let frame = |((name, parent), (length, angle)): ((&str, &str), (f64, f64))| Frame {
            name: name.into(),
            parent: parent.into(),
            translation: [length, 0.0, 0.0],
            rotation: [0.0, 0.0, (angle / 2.0).sin(), (angle / 2.0).cos()],
        };
        all.map(frame).collect()
    }

    fn simulator(&self) -> Option<&dyn Simulator> {
        Some(self)
    }
}

impl Simulator for Arm {
    fn moved(&self, positions: &[f64]) -> LimitedPosture {
        let asked = positions.iter().copied().chain([0.0; 3]);
        let asked = asked.map(|it| if it.is_finite() { it } else { 0.0 });
        let (mut positions, mut held) = (Vec::new(), Vec::new());
        for (joint, asked) in JOINTS.into_iter().zip(asked) {
            let limit = asked.clamp(-LIMIT, LIMIT);
            positions.push(limit);
            if asked.abs() > LIMIT {
                let joint = joint.into();
                held.push(LimitedJoint { joint, limit });
            }
        }
        LimitedPosture { positions, held }
    }

    /// Turns one joint after another so that the tip is in the direction of the point.
    fn dragged(
        &self,
        positions: &[f64],
        frame: &str,
        to: [f64; 3],
    ) -> Result<DragResult, AnyError> {
        if frame != TIP {
            return Err(format!("the frame {frame:?} cannot be dragged; drag {TIP:?}").into());
        }
        let mut moved = self.moved(positions);
        for turn in 0..3000 {
            let (joint, points) = (2 - turn % 3, self.chain(&moved.positions));
            let angle = |to: [f64; 3]| (to[1] - points[joint][1]).atan2(to[0] - points[joint][0]);
            moved.positions[joint] += (angle(to) - angle(points[3])).sin();
            moved = self.moved(&moved.positions);
        }
        let tip = self.chain(&moved.positions)[3];
        let squares = tip.iter().zip(to).map(|(is, to)| (is - to).powi(2));
        let distance_m = squares.sum::<f64>().sqrt();
        Ok(DragResult {
            is_reached: distance_m < 1e-6,
            positions: moved.positions,
            distance_m,
            held: moved.held,
        })
    }

    fn clearances(&self, _positions: &[f64]) -> Vec<Clearance> {
        Vec::new()
    }

    fn plan(&self, from: &[f64], motion: &str, file: &str) -> Result<Plan, AnyError> {
        let joint = |name: &str| JointPlan {
            name: name.into(),
            position_limits: [-LIMIT, LIMIT],
            velocity_limit: FASTEST[0],
            acceleration_limit: FASTEST[1],
            torque_limits: [-INERTIA * FASTEST[1], INERTIA * FASTEST[1]],
            ..JointPlan::default()
        };
        let mut plan = Plan {
            period_s: PERIOD_S,
            joints: JOINTS.map(joint).into(),
            ..Plan::default()
        };
        let (mut at, mut at_s) = (self.moved(from).positions, 0.0);
        push(&mut plan, &at, &at, 0.0, 1.0);
        for (step, Step { duration, to }) in (1..).zip(Self::read(motion, file)?.motion) {
            let joints = JOINTS.iter().zip(&at);
            let joints = joints.map(|(name, at)| *to.get(*name).unwrap_or(at));
            let to = self.moved(&joints.collect::<Vec<_>>()).positions;
            let (begins, reached) = (What::Begins, What::Reached);
            plan.events.push(PlanEvent {
                at_s,
                step,
                what: begins,
            });
            let (mut tick, ticks) = (1.0, (duration / PERIOD_S).round());
            while tick <= ticks {
                push(&mut plan, &at, &to, tick / ticks, ticks * PERIOD_S);
                tick += 1.0;
            }
            at_s += ticks * PERIOD_S;
            plan.events.push(PlanEvent {
                at_s,
                step,
                what: reached,
            });
            at = to;
        }
        Ok(plan)
    }

    fn steps(&self, motion: &str, file: &str) -> Result<Json, AnyError> {
        Ok(serde_json::to_value(Self::read(motion, file)?)?)
    }

    fn text(&self, steps: &Json) -> Result<String, AnyError> {
        let motion = Self::read(&steps.to_string(), "the motion")?;
        Ok(serde_json::to_string_pretty(&motion)?)
    }
}

/// Adds the tick after a part of a motion, along the polynomial of least jerk.
fn push(plan: &mut Plan, from: &[f64], to: &[f64], part: f64, duration_s: f64) {
    let rest = 1.0 - part;
    let [s, v, a] = [
        part.powi(3) * (10.0 - 15.0 * part + 6.0 * part.powi(2)),
        30.0 * (part * rest).powi(2) / duration_s,
        60.0 * part * rest * (1.0 - 2.0 * part) / duration_s.powi(2),
    ];
    for (joint, (from, to)) in plan.joints.iter_mut().zip(from.iter().zip(to)) {
        joint.position.push(from + (to - from) * s);
        joint.velocity.push((to - from) * v);
        joint.acceleration.push((to - from) * a);
        joint.torque.push(INERTIA * (to - from) * a);
    }
}

struct OfArm;

impl Application for OfArm {
    fn programs(&self) -> Vec<&'static str> {
        Vec::new()
    }

    fn run_program(&self, _: &str, _: Vec<String>) -> ExitCode {
        ExitCode::FAILURE
    }

    fn robot(&self, robot: &Path) -> Result<Option<Box<dyn Robot>>, AnyError> {
        let file = robot.to_string_lossy();
        let text = std::fs::read_to_string(robot).map_err(|it| format!("{file}: {it}"))?;
        let text = SourceText::new(&file, &text);
        let tree = text.parse()?;
        let lengths = text.keys(&tree).and_then(|mut keys| {
            let lengths: Option<[f64; 3]> = keys.need("lengths", "three lengths, m");
            keys.finish();
            lengths
        });
        let joints = JOINTS.map(|name| RobotJoint {
            name: name.into(),
            position: format!("{name}.position"),
            velocity: None,
            effort: None,
            limits: [-LIMIT, LIMIT],
        });
        Ok(Some(Box::new(Arm(text.finish(lengths)?, joints.into()))))
    }
}

fn main() -> ExitCode {
    condor_cli::main(&OfArm)
}
