//! SkRobot: the hub, assembled from modules.
#![forbid(unsafe_code)]
