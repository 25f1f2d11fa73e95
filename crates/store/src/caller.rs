//! Where a caller is: at the vehicle or elsewhere. All bounds that differ between the two use this.

/// Where a caller is. Callers at the vehicle never wait for callers elsewhere, and have shares of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Caller {
    /// At one of the vehicle's own displays.
    Vehicle,
    /// Anywhere else.
    Elsewhere,
}
