"""The mission protocol: upload item by item or as a file, read-back, comparison."""
