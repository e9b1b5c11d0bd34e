//! Published cells whose fields show.

use core::mem::offset_of;

use condor_mbox::published::PublishedReadError;
use condor_mbox::sim::SimWindow;
use condor_mbox::{Allocator, MemoryWindow, Region};
use condor_vars::{
    AnyValue, CatalogError, Cell, CellError, CellField, CellStruct, ValueKind, VariableTableError,
    describe,
};
use zerocopy::{Immutable, IntoBytes};

#[derive(IntoBytes, Immutable)]
#[repr(C)]
struct Grasp {
    force: f64,
    gains: [i16; 3],
    contacts: u8,
    state: u8,
}

impl CellStruct for Grasp {
    const FIELDS: &'static [CellField] = &[
        CellField::new("state", "", ValueKind::U8, offset_of!(Grasp, state)),
        CellField::new("gain", "N/m", ValueKind::I16, offset_of!(Grasp, gains)).repeated(3),
        CellField::new("force", "N", ValueKind::F64, offset_of!(Grasp, force)).about("At the tip."),
    ];
}

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

#[derive(IntoBytes, Immutable)]
#[repr(C)]
struct Short(u32);

impl CellStruct for Short {
    const FIELDS: &'static [CellField] = &[CellField::new("beyond", "", ValueKind::F64, 0)];
}

#[test]
fn a_field_outside_of_the_value_is_refused() {
    let own = Region::whole(SimWindow::new(4096));
    let mut allocator = Allocator::new(own.size());
    let cell = allocator.published::<Short>().unwrap();
    let refused = describe(cell, &own, &mut allocator);
    assert_eq!(refused, Err(CatalogError::Block { block: 0, words: 1 }));
}
