//! Instruction counts of the unmodified image, on the emulated board.

use std::path::{Path, PathBuf};

use gripline_latency::image::Image;
use gripline_latency::measure::map_of;
use gripline_latency::snapshot::{Counter, count, text};
use gripline_protocol::ForceMap;

fn image() -> PathBuf {
    std::env::var_os("GRIPLINE_IMAGE")
        .expect("GRIPLINE_IMAGE names the image; `cargo xtask test` sets it")
        .into()
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn every_number_of_contacts_takes_the_instructions_of_the_snapshot() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/counts.txt");
    let expected = std::fs::read_to_string(&file).expect("the snapshot is committed");
    let found = text(&count(&image()).expect("the board runs"));
    for (found, expected) in found.lines().zip(expected.lines()) {
        assert_eq!(
            found, expected,
            "contacts, kernel, intake; if this is meant: cargo xtask latency --bless"
        );
    }
    assert_eq!(found.lines().count(), expected.lines().count());
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn the_work_on_a_map_depends_on_the_number_of_its_contacts_alone() {
    let elf = std::fs::read(image()).expect("the image is there");
    let image = Image::read(&elf).expect("the image is one");
    let mut counter = Counter::new(&image, &elf).expect("the board boots");
    for contacts in [0, 1, 2, 9, 10, 11, 20, 59, 150, 390, 399, 400] {
        let mut counts = Vec::new();
        // Forces and places at random, then all taxels in front and all at the end, of the least and the greatest force.
        for seed in 0..4 {
            counts.push(counter.count(&map_of(contacts, 1_000 + seed)));
        }
        for (first, force) in [(0, i16::MIN), (400 - contacts, i16::MAX)] {
            let mut map = ForceMap::EMPTY;
            for taxel in map.taxels.iter_mut().skip(first).take(contacts) {
                (taxel.x, taxel.y, taxel.z) = (force, force, force);
            }
            counts.push(counter.count(&map));
        }
        let counts: Vec<_> = counts
            .into_iter()
            .map(|count| count.expect("the board runs"))
            .collect();
        assert!(
            counts.iter().all(|count| *count == counts[0]),
            "{contacts} contacts: {counts:?}"
        );
    }
}
