//! Every way in which a weights file can be wrong is a one-line error that names what was found and what was
//! expected; a good file survives the round trip.

use std::path::Path;

use gripline_network::unet::{UnetNetwork, UnetWeights};
use gripline_network::{NetworkError, Tensor};

use crate::UNET;

fn good() -> UnetWeights {
    UnetWeights::parse(UNET).unwrap()
}

/// The problem with these bytes, after checking that its message is one line.
fn problem(bytes: &[u8]) -> NetworkError {
    let problem = UnetWeights::parse(bytes).unwrap_err();
    let text = problem.to_string();
    assert!(!text.contains('\n') && !text.is_empty(), "{text:?}");
    problem
}

/// The problem with the file in which the first `from` is `to`, of the same length.
fn edited(from: &str, to: &str) -> NetworkError {
    assert_eq!(from.len(), to.len());
    let mut bytes = UNET.to_vec();
    let at = bytes
        .windows(from.len())
        .position(|window| window == from.as_bytes())
        .unwrap();
    bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    problem(&bytes)
}

/// The problem with a file written from changed weights, so that its checksum is right.
fn changed(change: impl FnOnce(&mut UnetWeights)) -> NetworkError {
    let mut weights = good();
    change(&mut weights);
    problem(&weights.to_bytes())
}

#[test]
fn a_written_file_reads_back_the_same() {
    assert_eq!(UnetWeights::parse(&good().to_bytes()).unwrap(), good());
}

#[test]
fn the_embedded_weights_load_and_are_small() {
    let calibration = UnetNetwork::embedded().unwrap().calibration();
    assert!(
        (0.005..0.05).contains(&calibration.contact_min_n),
        "{calibration:?}"
    );
    assert!((0.3..0.5).contains(&calibration.friction), "{calibration:?}");
    assert!(UNET.len() < 1_000_000);
}

#[test]
fn what_is_no_safetensors_file_is_refused() {
    for bytes in [
        &[][..],
        b"hello",
        &[0xff; 100],
        &UNET[..UNET.len() - 1],
        &UNET[..1000],
    ] {
        assert!(matches!(problem(bytes), NetworkError::NotSafetensors { .. }));
    }
}

#[test]
fn another_format_or_architecture_is_named() {
    let found = edited("gripline-weights-1", "gripline-weights-9").to_string();
    assert!(
        found.contains("gripline-weights-9") && found.contains("gripline-weights-1"),
        "{found}"
    );
    let found = edited("\"unet\"", "\"vnet\"").to_string();
    assert!(found.contains("`vnet`") && found.contains("`unet`"), "{found}");
    let found = edited("\"architecture\"", "\"architektur0\"").to_string();
    assert!(found.contains("no entry `architecture`"), "{found}");
}

#[test]
fn a_damaged_file_fails_its_checksum() {
    let mut bytes = UNET.to_vec();
    *bytes.last_mut().unwrap() ^= 1;
    assert!(matches!(problem(&bytes), NetworkError::Checksum { .. }));
    // The calibration is under the checksum too.
    assert!(matches!(
        edited("\"contact_min_n\":\"0.0", "\"contact_min_n\":\"0.1"),
        NetworkError::Checksum { .. }
    ));
}

#[test]
fn no_flipped_bit_changes_the_network_unnoticed() {
    let right = good();
    let mut bytes = UNET.to_vec();
    for step in 0..400 {
        let at = step * step * 7919 % bytes.len();
        bytes[at] ^= 1 << (step % 8);
        if let Ok(weights) = UnetWeights::parse(&bytes) {
            assert_eq!(weights, right, "byte {at}");
        }
        bytes[at] ^= 1 << (step % 8);
    }
}

#[test]
fn a_missing_or_unknown_tensor_is_named() {
    let missing = changed(|weights| drop(weights.tensors.remove("up10.weight")));
    assert!(matches!(missing, NetworkError::MissingTensor { name, .. } if name == "up10.weight"));
    let extra = Tensor {
        shape: vec![2],
        values: vec![0.0; 2],
    };
    let unknown = changed(|weights| drop(weights.tensors.insert("up40.weight".to_owned(), extra)));
    assert!(matches!(unknown, NetworkError::UnknownTensor { name } if name == "up40.weight"));
}

#[test]
fn a_tensor_of_another_shape_or_type_is_named_with_both() {
    let shape = changed(|weights| {
        weights.tensors.insert(
            "output.bias".to_owned(),
            Tensor {
                shape: vec![4],
                values: vec![0.0; 4],
            },
        );
    });
    let text = shape.to_string();
    assert!(
        text.contains("output.bias") && text.contains("[4]") && text.contains("[3]"),
        "{text}"
    );
    let text = edited("\"F32\"", "\"I32\"").to_string();
    assert!(text.contains("I32") && text.contains("F32"), "{text}");
}

#[test]
fn other_widths_are_other_shapes_and_odd_widths_are_refused() {
    let other = changed(|weights| weights.widths.bottom5 = 128);
    assert!(matches!(other, NetworkError::Shape { .. }), "{other}");
    for width in [0, 12, 1024] {
        let odd = changed(|weights| weights.widths.encode44 = width);
        assert!(
            matches!(odd, NetworkError::Metadata { key: "widths", .. }),
            "{odd}"
        );
    }
}

#[test]
fn weights_that_are_not_finite_are_named() {
    for value in [f32::NAN, f32::INFINITY] {
        let text = changed(|weights| weights.tensors.get_mut("decode20a.weight").unwrap().values[17] = value)
            .to_string();
        assert!(
            text.contains("decode20a.weight") && text.contains("index 17"),
            "{text}"
        );
    }
    let text = changed(|weights| weights.tensors.get_mut("up20.norm.variance").unwrap().values[1] = -1.0)
        .to_string();
    assert!(
        text.contains("up20.norm.variance") && text.contains("-1"),
        "{text}"
    );
}

#[test]
fn scales_and_calibration_out_of_range_are_named() {
    let key = |change: fn(&mut UnetWeights)| match changed(change) {
        NetworkError::Metadata { key, .. } => key,
        other => panic!("{other}"),
    };
    assert_eq!(
        key(|weights| weights.scaling.newtons_per_output = 0.0),
        "newtons_per_output"
    );
    assert_eq!(
        key(|weights| weights.scaling.difference_per_level = f32::NAN),
        "difference_per_level"
    );
    assert_eq!(key(|weights| weights.calibration.friction = 3.0), "friction");
    assert_eq!(
        key(|weights| weights.calibration.contact_min_n = -0.01),
        "contact_min_n"
    );
}

#[test]
fn a_file_that_is_not_there_is_named_with_its_path() {
    for path in ["no/such/file.safetensors", env!("CARGO_MANIFEST_DIR")] {
        let text = UnetNetwork::from_file(Path::new(path)).unwrap_err().to_string();
        assert!(text.contains(path) && !text.contains('\n'), "{text}");
    }
}
