//! A figure with its data.

use super::table::Table;

/// Label of most x-axes.
pub(super) const STEPS: &str = "environment steps";

/// One figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Its file name without extension.
    pub name: String,
    /// Its title.
    pub title: String,
    /// Explanation of what it shows.
    pub caption: String,
    /// The SVG.
    pub svg: String,
    /// The data.
    pub table: Table,
}
