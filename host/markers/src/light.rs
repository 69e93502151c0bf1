//! Lamps that drift: the part of an imprint that a slow change of the light explains, a polynomial of second degree over the
//! picture. Pure.

/// Monomials up to the second degree.
const POWERS: [[i32; 2]; 6] = [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]];

/// Takes the light's share out of a channel.
#[derive(Debug, Clone)]
pub(crate) struct LightField {
    /// Orthonormal over the pixels.
    basis: Vec<Vec<f32>>,
}

impl LightField {
    /// For channels of `width`×`height` pixels.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let mut basis: Vec<Vec<f32>> = Vec::new();
        for [i, j] in POWERS {
            let place = |at: usize, of: usize| (2 * at + 1) as f32 / of as f32 - 1.0;
            let mut field: Vec<f32> = (0..width * height)
                .map(|pixel| place(pixel % width, width).powi(i) * place(pixel / width, height).powi(j))
                .collect();
            for other in &basis {
                subtract(&mut field, other);
            }
            let length = dot(&field, &field).sqrt();
            for value in &mut field {
                *value /= length;
            }
            basis.push(field);
        }
        Self { basis }
    }

    /// Subtracts the field that fits the channel best.
    pub(crate) fn remove(&self, channel: &mut [f32]) {
        for field in &self.basis {
            subtract(channel, field);
        }
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    // Eight sums side by side: one would wait for each addition.
    let mut sums = [0.0f32; 8];
    let (a_parts, b_parts) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a_parts.0.iter().zip(b_parts.0) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f32 = a_parts.1.iter().zip(b_parts.1).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + rest
}

fn subtract(from: &mut [f32], unit: &[f32]) {
    let share = dot(from, unit);
    for (value, unit) in from.iter_mut().zip(unit) {
        *value -= share * unit;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curved_light_leaves_nothing_and_an_imprint_stays() {
        let light = LightField::new(40, 30);
        let curved = |pixel: usize| {
            let (x, y) = ((pixel % 40) as f32, (pixel / 40) as f32);
            3.0 - 0.2 * x + 0.1 * y + 0.01 * x * x - 0.02 * x * y
        };
        let mut channel: Vec<f32> = (0..1200).map(curved).collect();
        light.remove(&mut channel);
        assert!(channel.iter().all(|value| value.abs() < 1e-3));

        let imprint = |pixel: usize| if (500..510).contains(&pixel) { 20.0 } else { 0.0 };
        let mut channel: Vec<f32> = (0..1200).map(|pixel| curved(pixel) + imprint(pixel)).collect();
        light.remove(&mut channel);
        assert!(channel[505] > 18.0, "{}", channel[505]);
    }
}
