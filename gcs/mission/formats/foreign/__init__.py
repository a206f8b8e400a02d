"""Files of other programs: what is read although it is not as it should be, and formats that are only read."""
