//! Values as Python has them.

use condor_host::watching::{CatalogEntry, Type};
use condor_vars::{AnyValue, ValueKind};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use serde_json::{Value as Json, json};

/// A value of a variable, as Python gets it.
#[derive(Clone, Debug)]
pub(crate) enum PythonValue {
    Float(f64),
    Int(i64),
    Uint(u64),
    Bool(bool),
    Label(String),
}

impl PythonValue {
    pub(crate) fn of(of: &Type, value: AnyValue) -> Self {
        match value {
            // The shortest text that is this value, as everywhere.
            AnyValue::F32(short) => {
                Self::Float(of.text(value).parse().unwrap_or_else(|_| short.into()))
            }
            AnyValue::F64(value) => Self::Float(value),
            AnyValue::Int(value) => Self::Int(value),
            AnyValue::Uint(value) => Self::Uint(value),
            AnyValue::Bool(value) => Self::Bool(value),
            AnyValue::Choice(number) => match of.labels.get(number as usize) {
                Some(label) => Self::Label(label.clone()),
                None => Self::Uint(number.into()),
            },
        }
    }
}

impl<'py> IntoPyObject<'py> for PythonValue {
    type Target = PyAny;
    type Output = Bound<'py, PyAny>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Self::Output> {
        match self {
            Self::Float(value) => value.into_bound_py_any(py),
            Self::Int(value) => value.into_bound_py_any(py),
            Self::Uint(value) => value.into_bound_py_any(py),
            Self::Bool(value) => value.into_bound_py_any(py),
            Self::Label(value) => value.into_bound_py_any(py),
        }
    }
}

/// Returns two types of numpy for a kind of values: that of the stored words, and that of the values in Python.
pub(crate) const fn types(kind: ValueKind) -> (&'static str, &'static str) {
    match kind {
        ValueKind::F32 => ("<f4", "float32"),
        ValueKind::F64 => ("<f8", "float64"),
        ValueKind::I8 => ("<i4", "int8"),
        ValueKind::I16 => ("<i4", "int16"),
        ValueKind::I32 => ("<i4", "int32"),
        ValueKind::I64 => ("<i8", "int64"),
        ValueKind::U8 => ("<u4", "uint8"),
        ValueKind::U16 => ("<u4", "uint16"),
        ValueKind::U32 | ValueKind::Choice => ("<u4", "uint32"),
        ValueKind::U64 => ("<u8", "uint64"),
        ValueKind::Bool => ("<u4", "bool"),
    }
}

/// Describes a variable, a parameter or a field as JSON. `name` is the name by which Python calls it.
pub(crate) fn described(one: &CatalogEntry, name: &str) -> Json {
    let bounds = one.entry.bounds;
    json!({
        "name": name,
        "processor": one.member.name,
        "owner": *one.owner,
        "type": one.of.to_string(),
        "unit": one.entry.unit.to_string(),
        "about": one.entry.about.to_string(),
        "is_parameter": one.can_be_set(),
        "is_field": one.is_field(),
        "bounds": bounds.map(|both| both.map(|bound| one.of.json(bound))),
        "labels": one.of.labels,
    })
}
