//! Descriptions of systems.

mod description;
