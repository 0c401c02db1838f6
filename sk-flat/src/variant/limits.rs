//! What a variant from outside may cost.

use crate::error::VariantError;
use std::cell::Cell;

/// How many lists and maps may stand inside each other, in text and in binary form.
pub const VARIANT_DEPTH_MAX: usize = 64;
/// How many values one variant may hold, itself and every item and entry counted.
pub const VARIANT_NODES_MAX: usize = 262_144;
/// How many bytes the binary form of one variant may have: the largest message.
pub const VARIANT_BYTES_MAX: usize = 16 * 1024 * 1024;
/// How many bytes a JSON text may have.
pub const TEXT_BYTES_MAX: usize = 1024 * 1024;

/// The limits that a reader checks before it allocates.
///
/// A node costs its reader 24 bytes in a list and about 60 in a map, and its sender as little as
/// one byte, so nodes are counted apart from bytes.
///
/// ```
/// use sk_flat::{Limits, SkVariant};
///
/// let narrow = Limits { depth_max: 2, ..Limits::TEXT };
/// assert!(SkVariant::from_json_with("[[1]]", &narrow).is_ok());
/// assert!(SkVariant::from_json_with("[[[1]]]", &narrow).is_err());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// How many lists and maps may stand inside each other; above 64 it counts as 64.
    pub depth_max: usize,
    /// How many values there may be in all.
    pub nodes_max: usize,
    /// How many bytes the whole form may have.
    pub bytes_max: usize,
}

impl Limits {
    /// What the readers of the binary form use by default.
    pub const BINARY: Limits =
        Limits { depth_max: VARIANT_DEPTH_MAX, nodes_max: VARIANT_NODES_MAX, bytes_max: VARIANT_BYTES_MAX };
    /// What the readers of JSON use by default.
    pub const TEXT: Limits = Limits { bytes_max: TEXT_BYTES_MAX, ..Limits::BINARY };

    pub(super) fn check_bytes(&self, bytes: usize) -> Result<(), VariantError> {
        if bytes > self.bytes_max {
            return Err(VariantError::Limit { what: "size in bytes", max: self.bytes_max });
        }
        Ok(())
    }
}

/// What is left of the limits while one variant is read or measured.
pub(super) struct Budget {
    nodes_left: Cell<usize>,
    limits: Limits,
}

impl Budget {
    pub(super) fn new(limits: Limits) -> Budget {
        // The readers recurse, so their depth is bounded by what every stack can hold.
        let depth_max = limits.depth_max.min(VARIANT_DEPTH_MAX);
        Budget { nodes_left: Cell::new(limits.nodes_max), limits: Limits { depth_max, ..limits } }
    }

    /// Takes `count` nodes at once, so that a container is charged before it is allocated.
    pub(super) fn take_nodes(&self, count: usize) -> Result<(), VariantError> {
        match self.nodes_left.get().checked_sub(count) {
            Some(left) => {
                self.nodes_left.set(left);
                Ok(())
            }
            None => Err(VariantError::Limit { what: "the number of values", max: self.limits.nodes_max }),
        }
    }

    /// Answers the depth inside a container that stands at `depth`.
    pub(super) fn enter(&self, depth: usize) -> Result<usize, VariantError> {
        if depth >= self.limits.depth_max {
            return Err(VariantError::Limit { what: "the nesting depth", max: self.limits.depth_max });
        }
        Ok(depth + 1)
    }
}
