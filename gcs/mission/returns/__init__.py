"""Returns that the ground station flies round no-fly zones: their motion, and the check of a whole fleet's."""
