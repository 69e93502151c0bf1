//! Contestants that take turns, and the distribution of each one's times.

use std::time::Instant;

/// Timed calls per turn, after one that warms the caches.
const CALLS: usize = 10;

/// Something to time.
pub(crate) struct Contestant {
    name: String,
    /// Comes before each call, and is not timed.
    before: Box<dyn FnMut()>,
    call: Box<dyn FnMut()>,
}

impl Contestant {
    pub(crate) fn new(name: &str, call: impl FnMut() + 'static) -> Self {
        Self::after(name, || (), call)
    }

    /// With something that is not timed before each call.
    pub(crate) fn after(name: &str, before: impl FnMut() + 'static, call: impl FnMut() + 'static) -> Self {
        Self {
            name: name.to_owned(),
            before: Box::new(before),
            call: Box::new(call),
        }
    }
}

/// A contestant's times, microseconds.
pub(crate) struct Times {
    pub(crate) name: String,
    sorted_us: Vec<f64>,
}

impl Times {
    /// The time that a share of the calls stayed below.
    pub(crate) fn quantile_us(&self, share: f64) -> f64 {
        self.sorted_us[((self.sorted_us.len() - 1) as f64 * share).round() as usize]
    }

    pub(crate) fn median_us(&self) -> f64 {
        self.quantile_us(0.5)
    }
}

/// Lets every contestant have `rounds` turns, one after the other.
pub(crate) fn take_turns(contestants: &mut [Contestant], rounds: usize) -> Vec<Times> {
    let mut times: Vec<Vec<f64>> = vec![Vec::with_capacity(rounds * CALLS); contestants.len()];
    for _ in 0..rounds {
        for (contestant, times) in contestants.iter_mut().zip(&mut times) {
            (contestant.before)();
            (contestant.call)();
            for _ in 0..CALLS {
                (contestant.before)();
                let start = Instant::now();
                (contestant.call)();
                times.push(start.elapsed().as_secs_f64() * 1e6);
            }
        }
    }
    contestants
        .iter()
        .zip(times)
        .map(|(contestant, mut times)| {
            times.sort_unstable_by(f64::total_cmp);
            Times {
                name: contestant.name.clone(),
                sorted_us: times,
            }
        })
        .collect()
}
