"""What a person got wrong in a scenario file: what was perhaps meant, and the sentences of errors."""
