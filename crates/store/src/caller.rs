//! The caller of the server: the role of its user, and its place. All bounds that differ between places use the place.

telltale_engine::words! {
    /// The role of a user, with its word in files, in the database and on the command line.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
    pub enum Role {
        /// Leads the vehicle and is responsible for it.
        Operator = "operator",
        /// Sees everything and may change the configuration.
        Developer = "developer",
        /// May read everything and change nothing.
        Authority = "authority",
    }
}

impl Role {
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
