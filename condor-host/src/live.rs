//! `condor live`: a running system for viewers that speak the Foxglove websocket protocol.

mod connection;
#[cfg(test)]
mod hostile;
mod protocol;
mod session;
