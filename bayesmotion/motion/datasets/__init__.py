"""Public recordings, fetched from their publishers or read from a folder."""
