#![doc = include_str!("../README.md")]
#![cfg_attr(not(feature = "std"), no_std)]

#[cfg(test)]
extern crate std;

// Documents of their own.
#[cfg(all(feature = "linux", target_os = "linux"))]
pub mod server;
pub mod wire;

// Functions that tests and fuzz targets call with arbitrary bytes.
#[cfg(all(feature = "hostile", target_os = "linux"))]
#[doc(hidden)]
pub mod hostile;

mod client;
mod errno;

pub use client::{
    AllocationMode, Area, Buffer, BufferError, BufferResult, Directory, DirectoryEntry, File,
    FileError, FileSystem, FileTicket, OpenOptions, OperationResult, Receipt,
};
/// The traits that files and buffers implement, so that a program needs no dependency on embedded-io.
pub use embedded_io::{BufRead, Read, Seek, SeekFrom, Write};
pub use errno::Errno;
pub use wire::{FileStatus, SetTime, Space, Times};
