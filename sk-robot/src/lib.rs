//! SkRobot: the hub, assembled from modules.
#![forbid(unsafe_code)]

pub mod logging;
pub mod owner;
pub mod places;
