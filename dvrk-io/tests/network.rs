//! Which network is meant, by the environment variables of ROS 2.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use std::net::{IpAddr, Ipv4Addr};

use dvrk_io::Error;
use dvrk_io::transport::{Interfaces, Network};

fn of(vars: &[(&'static str, &str)]) -> Result<Network, Error> {
    let find = |name| vars.iter().find(|(key, _)| *key == name);
    Network::from_vars(|name| find(name).map(|(_, value)| (*value).to_owned()))
}

#[test]
fn variables_are_honoured() {
    assert_eq!(of(&[]).unwrap(), Network::default());
    let full = of(&[("ROS_DOMAIN_ID", "42"), ("ROS_LOCALHOST_ONLY", "0")]).unwrap();
    assert_eq!((full.domain(), full.interfaces()), (42, &Interfaces::All));
    assert_eq!(full.addresses(), None);
    let here = [
        vec![("ROS_LOCALHOST_ONLY", "1")],
        vec![("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")],
        vec![
            ("ROS_LOCALHOST_ONLY", "1"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"),
        ],
        vec![
            ("ROS_LOCALHOST_ONLY", "0"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
        ],
    ];
    for vars in here {
        let network = of(&vars).unwrap();
        assert_eq!(
            network.addresses(),
            Some(vec![IpAddr::from(Ipv4Addr::LOCALHOST)]),
            "{vars:?}"
        );
    }
    for value in ["SUBNET", "SYSTEM_DEFAULT", "", "  "] {
        let network = of(&[
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", value),
            ("ROS_DOMAIN_ID", ""),
        ])
        .unwrap();
        assert_eq!(network, Network::default());
    }
    assert_eq!(of(&[("ROS_DOMAIN_ID", " 232 ")]).unwrap().domain(), 232);
}

#[test]
fn values_that_mean_nothing_are_refused() {
    for (name, value) in [
        ("ROS_DOMAIN_ID", "233"),
        ("ROS_DOMAIN_ID", "-1"),
        ("ROS_DOMAIN_ID", "70000"),
        ("ROS_DOMAIN_ID", "one"),
        ("ROS_LOCALHOST_ONLY", "yes"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "localhost"),
    ] {
        let refused = of(&[(name, value)]);
        assert!(
            matches!(refused, Err(Error::BadNetwork { value: found, .. }) if found == value),
            "{name}={value}"
        );
    }
    assert!(Network::default().with_domain(233).is_err());
}

#[test]
fn configuration_goes_its_own_way() {
    let address = IpAddr::from([10, 0, 0, 7]);
    let network = Network::default()
        .with_interfaces(Interfaces::Only(vec![address]))
        .with_domain(7)
        .unwrap();
    assert_eq!(
        (network.domain(), network.addresses()),
        (7, Some(vec![address]))
    );
}
