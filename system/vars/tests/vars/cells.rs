//! Published cells whose fields show.

use condor_mbox::published::PublishedReadError;
use condor_mbox::sim::SimWindow;
use condor_mbox::{Allocator, MemoryWindow, Region};
use condor_vars::{AnyValue, Cell, CellError, VariableTableError, cell_struct, describe};
use zerocopy::{Immutable, IntoBytes};

#[derive(IntoBytes, Immutable)]
#[repr(C)]
struct Grasp {
    force: f64,
    gains: [i16; 3],
    contacts: u8,
    state: u8,
}

cell_struct!(Grasp {
    "state": state, "";
    "gain": gains, "N/m";
    "force": force, "N", "At the tip.";
});

#[test]
fn the_fields_of_a_cell_show() {
    let own = Region::whole(SimWindow::new(4096));
    let mut allocator = Allocator::new(own.size());
    let cell = allocator.published::<Grasp>().unwrap();
    let table = describe(cell, &own, &mut allocator).unwrap();
    let reader = Cell::open(&own, table).unwrap();
    let mut bytes = [0; 32];
    assert_eq!(
        reader.read(&mut bytes),
        Err(PublishedReadError::Unpublished.into())
    );
    let grasp = Grasp {
        force: 1.5,
        gains: [1, -2, 3],
        contacts: 0,
        state: 200,
    };
    cell.publisher(own.clone())
        .unwrap()
        .publish(&grasp)
        .unwrap();
    assert_eq!(reader.read(&mut bytes), Ok(1));
    let shown: Vec<_> = reader
        .table()
        .entries()
        .map(|entry| entry.unwrap())
        .map(|entry| (entry.name.to_string(), entry.of_cell(&bytes).unwrap()))
        .collect();
    let expected = [
        ("state", AnyValue::Uint(200)),
        ("gain.0", AnyValue::Int(1)),
        ("gain.1", AnyValue::Int(-2)),
        ("gain.2", AnyValue::Int(3)),
        ("force", AnyValue::F64(1.5)),
    ];
    assert_eq!(
        shown,
        expected.map(|(name, value)| (name.to_owned(), value))
    );
    let room = CellError::Room {
        bytes: 16,
        room: 15,
    };
    assert_eq!(reader.read(&mut bytes[..15]), Err(room));
    assert!(matches!(
        Cell::open(&own, 0),
        Err(CellError::Table(VariableTableError::NoTable { .. }))
    ));
}
