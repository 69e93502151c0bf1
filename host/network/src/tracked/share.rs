//! One picture's work, shared by the threads of the pool that the caller's thread belongs to, if it belongs to one.

/// Calls `work` on all of `items`, in parts of at most `at_once` for which free threads of the pool are woken. Outside of a pool, or of
/// one thread, on all at once.
pub(super) fn share<T: Send>(items: &mut [T], at_once: usize, work: &(impl Fn(&mut [T]) + Sync)) {
    let has_help = || rayon_core::current_thread_index().is_some() && rayon_core::current_num_threads() > 1;
    if items.len() > at_once && has_help() {
        let (left, right) = items.split_at_mut(items.len() / 2);
        rayon_core::join(|| share(left, at_once, work), || share(right, at_once, work));
    } else {
        work(items);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::sync::Mutex;
    use std::time::Duration;

    use super::*;

    /// The sizes of the parts, and the threads that worked on them.
    fn shared(count: usize, at_once: usize) -> (Vec<usize>, usize) {
        let mut items = vec![0; count];
        let parts = Mutex::new(Vec::new());
        let threads = Mutex::new(BTreeSet::new());
        share(&mut items, at_once, &|part: &mut [i32]| {
            for item in &mut *part {
                *item += 1;
            }
            parts.lock().unwrap().push(part.len());
            threads.lock().unwrap().insert(rayon_core::current_thread_index());
            std::thread::sleep(Duration::from_millis(20));
        });
        assert_eq!(items, vec![1; count]);
        (parts.into_inner().unwrap(), threads.into_inner().unwrap().len())
    }

    #[test]
    fn alone_all_is_one_part_and_in_a_pool_its_threads_work_on_small_ones() {
        let pool = |threads| {
            rayon_core::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
        };
        assert_eq!(shared(50, 8), (vec![50], 1));
        assert_eq!(pool(1).install(|| shared(50, 8)), (vec![50], 1));
        let (parts, threads) = pool(3).install(|| shared(50, 8));
        assert!(parts.iter().all(|&part| (3..=8).contains(&part)), "{parts:?}");
        // Parts that take this long are not all taken by one.
        assert!(threads > 1, "{threads}");
        assert_eq!(pool(3).install(|| shared(8, 8)), (vec![8], 1));
        assert_eq!(pool(3).install(|| shared(0, 8)), (vec![0], 1));
    }
}
