//! The device switch, its buses, controllers, drivers and streams.
#![cfg(not(condor_loom))]

mod buffered_read;
mod buffered_write;
mod bus_errors;
mod buses_conform;
mod claim;
mod controllers_conform;
mod descriptors;
mod dispatch;
mod drivers;
mod flaky;
mod hostile;
mod linux_bus;
mod linux_i2c;
mod linux_uio;
mod parts;
mod plic;
mod ring;
mod serial;
mod stream;
mod switch;

use utah_mit_boards::hostile::boards;
