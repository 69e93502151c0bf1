//! A frame must not touch the heap: the allocator's worst case is in no bound.

use gripline_network::{Evaluation, ForceNetwork, InstructionSet, downsample_440_to_88};

#[test]
fn a_frame_allocates_nothing() {
    let crop: Vec<u8> = (0..440 * 440).map(|i| (i % 251) as u8).collect();
    let (mut now, mut forces_n) = ([0; 7744], [[0.0; 3]; 400]);
    for set in InstructionSet::ALL.into_iter().filter(|set| set.is_available()) {
        for evaluation in [Evaluation::Dense, Evaluation::Skip] {
            let build = || {
                let network = ForceNetwork::embedded().unwrap().with_evaluation(evaluation);
                network.with_instructions(set).unwrap()
            };
            let mut network = build();
            let counted = allocation_counter::measure(|| {
                network.set_rest(&[30; 7744]);
                downsample_440_to_88(&crop, &mut now);
                network.infer(&now, &mut forces_n);
                network.infer(&now, &mut forces_n);
                now[4000] ^= 1;
                network.infer(&now, &mut forces_n);
            });
            assert_eq!(counted.count_total, 0, "{set}, {evaluation:?}");
            // The counter counts: building the network allocates.
            assert!(allocation_counter::measure(|| drop(build())).count_total > 0);
        }
    }
}
