"""The parts of figures.py: changes of shape, films, the gallery and the tutorial."""
