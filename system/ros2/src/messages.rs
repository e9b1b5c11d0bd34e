//! Messages whose types ROS 2 defines.

use crate::cdr::{CdrWriter, DecodeError, Reader};
use crate::schema::RosMessage;

const NS: u64 = 1_000_000_000;

pub(crate) const TIME: (&str, &str) = ("builtin_interfaces/Time", Time::DEFINITION);
const HEADER: (&str, &str) = (
    "std_msgs/Header",
    "builtin_interfaces/Time stamp\nstring frame_id\n",
);
const TRANSFORM_STAMPED: (&str, &str) = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\nTransform transform\n",
);
const TRANSFORM: (&str, &str) = (
    "geometry_msgs/Transform",
    "Vector3 translation\nQuaternion rotation\n",
);
const VECTOR: (&str, &str) = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
const QUATERNION: (&str, &str) = (
    "geometry_msgs/Quaternion",
    "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
);

/// `builtin_interfaces/msg/Time`: a point in time, since the epoch of its clock.
///
/// ```
/// use condor_ros2::Time;
///
/// assert_eq!(Time::from_ns(1_500_000_000).as_ns(), 1_500_000_000);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// The nanoseconds within the second, less than 10⁹.
    pub nanosec: u32,
}

impl Time {
    /// Returns the time `ns` nanoseconds after the epoch. The type ends at 2³¹ - 1 seconds, in the
    /// year 2038; a later time becomes that time.
    #[must_use]
    pub fn from_ns(ns: u64) -> Self {
        match i32::try_from(ns / NS) {
            Ok(sec) => Self {
                sec,
                nanosec: (ns % NS) as u32,
            },
            Err(_) => Self {
                sec: i32::MAX,
                nanosec: 0,
            },
        }
    }

    /// Returns the number of nanoseconds since the epoch; 0 for times before the epoch.
    #[must_use]
    pub fn as_ns(self) -> u64 {
        u64::try_from(self.sec).map_or(0, |sec| sec * NS + u64::from(self.nanosec))
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            sec: i32::from_le_bytes(from.number()?),
            nanosec: from.u32()?,
        })
    }
}

impl RosMessage for Time {
    const NAME: &'static str = "builtin_interfaces/msg/Time";
    const DEFINITION: &'static str = "int32 sec\nuint32 nanosec\n";
    const CONTAINED: &'static [(&'static str, &'static str)] = &[];

    fn write(&self, to: &mut CdrWriter) {
        to.number(self.sec.to_le_bytes());
        to.u32(self.nanosec);
    }
}

/// `std_msgs/msg/String`: a text, such as the URDF of a robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StringMessage<'m>(pub &'m str);

impl RosMessage for StringMessage<'_> {
    const NAME: &'static str = "std_msgs/msg/String";
    const DEFINITION: &'static str = "string data\n";
    const CONTAINED: &'static [(&'static str, &'static str)] = &[];

    fn write(&self, to: &mut CdrWriter) {
        to.text(self.0);
    }
}

/// `sensor_msgs/msg/JointState`: positions, velocities and efforts of joints at one time. Each slice of numbers has an
/// element for every name, or is empty.
///
/// ```
/// use condor_ros2::{JointState, RosMessage, Time, encode};
///
/// let state = JointState {
///     stamp: Time::from_ns(1_500_000_000),
///     names: &["index.proximal".into()],
///     positions: &[0.5],
///     velocities: &[],
///     efforts: &[],
/// };
/// assert_eq!(JointState::NAME, "sensor_msgs/msg/JointState");
/// println!("{} bytes of CDR", encode(&state).len());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointState<'m> {
    /// The time at which the joints were in this state.
    pub stamp: Time,
    /// The names of the joints.
    pub names: &'m [String],
    /// The positions of the joints, rad or m.
    pub positions: &'m [f64],
    /// The velocities of the joints, rad/s or m/s.
    pub velocities: &'m [f64],
    /// The efforts of the joints, N m or N.
    pub efforts: &'m [f64],
}

impl RosMessage for JointState<'_> {
    const NAME: &'static str = "sensor_msgs/msg/JointState";
    const DEFINITION: &'static str = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n";
    const CONTAINED: &'static [(&'static str, &'static str)] = &[HEADER, TIME];

    fn write(&self, to: &mut CdrWriter) {
        self.stamp.write(to);
        // Joints have no frame.
        to.text("");
        to.sequence(self.names, |to, name| to.text(name));
        to.floats(self.positions);
        to.floats(self.velocities);
        to.floats(self.efforts);
    }
}

/// `tf2_msgs/msg/TFMessage`: the poses of coordinate frames relative to other frames, at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TFMessage<'m> {
    /// The time at which the frames had these poses.
    pub stamp: Time,
    /// The poses of the frames.
    pub transforms: &'m [Transform],
}

/// The pose of a coordinate frame relative to another frame, for a [`TFMessage`].
#[derive(Clone, Debug, PartialEq)]
pub struct Transform {
    /// The name of the frame to which the pose is relative.
    pub parent: String,
    /// The name of the frame that has the pose.
    pub child: String,
    /// The origin of the frame in its parent: x, y, z, in metres.
    pub translation: [f64; 3],
    /// The rotation of the frame relative to its parent: a unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
}

impl RosMessage for TFMessage<'_> {
    const NAME: &'static str = "tf2_msgs/msg/TFMessage";
    const DEFINITION: &'static str = "geometry_msgs/TransformStamped[] transforms\n";
    const CONTAINED: &'static [(&'static str, &'static str)] = &[
        TRANSFORM_STAMPED,
        HEADER,
        TIME,
        TRANSFORM,
        VECTOR,
        QUATERNION,
    ];

    fn write(&self, to: &mut CdrWriter) {
        to.sequence(self.transforms, |to, one| {
            self.stamp.write(to);
            to.text(&one.parent);
            to.text(&one.child);
            for number in one.translation.iter().chain(&one.rotation) {
                to.number(number.to_le_bytes());
            }
        });
    }
}

/// `rcl_interfaces/msg/Log`: an event, described for people. The file, function and line that such
/// a message can have are left empty.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Log {
    /// The time of the event.
    pub stamp: Time,
    /// The severity of the event.
    pub level: Level,
    /// The source of the event, such as the name of a processor.
    pub name: String,
    /// The description of the event.
    pub text: String,
}

/// The severity of an event in a [`Log`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Level {
    /// Helps people who look for a mistake.
    Debug = 10,
    /// Something happened as expected.
    Info = 20,
    /// Something may be wrong.
    Warn = 30,
    /// Something is wrong.
    Error = 40,
    /// Something is so wrong that a program ends.
    Fatal = 50,
}

impl Level {
    /// Returns the level of a number: the greatest that is not above it, or `Debug`.
    const fn of(number: u8) -> Self {
        match number {
            0..20 => Self::Debug,
            20..30 => Self::Info,
            30..40 => Self::Warn,
            40..50 => Self::Error,
            50.. => Self::Fatal,
        }
    }
}

impl Log {
    /// Reads an event from the bytes of its message.
    ///
    /// # Errors
    /// [`DecodeError`] if `message` is not little-endian CDR, is too short, or has texts that are
    /// not UTF-8.
    pub fn decode(message: &[u8]) -> Result<Self, DecodeError> {
        let mut from = Reader::new(message)?;
        let stamp = Time::read(&mut from)?;
        let [level] = from.number()?;
        Ok(Self {
            stamp,
            level: Level::of(level),
            name: from.text()?,
            text: from.text()?,
        })
    }
}

impl RosMessage for Log {
    const NAME: &'static str = "rcl_interfaces/msg/Log";
    const DEFINITION: &'static str = "\
byte DEBUG=10
byte INFO=20
byte WARN=30
byte ERROR=40
byte FATAL=50
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
";
    const CONTAINED: &'static [(&'static str, &'static str)] = &[TIME];

    fn write(&self, to: &mut CdrWriter) {
        self.stamp.write(to);
        to.number([self.level as u8]);
        to.text(&self.name);
        to.text(&self.text);
        to.text("");
        to.text("");
        to.u32(0);
    }
}
