//! What sysfs says of UIO devices.

use super::{BusMapError, UioMemory};

#[test]
fn the_description_of_a_uio_device_gives_the_range() {
    let page = rustix::param::page_size() as u64;
    let directory = tempfile::tempdir().expect("a temporary directory");
    let describe = |address: &str, size: &str, offset: &str| {
        for (name, text) in [("addr", address), ("size", size), ("offset", offset)] {
            std::fs::write(directory.path().join(name), text).expect("it is written");
        }
        UioMemory::read(directory.path(), 2)
    };
    let expected = UioMemory {
        offset: 2 * page + 0x10,
        base: 0xfe00_0010,
        len: 0x1000,
    };
    let found = describe("0xfe000000\n", "0x0000000000001000\n", "0x10\n");
    assert_eq!(found.expect("it is well-formed"), expected);
    let older = describe("0xfe000010\n", "0x1000\n", "0x10\n");
    assert_eq!(older.expect("it is well-formed"), expected);
    let error = describe("none\n", "0x1\n", "0x0\n").expect_err("it is no number");
    assert!(matches!(error, BusMapError::System { .. }), "{error}");
}
