//! The caller of the server: the role of its user, and its place. All bounds that differ between places use the place.

telltale_engine::words! {
    /// The role of a user, with its word in files, in the database and on the command line.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
    pub enum Role {
        /// Leads the vehicle and is responsible for it.
        Operator = "operator",
        /// Sees everything and may change the configuration.
        Developer = "developer",
        /// Watches the vehicles of a fleet at its console.
        ControlRoom = "control_room",
        /// Looks into the faults of a fleet at its console.
        Engineer = "engineer",
        /// May read everything and change nothing.
        Authority = "authority",
    }
}

impl Role {
    /// The roles that a vehicle's server takes, and those that a fleet's console takes.
    pub const OF_VEHICLE: [Role; 3] = [Role::Operator, Role::Developer, Role::Authority];
    pub const OF_CONSOLE: [Role; 3] = [Role::ControlRoom, Role::Engineer, Role::Authority];

    /// Reads a role of the database, where an unknown word is a fault.
    pub(super) fn read(row: &rusqlite::Row<'_>, column: usize) -> rusqlite::Result<Role> {
        let word: String = row.get(column)?;
        Role::from_word(&word)
            .ok_or_else(|| rusqlite::Error::InvalidColumnType(column, word, rusqlite::types::Type::Text))
    }
}

/// Where a caller is. Callers at the vehicle never wait for callers elsewhere, and have shares of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Caller {
    /// At one of the vehicle's own displays.
    Vehicle,
    /// Anywhere else.
    Elsewhere,
}
