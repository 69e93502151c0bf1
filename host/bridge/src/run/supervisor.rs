//! Notifications to systemd: the run is ready, its loop runs, it stops (sd_notify(3): a datagram a message). The watchdog is fed
//! from the loop itself and from nowhere else: when the loop hangs, systemd restarts the program, and the microcontroller holds the
//! line meanwhile. Without `NOTIFY_SOCKET` nothing is sent. Linux only.

use std::cell::Cell;
use std::ffi::OsStr;
use std::io;
use std::time::{Duration, Instant};

/// How often the watchdog is fed within the time that systemd waits for it.
const FEEDS: u32 = 4;

/// The program that started this one and watches it, if there is one.
pub(super) struct Supervisor {
    socket: Option<Socket>,
    /// Between two feeds of the watchdog; `None`: there is none.
    interval: Option<Duration>,
    fed: Cell<Option<Instant>>,
}

impl Supervisor {
    /// Whether this process is a service.
    pub(super) fn is_there() -> bool {
        std::env::var_os("NOTIFY_SOCKET").is_some_and(|address| !address.is_empty())
    }

    /// The one named by this process's environment. If it cannot be reached, this is reported, and the run continues without it.
    pub(super) fn of_environment() -> Self {
        let variable = |name| std::env::var(name).ok();
        let interval = interval(
            variable("WATCHDOG_USEC").as_deref(),
            variable("WATCHDOG_PID").as_deref(),
            std::process::id(),
        );
        let address = std::env::var_os("NOTIFY_SOCKET").filter(|address| !address.is_empty());
        let opened = address.map(|address| (Socket::open(&address), address));
        let socket = opened.and_then(|(opened, address)| {
            let lost = |error: &io::Error| {
                tracing::warn!(
                    "NOTIFY_SOCKET: found {} ({error}), expected a socket of systemd's: it will think that this program hangs",
                    address.to_string_lossy()
                );
            };
            opened.inspect_err(lost).ok()
        });
        Self {
            socket,
            interval,
            fed: Cell::new(None),
        }
    }

    /// The loop is about to start.
    pub(super) fn ready(&self) {
        self.tell("READY=1");
    }

    /// One iteration of the loop is done: feeds the watchdog when it is due.
    pub(super) fn turned(&self) {
        let (Some(interval), now) = (self.interval, Instant::now()) else {
            return;
        };
        if self.fed.get().is_none_or(|fed| now - fed >= interval) {
            self.fed.set(Some(now));
            self.tell("WATCHDOG=1");
        }
    }

    /// The loop has ended.
    pub(super) fn stopping(&self) {
        self.tell("STOPPING=1");
    }

    /// A message that cannot be delivered at once is lost: it must not delay the loop, and the next one comes soon.
    fn tell(&self, message: &str) {
        if let Some(socket) = &self.socket {
            let _ = socket.send(message);
        }
    }
}

/// The time between two feeds, from the variables of sd_watchdog_enabled(3); another process's watchdog is none of ours.
fn interval(watchdog_us: Option<&str>, watchdog_pid: Option<&str>, own_pid: u32) -> Option<Duration> {
    let is_ours = watchdog_pid.is_none_or(|pid| pid.parse() == Ok(own_pid));
    let patience_us: u64 = watchdog_us?.parse().ok().filter(|us| *us > 0)?;
    is_ours.then(|| Duration::from_micros(patience_us) / FEEDS)
}

/// A socket that takes messages, and never waits.
#[cfg(target_os = "linux")]
struct Socket(std::os::unix::net::UnixDatagram);

#[cfg(target_os = "linux")]
impl Socket {
    /// `address`: a path, or a name in the kernel's own space after an @.
    fn open(address: &OsStr) -> io::Result<Self> {
        use std::os::linux::net::SocketAddrExt as _;
        use std::os::unix::ffi::OsStrExt as _;
        use std::os::unix::net::{SocketAddr, UnixDatagram};

        let socket = UnixDatagram::unbound()?;
        let address = match address.as_bytes().strip_prefix(b"@") {
            Some(name) => SocketAddr::from_abstract_name(name)?,
            None => SocketAddr::from_pathname(address)?,
        };
        socket.connect_addr(&address)?;
        socket.set_nonblocking(true)?;
        Ok(Self(socket))
    }

    fn send(&self, message: &str) -> io::Result<usize> {
        self.0.send(message.as_bytes())
    }
}

/// There is no systemd elsewhere.
#[cfg(not(target_os = "linux"))]
enum Socket {}

#[cfg(not(target_os = "linux"))]
impl Socket {
    fn open(_: &OsStr) -> io::Result<Self> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn send(&self, _: &str) -> io::Result<usize> {
        match *self {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_watchdog_is_fed_several_times_within_its_patience_and_only_our_own() {
        let ours = Some(Duration::from_millis(2_500));
        assert_eq!(interval(Some("10000000"), None, 7), ours);
        assert_eq!(interval(Some("10000000"), Some("7"), 7), ours);
        for (us, pid) in [
            (Some("10000000"), Some("8")),
            (Some("0"), None),
            (Some("x"), None),
            (None, Some("7")),
        ] {
            assert_eq!(interval(us, pid, 7), None, "{us:?} {pid:?}");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn systemd_hears_ready_then_the_turns_then_the_end_and_never_delays_the_loop() {
        use std::os::linux::net::SocketAddrExt as _;
        use std::os::unix::net::{SocketAddr, UnixDatagram};

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let name = format!("gripline-test-{}", std::process::id());
        let heard = |listener: &UnixDatagram| {
            let mut bytes = [0; 64];
            let length = listener.recv(&mut bytes).unwrap();
            String::from_utf8_lossy(&bytes[..length]).into_owned()
        };
        for (listener, address) in [
            (UnixDatagram::bind(&path).unwrap(), path.into_os_string()),
            (
                UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap(),
                format!("@{name}").into(),
            ),
        ] {
            let supervisor = Supervisor {
                socket: Some(Socket::open(&address).unwrap()),
                interval: Some(Duration::from_hours(1)),
                fed: Cell::new(None),
            };
            supervisor.ready();
            // Of many turns within the interval one feeds.
            for _ in 0..1_000 {
                supervisor.turned();
            }
            supervisor.stopping();
            let all = [heard(&listener), heard(&listener), heard(&listener)];
            assert_eq!(all, ["READY=1", "WATCHDOG=1", "STOPPING=1"]);
            // Nobody reads: the socket fills up, and no message waits for that.
            for _ in 0..10_000 {
                supervisor.stopping();
            }
        }
        assert!(Socket::open(OsStr::new("/no/such/socket")).is_err());
    }
}
