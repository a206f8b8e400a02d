"""One export folder: missions written, read back, verified; the folder replaced as a whole."""
