//! Serialisation of types for which serde has no derive.

pub(super) mod occupancy {
    use std::sync::Arc;

    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    use crate::body::cube::{Occupancy, PARTS};

    #[allow(clippy::ref_option, reason = "the signature that serde calls")]
    pub fn serialize<S: Serializer>(
        occupancy: &Option<Arc<Occupancy>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        occupancy
            .as_ref()
            .map(|shares| shares.to_vec())
            .serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<Arc<Occupancy>>, D::Error> {
        let shares = Option::<Vec<f64>>::deserialize(deserializer)?;
        let exact = |shares: Vec<f64>| {
            let found = shares.len();
            let shares: Occupancy = shares
                .try_into()
                .map_err(|_| D::Error::invalid_length(found, &PARTS.to_string().as_str()))?;
            Ok(Arc::new(shares))
        };
        shares.map(exact).transpose()
    }
}
