"""Rules between [[route]] and other tables: places, times and shapes of its points."""
