//! A run's live values and its control over HTTP, on an address of one's choice: `/` the page, `/events` what the page is drawn
//! from (server-sent events), `/status`, `/control` (POST with the token), `/metrics` for Prometheus and `/frames` as newline JSON.
//!
//! The loop never waits: it hands a frame over when somebody reads, and a thread of its own encodes it once for all readers. Who
//! is too slow misses frames. Without readers nothing is copied but the newest report.
//!
//! Limits: [`STREAMS`] streams and [`CONNECTIONS`] connections at a time, a request a connection, no encryption: keep it on the
//! machine, or behind a proxy that encrypts.
#![forbid(unsafe_code)]

mod control;
mod event;
mod host_name;
mod hub;
mod live;
mod metrics;
mod pace;
mod page;
mod readers;
pub mod request;
mod response;
mod routes;
#[cfg(test)]
mod sample;
mod server;
mod site;

pub use event::FrameView;
pub use live::{Live, LiveError};
pub use metrics::{CAPTURE_PARTS, QUANTILES, Values};
pub use routes::STREAMS;
pub use server::CONNECTIONS;
