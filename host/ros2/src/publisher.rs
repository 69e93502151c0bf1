//! The thread that publishes: each fingertip's newest frame, and the diagnostics when they change and once a second.

use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use gripline_control::Handle;
use gripline_protocol::SENSORS;
use gripline_recording::ros2::{
    DiagnosticArray, DiagnosticStatus, Header, Image, Namespace, Sample, Slip, Time, WrenchStamped,
};
use ros2_client::Publisher as Topic;

use crate::diagnostics::{is_the_same, statuses};
use crate::mailbox::Mailbox;

/// Without a change the diagnostics are said so often.
const DIAGNOSTICS_EVERY: Duration = Duration::from_secs(1);
/// A change is looked for so often.
const POLL_PERIOD: Duration = Duration::from_millis(50);

/// Topics of a fingertip.
pub(crate) struct FingertipTopics {
    pub(crate) wrench: Topic<WrenchStamped>,
    pub(crate) force_map: Topic<Image>,
    pub(crate) slip: Topic<Slip>,
}

/// What the thread works with.
pub(crate) struct Publisher {
    pub(crate) namespace: Namespace,
    pub(crate) fingertips: Vec<FingertipTopics>,
    pub(crate) diagnostics: Topic<DiagnosticArray>,
    pub(crate) handle: Handle,
    /// How the pictures of each fingertip are.
    health: [Option<DiagnosticStatus>; SENSORS],
    /// What was said last, and when.
    said: Option<(Instant, Vec<DiagnosticStatus>)>,
    polled: Option<Instant>,
}

impl Publisher {
    pub(crate) fn new(
        namespace: Namespace,
        fingertips: Vec<FingertipTopics>,
        diagnostics: Topic<DiagnosticArray>,
        handle: Handle,
    ) -> Self {
        Self {
            namespace,
            fingertips,
            diagnostics,
            handle,
            health: [None, None],
            said: None,
            polled: None,
        }
    }

    /// Publishes until there is no more.
    pub(crate) fn run(mut self, mailbox: &Arc<Mailbox>) {
        while let Some(frames) = mailbox.take(POLL_PERIOD) {
            for sample in frames.into_iter().flatten() {
                self.frame(&sample);
            }
            if self.polled.is_none_or(|at| at.elapsed() >= POLL_PERIOD) {
                self.polled = Some(Instant::now());
                self.diagnose();
            }
        }
    }

    /// Sensor data: who misses one gets the next.
    fn frame(&mut self, sample: &Sample) {
        let place = sample.report.sensor.index();
        let Some(topics) = self.fingertips.get(place) else {
            return;
        };
        if let Some(wrench) = sample.wrench(&self.namespace) {
            let _ = topics.wrench.publish(wrench);
        }
        if let Some(map) = sample.force_map(&self.namespace) {
            let _ = topics.force_map.publish(map);
        }
        let _ = topics.slip.publish(sample.slip(&self.namespace));
        if let Some(health) = self.health.get_mut(place) {
            *health = Some(sample.health(&self.namespace));
        }
    }

    fn diagnose(&mut self) {
        let mut status = statuses(&self.namespace, &self.handle.status());
        status.extend(self.health.iter().flatten().cloned());
        let is_news = self
            .said
            .as_ref()
            .is_none_or(|(at, said)| at.elapsed() >= DIAGNOSTICS_EVERY || !is_the_same(said, &status));
        if !is_news {
            return;
        }
        let since_1970 = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        let message = DiagnosticArray {
            header: Header {
                stamp: Time::from_ns(since_1970.as_nanos() as u64),
                frame_id: String::new(),
            },
            status: status.clone(),
        };
        // A slow reader whose window is full: said again at the next look.
        if self.diagnostics.publish(message).is_ok() {
            self.said = Some((Instant::now(), status));
        }
    }
}
