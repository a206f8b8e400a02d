"""What a flight leaves on disk, and how recordings are read again."""
