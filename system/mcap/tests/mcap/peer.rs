//! The crate `mcap` reads what is written here, and the other way round.

use std::collections::BTreeMap;
use std::io::Cursor;

use condor_mcap::{McapReader, McapRecord, McapWriter, MessageHead};
use mcap::records::MessageHeader;
use mcap::{MessageStream, WriteOptions};
use proptest::collection::vec;
use proptest::prelude::*;

const SCHEMA: &[u8] = b"float64 angle # rad";

fn messages() -> impl Strategy<Value = Vec<(MessageHead, Vec<u8>)>> {
    let message = (
        1..4_u16,
        any::<u32>(),
        any::<u64>(),
        vec(any::<u8>(), 0..80),
    );
    let message = message.prop_map(|(channel, sequence, log_time_ns, data)| {
        let message = MessageHead {
            channel,
            sequence,
            log_time_ns,
        };
        (message, data)
    });
    vec(message, 0..40)
}

fn topic(channel: u16) -> String {
    format!("/topic/{channel}")
}

fn written(messages: &[(MessageHead, Vec<u8>)]) -> Vec<u8> {
    let mut writer = McapWriter::new(Vec::new(), "ros2", "test").unwrap();
    writer
        .metadata("versions", &[("format", "1"), ("robot", "hand")])
        .unwrap();
    writer
        .schema(7, "test/msg/Angle", "ros2msg", SCHEMA)
        .unwrap();
    for channel in 1..4 {
        let processor = channel.to_string();
        let metadata = [("processor", processor.as_str())];
        writer
            .channel(channel, 7, &topic(channel), "cdr", &metadata)
            .unwrap();
    }
    for (number, (message, data)) in messages.iter().enumerate() {
        let (first, second) = data.split_at(data.len() / 2);
        if number % 2 == 0 {
            writer.message(message, &[first, second]).unwrap();
        } else {
            let head = message.head(data.len());
            for piece in [&head[..5], &head[5..], first, second] {
                writer.records(piece).unwrap();
            }
        }
    }
    writer.end().unwrap()
}

/// The messages of a file, as this crate reads them.
fn read(file: &[u8]) -> Vec<(MessageHead, Vec<u8>)> {
    let (mut reader, mut buffer) = (McapReader::new(file).unwrap(), [0; 512]);
    let mut messages = Vec::new();
    while let Some(record) = reader.next(&mut buffer).unwrap() {
        if let McapRecord::Message(message, data) = record {
            messages.push((message, data.to_vec()));
        }
    }
    messages
}

proptest! {
    #[test]
    fn the_peer_reads_what_is_written(messages in messages()) {
        let file = written(&messages);
        let seen: Vec<_> = MessageStream::new(&file).unwrap().map(Result::unwrap).collect();
        prop_assert_eq!(seen.len(), messages.len());
        for (seen, (message, data)) in seen.iter().zip(&messages) {
            prop_assert_eq!(&seen.channel.topic, &topic(message.channel));
            prop_assert_eq!(&seen.channel.message_encoding, "cdr");
            prop_assert_eq!(&seen.channel.metadata["processor"], &message.channel.to_string());
            let schema = seen.channel.schema.as_ref().unwrap();
            prop_assert_eq!(&schema.name, "test/msg/Angle");
            prop_assert_eq!(schema.data.as_ref(), SCHEMA);
            prop_assert_eq!(seen.sequence, message.sequence);
            prop_assert_eq!(seen.log_time, message.log_time_ns);
            prop_assert_eq!(seen.publish_time, message.log_time_ns);
            prop_assert_eq!(seen.data.as_ref(), data);
        }
        prop_assert_eq!(read(&file), messages);
    }

    #[test]
    fn what_the_peer_writes_is_read(messages in messages()) {
        let mut file = Cursor::new(Vec::new());
        let options = WriteOptions::new().use_chunks(false).compression(None);
        let mut writer = options.create(&mut file).unwrap();
        let schema = writer.add_schema("test/msg/Angle", "ros2msg", SCHEMA).unwrap();
        let channels: Vec<_> = (1..4)
            .map(|channel| {
                let metadata = BTreeMap::from([("a".into(), channel.to_string())]);
                writer.add_channel(schema, &topic(channel), "cdr", &metadata).unwrap()
            })
            .collect();
        let mut expected = Vec::new();
        for (message, data) in messages {
            let channel_id = channels[usize::from(message.channel) - 1];
            let header = MessageHeader {
                channel_id,
                sequence: message.sequence,
                log_time: message.log_time_ns,
                publish_time: 5,
            };
            writer.write_to_known_channel(&header, &data).unwrap();
            expected.push((MessageHead { channel: channel_id, ..message }, data));
        }
        writer.finish().unwrap();
        drop(writer);
        prop_assert_eq!(read(file.get_ref()), expected);
    }
}

#[test]
fn all_records_are_read_as_they_were_written() {
    let file = written(&[]);
    let (mut reader, mut buffer) = (McapReader::new(&file[..]).unwrap(), [0; 128]);
    let header = reader.next(&mut buffer).unwrap().unwrap();
    let (profile, library) = ("ros2", "test");
    assert_eq!(header, McapRecord::Header { profile, library });
    let Some(McapRecord::Metadata { name, pairs }) = reader.next(&mut buffer).unwrap() else {
        panic!("no metadata");
    };
    assert_eq!(name, "versions");
    assert!(pairs.iter().eq([("format", "1"), ("robot", "hand")]));
    assert_eq!(
        [pairs.get("robot"), pairs.get("boat")],
        [Some("hand"), None]
    );
    let schema = McapRecord::Schema {
        number: 7,
        name: "test/msg/Angle",
        encoding: "ros2msg",
        data: SCHEMA,
    };
    assert_eq!(reader.next(&mut buffer).unwrap(), Some(schema));
    for channel in 1..4 {
        let Some(McapRecord::Channel {
            number,
            schema,
            topic,
            encoding,
            metadata,
        }) = reader.next(&mut buffer).unwrap()
        else {
            panic!("no channel {channel}");
        };
        assert_eq!((number, schema), (channel, 7));
        assert_eq!((topic, encoding), (&*self::topic(channel), "cdr"));
        assert_eq!(metadata.get("processor"), Some(&*channel.to_string()));
    }
    assert_eq!(reader.next(&mut buffer).unwrap(), None);
    assert_eq!(reader.next(&mut buffer).unwrap(), None);
}
