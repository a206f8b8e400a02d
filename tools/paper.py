"""docs/paper.md, the paper reproduced on one page from the scenarios alone: ./tools/run python tools/paper.py"""

import os

# Before any library is loaded: seconds are the processor's, and must not be those of waiting threads.
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

if __name__ == "__main__":  # processes that measure load nothing that they do not need
    import typer

    from tools.paper.page import main

    typer.run(main)
