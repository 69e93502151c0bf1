//! Complete elliptic integrals of the complementary modulus k' = √(1−t²) by the arithmetic–geometric mean
//! (Abramowitz and Stegun 17.6). Argument t in (0, 1].

use std::f64::consts::FRAC_PI_2;

/// K(k') and K(k') − E(k') at t; the difference is summed, not subtracted, so it stays exact near t = 1.
fn k_and_k_minus_e(t: f64) -> (f64, f64) {
    let (mut a, mut b) = (1.0, t);
    let mut power = 0.5;
    let mut sum = power * (1.0 - t * t);
    while (a - b).abs() > 1e-12 * a {
        let c = 0.5 * (a - b);
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
        power *= 2.0;
        sum += power * c * c;
    }
    let k = FRAC_PI_2 / a;
    (k, k * sum)
}

/// E(k') at t = √(1−k'²), 0 ≤ t ≤ 1.
pub(super) fn e_complement(t: f64) -> f64 {
    if t <= 0.0 {
        return 1.0;
    }
    let (k, difference) = k_and_k_minus_e(t.min(1.0));
    k - difference
}

/// K(k') − E(k') at t = √(1−k'²), 0 < t ≤ 1; it is the integral of E(k')/u from u = t to 1.
pub(super) fn k_minus_e_complement(t: f64) -> f64 {
    k_and_k_minus_e(t.min(1.0)).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_form::simpson;

    #[test]
    fn elliptic_integrals_match_their_defining_integrals() {
        for t in [0.02_f64, 0.3, 0.7, 0.999, 1.0] {
            let m = 1.0 - t * t;
            let e = simpson(0.0, FRAC_PI_2, 4000, |x| (1.0 - m * x.sin().powi(2)).sqrt());
            let k = simpson(0.0, FRAC_PI_2, 4000, |x| 1.0 / (1.0 - m * x.sin().powi(2)).sqrt());
            assert!((e_complement(t) - e).abs() < 1e-10);
            assert!((k_minus_e_complement(t) - (k - e)).abs() < 1e-9);
        }
    }
}
