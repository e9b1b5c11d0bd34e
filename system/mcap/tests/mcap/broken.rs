//! What is no file, or a part of one.

use condor_mcap::{McapError, McapReader, McapWriter, MessageHead};
use proptest::collection::vec;
use proptest::prelude::*;

/// Reads a file to its end, or to an error.
fn read(file: &[u8], room: usize) -> Result<(), McapError<core::convert::Infallible>> {
    let (mut reader, mut buffer) = (McapReader::new(file)?, vec![0; room]);
    while reader.next(&mut buffer)?.is_some() {}
    Ok(())
}

fn file() -> Vec<u8> {
    let mut writer = McapWriter::new(Vec::new(), "", "test").unwrap();
    writer.channel(1, 0, "/a", "cdr", &[]).unwrap();
    let message = MessageHead {
        channel: 1,
        sequence: 1,
        log_time_ns: 1,
    };
    writer.message(&message, &[&[0; 40]]).unwrap();
    writer.end().unwrap()
}

#[test]
fn a_file_that_is_cut_off_anywhere_is_an_error() {
    let file = file();
    assert_eq!(read(&file, 128), Ok(()));
    for len in 0..file.len() {
        assert_eq!(read(&file[..len], 128), Err(McapError::BrokenOff), "{len}");
    }
}

#[test]
fn what_is_wrong_is_named() {
    let good = file();
    let channel = 8 + 9 + 4 + 4 + 4;
    let changed = |at: usize, byte: u8| {
        let mut file = good.clone();
        file[at] = byte;
        file
    };
    assert_eq!((good[channel], good.len()), (0x04, 180));
    let magic = read(&changed(0, b'M'), 128).unwrap_err();
    assert_eq!(
        magic.to_string(),
        "it is not an MCAP file: it begins with [4d, 4d, 43, 41, 50, 30, 0d, 0a]"
    );
    let (opcode, bytes) = (0x04, 21);
    assert_eq!(
        read(&changed(channel + 9 + 4, 200), 128),
        Err(McapError::Invalid { opcode, bytes })
    );
    assert_eq!(
        read(&good, 16),
        Err(McapError::Room {
            opcode,
            bytes,
            room: 16
        })
    );
    assert_eq!(read(&changed(channel, 0x06), 128), Err(McapError::Chunk));
    let end = good.len() - 1;
    let (opcode, bytes) = (0x02, 20);
    assert_eq!(
        read(&changed(end, b'!'), 128),
        Err(McapError::Invalid { opcode, bytes })
    );
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(
        bytes in vec(any::<u8>(), 0..300),
        changes in vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        room in 0..200_usize,
    ) {
        let _ = read(&bytes, room);
        #[cfg(feature = "hostile")]
        condor_mcap::hostile::reader(&bytes);
        let mut file = file();
        for (at, byte) in changes {
            let at = at.index(file.len());
            file[at] = byte;
        }
        let _ = read(&file, room);
        #[cfg(feature = "hostile")]
        condor_mcap::hostile::reader(&file);
    }
}
