//! Both ends of a ring, in use by contexts that interrupt each other.

use std::cell::RefCell;

use super::everywhere;
use crate::ring::Ring;

/// A ring, what was accepted into it, and what was taken out.
struct World(Ring<4>, RefCell<Vec<u8>>, RefCell<Vec<u8>>);

impl World {
    /// With two bytes in it, having gone round once.
    fn new() -> Self {
        let this = Self(Ring::new(), RefCell::default(), RefCell::default());
        this.write(&[1, 2, 3]);
        this.read(3);
        this.write(&[4, 5]);
        this
    }

    fn write(&self, bytes: &[u8]) {
        if let Some(mut writer) = self.0.writer() {
            let count = writer.write(bytes);
            self.1.borrow_mut().extend(&bytes[..count]);
        }
    }

    fn read(&self, most: usize) {
        if let Some(mut reader) = self.0.reader() {
            let mut bytes = [0; 4];
            let count = reader.read(&mut bytes[..most]);
            self.2.borrow_mut().extend(&bytes[..count]);
        }
    }

    fn check(&self) {
        self.read(4);
        assert_eq!(self.1, self.2);
        // Both ends are free again.
        self.write(&[9]);
        self.read(1);
        assert_eq!(self.2.borrow().last(), Some(&9));
    }
}

#[test]
fn a_reader_is_interrupted_by_a_writer() {
    let write = |world: &World| world.write(&[6, 7, 8]);
    everywhere(World::new, write, |world| world.read(3), World::check);
}

#[test]
fn a_writer_is_interrupted_by_a_reader() {
    let read = |world: &World| world.read(2);
    let write = |world: &World| world.write(&[6, 7, 8]);
    everywhere(World::new, read, write, World::check);
}

#[test]
fn a_reader_is_interrupted_by_a_reader() {
    let read = |world: &World| world.read(1);
    everywhere(World::new, read, |world| world.read(2), World::check);
}

#[test]
fn a_writer_is_interrupted_by_a_writer() {
    let write = |world: &World| world.write(&[7]);
    everywhere(World::new, write, |world| world.write(&[6]), World::check);
}
