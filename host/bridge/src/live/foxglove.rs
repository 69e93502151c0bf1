//! Live values in Foxglove: its WebSocket, with the channels of a recording (docs/foxglove.md). Clients can only read. The feature
//! `foxglove` adds the server; without it the configuration key exists, and using it is an error that explains how to build it.
//!
//! The loop never waits: it queues frames for a separate thread, and drops and counts them when the queue is full. A picture is
//! copied only while a client shows it.

use gripline_protocol::SensorId;
use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{SystemTime, UNIX_EPOCH};

use crate::error::Error;
use gripline_recording::{Channels, Frame, Message, Metadata};

/// Frames and lines that wait for the server.
const WAITING: usize = 16;

enum Item {
    Frame(Box<Frame>),
    Note(f64, String),
}

/// Whether a client shows the channel in this place of the list.
type IsWatched = Box<dyn Fn(usize) -> bool + Send>;

/// A server, as long as the run lives.
pub(crate) struct Foxglove {
    sender: Option<SyncSender<Item>>,
    worker: Option<JoinHandle<()>>,
    is_watched: IsWatched,
    /// Frames dropped because the queue was full.
    dropped: u64,
}

impl Foxglove {
    /// Listens at this address, for a run with these pictures at rest, by fingertip.
    ///
    /// # Errors
    /// [`Error`] when the address cannot be used, or this program was built without Foxglove.
    pub(crate) fn start(
        address: SocketAddr,
        about: &Metadata,
        rest: &[Vec<gripline_recording::Image>],
    ) -> Result<Self, Error> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let channels = Channels::new(rest.len(), about, now.as_nanos() as u64);
        let (put, is_watched) = open(address, &channels, rest)?;
        Ok(Self::with(channels, put, is_watched))
    }

    /// The same with any function that sends a message.
    fn with(
        mut channels: Channels,
        mut put: impl FnMut(&Message) + Send + 'static,
        is_watched: IsWatched,
    ) -> Self {
        let (sender, items): (_, Receiver<Item>) = sync_channel(WAITING);
        let worker = thread::spawn(move || {
            for item in items {
                let messages = match item {
                    Item::Frame(frame) => channels.frame(&frame).unwrap_or_default(),
                    Item::Note(t_s, text) => vec![channels.note(t_s, &text)],
                };
                messages.iter().for_each(&mut put);
            }
        });
        Self {
            sender: Some(sender),
            worker: Some(worker),
            is_watched,
            dropped: 0,
        }
    }

    /// Whether a client shows the pictures of this fingertip.
    pub(crate) fn wants_picture(&self, sensor: SensorId) -> bool {
        (self.is_watched)(Channels::picture(sensor.index()))
    }

    /// Queues a frame for viewers, if there is room.
    pub(crate) fn publish(&mut self, frame: Frame) {
        if let Some(sender) = &self.sender
            && let Err(TrySendError::Full(_)) = sender.try_send(Item::Frame(Box::new(frame)))
        {
            self.dropped += 1;
        }
    }

    /// Queues an event line; it is dropped when there is no room.
    pub(crate) fn note(&self, t_s: f64, text: &str) {
        if let Some(sender) = &self.sender {
            let _ = sender.try_send(Item::Note(t_s, text.to_owned()));
        }
    }
}

impl Drop for Foxglove {
    fn drop(&mut self) {
        self.sender = None;
        if let Some(worker) = self.worker.take() {
            // A worker that panicked has said so.
            let _ = worker.join();
        }
        if self.dropped > 0 {
            tracing::warn!("{} frames found no room on their way to Foxglove", self.dropped);
        }
    }
}

#[cfg(not(feature = "foxglove"))]
fn open(
    _: SocketAddr,
    _: &Channels,
    _: &[Vec<gripline_recording::Image>],
) -> Result<(impl FnMut(&Message) + Send + 'static, IsWatched), Error> {
    Err::<(fn(&Message), IsWatched), _>(Error::usage(
        "foxglove.listen (--foxglove): this gripline was built without Foxglove, expected one that has it: `cargo build \
         --release --features foxglove`",
    ))
}

#[cfg(feature = "foxglove")]
use server::open;

#[cfg(feature = "foxglove")]
mod server {
    use std::sync::Arc;
    use std::time::Duration;

    use foxglove::websocket::{ChannelView, Client, ServerListener};
    use foxglove::{
        ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, WebSocketServer,
        WebSocketServerHandle,
    };
    use tokio::runtime::{Builder, Runtime};

    use super::{Channels, Error, IsWatched, Message, SocketAddr};

    /// Messages that wait for one viewer; the first are up to 32 pictures at rest.
    const BACKLOG: usize = 128;
    /// How long viewers may take to receive the end of the run.
    const GOODBYE: Duration = Duration::from_millis(500);

    /// The server and its resources.
    struct Server {
        /// Taken when it ends.
        parts: Option<(WebSocketServerHandle, Runtime)>,
        channels: Vec<Arc<RawChannel>>,
        _context: Arc<Context>,
    }

    impl Drop for Server {
        fn drop(&mut self) {
            let Some((handle, runtime)) = self.parts.take() else {
                return;
            };
            let goodbye = async { tokio::time::timeout(GOODBYE, handle.stop().wait()).await };
            // Those that did not listen are cut off.
            let _ = runtime.block_on(goodbye);
            runtime.shutdown_background();
        }
    }

    /// Sends the rest pictures to every client that subscribes.
    struct AtRest {
        channels: Vec<Arc<RawChannel>>,
        messages: Vec<Message>,
    }

    impl ServerListener for AtRest {
        fn on_subscribe(&self, client: Client, channel: ChannelView<'_>) {
            for message in &self.messages {
                let its = &self.channels[message.channel];
                if its.id() == channel.id() {
                    put(its, message, client.sink_id());
                }
            }
        }
    }

    fn put(channel: &RawChannel, message: &Message, viewer: Option<foxglove::SinkId>) {
        let metadata = PartialMetadata {
            log_time: Some(message.time_ns),
        };
        channel.log_with_meta_to_sink(&message.bytes, metadata, viewer);
    }

    pub(super) fn open(
        address: SocketAddr,
        channels: &Channels,
        rest: &[Vec<gripline_recording::Image>],
    ) -> Result<(impl FnMut(&Message) + Send + 'static, IsWatched), Error> {
        let failed = |error: &dyn std::fmt::Display| {
            Error::failed(format!(
                "foxglove.listen {address}: {error}, expected an address of this machine that no other program listens on"
            ))
        };
        let context = Context::new();
        let list: Result<Vec<_>, FoxgloveError> = channels
            .list()
            .iter()
            .map(|channel| {
                ChannelBuilder::new(&*channel.topic)
                    .message_encoding(channel.message_encoding)
                    .schema(channel.schema.clone())
                    .metadata(channel.metadata.clone())
                    .context(&context)
                    .build_raw()
            })
            .collect();
        let list = list.map_err(|error| failed(&error))?;
        let at_rest = AtRest {
            channels: list.clone(),
            messages: (0..)
                .zip(rest)
                .flat_map(|(sensor, crops)| channels.rest(sensor, crops))
                .collect(),
        };
        let server = WebSocketServer::new()
            .name(concat!("gripline ", env!("CARGO_PKG_VERSION")))
            .bind(host(address), address.port())
            .message_backlog_size(BACKLOG)
            .capabilities([])
            .listener(Arc::new(at_rest))
            .context(&context);
        // One thread: the library's own runtime takes every core.
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.map_err(|error| failed(&error))?;
        let handle = runtime.block_on(server.start());
        let handle = handle.map_err(|error| failed(&error))?;
        let bound = SocketAddr::new(address.ip(), handle.port());
        tracing::info!("live for Foxglove at ws://{bound}");
        let watched = list.clone();
        let server = Server {
            parts: Some((handle, runtime)),
            channels: list,
            _context: context,
        };
        Ok((
            move |message: &Message| put(&server.channels[message.channel], message, None),
            Box::new(move |channel| watched[channel].has_sinks()),
        ))
    }

    /// The library puts the port behind it.
    fn host(address: SocketAddr) -> String {
        match address {
            SocketAddr::V4(address) => address.ip().to_string(),
            SocketAddr::V6(address) => format!("[{}]", address.ip()),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::mpsc::channel;

    use gripline_protocol::ForceMap;
    use gripline_protocol::message::Status;

    use super::*;
    use crate::view::tests::report;

    fn frame(number: u64) -> Frame {
        Frame {
            report: report(number),
            sequence: number as u32,
            capture_us: 0,
            begun_us: 0,
            until_us: 0,
            requested_mode: None,
            floor_lsb: 0,
            health_bits: 0,
            motion_bits: 0,
            wire: Status::default(),
            map: Box::new(ForceMap::EMPTY),
            pitch_um: 1600,
            picture: None,
        }
    }

    fn channels() -> Channels {
        Channels::new(2, &Metadata::default(), 1_000)
    }

    #[test]
    fn a_slow_viewer_costs_frames_and_never_time() {
        let (entered, inside) = channel();
        let (go, gate) = channel::<()>();
        let put = move |_: &Message| {
            let _ = entered.send(());
            // Stands still until the test lets it go.
            let _ = gate.recv();
        };
        let mut foxglove = Foxglove::with(channels(), put, Box::new(|_| true));
        foxglove.publish(frame(0));
        inside.recv().unwrap();
        for number in 1..=200 {
            foxglove.publish(frame(number));
        }
        foxglove.note(0.0, "there is no room for it");
        assert_eq!(foxglove.dropped, 200 - WAITING as u64);
        drop(go);
    }

    #[test]
    fn pictures_are_wanted_only_of_the_fingertip_that_somebody_looks_at() {
        let foxglove = Foxglove::with(
            channels(),
            |_| {},
            Box::new(|channel| channels().list()[channel].topic == "/second/picture"),
        );
        assert_eq!(
            SensorId::ALL.map(|sensor| foxglove.wants_picture(sensor)),
            [false, true]
        );
    }

    /// Every text in the layout that can name a topic.
    fn topics_in(value: &serde_json::Value, found: &mut Vec<String>) {
        match value {
            serde_json::Value::String(text) => found.extend(text.starts_with('/').then(|| text.clone())),
            serde_json::Value::Array(list) => list.iter().for_each(|value| topics_in(value, found)),
            serde_json::Value::Object(map) => {
                found.extend(map.keys().filter(|key| key.starts_with('/')).cloned());
                map.values().for_each(|value| topics_in(value, found));
            }
            _ => {}
        }
    }

    #[test]
    fn the_shipped_layout_shows_channels_and_fields_that_there_are() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/foxglove-layout.json");
        let layout: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let mut shown = Vec::new();
        topics_in(&layout, &mut shown);
        let mut channels = channels();
        let messages = channels.frame(&frame(0)).unwrap();
        let status: serde_json::Value = serde_json::from_slice(&messages.last().unwrap().bytes).unwrap();
        for text in &shown {
            // A topic, or a path of messages: /status{sensor==0}.stick_ratio
            let (path, filter) = match text.split_once('{') {
                Some((topic, rest)) => {
                    let (filter, field) = rest.split_once('}').unwrap();
                    (format!("{topic}{field}"), filter.split_once("=="))
                }
                None => (text.clone(), None),
            };
            let (topic, field) = path
                .split_once('.')
                .map_or((&*path, None), |(topic, field)| (topic, Some(field)));
            assert!(
                channels.list().iter().any(|channel| channel.topic == topic),
                "{text}"
            );
            for field in field.into_iter().chain(filter.map(|(field, _)| field)) {
                assert!(topic == "/status" && status.get(field).is_some(), "{text}");
            }
        }
        for needed in [
            "/picture",
            "/force_map",
            "/status{sensor==0}.stick_ratio",
            "/status.slip_evidence",
            "/status.line_n",
        ] {
            assert!(
                shown.iter().any(|text| text == needed),
                "{needed} is not in {shown:?}"
            );
        }
        // What the panels are called in their arrangement is what they are called in their settings.
        let panels = layout["configById"].as_object().unwrap();
        let arrangement = layout["layout"].to_string();
        for panel in panels.keys() {
            assert_eq!(arrangement.matches(&format!("\"{panel}\"")).count(), 1, "{panel}");
        }
    }

    #[cfg(not(feature = "foxglove"))]
    #[test]
    fn without_the_feature_it_says_how_to_build_it() {
        let address = ([127, 0, 0, 1], 0).into();
        let error = Foxglove::start(address, &Metadata::default(), &[Vec::new()]);
        let error = error.err().unwrap().to_string();
        assert!(error.contains("--features foxglove"), "{error}");
    }
}
