//! Under which names this machine may be asked while it listens on loopback only. A page of another site can make its own name
//! point here (DNS rebinding) and would then read as if it were of this machine; it cannot make an address or `localhost` its own.
//! Pure.

use std::net::{Ipv4Addr, Ipv6Addr};

/// Whether a `Host` header names this machine itself, or an address.
pub(crate) fn is_local(host: &str) -> bool {
    if let Some(bracketed) = host.strip_prefix('[') {
        return bracketed
            .split_once(']')
            .is_some_and(|(address, _)| address.parse::<Ipv6Addr>().is_ok());
    }
    let name = host.split_once(':').map_or(host, |(name, _)| name);
    let name = name.strip_suffix('.').unwrap_or(name).to_ascii_lowercase();
    name == "localhost" || name.ends_with(".localhost") || name.parse::<Ipv4Addr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_and_localhost_are_local_and_names_of_others_are_not() {
        for host in [
            "localhost",
            "LOCALHOST:9617",
            "cell.localhost:1",
            "localhost.",
            "127.0.0.1:9617",
            "[::1]:9617",
            "192.0.2.1",
        ] {
            assert!(is_local(host), "{host}");
        }
        for host in [
            "",
            "example.org",
            "127.0.0.1.example.org",
            "localhost.example.org:9617",
            "notlocalhost",
            "[::1",
            "[x]",
        ] {
            assert!(!is_local(host), "{host}");
        }
    }
}
