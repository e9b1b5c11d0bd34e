//! [`RosMessage`], [`schema`] and [`encode`]: a message, the text that defines it, and its bytes.

use crate::cdr::CdrWriter;

/// The name by which MCAP and the Foxglove protocol know the encoding of the messages of this
/// crate.
pub const ENCODING: &str = "cdr";
/// The name by which MCAP and the Foxglove protocol know the language of the schemas of this crate.
pub const SCHEMA_ENCODING: &str = "ros2msg";

/// A type of messages of ROS 2: its name, its definition, and the way to write a message.
/// [`encode`] and [`schema`] use it.
pub trait RosMessage {
    /// The name of the type, such as `sensor_msgs/msg/JointState`.
    const NAME: &'static str;
    /// The definition of the type, without those of the types that it contains.
    const DEFINITION: &'static str;
    /// The definitions of the types that it contains, each with its name, such as `std_msgs/Header`.
    const CONTAINED: &'static [(&'static str, &'static str)];

    /// Writes the fields of the message.
    fn write(&self, to: &mut CdrWriter);
}

/// Returns the bytes of `message` in CDR: 4 bytes that say how it is encoded, and its fields.
pub fn encode<M: RosMessage>(message: &M) -> Vec<u8> {
    let mut to = CdrWriter::new();
    message.write(&mut to);
    to.finish()
}

/// Returns the schema of the message type `M`, as a text in the format `ros2msg`: the definition of the type, and those
/// of the types that it contains.
#[must_use]
pub fn schema<M: RosMessage>() -> String {
    joined(M::DEFINITION, M::CONTAINED)
}

/// Returns a definition with those of the types that it contains.
pub(crate) fn joined(definition: &str, contained: &[(&str, &str)]) -> String {
    let mut text = definition.to_owned();
    for (name, definition) in contained {
        text.extend(["=".repeat(80).as_str(), "\nMSG: ", name, "\n", definition]);
    }
    text
}
