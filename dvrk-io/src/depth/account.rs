//! Counts what became of every point of a message.

use std::fmt;

/// What became of every point of the message. The tests run in this order, and the first that fails counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Account {
    /// Points, or pixels, of the message.
    pub total: usize,
    /// Nothing was measured: zero, NaN or infinite.
    pub missing: usize,
    /// Outside the workspace.
    pub outside: usize,
    /// In or near a capsule of an arm.
    pub arm: usize,
    /// On the table, below it, or no higher above it than the clearance.
    pub table: usize,
    /// Flying: between a near and a far surface.
    pub flying: usize,
    /// With too few other points around.
    pub lone: usize,
    /// In parts that are not the object.
    pub other_parts: usize,
    /// In voxels whose neighbours span no plane.
    pub without_normal: usize,
    /// Merged with others of the same voxel.
    pub merged: usize,
    /// Kept: the points of the object.
    pub kept: usize,
}

impl fmt::Display for Account {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = [
            (self.missing, "nothing measured"),
            (self.outside, "outside the workspace"),
            (self.arm, "arm"),
            (self.table, "table"),
            (self.flying, "between two surfaces"),
            (self.lone, "alone"),
            (self.other_parts, "in other parts"),
            (self.without_normal, "without a normal"),
            (self.merged, "merged with others of their voxel"),
        ];
        write!(formatter, "{} points, {} kept", self.total, self.kept)?;
        let removed = rows.iter().filter(|(count, _)| *count > 0);
        removed
            .into_iter()
            .try_for_each(|(count, why)| write!(formatter, "; {count} {why}"))
    }
}
