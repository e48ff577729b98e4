//! The derivative of a splat's colour, for training: by its coefficients and by the direction in
//! which it is seen.
//!
//! Contract, with the names of [`super::shade`] and `v_c` the derivative of the loss by channel c
//! of the colour, 0 where the colour was clamped at 0:
//!
//! Through [`EvenAir`](crate::EvenAir) `v_c` is multiplied by the factor that the colour had.
//!
//! - `dL/dsh_kc = basis_k(d) v_c`.
//! - `dL/dd = sum_k grad basis_k(d) sum_c sh_kc v_c`, with the basis functions taken as polynomials
//!   of `d`; projecting on the sphere is [`super::project_backward`]'s.
//!
//! Tolerance: sums of up to 45 products, relative 3e-6 of the largest.

pub(crate) mod cpu;
#[cfg(test)]
mod tests;
