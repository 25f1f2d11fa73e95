//! Where a caller is. All bounds that tell near callers from far ones ask this.

/// Callers at the vehicle wait for nobody elsewhere, and take no share of theirs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Caller {
    /// At one of the vehicle's own displays.
    Vehicle,
    /// Anywhere else.
    Elsewhere,
}
