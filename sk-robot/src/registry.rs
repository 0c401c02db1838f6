//! The modules that are built in. Nothing else in the hub names one.

use crate::hub::HubBuilder;

/// Adds every module this hub was built with, with its default parameters.
pub fn builtin(hub: HubBuilder) -> HubBuilder {
    #[cfg(feature = "host")]
    let hub = hub.module::<sk_host::Host>();
    hub
}
