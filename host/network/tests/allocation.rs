//! A frame must not touch the heap: the allocator's worst case is in no bound.

use gripline_network::{ForceNetwork, downsample_440_to_88};

#[test]
fn a_frame_allocates_nothing() {
    let mut network = ForceNetwork::embedded().unwrap();
    let crop: Vec<u8> = (0..440 * 440).map(|i| (i % 251) as u8).collect();
    let (mut now, mut forces_n) = ([0; 7744], [[0.0; 3]; 400]);
    network.set_rest(&[30; 7744]);
    let counted = allocation_counter::measure(|| {
        downsample_440_to_88(&crop, &mut now);
        network.infer(&now, &mut forces_n);
    });
    assert_eq!(counted.count_total, 0);
    // The counter counts: taking a rest image is allowed to allocate, and does.
    assert!(allocation_counter::measure(|| network.set_rest(&now)).count_total > 0);
}
