//! Names of instruction sets, and those that this processor lacks.

use gripline_kernels::InstructionSet;

#[test]
fn every_name_reads_back_and_an_unknown_one_is_named_in_the_error() {
    for set in InstructionSet::ALL {
        assert_eq!(set.to_string().parse::<InstructionSet>().unwrap(), set);
    }
    let error = "sve".parse::<InstructionSet>().unwrap_err().to_string();
    assert!(error.contains("`sve`") && error.contains("`neon`"), "{error}");
}

#[test]
fn the_widest_set_is_there_and_a_missing_one_is_refused_by_name() {
    assert!(InstructionSet::widest().checked().is_ok());
    assert!(InstructionSet::Portable.is_available());
    for set in InstructionSet::ALL {
        assert_eq!(set.checked().is_ok(), set.is_available());
    }
    // As on a processor that has only these two.
    let error = InstructionSet::Avx512.among(&[InstructionSet::Portable, InstructionSet::Avx2]);
    let text = error.unwrap_err().to_string();
    assert!(
        text.contains("`avx512` was asked for") && text.contains("only `portable`, `avx2`;"),
        "{text}"
    );
}
