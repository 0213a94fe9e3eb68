//! The middle of some values.
//!
//! Invariant: one of the values, whatever single ones are far off.

/// The value that as many are below as above; of an even number the upper of two. The values change places.
pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_value_in_the_middle_whatever_the_order() {
        assert_eq!(median(&mut [3.0, -1.0, 2e9]), Some(3.0));
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), Some(3.0));
        assert_eq!(median(&mut []), None);
    }
}
