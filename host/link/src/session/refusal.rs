//! Why the microcontroller refused settings, in words.

use gripline_protocol::message::Refusal;

/// Why settings, or the order to store them, were refused.
pub(super) fn reason(refusal: Refusal) -> String {
    match refusal {
        Refusal::OutOfRange(error) => error.to_string(),
        Refusal::Holding => "the gripper holds or is not open yet, expected it released; storing stops the \
                             microcontroller for a moment"
            .to_owned(),
        Refusal::FlashFailed => "the flash did not take them; those stored before are still there".to_owned(),
        other => format!("{other:?}"),
    }
}
