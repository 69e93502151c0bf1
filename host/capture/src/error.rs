//! What can be wrong with a camera: each with what was found, what was expected and what to do.

/// Why a camera cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// No such device.
    #[error(
        "camera {camera}: not found; expected a video device such as /dev/video0: plug it in, or choose one of {present}"
    )]
    Missing {
        /// The path.
        camera: String,
        /// Video devices that are there.
        present: String,
    },
    /// Not allowed.
    #[error(
        "camera {camera}: permission denied; expected to be allowed to read and write it: add the user to the group video, \
         or install the udev rule, and log in again"
    )]
    Permission {
        /// The path.
        camera: String,
    },
    /// Another program uses it.
    #[error(
        "camera {camera}: busy; expected a camera that no other program has open: close the other program"
    )]
    Busy {
        /// The path.
        camera: String,
    },
    /// It is something else.
    #[error("camera {camera}: found {found}, expected a camera that streams pictures; choose another device")]
    NoCamera {
        /// The path.
        camera: String,
        /// What it is.
        found: String,
    },
    /// Nothing that it offers can be used.
    #[error(
        "camera {camera}: no usable format: found {found}; expected {wanted} with 640×480 pixels: use another camera or \
         another camera.format"
    )]
    NoFormat {
        /// The path.
        camera: String,
        /// What would have been right.
        wanted: String,
        /// What it offers.
        found: String,
    },
    /// It gives something else than it offers.
    #[error("camera {camera}: found {found}, expected {expected}; unplug it and plug it in again")]
    Negotiation {
        /// The path.
        camera: String,
        /// What the driver set.
        found: String,
        /// What was asked for.
        expected: String,
    },
    /// A control that the configuration sets is not there.
    #[error(
        "camera {camera}: has no control for {control}, expected one because {key} is set: take {key} out of the \
         configuration, or use a camera that has it"
    )]
    NoControl {
        /// The path.
        camera: String,
        /// What is to be controlled.
        control: &'static str,
        /// The key that asks for it.
        key: &'static str,
    },
    /// A control does not take the value.
    #[error("camera {camera}: {key}: found {found}, the camera takes {taken}; choose a value that it has")]
    Control {
        /// The path.
        camera: String,
        /// The key.
        key: &'static str,
        /// What was asked for.
        found: String,
        /// What it did with it.
        taken: String,
    },
    /// It went away.
    #[error("camera {camera}: gone ({found}); expected it to stay connected, check cable and power")]
    Gone {
        /// The path.
        camera: String,
        /// What the system said.
        found: String,
    },
}
