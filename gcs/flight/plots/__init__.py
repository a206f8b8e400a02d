"""What pictures of flights are made of: the file, the layers of a map, labels, curves and panels."""
