//! A hand as URDF.

use core::fmt::Write as _;

use condor_hand::Pose;
use condor_hand::kinematics::ChainMotion;
use nalgebra::{Matrix3, Vector3};

use crate::finger::{Finger, Link};

/// Returns the description of a hand whose base has the name `base`.
pub(crate) fn write(name: &str, base: &str, fingers: &[Finger]) -> String {
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n",
        escaped(name)
    );
    // A string takes everything.
    let _ = writeln!(text, "  <link name=\"{base}\"/>");
    for finger in fingers {
        for link in &finger.links {
            let name = escaped(&link.frame_name());
            let _ = write!(text, "{}", body(link, &name));
            let (parent, at) = finger.placed(link.carrier, &link.placement, base);
            let _ = write!(text, "{}", joint(link, &name, &escaped(&parent), &at));
        }
        let name = escaped(&finger.tip_name());
        let tip = Pose::at(finger.tip.x, finger.tip.y, finger.tip.z);
        let (parent, tip) = finger.placed(Some(finger.tip_link), &tip, base);
        let parent = escaped(&parent);
        let _ = writeln!(text, "  <link name=\"{name}\"/>");
        let _ = writeln!(text, "  <joint name=\"{name}_joint\" type=\"fixed\">");
        let _ = writeln!(
            text,
            "    <parent link=\"{parent}\"/>\n    <child link=\"{name}\"/>"
        );
        let _ = writeln!(text, "    {}\n  </joint>", origin(&tip));
    }
    text + "</robot>\n"
}

fn body(link: &Link, name: &str) -> String {
    let Some(body) = &link.body else {
        return format!("  <link name=\"{name}\"/>\n");
    };
    let place = Pose {
        rotation: Matrix3::identity(),
        position: body.center,
    };
    let (origin, mass, i) = (origin(&place), body.mass, &body.inertia);
    let inertia = format!(
        "<inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/>",
        i.m11, i.m12, i.m13, i.m22, i.m23, i.m33
    );
    let visual = link.cuboid.map_or_else(String::new, |[x, y, z]| {
        format!(
            "    <visual>\n      {origin}\n      \
             <geometry><box size=\"{x} {y} {z}\"/></geometry>\n    </visual>\n"
        )
    });
    format!(
        "  <link name=\"{name}\">\n    <inertial>\n      {origin}\n      \
         <mass value=\"{mass}\"/>\n      {inertia}\n    </inertial>\n{visual}  </link>\n"
    )
}

fn joint(link: &Link, child: &str, parent: &str, at: &Pose) -> String {
    let (kind, axis) = match link.motion {
        ChainMotion::Revolute(axis) => ("revolute", axis),
        ChainMotion::Prismatic(axis) => ("prismatic", axis),
        ChainMotion::Fixed => ("fixed", Vector3::x()),
    };
    let (name, limits) = (escaped(&link.name), &link.limits);
    let mimic = link.follows.as_ref().map_or_else(String::new, |it| {
        let (other, ratio, offset) = (escaped(&it.name), it.ratio, it.offset);
        format!("\n    <mimic joint=\"{other}\" multiplier=\"{ratio}\" offset=\"{offset}\"/>")
    });
    format!(
        "  <joint name=\"{name}\" type=\"{kind}\">\n    \
         <parent link=\"{parent}\"/>\n    <child link=\"{child}\"/>\n    {}\n    \
         <axis xyz=\"{}\"/>\n    \
         <limit lower=\"{}\" upper=\"{}\" effort=\"{}\" velocity=\"{}\"/>{mimic}\n  </joint>\n",
        origin(at),
        three(&axis),
        limits.low,
        limits.high,
        link.effort,
        limits.velocity,
    )
}

fn origin(pose: &Pose) -> String {
    format!(
        "<origin xyz=\"{}\" rpy=\"{}\"/>",
        three(&pose.position),
        three(&rpy(&pose.rotation))
    )
}

/// Returns roll, pitch and yaw in radians, so that `Rz(yaw) Ry(pitch) Rx(roll)` is the rotation.
fn rpy(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let yaw = rotation.m21.atan2(rotation.m11);
    // At a pitch near ±90° the yaw is mere rounding. Roll and pitch come from what is left when the yaw that was
    // taken is turned back, `Ry(pitch) Rx(roll)`, so they make up for it.
    let (sin, cos) = yaw.sin_cos();
    let rest = Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0) * rotation;
    let roll = (-rest.m23).atan2(rest.m22);
    let pitch = (-rest.m31).atan2(rest.m11);
    Vector3::new(roll, pitch, yaw)
}

/// Three numbers, none of which is minus nothing.
fn three(vector: &Vector3<f64>) -> String {
    let [x, y, z] = vector.map(|value| value + 0.0).into();
    format!("{x} {y} {z}")
}

/// A name as the value of an attribute.
fn escaped(name: &str) -> String {
    let name = name.replace('&', "&amp;").replace('<', "&lt;");
    name.replace('"', "&quot;")
}
