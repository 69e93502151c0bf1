//! A run's live values and its control over HTTP, at a chosen address: `/` the page, `/events` the page's data (server-sent
//! events), `/status`, `/control` (POST with the token), `/metrics` for Prometheus and `/frames` as newline JSON.
//!
//! The loop never waits: it queues a frame when there are readers, and a separate thread encodes it once for all of them. Slow
//! readers miss frames. Without readers nothing is copied but the newest report.
//!
//! Limits: [`STREAMS`] streams and [`CONNECTIONS`] connections at a time, one request per connection, no encryption: keep it on the
//! machine, or behind an encrypting proxy.
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
