//! Hostile configurations, and hostile users and sensors of a finger, made of bytes.
//!
//! Both the property tests and the fuzz targets include this module, hence no names of either.

pub(crate) mod configuration;
pub(crate) mod control;
mod source;

use std::sync::LazyLock;

use condor_hand::config::Hand;

pub(crate) type Shipped = Hand<4, 4>;

const TEXT: &str = include_str!("../../../hands/utah-mit.toml");

static HAND: LazyLock<Shipped> =
    LazyLock::new(|| Hand::from_toml(TEXT, "utah-mit.toml").expect("the shipped hand is read"));
