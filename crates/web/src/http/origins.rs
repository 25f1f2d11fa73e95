//! The names by which this server is reached. They never come from the request: otherwise a foreign name
//! that resolves to this machine would pass.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// The origins that pages of this server have, and the `Host` headers that go with them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Origins {
    origins: Vec<String>,
    hosts: Vec<String>,
}

/// The text is not an origin.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no origin; write it as browsers do: https://shuttle-1.example or http://10.0.0.5:8080")]
pub struct NoOrigin(pub String);

impl Origins {
    /// Those of a listener at `address`. One that listens on all addresses is known by the names
    /// of the loopback interface alone; add the others with [`Origins::add`].
    pub fn of_listener(address: SocketAddr, secure: bool) -> Origins {
        let ip = address.ip();
        let mut origins = Origins::default();
        if ip.is_loopback() || ip.is_unspecified() {
            origins.add_host("localhost", address.port(), secure);
            origins.add_ip(IpAddr::V4(Ipv4Addr::LOCALHOST), address.port(), secure);
            origins.add_ip(IpAddr::V6(Ipv6Addr::LOCALHOST), address.port(), secure);
        }
        if !ip.is_unspecified() {
            origins.add_ip(ip, address.port(), secure);
        }
        origins
    }

    /// Adds an origin by which browsers reach this server, perhaps through a proxy.
    ///
    /// # Errors
    /// If the text is not scheme, host and perhaps port.
    pub fn add(&mut self, origin: &str) -> Result<(), NoOrigin> {
        let wrong = || NoOrigin(origin.to_owned());
        let uri: axum::http::Uri = origin.parse().map_err(|_| wrong())?;
        let secure = match uri.scheme_str() {
            Some("https") => true,
            Some("http") => false,
            _ => return Err(wrong()),
        };
        let authority = uri.authority().ok_or_else(wrong)?;
        let is_bare = uri.path() == "/" && uri.query().is_none() && !origin.ends_with('/');
        if !is_bare || authority.as_str().contains('@') {
            return Err(wrong());
        }
        let port = authority.port_u16().unwrap_or(default_port(secure));
        self.add_host(&authority.host().to_ascii_lowercase(), port, secure);
        Ok(())
    }

    /// The host of an origin that browsers reach over TLS.
    pub fn secure_host(origin: &str) -> Option<String> {
        let uri: axum::http::Uri = origin.parse().ok()?;
        (uri.scheme_str() == Some("https")).then(|| uri.host().unwrap_or_default().to_owned())
    }

    /// The host of an origin, a name or an address.
    pub fn host(origin: &str) -> Option<String> {
        let uri: axum::http::Uri = origin.parse().ok()?;
        uri.scheme().and(uri.host()).map(str::to_owned)
    }

    /// Whether an `Origin` header names a page of this server.
    pub fn has(&self, origin: &str) -> bool {
        self.origins.iter().any(|known| known == origin)
    }

    /// Whether a `Host` header names this server.
    pub fn has_host(&self, host: &str) -> bool {
        self.hosts.iter().any(|known| known.eq_ignore_ascii_case(host))
    }

    /// The origin that goes with a `Host` header; that over TLS, if there are two.
    pub fn of_host(&self, host: &str) -> Option<&str> {
        let is_of = |origin: &&String| {
            let (scheme, own) = origin.split_once("://").unwrap_or_default();
            let host = host.strip_suffix(if scheme == "https" { ":443" } else { ":80" }).unwrap_or(host);
            own.eq_ignore_ascii_case(host)
        };
        let origin = self.origins.iter().filter(is_of).max_by_key(|it| it.starts_with("https:"));
        origin.map(String::as_str)
    }

    /// One name of this server.
    pub fn own_host(&self) -> &str {
        self.hosts.first().map_or("", String::as_str)
    }

    fn add_ip(&mut self, ip: IpAddr, port: u16, secure: bool) {
        match ip {
            IpAddr::V4(ip) => self.add_host(&ip.to_string(), port, secure),
            IpAddr::V6(ip) => self.add_host(&format!("[{ip}]"), port, secure),
        }
    }

    fn add_host(&mut self, host: &str, port: u16, secure: bool) {
        let scheme = if secure { "https" } else { "http" };
        self.hosts.push(format!("{host}:{port}"));
        if port == default_port(secure) {
            self.hosts.push(host.to_owned());
            self.origins.push(format!("{scheme}://{host}"));
        } else {
            self.origins.push(format!("{scheme}://{host}:{port}"));
        }
    }
}

fn default_port(secure: bool) -> u16 {
    if secure { 443 } else { 80 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_listener_is_known_by_its_address_and_on_loopback_by_its_names() {
        let cases = [
            ("127.0.0.1:8080", "http://localhost:8080", true),
            ("127.0.0.1:8080", "http://127.0.0.1:8080", true),
            ("127.0.0.1:8080", "http://[::1]:8080", true),
            ("127.0.0.1:8080", "https://127.0.0.1:8080", false),
            ("127.0.0.1:8080", "http://127.0.0.1", false),
            ("127.0.0.1:8080", "http://127.0.0.1:80801", false),
            ("127.0.0.1:8080", "null", false),
            ("127.0.0.1:80", "http://localhost", true),
            ("127.0.0.1:80", "http://localhost:80", false),
            ("10.0.0.5:8080", "http://10.0.0.5:8080", true),
            ("10.0.0.5:8080", "http://localhost:8080", false),
            ("0.0.0.0:8080", "http://localhost:8080", true),
            ("0.0.0.0:8080", "http://0.0.0.0:8080", false),
            ("0.0.0.0:8080", "http://evil.example:8080", false),
        ];
        for (address, origin, expected) in cases {
            let origins = Origins::of_listener(address.parse().unwrap(), false);
            assert_eq!(origins.has(origin), expected, "{address} {origin}");
        }
    }

    #[test]
    fn a_host_leads_to_a_configured_origin() {
        let mut origins = Origins::of_listener("127.0.0.1:8080".parse().unwrap(), false);
        origins.add("https://fleet.example").unwrap();
        origins.add("http://fleet.example").unwrap();
        for (host, origin) in [
            ("localhost:8080", Some("http://localhost:8080")),
            ("Fleet.example", Some("https://fleet.example")),
            ("fleet.example:443", Some("https://fleet.example")),
            ("fleet.example:80", Some("http://fleet.example")),
            ("fleet.example:8080", None),
            ("localhost", None),
            ("", None),
        ] {
            assert_eq!(origins.of_host(host), origin, "{host}");
        }
    }

    #[test]
    fn configured_origins_are_exact() {
        let mut origins = Origins::default();
        origins.add("https://Shuttle-1.example").unwrap();
        assert!(origins.has("https://shuttle-1.example") && origins.has_host("SHUTTLE-1.example"));
        assert!(origins.has_host("shuttle-1.example:443") && !origins.has("https://shuttle-1.example.evil"));
        for wrong in ["", "shuttle", "ftp://a", "http://a/", "http://a/b", "http://u@a", "null", "http://"] {
            assert_eq!(origins.add(wrong), Err(NoOrigin(wrong.to_owned())));
        }
    }
}
