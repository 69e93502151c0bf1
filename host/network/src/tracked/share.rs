//! One picture's work, shared by the threads of the pool that the caller's thread belongs to, if it belongs to one.

use super::dirty_tiles::DirtyTiles;

/// Calls `work` on all of `items`, in parts of at most `at_once` for which free threads of the pool are woken. On all at once where few
/// tiles of the picture are `dirty`, outside of a pool, and in one of a single thread.
pub(super) fn share<T: Send>(
    items: &mut [T],
    at_once: usize,
    dirty: &DirtyTiles,
    work: &(impl Fn(&mut [T]) + Sync),
) {
    let has_help = || rayon_core::current_thread_index().is_some() && rayon_core::current_num_threads() > 1;
    if items.len() > at_once && !dirty.are_few() && has_help() {
        let (left, right) = items.split_at_mut(items.len() / 2);
        rayon_core::join(
            || share(left, at_once, dirty, work),
            || share(right, at_once, dirty, work),
        );
    } else {
        work(items);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::sync::Mutex;
    use std::time::{Duration, Instant};

    use super::super::dirty_tiles::TILES;
    use super::*;

    /// The sizes of the parts of 50 items, and how many of the pool's threads worked on them.
    fn shared(at_once: usize, dirty: &DirtyTiles, threads: usize) -> (Vec<usize>, usize) {
        let mut items = [0; 50];
        let parts = Mutex::new(Vec::new());
        let workers = Mutex::new(BTreeSet::new());
        let count = || workers.lock().unwrap().len();
        let begun = Instant::now();
        let mut task = || {
            share(&mut items, at_once, dirty, &|part: &mut [i32]| {
                for item in &mut *part {
                    *item += 1;
                }
                parts.lock().unwrap().push(part.len());
                workers.lock().unwrap().insert(rayon_core::current_thread_index());
                // The others have all the time that they need to come.
                while part.len() < 50 && count() < threads && begun.elapsed() < Duration::from_secs(20) {
                    std::thread::yield_now();
                }
            });
        };
        if threads == 0 {
            task();
        } else {
            let pool = rayon_core::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.unwrap().install(task);
        }
        assert_eq!(items, [1; 50]);
        (parts.into_inner().unwrap(), workers.into_inner().unwrap().len())
    }

    #[test]
    fn in_a_pool_all_threads_work_on_small_parts_and_elsewhere_all_is_one() {
        let all = DirtyTiles::all();
        let (parts, threads) = shared(8, &all, 3);
        assert!(parts.iter().all(|&part| (3..=8).contains(&part)), "{parts:?}");
        assert_eq!(threads, 3);
        let whole = (vec![50], 1);
        assert_eq!(shared(8, &all, 0), whole, "no pool");
        assert_eq!(shared(8, &all, 1), whole, "a pool of one");
        assert_eq!(shared(50, &all, 3), whole, "one part");
        let mut few = [[false; TILES]; TILES];
        few[7][9] = true;
        assert_eq!(
            shared(8, &DirtyTiles::of(&few), 3),
            whole,
            "hardly anything changed"
        );
    }
}
