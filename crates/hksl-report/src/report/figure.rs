//! A drawing with its numbers.

use super::table::Table;

/// The axis of most drawings.
pub(super) const STEPS: &str = "environment steps";

/// One drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Its name in files.
    pub name: String,
    /// What it is of.
    pub title: String,
    /// What it shows.
    pub caption: String,
    /// The drawing.
    pub svg: String,
    /// The numbers drawn.
    pub table: Table,
}
