"""The constraints of a plan, each as a margin that is bounded over intervals of time."""
