"""Surveys on the command line: their options, and their coverage."""
