"""Programs run by hand: benchmarks, pictures, and files that are generated. No flight needs them."""
