//! The run in ROS 2: topics, diagnostics and services (docs/ros2.md). The feature `ros2` adds DDS, in the crate `gripline-ros2`;
//! without it the configuration keys exist, and using them is an error that explains how to build it.

use std::time::{Instant, SystemTime};

use gripline_control::Handle;
use gripline_protocol::ForceMap;
use gripline_recording::ros2::{Namespace, Range, Rmw, Sample};
use gripline_recording::telemetry::FrameReport;

use crate::error::Error;

/// The environment variables of ROS 2 that replace missing keys.
pub(crate) const ENVIRONMENT: [&str; 2] = ["ROS_DOMAIN_ID", "RMW_IMPLEMENTATION"];

/// Its configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Ros2Settings {
    /// Namespace of topics, services and frames.
    pub namespace: Namespace,
    /// DDS domain; `None`: that of [`ENVIRONMENT`].
    pub domain: Option<u16>,
    /// How far it reaches.
    pub range: Range,
    /// How services are mapped to DDS; `None`: by [`ENVIRONMENT`].
    pub rmw: Option<Rmw>,
    /// Whether there are services.
    pub control: bool,
}

/// Leaves a frame for the node; never waits.
type Leave = Box<dyn Fn(Sample) + Send>;

/// A node, as long as the run lives.
pub(crate) struct Ros2 {
    leave: Leave,
}

impl Ros2 {
    /// Joins the domain, with this number of fingertips.
    ///
    /// # Errors
    /// [`Error`] when the environment is wrong, the domain cannot be joined, or this program was built without ROS 2.
    pub(crate) fn start(settings: &Ros2Settings, fingertips: u8, handle: &Handle) -> Result<Self, Error> {
        let [domain, rmw] = ENVIRONMENT.map(|name| std::env::var(name).ok());
        let domain = match settings.domain {
            Some(domain) => domain,
            None => domain_of(domain.as_deref()).map_err(Error::usage)?,
        };
        let rmw = settings.rmw.unwrap_or_else(|| rmw_of(rmw.as_deref()));
        let leave = open(settings, domain, rmw, fingertips, handle)?;
        Ok(Self { leave })
    }

    /// Publishes a frame whose picture was taken at this time; never waits.
    pub(crate) fn publish(&self, report: &FrameReport, map: &ForceMap, pitch_mm: f64, taken: Instant) {
        let captured = SystemTime::now().checked_sub(taken.elapsed());
        let since_1970 = captured.and_then(|at| at.duration_since(SystemTime::UNIX_EPOCH).ok());
        (self.leave)(Sample {
            captured_ns: since_1970.unwrap_or_default().as_nanos() as u64,
            report: report.clone(),
            map: Box::new(map.clone()),
            pitch_mm,
        });
    }
}

/// The domain that `ROS_DOMAIN_ID` names.
fn domain_of(text: Option<&str>) -> Result<u16, String> {
    text.map_or(Ok(0), |text| {
        check_domain(text).map_err(|error| format!("ROS_DOMAIN_ID: {error}"))
    })
}

/// The mapping of services for `RMW_IMPLEMENTATION`.
fn rmw_of(text: Option<&str>) -> Rmw {
    match text {
        Some("rmw_cyclonedds_cpp") => Rmw::CycloneDds,
        _ => Rmw::FastRtps,
    }
}

/// A domain of DDS: the ports of higher ones do not exist.
pub(crate) fn check_domain(text: &str) -> Result<u16, String> {
    let domain = text.parse().ok().filter(|domain| *domain <= 232);
    domain.ok_or_else(|| format!("found {text}, expected a DDS domain of 0 to 232"))
}

#[cfg(not(feature = "ros2"))]
fn open(_: &Ros2Settings, _: u16, _: Rmw, _: u8, _: &Handle) -> Result<Leave, Error> {
    Err(Error::usage(
        "ros2.name (--ros2-name): this gripline was built without ROS 2, expected one that has it: `cargo build --release \
         --features ros2`",
    ))
}

#[cfg(feature = "ros2")]
fn open(
    settings: &Ros2Settings,
    domain: u16,
    rmw: Rmw,
    fingertips: u8,
    handle: &Handle,
) -> Result<Leave, Error> {
    let node = gripline_ros2::Ros2Node::start(
        &gripline_ros2::Settings {
            namespace: settings.namespace.clone(),
            domain,
            range: settings.range,
            rmw,
            control: settings.control,
            fingertips,
        },
        handle,
    );
    let node = node?;
    tracing::info!(
        "ROS 2: /{} in domain {domain}, range {}{}",
        settings.namespace,
        settings.range,
        if settings.control { ", with control" } else { "" }
    );
    Ok(Box::new(move |sample| node.publish(sample)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_of_ros_stands_for_keys_that_are_not_given() {
        assert_eq!(domain_of(None), Ok(0));
        assert_eq!(domain_of(Some("42")), Ok(42));
        for wrong in ["", "-1", "233", "a"] {
            let error = domain_of(Some(wrong)).unwrap_err();
            assert!(
                error.starts_with("ROS_DOMAIN_ID: found ") && error.contains("0 to 232"),
                "{error}"
            );
        }
        for (text, rmw) in [
            (None, Rmw::FastRtps),
            (Some("rmw_fastrtps_cpp"), Rmw::FastRtps),
            (Some("rmw_cyclonedds_cpp"), Rmw::CycloneDds),
        ] {
            assert_eq!(rmw_of(text), rmw);
        }
    }

    #[cfg(not(feature = "ros2"))]
    #[test]
    fn without_the_feature_it_says_how_to_build_it() {
        let settings = Ros2Settings {
            namespace: "left".parse().unwrap(),
            domain: Some(0),
            range: Range::Localhost,
            rmw: None,
            control: false,
        };
        let (handle, _inbox) = gripline_control::channel();
        let error = Ros2::start(&settings, 1, &handle).err().unwrap().to_string();
        assert!(error.contains("--features ros2"), "{error}");
    }
}
