"""What `gcs new` makes a scenario of: sheets of positions, drawn routes."""
