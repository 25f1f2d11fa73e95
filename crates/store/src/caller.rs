//! The caller of the server: the role of its user, and its place. All bounds that differ between places use the place.

/// The role of a user.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// Leads the vehicle and is responsible for it.
    Operator,
    /// Sees everything and may change the configuration.
    Developer,
    /// May read everything and change nothing.
    Authority,
}

impl Role {
    pub const ALL: [Role; 3] = [Role::Operator, Role::Developer, Role::Authority];

    /// The word used in files, in the database and on the command line.
    pub const fn as_str(self) -> &'static str {
        match self {
            Role::Operator => "operator",
            Role::Developer => "developer",
            Role::Authority => "authority",
        }
    }

    /// Reads a role of the database, where an unknown word is a fault.
    pub(super) fn read(row: &rusqlite::Row<'_>, column: usize) -> rusqlite::Result<Role> {
        let word: String = row.get(column)?;
        Role::from_word(&word)
            .ok_or_else(|| rusqlite::Error::InvalidColumnType(column, word, rusqlite::types::Type::Text))
    }

    pub fn from_word(word: &str) -> Option<Role> {
        Role::ALL.into_iter().find(|role| role.as_str() == word)
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
