//! Small linear algebra that gives the same bits on every target.
//!
//! Only additions, multiplications and divisions, in an order that is written down here.

mod ldl;
mod symmetric;

pub use ldl::Ldl;
pub use symmetric::Symmetric3;
