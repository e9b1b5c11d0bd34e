//! The table of descriptors.

use super::{Fd, FdError, FdTable, OpenMode};

#[test]
fn every_misuse_has_its_error() {
    let table = FdTable::<2>::new();
    let fd = table.insert(4095, OpenMode::READ).unwrap();
    let entry = table.get(fd, OpenMode::READ).unwrap();
    assert_eq!(entry.slot(), 4095);
    assert_eq!(
        table.get(fd, OpenMode::WRITE),
        Err(FdError::Direction {
            fd,
            wanted: OpenMode::WRITE,
            opened: OpenMode::READ
        })
    );
    table.hold(fd, 1);
    assert_eq!(table.remove(fd), Err(FdError::InUse { fd }));
    table.hold(fd, -1);
    table.remove(fd).unwrap();
    assert_eq!(table.get(fd, OpenMode::READ), Err(FdError::Closed { fd }));
    let again = table.insert(0, OpenMode::READ).unwrap();
    assert_eq!((again.number(), again.generation()), (0, 1));
    assert_eq!(table.remove(fd), Err(FdError::Closed { fd }));
    let foreign = Fd::new(2, 0);
    assert_eq!(
        table.get(foreign, OpenMode::READ),
        Err(FdError::Closed { fd: foreign })
    );
    assert!(table.insert(0, OpenMode::WRITE).is_some());
    assert!(table.insert(0, OpenMode::WRITE).is_none());
}
