"""Export formats: one module for each, and the table of them (`registry`)."""
