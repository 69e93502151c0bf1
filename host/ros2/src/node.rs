//! The node: joins a domain, offers topics and services, and hands frames to the publishing thread.

use gripline_protocol::SensorId;
use std::net::Ipv4Addr;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use gripline_control::Handle;
use gripline_recording::ros2::{Namespace, Range, Rmw, Sample};
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher as Topic};
use serde::Serialize;

use crate::error::Ros2Error;
use crate::mailbox::Mailbox;
use crate::publisher::{FingertipTopics, Publisher};
use crate::services::{self, Services};

/// The node's name in its namespace.
const NODE: &str = "gripline";

/// What the configuration says of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Namespace of topics, services and frames.
    pub namespace: Namespace,
    /// DDS domain, 0 to 232.
    pub domain: u16,
    /// How far it reaches.
    pub range: Range,
    /// How services travel.
    pub rmw: Rmw,
    /// Whether there are services: every participant of the domain may then ask the gripper to move.
    pub control: bool,
    /// Fingertips, 1 or 2.
    pub fingertips: u8,
}

/// A node, as long as the run lives.
pub struct Ros2Node {
    mailbox: Arc<Mailbox>,
    worker: Option<JoinHandle<()>>,
    services: Option<Services>,
    /// Known to others until it is dropped.
    _node: Node,
}

impl Ros2Node {
    /// Joins the domain. `handle` is for status and control.
    ///
    /// # Errors
    /// [`Ros2Error`] that names what cannot be had.
    pub fn start(settings: &Settings, handle: &Handle) -> Result<Self, Ros2Error> {
        let domain = settings.domain.to_string();
        let builder = DomainParticipantBuilder::new(settings.domain);
        let builder = match settings.range {
            Range::Localhost => builder.with_only_networks([Ipv4Addr::LOCALHOST]),
            Range::Subnet => builder,
        };
        let participant = builder.build().map_err(Ros2Error::of("domain", &domain))?;
        let context =
            Context::from_domain_participant(participant).map_err(Ros2Error::of("domain", &domain))?;
        let namespace = &settings.namespace;
        let name = NodeName::new(&format!("/{namespace}"), NODE).map_err(Ros2Error::of("node", NODE))?;
        // No parameters: what there is to set is in the configuration, and asked for by services.
        let options = NodeOptions::new()
            .enable_rosout(false)
            .start_parameter_services(false);
        let mut node = context
            .new_node(name, options)
            .map_err(Ros2Error::of("node", NODE))?;
        let fingertips = SensorId::ALL
            .into_iter()
            .take(settings.fingertips.into())
            .map(|fingertip| {
                let name = |topic: &str| namespace.fingertip_topic(fingertip, topic);
                let sensor = sensor_data();
                Ok(FingertipTopics {
                    wrench: topic(
                        &mut node,
                        &name("wrench"),
                        ("geometry_msgs", "WrenchStamped"),
                        &sensor,
                    )?,
                    force_map: topic(&mut node, &name("force_map"), ("sensor_msgs", "Image"), &sensor)?,
                    slip: topic(&mut node, &name("slip"), ("gripline_msgs", "Slip"), &sensor)?,
                })
            });
        let fingertips = fingertips.collect::<Result<Vec<_>, Ros2Error>>()?;
        let array = ("diagnostic_msgs", "DiagnosticArray");
        let diagnostics = topic(&mut node, "/diagnostics", array, &state())?;
        let publisher = Publisher::new(namespace.clone(), fingertips, diagnostics, handle.clone());
        let services = if settings.control {
            Some(services::start(&mut node, namespace, settings.rmw, handle)?)
        } else {
            None
        };
        let mailbox = Arc::new(Mailbox::default());
        let its = Arc::clone(&mailbox);
        let worker = thread::Builder::new()
            .name("ros2".to_owned())
            .spawn(move || publisher.run(&its))
            .map_err(Ros2Error::of("thread", NODE))?;
        Ok(Self {
            mailbox,
            worker: Some(worker),
            services,
            _node: node,
        })
    }

    /// Leaves a frame for the publisher; never waits.
    pub fn publish(&self, sample: Sample) {
        self.mailbox.leave(sample);
    }
}

impl Drop for Ros2Node {
    fn drop(&mut self) {
        self.services = None;
        self.mailbox.close();
        if let Some(worker) = self.worker.take() {
            // A worker that panicked has said so.
            let _ = worker.join();
        }
    }
}

/// Frames: the next one comes in a moment.
const fn sensor_data() -> QosProfile {
    QosProfile::subscription_default().history(History::KeepLast { depth: 5 })
}

/// How things are: whoever comes later gets what was said last. A reader that is too slow keeps nobody waiting.
const fn state() -> QosProfile {
    QosProfile::subscription_default()
        .reliability_reliable(WhenFull::Fail)
        .durability(Durability::TransientLocal)
        .history(History::KeepLast { depth: 1 })
}

fn topic<M: Serialize>(
    node: &mut Node,
    name: &str,
    (package, kind): (&str, &str),
    qos: &QosProfile,
) -> Result<Topic<M>, Ros2Error> {
    let ros_name = Name::parse(name).map_err(Ros2Error::of("topic", name))?;
    let topic = node
        .create_topic(&ros_name, MessageTypeName::new(package, kind), qos)
        .map_err(Ros2Error::of("topic", name))?;
    node.create_publisher(&topic, None)
        .map_err(Ros2Error::of("topic", name))
}
