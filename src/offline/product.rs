//! Sums of products of two columns.
//!
//! Invariant: of the same columns the same sum, to the bit.

use nalgebra::DVectorView;

/// Sum of products, in which no row waits for the one before it.
pub(super) fn product(a: &[f64], b: &[f64]) -> f64 {
    DVectorView::from_slice(a, a.len()).dot(&DVectorView::from_slice(b, b.len()))
}
