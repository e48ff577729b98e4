//! Quantiles of what is measured.

/// The value that a share (0 to below 1) of the values is below; `None` if there are none.
pub(super) fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    let at = (share * values.len() as f64) as usize;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(at, f64::total_cmp).1)
}

/// The middle value; `None` if there are none.
pub(super) fn median(values: Vec<f64>) -> Option<f64> {
    quantile(values, 0.5)
}
