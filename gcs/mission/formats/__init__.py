"""One file per file format, and the registry that names them."""
