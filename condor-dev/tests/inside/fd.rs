//! The table of descriptors.

use super::{Fd, FdError, FdTable, Mode};

#[test]
fn every_misuse_has_its_error() {
    let table = FdTable::<2>::new();
    let fd = table.insert(4095, Mode::READ).unwrap();
    let entry = table.get(fd, Mode::READ).unwrap();
    assert_eq!(entry.slot(), 4095);
    assert_eq!(
        table.get(fd, Mode::WRITE),
        Err(FdError::Direction {
            fd,
            wanted: Mode::WRITE,
            opened: Mode::READ
        })
    );
    table.hold(fd, 1);
    assert_eq!(table.remove(fd), Err(FdError::InUse { fd }));
    table.hold(fd, -1);
    table.remove(fd).unwrap();
    assert_eq!(table.get(fd, Mode::READ), Err(FdError::Closed { fd }));
    let again = table.insert(0, Mode::READ).unwrap();
    assert_eq!((again.number(), again.generation()), (0, 1));
    assert_eq!(table.remove(fd), Err(FdError::Closed { fd }));
    let foreign = Fd::new(2, 0);
    assert_eq!(
        table.get(foreign, Mode::READ),
        Err(FdError::Closed { fd: foreign })
    );
    assert!(table.insert(0, Mode::WRITE).is_some());
    assert!(table.insert(0, Mode::WRITE).is_none());
}
