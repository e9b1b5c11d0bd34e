//! Hostile configurations, and hostile users and sensors of a finger, made of bytes.

mod configuration;
mod control;
mod source;

pub use configuration::run as configuration;
pub use control::run as control;

use std::sync::LazyLock;

use crate::config::Hand;

type Shipped = Hand<4, 4, 8>;

const TEXT: &str = include_str!("../../hands/utah-mit.toml");

static HAND: LazyLock<Shipped> =
    LazyLock::new(|| Hand::from_toml(TEXT, "utah-mit.toml").expect("the shipped hand is read"));
