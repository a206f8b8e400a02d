"""The parts of paper.py: the paper reproduced on one page, a section per module."""
