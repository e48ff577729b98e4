//! Rain for a radar: what it takes and what it sends back. Fog and dry snow do neither.

/// Frequencies for which there are numbers, GHz.
pub(super) const BAND_GHZ: [f64; 2] = [24.0, 81.0];

/// ITU-R P.838-3, vertical polarisation: a, b and c of each term of `log10 k`, then its slope and
/// its constant in `log10 f`.
const K_TERMS: [[f64; 3]; 4] = [
    [-3.80595, 0.56934, 0.81061],
    [-3.44965, -0.22911, 0.51059],
    [-0.39902, 0.73042, 0.11899],
    [0.50167, 1.07319, 0.27195],
];
const K_LINE: [f64; 2] = [-0.16398, 0.63297];
/// Terms of the fit of alpha.
const ALPHA_TERMS: [[f64; 3]; 5] = [
    [-0.07771, 2.33840, -0.76284],
    [0.56727, 0.95545, 0.54039],
    [-0.20238, 1.14520, 0.26809],
    [-48.2991, 0.791669, 0.116226],
    [48.5833, 0.791459, 0.116479],
];
const ALPHA_LINE: [f64; 2] = [-0.053739, 0.83433];

/// Attenuation by rain at a frequency, GHz, one way: k and alpha of `k R^alpha` dB/km with the rate
/// R in mm/h (ITU-R P.838-3, vertical polarisation).
fn rain_coefficients(frequency: f64) -> [f64; 2] {
    let log = frequency.log10();
    let sum = |terms: &[[f64; 3]], [slope, constant]: [f64; 2]| {
        let bells = terms.iter().map(|[a, b, c]| a * (-((log - b) / c).powi(2)).exp());
        bells.sum::<f64>() + slope * log + constant
    };
    [10f64.powf(sum(&K_TERMS, K_LINE)), sum(&ALPHA_TERMS, ALPHA_LINE)]
}

/// Attenuation by rain of a rate, mm/h, one way, dB/km.
pub(crate) fn rain_attenuation(frequency: f64, rate: f64) -> f64 {
    let [k, alpha] = rain_coefficients(frequency);
    if rate > 0.0 { k * rate.powf(alpha) } else { 0.0 }
}

/// Rates of the table of clutter, mm/h.
const CLUTTER_RATES_MM_H: [f64; 6] = [1.0, 2.5, 10.0, 25.0, 50.0, 100.0];
/// RCS of rain, m^2/m^3, at 24 and at 76.5 GHz: by Mie's theory over the sizes of drops of Marshall
/// and Palmer.
const CLUTTER_TABLE: [(f64, [f64; 6]); 2] = [
    (24.0, [3.8e-6, 1.5e-5, 1.1e-4, 3.7e-4, 8.5e-4, 1.9e-3]),
    (76.5, [8.8e-5, 1.9e-4, 5.5e-4, 1.0e-3, 1.6e-3, 2.5e-3]),
];

/// RCS of rain of a rate, mm/h, in a volume, m^2/m^3: between the lines and columns of the table by
/// logarithms; rates beyond it go on as between the last two, frequencies do not.
pub(crate) fn rain_reflectivity(frequency: f64, rate: f64) -> f64 {
    if rate <= 0.0 {
        return 0.0;
    }
    let pair = CLUTTER_RATES_MM_H[1..5].partition_point(|known| *known < rate);
    let share = (rate / CLUTTER_RATES_MM_H[pair]).ln()
        / (CLUTTER_RATES_MM_H[pair + 1] / CLUTTER_RATES_MM_H[pair]).ln();
    let of = |row: &[f64; 6]| row[pair].ln() + share * (row[pair + 1] / row[pair]).ln();
    let [(low, first), (high, second)] = CLUTTER_TABLE;
    let across = ((frequency / low).ln() / (high / low).ln()).clamp(0.0, 1.0);
    (of(&first) * (1.0 - across) + of(&second) * across).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of the recommendation that were computed apart from this code.
    #[test]
    fn attenuation_is_that_of_the_recommendation() {
        for (frequency, k, alpha) in
            [(24.125, 0.1420, 0.9552), (76.5, 1.1208, 0.7082), (79.0, 1.1541, 0.7038)]
        {
            let found = rain_coefficients(frequency);
            assert!((found[0] - k).abs() < 1e-4 && (found[1] - alpha).abs() < 1e-4, "{frequency}: {found:?}");
        }
        assert_eq!(rain_attenuation(77.0, 0.0), 0.0);
    }

    #[test]
    fn reflectivity_goes_through_its_table() {
        for (frequency, row) in CLUTTER_TABLE {
            for (rate, known) in CLUTTER_RATES_MM_H.iter().zip(row) {
                assert!(
                    (rain_reflectivity(frequency, *rate) / known - 1.0).abs() < 1e-9,
                    "{frequency} {rate}"
                );
            }
        }
        let between = rain_reflectivity(45.0, 15.0);
        assert!((1.1e-4..1e-3).contains(&between), "{between}");
        assert!(rain_reflectivity(77.0, 0.1) < 8.8e-5 && rain_reflectivity(77.0, 200.0) > 2.5e-3);
        assert_eq!(rain_reflectivity(77.0, 0.0), 0.0);
    }
}
