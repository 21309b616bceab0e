//! The room that the database has: free on its disk, and free within its file.

/// Bytes that the database takes and has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// Size of the database: of SQLite the file, without its write-ahead log.
    pub file: u64,
    /// Of these, in pages whose content was deleted; they are written to before the file grows. PostgreSQL does not tell: 0.
    pub free_pages: u64,
    /// Free on the disk; `None` when that is a server's.
    pub disk_free: Option<u64>,
}

impl Space {
    /// What can be stored before the disk is full, as far as it is known.
    #[must_use]
    pub fn room(&self) -> u64 {
        self.disk_free.map_or(u64::MAX, |free| free.saturating_add(self.free_pages))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_pages_are_room() {
        let space = Space { file: 100, free_pages: 60, disk_free: Some(5) };
        assert_eq!(space.room(), 65);
        assert_eq!(Space { disk_free: None, ..space }.room(), u64::MAX);
    }
}
