//! Files of any bytes: read, written again, and read again.

use crate::{McapReader, McapRecord, McapWriter};

/// The size in bytes of a buffer for any record of a file that is found by chance.
const ROOM: usize = 4096;

/// Reads `bytes`, the input of a fuzz target, as an MCAP file up to the first fault: once as they are, and once with
/// the right beginning before them. Writes the records into another file, which must have the same records.
///
/// # Panics
/// Panics if the other file has different records.
pub fn reader(bytes: &[u8]) {
    copy(bytes);
    copy(&[b"\x89MCAP0\r\n", bytes].concat());
}

fn copy(file: &[u8]) {
    let (mut buffer, mut again) = ([0; ROOM], [0; ROOM]);
    let Ok(mut reader) = McapReader::new(file) else {
        return;
    };
    let mut written = Vec::new();
    let mut writer = McapWriter::new(&mut written, "", "").expect("memory");
    let mut count = 0;
    while let Ok(Some(record)) = reader.next(&mut buffer) {
        count += usize::from(write(&mut writer, &record));
    }
    writer.end().expect("memory");

    let mut first = McapReader::new(file).expect("it was read before");
    let mut second = McapReader::new(&written[..]).expect("it was written here");
    // The first record is the copy's own header.
    second.next(&mut again).expect("it was written here");
    for _ in 0..count {
        let record = loop {
            let record = first.next(&mut buffer).expect("it was read before");
            let record = record.expect("it was read before");
            if !matches!(record, McapRecord::Header { .. }) {
                break record;
            }
        };
        assert_eq!(second.next(&mut again), Ok(Some(record)));
    }
    assert_eq!(second.next(&mut again), Ok(None));
}

/// Writes a record; false for a header, which only begins a file.
fn write(writer: &mut McapWriter<&mut Vec<u8>>, record: &McapRecord<'_>) -> bool {
    let written = match *record {
        McapRecord::Metadata { name, pairs } => {
            let pairs: Vec<_> = pairs.iter().collect();
            writer.metadata(name, &pairs)
        }
        McapRecord::Schema {
            number,
            name,
            encoding,
            data,
        } => writer.schema(number, name, encoding, data),
        McapRecord::Channel {
            number,
            schema,
            topic,
            encoding,
            metadata,
        } => {
            let metadata: Vec<_> = metadata.iter().collect();
            writer.channel(number, schema, topic, encoding, &metadata)
        }
        McapRecord::Message(message, data) => writer.message(&message, &[data]),
        _ => return false,
    };
    written.expect("memory");
    true
}
