"""The `gcs` command: it parses, calls and prints."""
