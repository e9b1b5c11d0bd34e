use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

use condor_ros2::{Level, RosField};
use condor_vars::{AnyValue, ValueKind};
use mcap::records::op;
use proptest::prelude::*;

use super::*;

fn variable(name: &str, kind: ValueKind) -> RosField {
    RosField {
        name: name.into(),
        kind,
        unit: "rad".into(),
        about: String::new(),
        labels: Vec::new(),
    }
}

/// A recording of two loops, whose values follow from their ticks.
struct Made {
    writer: Writer,
    channels: [u16; 2],
    /// How many rows were committed of each loop.
    taken: [u64; 2],
}

fn begin(path: &Path) -> Made {
    let attached = [AttachedFile {
        name: "hand.toml".into(),
        content: b"name = \"hand\"\n".to_vec(),
    }];
    let origin = Origin {
        system: "tested",
        is_simulated: false,
        ahead_ns: 1_000_000,
        every: 1,
        attached: &attached,
    };
    let mut writer = Writer::create(path, &origin).unwrap();
    let fields = [
        variable("position", ValueKind::F64),
        variable("beat", ValueKind::U8),
    ];
    let a = writer.rows_of("servo-a", "servo", fields.clone()).unwrap();
    let b = writer.rows_of("servo_a", "servo", fields).unwrap();
    Made {
        writer,
        channels: [a, b],
        taken: [0; 2],
    }
}

fn position(source: usize, tick: u64) -> f64 {
    0.5 * f64::from(tick as u32) + f64::from(source as u32)
}

impl Made {
    fn rows(&mut self, source: usize, count: u64) {
        for _ in 0..count {
            let tick = self.taken[source];
            let long = position(source, tick).to_bits();
            let words = [long as u32, (long >> 32) as u32, (tick % 256) as u32];
            let (channel, at_ns) = (self.channels[source], 1000 * tick);
            self.writer.row(channel, at_ns, tick, 0, &words).unwrap();
            self.taken[source] += 1;
        }
        self.writer.commit().unwrap();
    }

    /// As if the process were killed: nothing that it holds is written.
    fn kill(self) -> [u64; 2] {
        let taken = self.taken;
        self.writer.abandon();
        taken
    }
}

/// Reads all rows, which must be the first ones of each loop; returns how many.
fn check(path: &Path) -> [u64; 2] {
    let reader = RecordingReader::open(path).unwrap();
    let mut counts = [0; 2];
    let numbers: Vec<_> = (0..reader.sources().len()).collect();
    reader
        .rows(&numbers, reader.span(), |source, at_ns, row| {
            let tick = counts[source];
            assert_eq!(row.head().tick, tick);
            assert_eq!(at_ns, 1_000_000 + 1000 * tick);
            assert_eq!(row.head().stamp.as_ns(), at_ns);
            assert_eq!(row.value(0), Some(AnyValue::F64(position(source, tick))));
            assert_eq!(row.value(1), Some(AnyValue::Uint(tick % 256)));
            counts[source] += 1;
            Ok::<_, RecordingError>(())
        })
        .unwrap();
    for (source, count) in reader.sources().iter().zip(counts) {
        assert_eq!(source.rows, count);
    }
    counts
}

/// Keeps the former recording, if there is one; returns its name.
fn former(path: &Path) -> Result<Option<PathBuf>, RecordingError> {
    Former::complete(path)?.map(Former::keep).transpose()
}

fn place() -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run.mcap");
    (directory, path)
}

#[test]
fn a_recording_has_what_was_written() {
    let (directory, path) = place();
    let mut made = begin(&path);
    made.rows(0, 300);
    made.writer.event(7, Level::Warn, "a", "restarted");
    made.rows(1, 5);
    let written = made.writer.end().unwrap();
    let topics: Vec<_> = written.iter().map(|it| (&*it.topic, it.messages)).collect();
    let expected = [
        ("/events", 1),
        ("/servo_a/servo", 300),
        ("/servo_a/servo_2", 5),
    ];
    assert_eq!(topics, expected);
    assert_eq!(check(&path), [300, 5]);
    let reader = RecordingReader::open(&path).unwrap();
    assert_eq!(reader.about()["system"], "tested");
    assert_eq!(reader.sources()[0].dropped, Some(0));
    let events = reader.events(reader.span()).unwrap();
    let [(at_ns, event)] = events.as_slice() else {
        panic!("{events:?}");
    };
    assert_eq!((*at_ns, &*event.text), (1_000_007, "restarted"));
    let found = reader.columns(&["servo-a:pos*".into()]).unwrap();
    assert_eq!(reader.labels(&found), ["servo-a:position"]);
    assert_eq!((found[0].source, found[0].field), (0, 0));
    let error = reader.columns(&["position".into()]).unwrap_err();
    assert!(error.to_string().contains("several variables"), "{error}");
    // Nothing else stays.
    let files = std::fs::read_dir(directory.path()).unwrap();
    assert_eq!(files.count(), 1);
}

#[test]
fn a_span_has_its_rows_only() {
    let (_directory, path) = place();
    let mut made = begin(&path);
    made.rows(0, 100);
    made.writer.end().unwrap();
    let reader = RecordingReader::open(&path).unwrap();
    let mut ticks = Vec::new();
    let span = 1_010_000..1_013_000;
    let read = reader.rows(&[0], span, |_, _, row| {
        ticks.push(row.head().tick);
        Ok::<_, RecordingError>(())
    });
    read.unwrap();
    assert_eq!(ticks, [10, 11, 12]);
}

#[test]
fn a_file_that_ends_at_any_byte_has_its_whole_chunks() {
    let (directory, path) = place();
    let mut made = begin(&path);
    let mut lengths = Vec::new();
    for rows in [20, 30, 7] {
        made.rows(0, rows);
        made.writer.flush().unwrap();
        lengths.push((std::fs::metadata(&path).unwrap().len(), made.taken[0]));
    }
    let taken = std::fs::read(directory.path().join("run.mcap.taken")).unwrap();
    let total = made.taken[0];
    made.writer.end().unwrap();
    let whole = std::fs::read(&path).unwrap();
    let ends = lengths.iter().map(|(length, _)| *length as usize);
    let around = ends.flat_map(|end| end - 1..end + 2);
    // Each costs the disk some milliseconds.
    for cut in (0..whole.len()).step_by(31).chain(around) {
        std::fs::write(&path, &whole[..cut]).unwrap();
        std::fs::write(directory.path().join("run.mcap.taken"), &taken).unwrap();
        assert!(RecordingReader::open(&path).is_err(), "cut at {cut}");
        let completed = complete(&path).unwrap();
        assert!(!completed.was_complete, "cut at {cut}");
        let reader = RecordingReader::open(&path);
        let before = lengths.iter().filter(|(length, _)| *length <= cut as u64);
        let expected = before.map(|(_, rows)| *rows).max().unwrap_or(0);
        match reader {
            Ok(reader) if !reader.sources().is_empty() => {
                // The message index of the last chunk may be cut off: that is written anew.
                let [rows, _] = check(&path);
                let next = lengths.iter().find(|(length, _)| *length > cut as u64);
                let next = next.map_or(expected, |(_, rows)| *rows);
                assert!([expected, next].contains(&rows), "cut at {cut}: {rows}");
                assert_eq!(reader.sources()[0].dropped, Some(total - rows));
            }
            // Cut before the first channel.
            _ => assert_eq!(expected, 0, "cut at {cut}"),
        }
        assert!(complete(&path).unwrap().was_complete);
    }
}

#[test]
fn a_recording_in_use_is_left_alone() {
    let (_directory, path) = place();
    let mut made = begin(&path);
    made.rows(0, 3);
    let error = complete(&path).unwrap_err();
    assert!(matches!(error, RecordingError::InUse { .. }), "{error}");
    let error = former(&path).unwrap_err();
    assert!(matches!(error, RecordingError::InUse { .. }), "{error}");
    made.writer.end().unwrap();
    assert_eq!(check(&path), [3, 0]);
}

#[test]
fn what_is_no_recording_is_left_alone() {
    let (_directory, path) = place();
    std::fs::write(&path, "name = \"hand\"\n").unwrap();
    for error in [complete(&path).unwrap_err(), former(&path).unwrap_err()] {
        assert!(matches!(error, RecordingError::NotMcap { .. }), "{error}");
    }
    assert_eq!(std::fs::read(&path).unwrap(), b"name = \"hand\"\n");
}

#[test]
fn former_recordings_are_completed_and_kept() {
    let (directory, path) = place();
    let mut names = Vec::new();
    for count in [3, 4] {
        let mut made = begin(&path);
        made.rows(0, count);
        made.writer.flush().unwrap();
        made.kill();
        names.push(former(&path).unwrap().unwrap());
    }
    let expected = ["run.1.mcap", "run.2.mcap"].map(|name| directory.path().join(name));
    assert_eq!(names, expected);
    assert_eq!(expected.map(|path| check(&path)[0]), [3, 4]);
    assert_eq!(former(&path).unwrap(), None);
}

#[test]
fn without_counts_nobody_knows_what_was_dropped() {
    let (directory, path) = place();
    let mut made = begin(&path);
    made.rows(0, 3);
    made.kill();
    std::fs::remove_file(directory.path().join("run.mcap.taken")).unwrap();
    let completed = complete(&path).unwrap();
    assert_eq!(completed.topics[1].dropped, None);
    assert_eq!(
        RecordingReader::open(&path).unwrap().sources()[0].dropped,
        None
    );
}

/// The records of a part of a file: opcodes and bodies.
fn records_of(bytes: &[u8]) -> Vec<(u8, Vec<u8>)> {
    let all = records::records(bytes);
    all.map(|(opcode, body)| (opcode, body.to_vec())).collect()
}

/// Writes a record.
fn put(file: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    file.push(opcode);
    file.extend((body.len() as u64).to_le_bytes());
    file.extend(body);
}

/// Copies a complete recording as other programs do: with compressed chunks, without metadata.
fn copied_by_others(whole: &[u8], compression: &str) -> Vec<u8> {
    use std::io::Write as _;
    let pack = |content: &[u8]| match compression {
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        }
        "zstd" => {
            ruzstd::encoding::compress_to_vec(content, ruzstd::encoding::CompressionLevel::Fastest)
        }
        _ => content.to_vec(),
    };
    let mut file = mcap::MAGIC.to_vec();
    let (mut chunks, mut summary) = (Vec::new(), 0);
    for (opcode, body) in records_of(&whole[8..]) {
        match opcode {
            op::CHUNK => {
                let packed = pack(&body[40..]);
                let mut chunk = body[..28].to_vec();
                chunk.extend((compression.len() as u32).to_le_bytes());
                chunk.extend(compression.as_bytes());
                chunk.extend((packed.len() as u64).to_le_bytes());
                chunk.extend(&packed);
                let mut index = body[..16].to_vec();
                index.extend((file.len() as u64).to_le_bytes());
                index.extend((chunk.len() as u64 + 9).to_le_bytes());
                index.extend([0; 4 + 8]);
                index.extend((compression.len() as u32).to_le_bytes());
                index.extend(compression.as_bytes());
                index.extend((packed.len() as u64).to_le_bytes());
                index.extend(&body[16..24]);
                chunks.push(index);
                put(&mut file, opcode, &chunk);
            }
            op::DATA_END => {
                put(&mut file, opcode, &[0; 4]);
                summary = file.len() as u64;
                for index in &chunks {
                    put(&mut file, op::CHUNK_INDEX, index);
                }
            }
            op::HEADER | op::SCHEMA | op::CHANNEL | op::STATISTICS => {
                put(&mut file, opcode, &body);
            }
            _ => {}
        }
    }
    put(
        &mut file,
        op::FOOTER,
        &[&summary.to_le_bytes()[..], &[0; 12]].concat(),
    );
    file.extend(mcap::MAGIC);
    file
}

#[test]
fn what_other_programs_have_copied_is_read() {
    let (_directory, path) = place();
    let mut made = begin(&path);
    made.rows(0, 300);
    made.writer.flush().unwrap();
    made.rows(1, 40);
    made.writer.end().unwrap();
    let whole = std::fs::read(&path).unwrap();
    for compression in ["", "lz4", "zstd"] {
        let copy = copied_by_others(&whole, compression);
        assert!(compression.is_empty() || copy.len() < whole.len());
        std::fs::write(&path, &copy).unwrap();
        assert_eq!(check(&path), [300, 40], "{compression:?}");
        assert!(complete(&path).unwrap().was_complete, "{compression:?}");
        // What was compressed when its recorder was killed is completed, too.
        std::fs::write(&path, &copy[..copy.len() - 30]).unwrap();
        assert!(!complete(&path).unwrap().was_complete, "{compression:?}");
        assert_eq!(check(&path), [300, 40], "{compression:?}");
    }
    std::fs::write(&path, copied_by_others(&whole, "none")).unwrap();
    let error = check_error(&path);
    let told = format!(
        "`mcap compress --compression none {} -o COPY.mcap`",
        path.display()
    );
    assert!(error.to_string().contains(&told), "{error}");
}

/// Reads all rows, which cannot be read.
fn check_error(path: &Path) -> RecordingError {
    let reader = RecordingReader::open(path).unwrap();
    let read = reader.rows(&[0], reader.span(), |_, _, _| Ok(()));
    read.unwrap_err()
}

/// The ticks of the first source.
fn ticks(path: &Path) -> Vec<u64> {
    let reader = RecordingReader::open(path).unwrap();
    let mut ticks = Vec::new();
    let read = reader.rows(&[0], reader.span(), |_, _, row| {
        ticks.push(row.head().tick);
        Ok::<_, RecordingError>(())
    });
    read.unwrap();
    ticks
}

/// Makes a recording of three chunks of 20 rows of a recorder that is killed then.
fn killed(path: &Path) {
    let mut made = begin(path);
    for _ in 0..3 {
        made.rows(0, 20);
        made.writer.flush().unwrap();
    }
    made.kill();
}

/// Returns where the row of a tick is.
fn place_of(bytes: &[u8], tick: u64) -> usize {
    let value = position(0, tick).to_le_bytes();
    bytes.windows(8).position(|it| it == value).unwrap()
}

#[test]
fn whole_chunks_around_a_damaged_one_stay_up_to_a_length_that_is_wrong() {
    let (_directory, path) = place();
    killed(&path);
    let counts = std::fs::read(beside(&path, ".taken")).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let (second, third) = (place_of(&whole, 30), place_of(&whole, 50));
    let chunk = records_of(&whole[8..])
        .into_iter()
        .map(|(_, body)| 9 + body.len());
    let begins = chunk.scan(8, |at, bytes| Some(core::mem::replace(at, *at + bytes)));
    let begin = begins.filter(|at| *at < second).last().unwrap();
    let [before, around, two]: [Vec<u64>; 3] = [
        (0..20).collect(),
        (0..20).chain(40..60).collect(),
        (0..40).collect(),
    ];
    // Bits that are turned; without any, the bytes become 0.
    let damages = [
        ("a bit of a value", second..second + 1, 1, &around),
        ("the opcode", begin..begin + 1, 0x08, &around),
        (
            "an opcode that there is not",
            begin..begin + 1,
            0x60,
            &before,
        ),
        ("the length", begin + 8..begin + 9, 0x80, &before),
        ("the length within", begin + 48..begin + 49, 0x80, &before),
        ("the last bytes", third..whole.len(), 0, &two),
    ];
    for (what, places, bits, expected) in damages {
        let mut bytes = whole.clone();
        for byte in &mut bytes[places] {
            *byte = if bits == 0 { 0 } else { *byte ^ bits };
        }
        std::fs::write(&path, &bytes).unwrap();
        std::fs::write(beside(&path, ".taken"), &counts).unwrap();
        let completed = complete(&path).unwrap();
        assert!(!completed.was_complete, "{what}");
        assert!(completed.damage.places > 0, "{what}");
        assert_eq!(&ticks(&path), expected, "{what}");
        let dropped = 60 - expected.len() as u64;
        assert_eq!(completed.topics[1].dropped, Some(dropped), "{what}");
        assert!(complete(&path).unwrap().was_complete, "{what}");
    }
}

/// Reads all rows, of which any may be missing.
fn check_each(path: &Path) {
    let reader = RecordingReader::open(path).unwrap();
    for (number, source) in reader.sources().iter().enumerate() {
        let made = usize::from(source.topic.ends_with("_2"));
        let read = reader.rows(&[number], reader.span(), |_, at_ns, row| {
            let tick = row.head().tick;
            assert_eq!(at_ns, 1_000_000 + 1000 * tick);
            assert_eq!(row.value(0), Some(AnyValue::F64(position(made, tick))));
            Ok::<_, RecordingError>(())
        });
        read.unwrap();
    }
}

#[test]
fn whatever_bit_of_an_opcode_is_turned_no_message_is_made_of_it() {
    let (_directory, path) = place();
    let counts = beside(&path, ".taken");
    let mut made = begin(&path);
    for source in [0, 1] {
        made.rows(source, 20);
        made.writer.flush().unwrap();
    }
    let taken = std::fs::read(&counts).unwrap();
    let begun = std::fs::read(&path).unwrap();
    made.writer.end().unwrap();
    let ended = std::fs::read(&path).unwrap();
    for whole in [begun, ended] {
        let mut at = 8;
        // A record less than 9 bytes from the end is the magic.
        while at + 9 < whole.len() {
            for bit in 0..8 {
                let mut bytes = whole.clone();
                bytes[at] ^= 1 << bit;
                std::fs::write(&path, &bytes).unwrap();
                std::fs::write(&counts, &taken).unwrap();
                let completed = complete(&path).unwrap();
                let rows = completed.topics.iter().filter(|it| it.name != "/events");
                assert!(
                    rows.clone().all(|it| it.messages <= 20),
                    "bit {bit} of {at}"
                );
                if rows.clone().any(|it| it.messages > 0) {
                    check_each(&path);
                }
                if let Some(kept) = completed.kept {
                    std::fs::remove_file(kept).unwrap();
                }
            }
            let length = whole[at + 1..at + 9].try_into().unwrap();
            at += 9 + usize::try_from(u64::from_le_bytes(length)).unwrap();
        }
    }
}

#[test]
fn a_record_of_an_application_that_is_not_copied_is_counted() {
    let (_directory, path) = place();
    killed(&path);
    let mut bytes = std::fs::read(&path).unwrap();
    put(&mut bytes, 0x80, b"theirs");
    std::fs::write(&path, &bytes).unwrap();
    let damage = complete(&path).unwrap().damage;
    assert_eq!((damage.places, damage.bytes), (1, 9 + 6));
}

#[test]
fn damage_of_a_complete_recording_is_told_and_mended() {
    let (_directory, path) = place();
    let mut made = begin(&path);
    for _ in 0..3 {
        made.rows(0, 20);
        made.writer.flush().unwrap();
    }
    made.writer.end().unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let place = place_of(&bytes, 30);
    bytes[place] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let error = check_error(&path);
    assert!(matches!(error, RecordingError::Damaged { .. }), "{error}");
    let completed = complete(&path).unwrap();
    assert!(!completed.was_complete);
    assert_eq!(completed.damage.places, 1);
    assert_eq!(completed.topics[1].dropped, Some(20));
    assert_eq!(ticks(&path).len(), 40);
    // What this program cannot read, another one may.
    assert_eq!(std::fs::read(completed.kept.unwrap()).unwrap(), bytes);
}

#[test]
fn rows_stay_though_the_chunk_that_describes_them_is_damaged() {
    let (_directory, path) = place();
    let mut made = begin(&path);
    for _ in 0..2 {
        made.rows(0, 20);
        made.writer.flush().unwrap();
    }
    made.writer.end().unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let place = place_of(&bytes, 5);
    bytes[place] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(complete(&path).unwrap().damage.places, 1);
    assert_eq!(ticks(&path), (20..40).collect::<Vec<_>>());
}

#[test]
fn no_former_recording_stops_the_next() {
    let (_directory, path) = place();
    killed(&path);
    let whole = std::fs::read(&path).unwrap();
    let mut other = mcap::MAGIC.to_vec();
    let mut chunk = vec![0; 28];
    chunk.extend([4, 0, 0, 0]);
    chunk.extend(b"none");
    chunk.extend([0; 8]);
    put(&mut other, op::CHUNK, &chunk);
    let mut damaged = whole.clone();
    let place = place_of(&whole, 30);
    damaged[place] ^= 1;
    let contents = [other, damaged, vec![0; 4096], Vec::new()];
    // One with damage is kept as it was, too, under the number before.
    for (content, number) in contents.iter().zip([1, 3, 5, 6]) {
        std::fs::write(&path, content).unwrap();
        // As after a power loss.
        std::fs::write(beside(&path, ".taken"), [0; 32]).unwrap();
        let kept = former(&path).unwrap().unwrap();
        let expected = path.with_file_name(format!("run.{number}.mcap"));
        assert_eq!(kept, expected);
        let mut made = begin(&path);
        made.rows(0, 3);
        made.writer.end().unwrap();
        assert_eq!(check(&path), [3, 0]);
    }
    let read = |number| std::fs::read(path.with_file_name(format!("run.{number}.mcap"))).unwrap();
    assert_eq!(
        [1, 2, 4].map(read),
        [0, 1, 2].map(|index| contents[index].clone())
    );
    assert_eq!(ticks(&path.with_file_name("run.3.mcap")).len(), 40);
}

#[test]
fn what_cannot_be_unpacked_is_left_alone() {
    let (directory, path) = place();
    let mut made = begin(&path);
    made.rows(0, 20);
    made.writer.end().unwrap();
    let mut bytes = copied_by_others(&std::fs::read(&path).unwrap(), "none");
    bytes.truncate(bytes.len() - 30);
    std::fs::write(&path, &bytes).unwrap();
    let error = complete(&path).unwrap_err();
    assert!(
        matches!(error, RecordingError::Compression { .. }),
        "{error}"
    );
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    assert!(!directory.path().join("run.mcap.new").exists());
}

#[test]
fn a_complete_file_without_a_summary_is_left_alone() {
    let (_directory, path) = place();
    let options = mcap::WriteOptions::new()
        .use_chunks(false)
        .emit_summary_records(false)
        .emit_summary_offsets(false);
    let mut file = options.create(File::create(&path).unwrap()).unwrap();
    let channel = file.add_channel(0, "/servo", "any", &BTreeMap::new());
    let header = mcap::records::MessageHeader {
        channel_id: channel.unwrap(),
        sequence: 0,
        log_time: 1,
        publish_time: 1,
    };
    file.write_to_known_channel(&header, b"row").unwrap();
    file.finish().unwrap();
    drop(file);
    let bytes = std::fs::read(&path).unwrap();
    assert!(complete(&path).unwrap().was_complete);
    let error = RecordingReader::open(&path).unwrap_err();
    assert!(matches!(error, RecordingError::NoIndex { .. }), "{error}");
    let kept = former(&path).unwrap().unwrap();
    assert_eq!(std::fs::read(&kept).unwrap(), bytes);
    // Without its last byte it is not complete.
    std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    let error = RecordingReader::open(&path).unwrap_err();
    assert!(
        matches!(error, RecordingError::Incomplete { .. }),
        "{error}"
    );
    assert!(!complete(&path).unwrap().was_complete);
}

#[test]
fn files_of_others_beside_a_recording_are_left_alone() {
    let (directory, path) = place();
    let mut made = begin(&path);
    made.rows(0, 3);
    made.writer.flush().unwrap();
    made.kill();
    let new = directory.path().join("run.mcap.new");
    std::fs::write(&new, "notes").unwrap();
    let error = complete(&path).unwrap_err();
    assert!(matches!(error, RecordingError::NotMcap { .. }), "{error}");
    assert_eq!(std::fs::read(&new).unwrap(), b"notes");
    // What a completion leaves that is killed.
    std::fs::write(&new, &mcap::MAGIC[..5]).unwrap();
    complete(&path).unwrap();
    assert!(!new.exists());
    assert_eq!(check(&path), [3, 0]);
}

#[test]
fn a_recording_that_is_moved_leaves_the_counts_of_the_next_alone() {
    let (directory, path) = place();
    let night = directory.path().join("night.mcap");
    let mut moved = begin(&path);
    moved.rows(0, 3);
    std::fs::rename(&path, &night).unwrap();
    let mut next = begin(&path);
    next.rows(0, 5);
    moved.rows(0, 4);
    moved.writer.end().unwrap();
    assert_eq!(check(&night), [7, 0]);
    next.writer.flush().unwrap();
    next.rows(0, 2);
    next.kill();
    complete(&path).unwrap();
    let [rows, _] = check(&path);
    let reader = RecordingReader::open(&path).unwrap();
    assert_eq!(reader.sources()[0].dropped, Some(7 - rows));
}

#[test]
fn counts_of_another_recording_are_ignored() {
    let (_directory, path) = place();
    let counts = beside(&path, ".taken");
    let mut other = begin(&path);
    other.rows(0, 9);
    let of_other = std::fs::read(&counts).unwrap();
    other.writer.end().unwrap();
    std::fs::remove_file(&path).unwrap();
    let mut made = begin(&path);
    made.rows(0, 3);
    made.writer.flush().unwrap();
    made.kill();
    std::fs::write(&counts, &of_other).unwrap();
    assert_eq!(complete(&path).unwrap().topics[1].dropped, None);
    assert_eq!(std::fs::read(&counts).unwrap(), of_other);
}

#[derive(Clone, Copy, Debug)]
enum Step {
    Rows(usize, u64),
    Flush,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let rows = (0..2_usize, 1..50_u64).prop_map(|(source, count)| Step::Rows(source, count));
    proptest::collection::vec(prop_oneof![4 => rows, 1 => Just(Step::Flush)], 0..20)
}

proptest! {
    #[test]
    fn what_a_killed_recorder_dropped_is_counted(steps in steps()) {
        let (_directory, path) = place();
        let mut made = begin(&path);
        let mut flushed = [0; 2];
        for step in steps {
            match step {
                Step::Rows(source, count) => made.rows(source, count),
                Step::Flush => {
                    made.writer.flush().unwrap();
                    flushed = made.taken;
                }
            }
        }
        let taken = made.kill();
        complete(&path).unwrap();
        let rows = check(&path);
        let reader = RecordingReader::open(&path).unwrap();
        for (source, place) in reader.sources().iter().zip(0..) {
            // A slow machine flushes by itself.
            prop_assert!(rows[place] >= flushed[place]);
            prop_assert_eq!(source.dropped, Some(taken[place] - rows[place]));
        }
    }

    #[test]
    fn a_damaged_file_is_an_error_and_what_is_whole_is_kept(
        flips in proptest::collection::vec(
            (any::<prop::sample::Index>(), prop_oneof![Just(0x80), any::<u8>()]), 1..4
        ),
        is_ended: bool,
    ) {
        let (_directory, path) = place();
        let mut made = begin(&path);
        made.rows(0, 20);
        made.writer.event(7, Level::Info, "a", "restarted");
        made.writer.flush().unwrap();
        made.rows(0, 20);
        if is_ended {
            made.writer.end().unwrap();
        } else {
            made.writer.flush().unwrap();
            made.kill();
        }
        let mut bytes = std::fs::read(&path).unwrap();
        for (place, byte) in flips {
            let place = place.index(bytes.len());
            bytes[place] ^= byte;
        }
        std::fs::write(&path, &bytes).unwrap();
        // Whatever it says, nothing panics, and no memory is taken that the file has no bytes for.
        if let Ok(reader) = RecordingReader::open(&path) {
            let numbers: Vec<_> = (0..reader.sources().len()).collect();
            let _ = reader.rows(&numbers, reader.span(), |_, _, _| Ok::<_, RecordingError>(()));
            let _ = reader.events(reader.span());
        }
        // Only a file that begins as another one does cannot be completed.
        match complete(&path) {
            Err(RecordingError::NotMcap { .. } | RecordingError::Compression { .. }) => {}
            other => {
                other.unwrap();
                prop_assert!(complete(&path).unwrap().was_complete);
            }
        }
    }

    #[test]
    fn records_that_fit_are_read_within_what_they_have(opcode in 1..16_u8, body: Vec<u8>) {
        if records::fits(opcode, &body) {
            // It aborts if it takes more than there is.
            let _ = mcap::parse_record(opcode, &body);
        }
    }
}

#[test]
fn a_fifo_is_refused_at_once() {
    let place = tempfile::tempdir().unwrap();
    let fifo = place.path().join("fifo");
    let made = std::process::Command::new("mkfifo").arg(&fifo).status();
    assert!(made.unwrap().success());
    let reads: [fn(&Path) -> String; 2] = [
        |fifo| RecordingReader::open(fifo).unwrap_err().to_string(),
        |fifo| complete(fifo).unwrap_err().to_string(),
    ];
    let (sender, receiver) = mpsc::channel();
    for read in reads {
        // A read that waits for ever must not take the test with it.
        let (fifo, sender) = (fifo.clone(), sender.clone());
        std::thread::spawn(move || sender.send(read(&fifo)).unwrap());
        let told = receiver.recv_timeout(Duration::from_secs(60)).unwrap();
        assert!(told.contains("it is a FIFO, not a regular file"), "{told}");
        assert!(told.contains("fifo"), "{told}");
    }
}
