//! Updates of the modelled chip: what is in its flash at the end, whatever happens on the way.

use gripline_flash::dfu::Dfu;
use gripline_flash::error::FlashError;
use gripline_flash::image::{FLASH, Image, SETTINGS};
use gripline_flash::layout::sectors;
use gripline_flash::update::{Progress, Step, update};

use crate::image::{binary, identity};
use crate::model::{Chip, InjectedFault, LAYOUT, TRANSFER_BYTES};

fn image(fill: u8) -> Image {
    Image::read(&binary(identity(1), fill)).unwrap()
}

/// A chip that runs an older, longer image and has settings.
fn in_use() -> Chip {
    let mut chip = Chip::empty();
    let old = image(0x11);
    for part in &old.parts {
        let from = (part.address - FLASH) as usize;
        chip.flash[from..from + part.bytes.len()].copy_from_slice(&part.bytes);
    }
    chip.flash[0x1_4000..0x1_5000].fill(0x22);
    chip.flash[0x4000..0xC000].fill(0x77);
    chip
}

fn run(chip: Chip, image: &Image) -> (Chip, Result<Vec<Progress>, FlashError>) {
    let mut dfu = Dfu::new(chip, TRANSFER_BYTES);
    let mut steps = Vec::new();
    let result = update(&mut dfu, &sectors(LAYOUT).unwrap(), image, &mut |step| {
        steps.push(step);
    });
    (dfu.into_wire(), result.map(|()| steps))
}

fn holds(chip: &Chip, image: &Image) -> bool {
    image.parts.iter().all(|part| {
        let from = (part.address - FLASH) as usize;
        chip.flash[from..from + part.bytes.len()] == part.bytes
    })
}

fn settings_are_kept(chip: &Chip) -> bool {
    chip.flash[(SETTINGS.start - FLASH) as usize..(SETTINGS.end - FLASH) as usize]
        .iter()
        .all(|&byte| byte == 0x77)
}

#[test]
fn an_update_replaces_the_image_keeps_the_settings_and_starts() {
    let new = image(0x33);
    let (chip, result) = run(in_use(), &new);
    let steps = result.unwrap();
    assert!(holds(&chip, &new) && settings_are_kept(&chip) && chip.starts());
    assert_eq!(
        chip.erased,
        [FLASH, 0x0800_C000],
        "the vectors first, the settings never"
    );
    assert_eq!(chip.started, None, "whoever updates says when it starts");
    for step in [Step::Erase, Step::Write, Step::Verify] {
        let of_step: Vec<_> = steps.iter().filter(|one| one.step == step).collect();
        assert!(
            of_step.len() > 1 && of_step.is_sorted_by_key(|one| one.done),
            "{step:?}"
        );
    }
    assert!(chip.waited_ms > 0, "it waits as long as the chip asks for");
    let mut dfu = Dfu::new(chip, TRANSFER_BYTES);
    dfu.start(FLASH).unwrap();
    assert_eq!(dfu.into_wire().started, Some(FLASH));
}

#[test]
fn a_bootloader_that_another_program_left_in_an_error_is_taken_over() {
    let new = image(0x33);
    let (chip, result) = run(in_use().left_in_error(), &new);
    result.unwrap();
    assert!(holds(&chip, &new) && chip.starts());
}

/// The promise: at no instant does the chip hold a half image that starts, its settings are kept, and the next try succeeds.
#[test]
fn a_power_cut_at_any_request_leaves_the_old_image_or_none_that_starts_and_the_next_try_succeeds() {
    let (old, new) = (image(0x11), image(0x33));
    let (whole, result) = run(in_use(), &new);
    result.unwrap();
    let (mut old_kept, mut dead, mut done) = (0, 0, 0);
    for at_request in 0..whole.requests {
        for bytes in [0, 4, 5, 1_000, usize::MAX] {
            let mut chip = in_use();
            chip.fault = InjectedFault::PowerCut { at_request, bytes };
            let (chip, result) = run(chip, &new);
            let error = result.unwrap_err();
            assert!(
                matches!(&error, FlashError::Dfu { error, .. } if matches!(**error, FlashError::Gone { .. })),
                "{at_request}, {bytes}: {error}"
            );
            assert!(settings_are_kept(&chip), "{at_request}, {bytes}");
            if chip.starts() {
                assert!(
                    holds(&chip, &old) || holds(&chip, &new),
                    "{at_request}, {bytes}: a half image starts"
                );
                if holds(&chip, &old) {
                    old_kept += 1;
                } else {
                    done += 1;
                }
            } else {
                dead += 1;
                assert!(
                    error.to_string().contains("until the update is repeated"),
                    "{error}"
                );
            }
            let (chip, again) = run(chip.power_cycled(), &new);
            again.unwrap();
            assert!(holds(&chip, &new) && chip.starts() && settings_are_kept(&chip));
        }
    }
    println!(
        "{} requests; {old_kept} cuts: old image, {dead}: none that starts, {done}: new image",
        whole.requests
    );
    assert!(old_kept > 0 && dead > 0 && done > 0);
}

#[test]
fn a_chip_that_fails_to_erase_or_write_or_that_writes_something_else_is_found_out_and_does_not_start() {
    let new = image(0x33);
    let blocks = |number| {
        [
            InjectedFault::WriteFails { number },
            InjectedFault::BitFlips { number },
        ]
    };
    let faults: Vec<InjectedFault> = (0..2)
        .map(|number| InjectedFault::EraseFails { number })
        .chain((0..6).flat_map(blocks))
        .chain([InjectedFault::WriteFails { number: 6 }])
        .collect();
    for fault in faults {
        let mut chip = in_use();
        chip.fault = fault;
        let (mut chip, result) = run(chip, &new);
        let error = result.unwrap_err();
        match fault {
            InjectedFault::BitFlips { .. } => {
                assert!(matches!(error, FlashError::Differs { .. }), "{fault:?}: {error}");
            }
            _ => assert!(
                matches!(&error, FlashError::Dfu { error, .. } if matches!(**error, FlashError::Failed { .. })),
                "{fault:?}: {error}"
            ),
        }
        // The chip's first erasure failed before it did anything; every later failure finds the vectors gone.
        let is_untouched = fault == (InjectedFault::EraseFails { number: 0 });
        assert_eq!(chip.starts(), is_untouched, "{fault:?}");
        assert!(settings_are_kept(&chip));
        chip.fault = InjectedFault::None;
        let (chip, again) = run(chip, &new);
        again.unwrap_or_else(|error| panic!("{fault:?}: {error}"));
        assert!(holds(&chip, &new) && chip.starts());
    }
}

#[test]
fn a_chip_that_is_busy_for_ever_is_given_up() {
    let mut chip = in_use();
    chip.fault = InjectedFault::Hangs { number: 1 };
    let (chip, result) = run(chip, &image(0x33));
    let error = result.unwrap_err().to_string();
    assert!(
        error.contains("erasing the sector at 0x0800c000") && error.contains("within 10 s"),
        "{error}"
    );
    assert!(chip.waited_ms < 20_000, "{}", chip.waited_ms);
}

#[test]
fn an_image_that_does_not_fit_the_chip_is_refused_before_anything_is_erased() {
    let new = image(0x33);
    for layout in [
        "@Internal Flash  /0x08000000/03*016Kg",
        "@Internal Flash  /0x08000000/03*016Kg,01*016Ka,01*064Kg",
        "@Internal Flash  /0x08000000/01*064Kg",
        "@Internal Flash  /0x08008000/04*016Kg",
    ] {
        let mut dfu = Dfu::new(in_use(), TRANSFER_BYTES);
        let result = update(&mut dfu, &sectors(layout).unwrap(), &new, &mut |_| {});
        assert!(
            matches!(result, Err(FlashError::NoRoom { .. })),
            "{layout}: {result:?}"
        );
        let chip = dfu.into_wire();
        assert!(chip.erased.is_empty() && chip.requests == 0 && chip.starts());
    }
}
