//! Small linear algebra with the same bits in the result on every target.
//!
//! Only additions, multiplications and divisions are used, in the order in which they are written here.

mod ldl;
mod symmetric;

pub use ldl::Ldl;
pub use symmetric::Symmetric3;
