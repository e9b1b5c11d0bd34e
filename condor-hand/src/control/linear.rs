//! Small linear algebra that gives the same bits on every target.
//!
//! Only additions, multiplications and divisions, in an order that is written down here.

mod cofactors;
mod inertia;
mod ldl;
mod tridiagonal;

pub use cofactors::Cofactors;
pub use inertia::{Inertia, inertia, is_positive_semidefinite};
pub use ldl::Ldl;
pub use tridiagonal::solve_tridiagonal;
