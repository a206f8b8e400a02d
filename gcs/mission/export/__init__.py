"""One export folder: missions written, read back, verified, and swapped in whole."""
