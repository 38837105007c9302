//! Selects a ROS 2 network: the domain, and the interfaces.
//!
//! ```text
//! ROS_DOMAIN_ID                    0 … 232, default 0
//! ROS_LOCALHOST_ONLY               1: this machine only, overrides the next variable
//! ROS_AUTOMATIC_DISCOVERY_RANGE    LOCALHOST: this machine only;  SUBNET, SYSTEM_DEFAULT: everything;  OFF: refused
//! ```

use std::net::{IpAddr, Ipv4Addr};

use crate::Error;

/// The highest domain that has ports on every system.
const LAST_DOMAIN: u16 = 232;

/// The network interfaces to use.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Interfaces {
    /// All.
    #[default]
    All,
    /// This machine only.
    Loopback,
    /// Those with these addresses.
    Only(Vec<IpAddr>),
}

/// Selects a ROS 2 network. The default is that of ROS 2 without environment variables: domain 0 on all
/// interfaces.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Network {
    domain: u16,
    interfaces: Interfaces,
}

impl Network {
    /// The network selected by the environment variables of ROS 2.
    ///
    /// # Errors
    /// [`Error::BadNetwork`]: a variable with an invalid value, or discovery that is switched off.
    pub fn from_env() -> Result<Self, Error> {
        Self::from_vars(|name| std::env::var(name).ok())
    }

    /// As [`Network::from_env`], with variables from `var`.
    ///
    /// # Errors
    /// See [`Network::from_env`].
    pub fn from_vars(var: impl Fn(&'static str) -> Option<String>) -> Result<Self, Error> {
        // An empty variable counts as not set.
        let var = |name| {
            var(name)
                .map(|value| value.trim().to_owned())
                .filter(|value| !value.is_empty())
        };
        let bad = |what, value: &str, expected| Error::BadNetwork {
            what,
            value: value.to_owned(),
            expected,
        };
        let domain = match var("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => text
                .parse()
                .map_err(|_| bad("ROS_DOMAIN_ID", &text, "0 to 232"))?,
        };
        let range = var("ROS_AUTOMATIC_DISCOVERY_RANGE");
        let interfaces = match (var("ROS_LOCALHOST_ONLY").as_deref(), range.as_deref()) {
            (Some("1"), _) | (None | Some("0"), Some("LOCALHOST")) => Interfaces::Loopback,
            (None | Some("0"), None | Some("SUBNET" | "SYSTEM_DEFAULT")) => Interfaces::All,
            (None | Some("0"), Some(other)) => {
                let expected = "must be LOCALHOST, SUBNET or SYSTEM_DEFAULT: with OFF nothing can be discovered";
                return Err(bad("ROS_AUTOMATIC_DISCOVERY_RANGE", other, expected));
            }
            (Some(other), _) => return Err(bad("ROS_LOCALHOST_ONLY", other, "0 or 1")),
        };
        Self::default()
            .with_interfaces(interfaces)
            .with_domain(domain)
    }

    /// The same with another domain.
    ///
    /// # Errors
    /// [`Error::BadNetwork`]: more than 232.
    pub fn with_domain(self, domain: u16) -> Result<Self, Error> {
        if domain > LAST_DOMAIN {
            return Err(Error::BadNetwork {
                what: "domain",
                value: domain.to_string(),
                expected: "0 to 232",
            });
        }
        Ok(Self { domain, ..self })
    }

    /// The same with other interfaces.
    #[must_use]
    pub fn with_interfaces(self, interfaces: Interfaces) -> Self {
        Self { interfaces, ..self }
    }

    /// The domain.
    pub fn domain(&self) -> u16 {
        self.domain
    }

    /// The interfaces.
    pub fn interfaces(&self) -> &Interfaces {
        &self.interfaces
    }

    /// Their addresses, unless all are used.
    pub fn addresses(&self) -> Option<Vec<IpAddr>> {
        match &self.interfaces {
            Interfaces::All => None,
            Interfaces::Loopback => Some(vec![Ipv4Addr::LOCALHOST.into()]),
            Interfaces::Only(addresses) => Some(addresses.clone()),
        }
    }
}
