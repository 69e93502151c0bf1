//! How the live side is reached: values of the configuration, known to builds without DDS too. Pure.

use std::fmt;
use std::str::FromStr;

/// How far discovery and data go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Range {
    /// This machine: packets are sent to 127.0.0.1 only.
    #[default]
    Localhost,
    /// Every network that this machine is in, found by multicast.
    Subnet,
}

/// How services are mapped to DDS, in which ROS 2 implementations differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rmw {
    /// As `rmw_fastrtps_cpp`, and the others that follow the standard.
    #[default]
    FastRtps,
    /// As `rmw_cyclonedds_cpp`.
    CycloneDds,
}

impl FromStr for Range {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "localhost" => Ok(Self::Localhost),
            "subnet" => Ok(Self::Subnet),
            _ => Err(format!("found {text}, expected localhost or subnet")),
        }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Localhost => "localhost",
            Self::Subnet => "subnet",
        })
    }
}

impl FromStr for Rmw {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "fastrtps" => Ok(Self::FastRtps),
            "cyclonedds" => Ok(Self::CycloneDds),
            _ => Err(format!("found {text}, expected fastrtps or cyclonedds")),
        }
    }
}

impl fmt::Display for Rmw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::FastRtps => "fastrtps",
            Self::CycloneDds => "cyclonedds",
        })
    }
}
