//! Buffered input and output over any type that implements `embedded-io`, such as a file, or a board through a
//! [`DeviceStream`](crate::stream::DeviceStream) (A. I. Memo 977, section 3.1). Both buffers own what is behind them,
//! so that one can stand in the other:
//!
//! ```
//! use condor_dev::stdio::{BufReader, BufWriter, Buffering};
//! # struct Port(&'static [u8], Vec<u8>);
//! # impl embedded_io::ErrorType for Port { type Error = core::convert::Infallible; }
//! # impl embedded_io::Read for Port {
//! #     fn read(&mut self, into: &mut [u8]) -> Result<usize, Self::Error> { self.0.read(into) }
//! # }
//! # impl embedded_io::Write for Port {
//! #     fn write(&mut self, from: &[u8]) -> Result<usize, Self::Error> { self.1.extend(from); Ok(from.len()) }
//! #     fn flush(&mut self) -> Result<(), Self::Error> { Ok(()) }
//! # }
//! # let port = Port(b"open\nclose\n", Vec::new());
//! use embedded_io::{Read, Write};
//!
//! let mut port = BufWriter::<_, 64>::new(BufReader::<_, 64>::new(port), Buffering::Line);
//! let mut line = [0; 16];
//! assert_eq!(port.inner_mut().read_line(|byte| byte == b'\n', &mut line)?, "open\n");
//! writeln!(port, "joint {} is at {:.3} rad", 3, 0.25)?;
//! assert!(port.held().is_empty());
//! # Ok::<_, Box<dyn std::error::Error>>(())
//! ```

mod read;
mod write;

pub use read::{BufReader, LineError};
pub use write::{BufWriter, Buffering, WriteError};

/// Moves the bytes of `buffer` between `begin` and `end` to its front.
fn to_front(buffer: &mut [u8], begin: usize, end: usize) {
    for at in begin..end {
        let byte = buffer.get(at).copied().unwrap_or_default();
        if let Some(place) = buffer.get_mut(at - begin) {
            *place = byte;
        }
    }
}
