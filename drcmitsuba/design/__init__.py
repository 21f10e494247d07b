"""Design: what a designer can turn, and how the light of a year answers to it."""
