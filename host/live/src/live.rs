//! The loop's end of the server: a run hands over frames and pictures here.

use std::cell::Cell;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use gripline_control::Handle;
use gripline_protocol::SENSORS;
use gripline_recording::telemetry::FrameReport;

use crate::event::{Details, FrameView};
use crate::hub::{Hub, Published};
use crate::metrics::Values;
use crate::pace::Pace;
use crate::readers::Readers;
use crate::server;
use crate::site::Site;

/// Frames per second sent to a page, of all fingertips together.
const FRAMES_PER_SECOND: f64 = 30.0;
/// Pictures a second among them.
const PICTURES_PER_SECOND: f64 = 10.0;

/// It cannot be served.
#[derive(Debug, thiserror::Error)]
#[error(
    "serve.listen {address}: {error}, expected an address of this machine that no other program listens on"
)]
pub struct LiveError {
    address: SocketAddr,
    error: io::Error,
}

/// The server, as long as the run lives.
pub struct Live {
    site: Arc<Site>,
    hub: Hub,
    address: SocketAddr,
    /// Of frames and pictures, by fingertip.
    paces: Cell<[(Pace, Pace); SENSORS]>,
    /// Fingertips seen so far.
    fingertips: Cell<usize>,
}

impl Live {
    /// Serves at `address` what is published and what `handle` answers; `token` is required for requests.
    ///
    /// # Errors
    /// [`LiveError`] when the address is not available.
    pub fn start(address: SocketAddr, handle: Handle, token: String) -> Result<Self, LiveError> {
        let failed = |error| LiveError { address, error };
        let listener = TcpListener::bind(address).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let site = Arc::new(Site {
            values: Mutex::default(),
            lines: Readers::default(),
            events: Readers::default(),
            has_new_page: AtomicBool::new(false),
            streams: AtomicUsize::new(0),
            handle,
            token,
            is_loopback: address.ip().is_loopback(),
        });
        server::start(listener, Arc::clone(&site));
        let pace = (Pace::new(FRAMES_PER_SECOND), Pace::new(PICTURES_PER_SECOND));
        Ok(Self {
            hub: Hub::start(Arc::clone(&site)),
            site,
            address,
            paces: Cell::new([pace; SENSORS]),
            fingertips: Cell::new(1),
        })
    }

    /// Where it listens, with the port that the system chose for port 0.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Hands over a frame. `fill` brings the counters up to date; `view` is called only when a page wants this
    /// frame. Never waits.
    pub fn publish<'a>(
        &self,
        report: &FrameReport,
        fill: impl FnOnce(&mut Values),
        view: impl FnOnce() -> FrameView<'a>,
    ) {
        let sensor = report.sensor.index();
        // Where a reader is looking just now, the next frame comes in a moment.
        if let Ok(mut values) = self.site.values.try_lock() {
            fill(&mut values);
            values.newest[sensor] = Some(report.clone());
        }
        let as_line = self.site.lines.is_wanted();
        let details = self
            .site
            .events
            .is_wanted()
            .then(|| self.due(sensor))
            .flatten()
            .map(|with_picture| Details::of(view(), with_picture));
        if as_line || details.is_some() {
            self.hub.offer(Published {
                report: report.clone(),
                as_line,
                details,
            });
        }
    }

    /// Brings state, line and faults of the newest frames up to date where no new frame comes. Never waits.
    pub fn update(&self, state: &'static str, line_n: f64, faults: &[&'static str]) {
        if let Ok(mut values) = self.site.values.try_lock() {
            for newest in values.newest.iter_mut().flatten() {
                (newest.state, newest.line_n) = (state, line_n);
                newest.faults = faults.to_vec();
            }
        }
    }

    /// Whether to send this fingertip's frame to pages now; if so, whether with its picture.
    fn due(&self, sensor: usize) -> Option<bool> {
        self.fingertips.set(self.fingertips.get().max(sensor + 1));
        let mut paces = self.paces.get();
        if self.site.has_new_page.swap(false, Ordering::Relaxed) {
            for (frames, pictures) in &mut paces {
                frames.reset();
                pictures.reset();
            }
        }
        let (now, shares) = (Instant::now(), self.fingertips.get());
        let (frames, pictures) = &mut paces[sensor];
        let due = frames.lets(now, shares).then(|| pictures.lets(now, shares));
        self.paces.set(paces);
        due
    }
}
